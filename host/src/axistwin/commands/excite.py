"""`axistwin excite`: switches the excitation of a node on or off."""

from __future__ import annotations

import argparse

from axistwin import bus, excitation
from axistwin.terminal import Terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument("switch", choices=("on", "off"), help="on with the settings given, or off")
    excitation.add_settings(parser)
    bus.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Switches. Returns the exit status."""
    terminal = Terminal()
    with bus.node_of(arguments) as node:
        node.connect(arguments.wait, terminal.note)
        if arguments.switch == "on":
            excitation.switch_on(node, arguments)
        else:
            node.command("ExcitationOff")
    print(f"node {arguments.node}: excitation {arguments.switch}")
    return 0
