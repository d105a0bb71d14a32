"""docs/paper.md, filled in from the tables of a run, so that no number in it is typed by hand.

Its template is docs/paper.md.in. There::

    {{study; row; column; format}}     a number of studies.json
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

PAGE = "paper.md"
TEMPLATE = "paper.md.in"
FIGURES = "figures"

_PLACEHOLDER = re.compile(r"\{\{([^{}]*)\}\}")
_PICTURE = re.compile(rf"\({FIGURES}/([\w.-]+\.png)\)")
_NOTE = (
    "<!-- Made by `make paper` from paper.md.in and what the run finds: change that one. -->\n\n"
)

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
    """Writes docs/paper.md and docs/figures/ anew from the results of a run."""
    page = render((docs / TEMPLATE).read_text(encoding="utf-8"), results)
    (docs / PAGE).write_text(page, encoding="utf-8")
    (docs / FIGURES).mkdir(exist_ok=True)
    for picture in pictures(page):
        shutil.copyfile(results / picture, docs / FIGURES / picture)


def pictures(page: str) -> list[str]:
    """Names of the figures that a page shows."""
    return sorted(set(_PICTURE.findall(page)))


def render(template: str, results: Path) -> str:
    """The page for a template, from tables.json and studies.json in ``results``.

    Raises InputError when the template asks for a number that is not there.
    """
    tables, studies = (
        json.loads((results / f"{name}.json").read_text(encoding="utf-8"))
        for name in ("tables", "studies")
    )
    page = _PLACEHOLDER.sub(lambda match: _number(match[1], tables, studies), template)
    if "<<LS>>" in page:
        page = page.replace("<<LS>>", "\n".join(_least_squares(tables)))
    if "<<RLS>>" in page:
        page = page.replace("<<RLS>>", "\n".join(_recursive(tables, studies)))
    return _NOTE + page


def _number(text: str, tables: Tables, studies: Tables) -> str:
    parts = [part.strip() for part in text.split(";")]
    if len(parts) != 4:
        raise InputError(f"{TEMPLATE}: {{{{{text}}}}} needs a table, a row, a column and a format")
    name, row, column, style = parts
    cell = _find({**tables, **studies}, name, row, _column(column))
    if style == "printed":
        return _plain(cell["printed"])
    return formatted(cell["ours"] if name in tables else cell["value"], style)


def _column(text: str) -> str:
    """``a`` and ``b``, alone or before a comma, are the settings' keys."""
    key, comma, rest = text.partition(",")
    titles = {setting.key: setting.title for setting in SETTINGS}
    return titles.get(key, key) + comma + rest


def _find(tables: Tables, name: str, row: str, column: str) -> dict[str, Any]:
    for cell in tables.get(name, []):
        if cell["row"] == row and cell["column"] == column:
            return cell
    raise InputError(f"{TEMPLATE}: there is no {row!r}, {column!r} in {name!r}")


def formatted(value: float, style: str) -> str:
    """A number as the template wants it."""
    if style == "below":
        return f"1e{math.ceil(math.log10(max(abs(value), _LEAST)))}"
    if style.startswith("abs"):
        value, style = abs(value), style.removeprefix("abs").strip()
    if style.endswith("g"):
        style = f"#{style}"  # 1.0 and not 1
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
