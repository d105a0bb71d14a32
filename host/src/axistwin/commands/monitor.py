"""`axistwin monitor`: what the nodes on a bus do, listening only."""

from __future__ import annotations

import argparse
import contextlib
import math
import time
from dataclasses import dataclass, field
from typing import Any

import can

from axistwin import bus
from axistwin.contract import NODES, Contract, load_contract
from axistwin.errors import InputError, NoAnswerError
from axistwin.monitor import BusLoad, StreamMonitor
from axistwin.output import write_json

_DEFAULT_BIT_RATE = 1_000_000

# A node sends ten heartbeats a second; another one with its id adds as many, seen after a while.
_HEARTBEATS = 10.0
_TWO_NODES = 1.5
_SEEN_MIN = 3.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument(
        "--interval",
        type=float,
        default=1.0,
        metavar="S",
        help="one line for each node (default: 1)",
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="stop after this time (default: Ctrl-C stops)"
    )
    parser.add_argument(
        "--json", metavar="FILE", help="write the summary here (-: standard output)"
    )
    bus.add_arguments(parser, several=True)


@dataclass
class _Node:
    """What has been heard of a node."""

    stream: StreamMonitor
    begin: float
    heartbeats: int = 0
    last_heartbeat: float = 0.0
    restarts: int = 0
    state: str = ""
    samples_before: int = 0
    latest: dict[str, bytes] = field(default_factory=dict)  # payload by message

    def twice(self, now: float) -> bool:
        """Are there so many heartbeats that a second node must have this id?"""
        heard = now - self.begin
        return heard > _SEEN_MIN and self.heartbeats > _TWO_NODES * _HEARTBEATS * heard


def _drive(contract: Contract, node: _Node) -> str:
    """The state of the drive by its latest status word; empty where none has come."""
    for kind in ("Samples", "Table"):
        if kind in node.latest:
            word = int(contract.value(kind, "StatusWord", node.latest[kind]))
            return contract.names["DriveState"].get(word & bus.DRIVE_STATE, f"0x{word:04X}")
    return ""


def _sample(contract: Contract, node: _Node) -> str:
    """Torque and motor position of the latest sample; empty where none has come."""
    for kind, torque, position in (
        ("Samples", "Torque0", "MotorPosition0"),
        ("Motor", "Torque", "Position"),
    ):
        if kind in node.latest:
            return (
                f"torque {contract.value(kind, torque, node.latest[kind]):.1f} per mille  "
                f"motor {contract.value(kind, position, node.latest[kind]):.0f} counts"
            )
    return ""


class _Listener:
    """Hears all nodes of a bus, or those that are wanted. Give it every message."""

    def __init__(self, contract: Contract, wanted: list[int] | None) -> None:
        self.nodes: dict[int, _Node] = {}
        self.errors = 0
        self.contract = contract
        self._kinds = {
            contract.identifier(message, node): (message, node)
            for message in ("Heartbeat", "Motor", "Table", "Samples")
            for node in wanted or NODES
        }

    def __call__(self, message: can.Message) -> None:
        """Takes a message."""
        if message.is_error_frame:
            self.errors += 1
            return
        kind, number = self._kinds.get(message.arbitration_id, ("", 0))
        if not kind or message.is_extended_id or len(message.data) != self.contract.length(kind):
            return
        if kind == "Heartbeat":
            self._heartbeat(number, bytes(message.data))
        elif number in self.nodes:  # else a device of another kind may use these identifiers
            self.nodes[number].stream(message)
            self.nodes[number].latest[kind] = bytes(message.data)

    def _heartbeat(self, number: int, payload: bytes) -> None:
        now = time.monotonic()
        if number not in self.nodes:
            self.nodes[number] = _Node(StreamMonitor(self.contract, number), now)
        node = self.nodes[number]
        state = int(self.contract.value("Heartbeat", "State", payload))
        node.state = self.contract.name_of("Heartbeat", "State", state)
        node.heartbeats += 1
        node.last_heartbeat = now
        if node.state == "BootUp":
            node.restarts += 1
            node.stream.start_afresh()


def run(arguments: argparse.Namespace) -> int:
    """Listens until the time is over or the user stops it. Returns the exit status."""
    for option in ("interval", "duration"):
        value = getattr(arguments, option)
        if value is not None and not 0.0 < value < math.inf:
            raise InputError(f"--{option} has to be a positive time, not {value}")
    listener = _Listener(load_contract(arguments.dbc), arguments.node)
    bit_rate = getattr(arguments, "bitrate", None) or _DEFAULT_BIT_RATE
    load = BusLoad(bit_rate, getattr(arguments, "data_bitrate", None))
    begin = shown = time.monotonic()
    with bus.listening(arguments) as receive, contextlib.suppress(KeyboardInterrupt):
        while (now := time.monotonic()) - begin < (arguments.duration or math.inf):
            message = receive(0.1)
            if message is not None:
                listener(message)
                load(message)
            if now - shown >= arguments.interval:
                _show(listener, load, now - begin, now - shown, arguments.heartbeat_timeout)
                shown = now
    if arguments.json is not None:
        write_json(arguments.json, _summary(listener, load, time.monotonic() - begin))
    if not listener.nodes:
        raise NoAnswerError("heard no heartbeat of a node")
    return 0


def _show(
    listener: _Listener, load: BusLoad, elapsed: float, since: float, patience: float
) -> None:
    """A line for each node, and one for the bus."""
    now = time.monotonic()
    for number, node in sorted(listener.nodes.items()):
        rate = (node.stream.samples - node.samples_before) / since
        node.samples_before = node.stream.samples
        silent = now - node.last_heartbeat
        parts = [
            f"{elapsed:7.1f} s  node {number}",
            node.state if silent <= patience else f"silent for {silent:.1f} s",
            _drive(listener.contract, node),
            f"{rate:.1f} samples/s  {node.stream.lost} lost",
            _sample(listener.contract, node),
            f"restarted {node.restarts} times" if node.restarts > 0 else "",
            "heartbeats of two nodes with this id" if node.twice(now) else "",
        ]
        print("  ".join(part for part in parts if part))
    print(
        f"{elapsed:7.1f} s  bus load {100.0 * load.recent():.1f} %  {listener.errors} error frames",
        flush=True,
    )


def _summary(listener: _Listener, load: BusLoad, duration: float) -> dict[str, Any]:
    now = time.monotonic()
    return {
        "schema": "axistwin.monitor/1",
        "duration_s": duration,
        "bus_load": load.mean(),
        "bus_errors": listener.errors,
        "nodes": [
            {
                "id": number,
                "state": node.state,
                "drive": _drive(listener.contract, node) or None,
                "silent_s": now - node.last_heartbeat,
                "samples": node.stream.samples,
                "lost": node.stream.lost,
                "restarts": node.restarts,
                "two_nodes": node.twice(now),
            }
            for number, node in sorted(listener.nodes.items())
        ],
    }
