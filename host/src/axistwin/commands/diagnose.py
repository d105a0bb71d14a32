"""`axistwin diagnose`: what the simulation of a record gets wrong, and why."""

from __future__ import annotations

import argparse
from dataclasses import replace

from axistwin import diagnose, header, model, readers
from axistwin.diagnose import report, summary, windows
from axistwin.diagnose.result import Diagnosis
from axistwin.errors import InputError
from axistwin.output import write_json
from axistwin.terminal import Terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    readers.add_arguments(parser)
    parser.add_argument(
        "--window",
        type=float,
        metavar="S",
        help="simulate this long from each state that is taken from the record (default: "
        f"{windows.WINDOW:g}, with one encoder half of it)",
    )
    model.add_hold_argument(parser)
    parser.add_argument("--json", metavar="FILE", help="write the answer here (-: standard output)")
    parser.add_argument("--report", metavar="FILE", help="write the figures as one HTML page")
    parser.add_argument("--model", metavar="FILE", help="write the extended model (TOML)")
    parser.add_argument(
        "--header", metavar="FILE", help="write the extended model as a C header for a firmware"
    )


def run(arguments: argparse.Namespace) -> int:
    """Reads, diagnoses, prints and saves. Returns the exit status: 1 if anything is wrong."""
    if arguments.window is not None and not arguments.window > 0.0:
        raise InputError(f"--window {arguments.window:g}: has to be a positive time")
    terminal = Terminal()

    def progress(text: str) -> None:
        if terminal.due():
            terminal.live(text)

    record = readers.read(arguments)
    diagnosis = diagnose.diagnose(
        record, hold=arguments.hold, window=arguments.window, progress=progress
    )
    terminal.clear()
    text = summary.text(diagnosis)
    if arguments.json == "-":
        terminal.note(text)
    else:
        print(text)
    _save(diagnosis, arguments, terminal)
    return 0 if diagnosis.healthy else 1


def _save(diagnosis: Diagnosis, arguments: argparse.Namespace, terminal: Terminal) -> None:
    """Writes what was asked for."""
    extended = replace(diagnosis.model, meta=_origin(diagnosis))
    if arguments.model is not None:
        model.write(extended, arguments.model)
        terminal.note(f"{arguments.model}: the extended model")
    if arguments.header is not None:
        header.write(extended, arguments.header, diagnosis.record.source)
        terminal.note(f"{arguments.header}: the extended model as a header")
    if arguments.report is not None:
        terminal.live("drawing the report")
        report.write(diagnosis, arguments.report)
        terminal.note(f"{arguments.report}: the report")
    if arguments.json is not None:
        write_json(arguments.json, diagnosis.to_json(arguments.model))


def _origin(diagnosis: Diagnosis) -> dict[str, str | float]:
    """Where the extended model comes from and what it is worth, for those who find it later."""
    error, record = diagnosis.error, diagnosis.record
    return {
        "made_by": "axistwin diagnose",
        "record": record.source,
        "samples": len(record),
        "rate_hz": 1.0 / record.time_step,
        "error": f"{error.what} [{error.unit}]",
        "error_base": float(error.base),
        "error_extended": float(error.extended),
        "error_noise_floor": float(error.noise_floor),
    }
