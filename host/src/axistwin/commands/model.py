"""`axistwin model`: gives a model file to an emulated axis on the bus, or to a firmware."""

from __future__ import annotations

import argparse

from axistwin import bus, header, model
from axistwin.terminal import Terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    verbs = parser.add_subparsers(dest="action", metavar="ACTION", required=True)

    send = verbs.add_parser(
        "send",
        help="an emulated axis begins anew as this one",
        description="Has an emulated axis on the bus begin anew as that of the model, effects and "
        "all. The drive must not be enabled.",
    )
    send.add_argument("model", metavar="MODEL", help="model file (TOML)")
    bus.add_arguments(send)
    send.set_defaults(carry_out=_send)

    write = verbs.add_parser(
        "header",
        help="constants of a firmware",
        description="Writes the model as a C header for axt_machine_init().",
    )
    write.add_argument("model", metavar="MODEL", help="model file (TOML)")
    write.add_argument(
        "-f",
        "--file",
        required=True,
        metavar="HEADER",
        help="header to write; its name is that of the constants",
    )
    write.set_defaults(carry_out=_header)


def run(arguments: argparse.Namespace) -> int:
    """Reads the model and carries out what was asked for. Returns the exit status."""
    status: int = arguments.carry_out(arguments, model.read(arguments.model))
    return status


def _send(arguments: argparse.Namespace, wanted: model.Model) -> int:
    with bus.node_of(arguments) as node:
        node.connect(arguments.wait, Terminal().note)
        node.restart_axis(wanted)
    print(f"node {arguments.node}: the axis of {arguments.model}, at rest at angle 0")
    return 0


def _header(arguments: argparse.Namespace, wanted: model.Model) -> int:
    header.write(wanted, arguments.file, arguments.model)
    Terminal().note(f"{arguments.file}: the axis of {arguments.model}")
    return 0
