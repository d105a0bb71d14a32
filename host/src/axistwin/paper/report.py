"""What the studies leave behind: tables.json, studies.json, and each figure as PNG and CSV.

``tables.json`` sets the paper's tables beside ours, cell by cell; ``studies.json`` holds the tables
that the paper has no counterpart for.
"""

from __future__ import annotations

import csv
import io
import json
import math
import sys
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from decimal import ROUND_DOWN, ROUND_HALF_UP, Decimal
from pathlib import Path
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from PIL import Image

from axistwin.errors import InputError

Verdict: TypeAlias = Literal["reproduced", "within rounding", "not reproduced"]

_COLOURS = 128


@dataclass(frozen=True)
class Cell:
    """One printed number of the paper beside ours.

    ``printed`` is the paper's text with a decimal point, ``paper`` its value; ``why`` says where
    our number comes from and, when it differs, why it does.
    """

    row: str
    column: str
    printed: str
    paper: float
    ours: float
    verdict: Verdict
    why: str


@dataclass(frozen=True)
class Value:
    """One number of a study of ours; ``unit`` may be empty."""

    row: str
    column: str
    value: float
    unit: str = ""
    why: str = ""


def compare(row: str, column: str, printed: str, ours: float, why: str) -> Cell:
    """A cell with its verdict.

    ``reproduced``: our number, rounded or cut off (the paper does either) to as many digits as are
    printed, gives the same digits. ``within rounding``: it misses by at most one unit of the last
    printed digit. Raises InputError when a number is not finite.
    """
    if not math.isfinite(ours):
        raise InputError(f"{row}, {column}: {ours} is not a number to print")
    given = Decimal(printed)
    unit = Decimal((0, (1,), int(given.as_tuple().exponent)))
    exact = Decimal(ours)
    verdict: Verdict = "not reproduced"
    if given in {exact.quantize(unit, ROUND_HALF_UP), exact.quantize(unit, ROUND_DOWN)}:
        verdict = "reproduced"
    elif abs(exact - given) <= unit:
        verdict = "within rounding"
    return Cell(row, column, printed, float(given), ours, verdict, why)


@dataclass
class Report:
    """The output of a run, in one folder. Figures are written at once, tables by write()."""

    folder: Path
    tables: dict[str, list[Cell]] = field(default_factory=dict)
    studies: dict[str, list[Value]] = field(default_factory=dict)

    def table(self, name: str, cells: Iterable[Cell]) -> None:
        """Adds a table of the paper; ``name`` is its title there."""
        self.tables[name] = list(cells)

    def study(self, name: str, values: Iterable[Value]) -> None:
        """Adds a table of our own. Raises InputError for a number that is not finite."""
        found = list(values)
        for value in found:
            if not math.isfinite(value.value):
                raise InputError(f"{name}, {value.row}, {value.column}: {value.value}")
        self.studies[name] = found

    def figure(self, name: str, figure: Figure, data: Mapping[str, npt.ArrayLike]) -> None:
        """Writes NAME.png and NAME.csv, the plotted numbers.

        ``data`` has a column for each key (name and unit); columns may differ in length, and what
        is not finite is left empty.
        """
        _save(figure, self.folder / f"{name}.png")
        columns = [np.asarray(column).ravel() for column in data.values()]
        with (self.folder / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            writer.writerow(data)
            for i in range(max(len(column) for column in columns)):
                writer.writerow([_cell(column, i) for column in columns])

    def progress(self, text: str) -> None:
        """Tells the person who waits how far it is."""
        print(f"paper: {text}", file=sys.stderr, flush=True)

    def add(self, other: Report) -> None:
        """Takes over the tables of another report."""
        self.tables.update(other.tables)
        self.studies.update(other.studies)

    def write(self) -> None:
        """Writes tables.json and studies.json."""
        _write(self.folder / "tables.json", self.tables)
        _write(self.folder / "studies.json", self.studies)


def _cell(column: npt.NDArray[Any], row: int) -> str:
    return f"{column[row]:.9g}" if row < len(column) and np.isfinite(column[row]) else ""


def _save(figure: Figure, path: Path) -> None:
    """Saves as PNG with a palette: a quarter of the size, and no difference to the eye."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png")
    Image.open(drawn).convert("RGB").quantize(_COLOURS).save(path, optimize=True)


def _write(path: Path, tables: Mapping[str, Sequence[Cell | Value]]) -> None:
    plain = {name: [asdict(row) for row in rows] for name, rows in sorted(tables.items())}
    path.write_text(json.dumps(plain, indent=1, allow_nan=False) + "\n", encoding="utf-8")
