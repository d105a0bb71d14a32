"""Records as CSV: a header that names the columns, one sample a line.

Comma, semicolon (then perhaps with decimal commas), tab or blanks part the columns; lines that
begin with # or % are comments. What write_csv() wrote comes back to the last bit.
"""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from axistwin.errors import InputError
from axistwin.readers.columns import ColumnOptions, make_record, wanted
from axistwin.record import CSV_TAG, Record
from axistwin.sampling import Array

ENDINGS = (".csv", ".tsv", ".txt")

_COMMENTS = ("#", "%")


def read(path: Path, options: ColumnOptions) -> Record:
    """The record in a CSV file. Raises InputError naming file and line."""
    try:
        text = path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    lines = text.splitlines()
    header_at = next((i for i, line in enumerate(lines) if _is_data(line)), None)
    if header_at is None:
        raise InputError(f"{path} has no header that names its columns")
    delimiter = _delimiter(lines[header_at])
    names = [name.strip().strip('"') for name in lines[header_at].split(delimiter)]
    if any(_is_number(name) for name in names):
        raise InputError(
            f"{path}, line {header_at + 1}: a header that names the columns is missing, "
            "such as t,torque,theta1"
        )
    columns = wanted(options, names, str(path))
    places = {channel: names.index(column) for channel, column in columns.items()}
    if delimiter == ";":
        lines[header_at + 1 :] = [line.replace(",", ".") for line in lines[header_at + 1 :]]
    table = _numbers(path, lines, header_at + 1, delimiter, places)
    channels = {name: table[:, i] for i, name in enumerate(places)}
    if lines[0].startswith(CSV_TAG) and options == ColumnOptions():
        return _as_written(path, lines[0].removeprefix(CSV_TAG), channels)
    return make_record(channels, options, str(path))


def _numbers(
    path: Path, lines: list[str], start: int, delimiter: str | None, places: dict[str, int]
) -> Array:
    """The chosen columns (n, c) of the lines from ``start`` on."""
    body = [line for line in lines[start:] if _is_data(line)]
    if len(body) < 2:
        raise InputError(f"{path}: {len(body)} samples are no record")
    try:
        return np.loadtxt(
            io.StringIO("\n".join(body)),
            delimiter=delimiter,
            usecols=list(places.values()),
            comments=None,
            ndmin=2,
        )
    except ValueError:
        raise InputError(_culprit(path, lines, start, delimiter, places)) from None


def _culprit(
    path: Path, lines: list[str], start: int, delimiter: str | None, places: dict[str, int]
) -> str:
    """What is wrong with the first line that cannot be read."""
    for number, line in enumerate(lines[start:], start + 1):
        if not _is_data(line):
            continue
        cells = line.split(delimiter)
        for name, place in places.items():
            if place >= len(cells):
                return (
                    f"{path}, line {number}: {len(cells)} columns, too few for {name} "
                    "(is the file cut off?)"
                )
            if not _is_number(cells[place]):
                return f"{path}, line {number}: {name} is {cells[place].strip()!r}, no number"
    return f"{path}: its lines have different numbers of columns"


def _as_written(path: Path, head: str, channels: dict[str, Array]) -> Record:
    """The record whose comment line write_csv() wrote."""
    try:
        values: dict[str, Any] = json.loads(head)
        motor, table = values["counts_per_turn"]
        return Record(
            time=channels.pop("t"),
            **channels,
            time_step=float(values["time_step"]),
            counts_per_turn=(motor, table),
            missing=np.array(values["missing"], np.int64),
            linear=bool(values["linear"]),
            warnings=tuple(map(str, values["warnings"])),
            meta=dict(values["meta"]),
            source=str(path),
        )
    except (ValueError, KeyError, TypeError) as error:
        raise InputError(f"{path}, line 1: the comment of the record is damaged") from error


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(_COMMENTS)


def _delimiter(header: str) -> str | None:
    """The mark that occurs most; None, which stands for blanks, when none of them does."""
    mark = max("\t;,", key=header.count)
    return mark if mark in header else None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
