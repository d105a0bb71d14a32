"""`axistwin identify`: the parameters of the axis that a record shows."""

from __future__ import annotations

import argparse
import copy

from axistwin import identify, plots, readers
from axistwin.core import Axis
from axistwin.errors import InputError
from axistwin.identify.result import RIGID
from axistwin.identify.samples import HOLDS
from axistwin.output import write_json
from axistwin.terminal import Terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    readers.add_arguments(parser)
    parser.add_argument(
        "--model",
        choices=("auto", "two-inertia", "rigid"),
        default="auto",
        help="two inertias and a shaft, which takes both encoders, or the rigid axis with friction "
        "(default: what the record can answer)",
    )
    parser.add_argument(
        "--hold",
        choices=("auto", *HOLDS),
        default="auto",
        help="two inertias: the torque between samples, by the trapezoidal rule of the emulated "
        "axis (newmark), held from each to the next as a drive does (zoh), or linear (foh) "
        "(default: find out)",
    )
    parser.add_argument(
        "--bandwidth",
        type=float,
        metavar="HZ",
        help="rigid axis: the fastest motion to be explained, that of the closed position loop "
        "(default: a fiftieth of the sample rate)",
    )
    parser.add_argument(
        "--true",
        type=_axis,
        metavar="I1,I2,B,K",
        help="the known parameters of an emulated axis, to show the errors",
    )
    parser.add_argument(
        "--validate",
        metavar="RECORD",
        help="a further record, read in the same way, to predict with what was identified",
    )
    parser.add_argument("--json", metavar="FILE", help="write the result here (-: standard output)")
    parser.add_argument("--plot", metavar="FOLDER", help="write pictures into this folder")


def run(arguments: argparse.Namespace) -> int:
    """Reads, identifies, prints and saves. Returns the exit status."""
    terminal = Terminal()

    def progress(text: str) -> None:
        if terminal.due():
            terminal.live(text)

    record = readers.read(arguments)
    result = identify.identify(
        record,
        arguments.model,
        hold=arguments.hold,
        bandwidth=arguments.bandwidth,
        progress=progress,
    )
    if arguments.validate is not None:
        other = copy.copy(arguments)
        other.record = arguments.validate
        result = identify.validate(result, readers.read(other), bandwidth=arguments.bandwidth)
    terminal.clear()

    truth = None
    if arguments.true is not None:
        truth = identify.axis_truth(arguments.true)
        if result.model == RIGID:
            truth = {"I": arguments.true.I1 + arguments.true.I2}
    text = identify.table(result, truth)
    if arguments.json == "-":
        terminal.note(text)
    else:
        print(text)
    if arguments.plot is not None:
        for path in plots.save_all(result, arguments.plot, truth):
            terminal.note(str(path))
    if arguments.json is not None:
        write_json(arguments.json, result.to_json())
    return 0


def _axis(text: str) -> Axis:
    numbers = [float(number) for number in text.split(",")]
    if len(numbers) != 4:
        raise argparse.ArgumentTypeError(f"{text!r} is not four numbers I1,I2,B,K")
    axis = Axis(*numbers)
    try:
        identify.axis_truth(axis)
    except InputError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return axis
