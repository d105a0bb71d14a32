"""Pages of docs/, filled in from the tables of a run, so that no number is typed by hand.

The template of a page has its name with .in after it. There::

    {{study; row; column; format}}     a number of studies.json
    {{study; row; this|that; format}}  numbers of several columns, as cells of a table
    {{table; row; column; printed}}    a number of the paper, as printed
    {{table; row; column; format}}     our number beside it
    <<LS>>, <<RLS>>                    the paper's Tables 3 and 4, 5 and 6 beside ours

``a`` and ``b`` in a column stand for the two settings. A format is Python's, after ``abs`` without
the sign; ``below`` is the next power of ten above the number's size.
"""

from __future__ import annotations

import json
import math
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

from axistwin.errors import InputError
from axistwin.paper import printed
from axistwin.paper.settings import SETTINGS

Tables: TypeAlias = dict[str, list[dict[str, Any]]]

PAGES = ("estimators.md", "paper.md")
FIGURES = "figures"

_PLACEHOLDER = re.compile(r"\{\{([^{}]*)\}\}")
_PICTURE = re.compile(rf"\({FIGURES}/([\w.-]+\.png)\)")
_NOTE = "<!-- Made by `make paper` from {} and what the run finds: change that one. -->\n\n"

#: What is smaller is said to be below this: the rounding of a double, in per cent.
_LEAST = 1e-13

#: Powers of ten written out.
_SMALL_EXPONENT, _LARGE_EXPONENT = -2, 3

_SYMBOLS = {
    "I1": "I1 [kg m²]",
    "I2": "I2 [kg m²]",
    "B": "B [N m s/rad]",
    "K": "K [N m/rad]",
    "wn1": "ωn [rad/s]",
    "wd1": "ωd [rad/s]",
    "zeta1": "ζ",
}


def update(docs: Path, results: Path) -> None:
    """Writes the pages and docs/figures/ anew from the results of a run."""
    (docs / FIGURES).mkdir(exist_ok=True)
    for name in PAGES:
        page = render(docs / template(name), results)
        (docs / name).write_text(page, encoding="utf-8")
        for picture in pictures(page):
            shutil.copyfile(results / picture, docs / FIGURES / picture)


def template(page: str) -> str:
    """Name of the template of a page."""
    return f"{page}.in"


def pictures(page: str) -> list[str]:
    """Names of the figures that a page shows."""
    return sorted(set(_PICTURE.findall(page)))


def render(template: Path, results: Path) -> str:
    """The page for a template, from tables.json and studies.json in ``results``.

    Raises InputError when the template asks for a number that is not there.
    """
    try:
        page = _fill(template.read_text(encoding="utf-8"), results)
    except InputError as error:
        raise InputError(f"{template.name}: {error}") from None
    return _NOTE.format(template.name) + page


def _fill(template: str, results: Path) -> str:
    tables, studies = (
        json.loads((results / f"{name}.json").read_text(encoding="utf-8"))
        for name in ("tables", "studies")
    )
    page = _PLACEHOLDER.sub(lambda match: _number(match[1], tables, studies), template)
    if "<<LS>>" in page:
        page = page.replace("<<LS>>", "\n".join(_least_squares(tables)))
    if "<<RLS>>" in page:
        page = page.replace("<<RLS>>", "\n".join(_recursive(tables, studies)))
    return page


def _number(text: str, tables: Tables, studies: Tables) -> str:
    parts = [part.strip() for part in text.split(";")]
    if len(parts) != 4:
        raise InputError(f"{{{{{text}}}}} needs a table, a row, a column and a format")
    name, row, columns, style = parts
    cells = [_find({**tables, **studies}, name, row, _column(c)) for c in columns.split("|")]
    if style == "printed":
        return " | ".join(_plain(cell["printed"]) for cell in cells)
    key = "ours" if name in tables else "value"
    return " | ".join(formatted(cell[key], style) for cell in cells)


def _column(text: str) -> str:
    """``a`` and ``b``, alone or before a comma, are the settings' keys."""
    key, comma, rest = text.partition(",")
    titles = {setting.key: setting.title for setting in SETTINGS}
    return titles.get(key, key) + comma + rest


def _find(tables: Tables, name: str, row: str, column: str) -> dict[str, Any]:
    for cell in tables.get(name, []):
        if cell["row"] == row and cell["column"] == column:
            return cell
    raise InputError(f"there is no {row!r}, {column!r} in {name!r}")


def formatted(value: float, style: str) -> str:
    """A number as the template wants it."""
    if style == "below":
        return f"1e{math.ceil(math.log10(max(abs(value), _LEAST)))}"
    if style.startswith("abs"):
        value, style = abs(value), style.removeprefix("abs").strip()
    if style.endswith("g"):
        sign = "+" if style.startswith("+") else ""
        style = f"{sign}#{style.removeprefix(sign)}"  # 1.0 and not 1
    text = format(value, style).replace(".e", "e").removesuffix(".")
    nothing = not re.search("[1-9]", text.lower().partition("e")[0])
    return _plain(text.lstrip("+-") if nothing else text)


def _plain(text: str) -> str:
    """As people write it: 0.85 for 8.5e-1, 1.4e-6 for 1.4e-06, 5 % for 5%, and a true minus."""
    text = text.replace("%", " %").replace("-", "−", 1 if text.startswith("-") else 0)
    mantissa, e, exponent = text.lower().partition("e")
    if not e:
        return text
    if not _SMALL_EXPONENT <= int(exponent) <= _LARGE_EXPONENT:
        return f"{mantissa}e{int(exponent)}"
    digits = max(len(mantissa.partition(".")[2]) - int(exponent), 0)
    return f"{float(text.replace('−', '-')):.{digits}f}".replace("-", "−")


def _least_squares(tables: Tables) -> Iterator[str]:
    head = ["", *(f"{setting.key}: {what}" for setting in SETTINGS for what in _LEAST_SQUARES)]
    yield from _table(head, _least_squares_rows(tables))


_LEAST_SQUARES = ("paper", "ours", "error, paper", "error, ours")
_RECURSIVE = ("paper", "Eqs. 9, 14–16", "bias-free, float64", "bias-free, float32")


def _least_squares_rows(tables: Tables) -> Iterator[list[str]]:
    for name, row in _rows("Table 3", "Table 4"):
        cells = [_SYMBOLS[row]]
        for setting in SETTINGS:
            estimate, error = (
                _find(tables, name, row, f"{setting.title}, {column}") for column in printed.COLUMNS
            )
            cells += [_plain(estimate["printed"]), _as_printed(estimate)]
            cells += [f"{_plain(error['printed'])} %", f"{_as_printed(error)} %"]
        yield cells


def _recursive(tables: Tables, studies: Tables) -> Iterator[str]:
    head = ["error of", *(f"{setting.key}: {what}" for setting in SETTINGS for what in _RECURSIVE)]
    rows = []
    for name, row in _rows("Table 5", "Table 6"):
        cells = [_SYMBOLS[row].partition(" ")[0]]
        for setting in SETTINGS:
            error = _find(tables, name, row, f"{setting.title}, {printed.COLUMNS[1]}")
            cells += [f"{_plain(error['printed'])} %", f"{_as_printed(error)} %"]
            for precision in ("float64", "float32"):
                quantity = f"after one period: {row.rstrip('12') if row[0] in 'wz' else row}"
                study = f"Bias-free form, {precision}"
                value = _find(studies, study, quantity, setting.title)["value"]
                cells.append(f"< {formatted(value, 'below')} %")
        rows.append(cells)
    yield from _table(head, rows)


def _rows(parameters: str, modal: str) -> Iterator[tuple[str, str]]:
    """Table and row of each parameter and of each modal value; the paper prints those twice."""
    for row in _SYMBOLS:
        yield (parameters if row in printed.PARAMETERS else modal), row


def _as_printed(cell: dict[str, Any]) -> str:
    """Our number, cut off after one digit more than the paper prints."""
    digits = len(cell["printed"].lower().partition("e")[0].replace(".", "").lstrip("0"))
    mantissa, e, exponent = f"{cell['ours']:.{digits + 4}e}".partition("e")
    return _plain(mantissa[: digits + 2] + e + exponent)


def _table(head: list[str], rows: Iterable[list[str]]) -> Iterator[str]:
    yield "| " + " | ".join(head) + " |"
    yield "|" + "---|" * len(head)
    for row in rows:
        yield "| " + " | ".join(row) + " |"
