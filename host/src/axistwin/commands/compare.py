"""`axistwin compare`: how far a model is from a record, nothing fitted."""

from __future__ import annotations

import argparse

from axistwin import compare, model, readers
from axistwin.errors import InputError
from axistwin.output import write_json
from axistwin.terminal import Terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument("model", metavar="MODEL", help="model file (TOML)")
    readers.add_arguments(parser)
    parser.add_argument(
        "--window",
        type=float,
        default=0.5,
        metavar="S",
        help="simulate this long from each state that is taken from the record (default: 0.5)",
    )
    parser.add_argument(
        "--bandwidth",
        type=float,
        metavar="HZ",
        help="of the fastest motion whose torque is compared (default: a fiftieth of the rate)",
    )
    model.add_hold_argument(parser)
    parser.add_argument("--json", metavar="FILE", help="write the result here (-: standard output)")


def run(arguments: argparse.Namespace) -> int:
    """Reads, simulates, prints and saves. Returns the exit status."""
    if not arguments.window > 0.0:
        raise InputError(f"--window {arguments.window:g}: has to be a positive time")
    terminal = Terminal()

    def progress(text: str) -> None:
        if terminal.due():
            terminal.live(text)

    axis = model.read(arguments.model)
    record = readers.read(arguments)
    errors = compare.compare(
        axis,
        record,
        window=arguments.window,
        hold=arguments.hold,
        bandwidth=arguments.bandwidth,
        progress=progress,
    )
    terminal.clear()
    lines = [f"{'channel':<8}{'rms error':>14}      {'of its size':>12}   worst at"]
    for error in errors:
        lines.append(
            f"{error.name:<8}{error.rms:>14.4g} {error.unit:<4}{100.0 * error.relative:>12.4g} %"
            f"   {error.worst:.4g} s"
        )
    for error in errors:
        if error.below is not None:
            lines.append(
                f"{error.name}: that needed to move as measured against that applied, "
                f"below {error.below:.4g} Hz"
            )
    text = "\n".join(lines)
    if arguments.json == "-":
        terminal.note(text)
    else:
        print(text)
    if arguments.json is not None:
        result = {
            "schema": compare.SCHEMA,
            "model": arguments.model,
            "record": record.source,
            "window_s": arguments.window,
            "hold": arguments.hold,
            "errors": {error.name: error.to_json() for error in errors},
        }
        write_json(arguments.json, result)
    return 0
