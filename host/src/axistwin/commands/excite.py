"""`axistwin excite`: the excitation of a node on for a while, or off."""

from __future__ import annotations

import argparse
import time

from axistwin import bus, excitation
from axistwin.errors import BusError, InputError
from axistwin.terminal import Terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument(
        "switch",
        choices=("on", "off"),
        help="on: enable the drive and excite the axis until Ctrl-C; off: end that, whoever began",
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="on: end after this time (default: Ctrl-C ends)"
    )
    excitation.add_settings(parser)
    bus.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Switches; a drive stays enabled only while its host is there. Returns the exit status."""
    if arguments.duration is not None and not arguments.duration > 0.0:
        raise InputError(f"--duration has to be a positive time, not {arguments.duration}")
    terminal = Terminal()
    arguments.excite = arguments.switch == "on"
    with bus.node_of(arguments) as node:
        node.connect(arguments.wait, terminal.note)
        if arguments.excite:
            with excitation.excited(node, arguments):
                print(f"node {node.id}: excitation on", flush=True)
                _stay(node, arguments.duration)
        else:
            excitation.switch_off(node)
    print(f"node {arguments.node}: excitation off")
    return 0


def _stay(node: bus.Node, duration: float | None) -> None:
    """Keeps the drive enabled until the time is over or the user ends it.

    Raises DriveFaultError when the drive goes into fault, BusError when somebody else ends it.
    """
    end = time.monotonic() + (duration or float("inf"))
    try:
        while (left := end - time.monotonic()) > 0.0:
            node.poll(min(left, 0.1))
            node.check_drive()
            if not node.excited:
                raise BusError(f"node {node.id}: the excitation was ended by another host")
    except KeyboardInterrupt:
        pass
