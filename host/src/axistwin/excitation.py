"""The excitation of a node, as options of a command and as commands to the node."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager, suppress

from axistwin.bus import Node
from axistwin.errors import AxisTwinError

# Option, command, type, what it is.
_SETTINGS = (
    ("--rms", "ExcitationRms", float, "NM", "rms torque"),
    ("--length", "ExcitationLength", int, "N", "samples a period"),
    ("--lines", "ExcitationLines", int, "N", "number of harmonics"),
    ("--first", "ExcitationFirst", int, "K", "first harmonic"),
    ("--stride", "ExcitationStride", int, "K", "distance between harmonics"),
    ("--seed", "ExcitationSeed", int, "SEED", "0: Schroeder's phases, else random ones"),
)

# Lines are filled in by the node's background task, some milliseconds each on a small controller.
_FILLING_MAX = 30.0


def add_settings(parser: argparse.ArgumentParser) -> None:
    """Adds the options that change the excitation's settings."""
    group = parser.add_argument_group(
        "excitation", "settings that are not given stay as they are on the node"
    )
    for option, command, kind, metavar, text in _SETTINGS:
        group.add_argument(option, dest=command, type=kind, metavar=metavar, help=text)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds --excite and the settings."""
    parser.add_argument(
        "--excite",
        action="store_true",
        help="switch the excitation on meanwhile, off at the end",
    )
    add_settings(parser)


def switch_on(node: Node, arguments: argparse.Namespace) -> None:
    """Enables the drive, sends the settings that were given, and waits until the excitation plays.

    Raises CommandRefusedError when a setting is refused, NoAnswerError when the excitation does not
    begin, DriveFaultError when the drive goes into fault instead.
    """
    node.enable()
    for _, command, *_ in _SETTINGS:
        value = getattr(arguments, command)
        if value is not None:
            node.command(command, value)
    node.command("ExcitationOn")
    # The answer comes before the period has been computed; the status word says when it plays.
    node.await_status(
        lambda: bool(node.excited) or node.fault is not None, "apply the excitation", _FILLING_MAX
    )
    node.check_drive()


def switch_off(node: Node) -> None:
    """Ends the excitation and disables the drive."""
    node.command("ExcitationOff")
    node.disable()


@contextmanager
def excited(node: Node, arguments: argparse.Namespace) -> Iterator[None]:
    """With --excite: the excitation is on inside, and off afterwards. Else nothing is touched.

    Raises DriveFaultError at the end when the drive has gone into fault inside.
    """
    if not arguments.excite:
        yield
        return
    try:
        switch_on(node, arguments)
        yield
        node.check_drive()
    finally:
        with suppress(AxisTwinError):  # a node that has gone: what ended this says so
            switch_off(node)
