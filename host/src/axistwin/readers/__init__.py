"""Reading records from files: CSV, MAT and bus logs. The ending of a file's name says which."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from axistwin import history
from axistwin.contract import load_contract
from axistwin.errors import InputError
from axistwin.frames import Settings
from axistwin.readers import buslog, csvfile, matfile
from axistwin.readers.columns import ColumnOptions
from axistwin.record import Record

__all__ = ["add_arguments", "read", "read_record"]


def add_arguments(parser: argparse.ArgumentParser, option: str | None = None) -> None:
    """Adds RECORD and everything that says how to read it to the parser of a command.

    RECORD follows ``option`` where the command has one for it.
    """
    named: dict[str, Any] = {"dest": "record", "required": True} if option else {}
    parser.add_argument(
        option or "record",
        **named,
        metavar="RECORD",
        help="CSV (t,torque,theta1[,theta2][,omega1][,omega2] in SI units), MAT, or a bus log "
        "(candump .log, .asc, .blf, .mf4, .trc, ...); what `modbus log` left (.jsonl)",
    )
    group = parser.add_argument_group("how to read the record")
    group.add_argument(
        "--map",
        nargs="+",
        action="extend",
        default=[],
        metavar="CHANNEL=COLUMN",
        help="the column that holds a channel, for example theta1=q1",
    )
    group.add_argument(
        "--scale",
        nargs="+",
        action="extend",
        default=[],
        metavar="CHANNEL=FACTOR",
        help="multiply a channel by a number, or by a variable of a MAT file",
    )
    group.add_argument("--linear", action="store_true", help="a linear axis: m, N and kg")
    group.add_argument(
        "--counts",
        type=_counts,
        default=(None, None),
        metavar="MOTOR[,TABLE]",
        help="encoder counts a turn (a metre with --linear) where the record does not say",
    )
    group.add_argument(
        "--time-step", type=float, metavar="S", help="time between samples, likewise"
    )
    group.add_argument(
        "--rated-torque", type=float, metavar="NM", help="rated torque of a bus log, likewise"
    )
    group.add_argument("--node", type=int, metavar="ID", help="node whose frames a bus log holds")
    group.add_argument("--dbc", metavar="FILE", help="wire contract to decode a bus log with")
    group.add_argument(
        "--part",
        choices=("trace", "stream"),
        help="which of the two that a bus log may hold (default: the trace if there is one)",
    )


def read(arguments: argparse.Namespace) -> Record:
    """The record that the arguments of add_arguments() name. Raises InputError."""
    columns = ColumnOptions(
        columns=_pairs(arguments.map, "--map"),
        scales=_pairs(arguments.scale, "--scale"),
        time_step=_positive(arguments.time_step, "--time-step"),
        counts_per_turn=arguments.counts,
        linear=arguments.linear,
    )
    settings = Settings(
        node=arguments.node,
        time_step=columns.time_step,
        rated_torque=_positive(arguments.rated_torque, "--rated-torque"),
        counts_per_turn=arguments.counts,
        linear=arguments.linear,
    )
    return read_record(arguments.record, columns, settings, arguments.dbc, arguments.part)


def read_record(
    path: str | Path,
    columns: ColumnOptions | None = None,
    settings: Settings | None = None,
    dbc: str | None = None,
    part: str | None = None,
) -> Record:
    """The record in a file. ``columns`` is for CSV and MAT, the rest for bus logs.

    Raises InputError, with one clear line, whatever the file may hold.
    """
    file = Path(path)
    if not file.exists():
        raise InputError(f"cannot read {file}: there is no such file")
    if file.is_dir():
        raise InputError(f"cannot read {file}: it is a folder")
    if file.stat().st_size == 0:
        raise InputError(f"{file} is empty")
    ending = file.suffix.lower()
    if ending == ".mat":
        return matfile.read(file, columns or ColumnOptions())
    if ending in csvfile.ENDINGS and not buslog.is_csv_log(file):
        return csvfile.read(file, columns or ColumnOptions())
    if ending in buslog.endings():
        return buslog.read(file, load_contract(dbc), settings or Settings(), part)
    if ending == history.ENDING:
        return history.read(file)
    known = " ".join(sorted({*csvfile.ENDINGS, ".mat", history.ENDING, *buslog.endings()}))
    raise InputError(f"cannot read {file}: its ending is none of {known}")


def _pairs(texts: list[str], option: str) -> dict[str, str]:
    pairs = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not (name and equals and value):
            raise InputError(f"{option} wants CHANNEL=VALUE, not {text!r}")
        pairs[name] = value
    return pairs


def _counts(text: str) -> tuple[int | None, int | None]:
    numbers = [int(number) for number in text.split(",")]
    if not 1 <= len(numbers) <= 2 or min(numbers) < 1:
        raise ValueError
    return numbers[0], numbers[-1]


def _positive(number: float | None, option: str) -> float | None:
    if number is not None and not 0.0 < number < float("inf"):
        raise InputError(f"{option} has to be a positive number, not {number}")
    return number
