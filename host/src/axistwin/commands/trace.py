"""`axistwin trace`: samples at the full control rate, captured by the node and fetched from it."""

from __future__ import annotations

import argparse
import time
from dataclasses import asdict
from pathlib import Path

import can
import numpy as np

from axistwin import bus, excitation, frames
from axistwin.contract import PAYLOAD
from axistwin.errors import BusError, InputError
from axistwin.output import atomic_write, write_json
from axistwin.readers import buslog, csvfile
from axistwin.record import Record, write_csv
from axistwin.terminal import Terminal

_SAMPLES = 10240

# Flags of the report page TraceCaptured.
_CAPTURING, _READY = 1, 2

# A node that has not said by now that it is done is asked.
_ASK_AGAIN = 1.0

# An upload that pauses for this long has lost frames or has ended.
_PAUSE = 0.5

_UPLOADS_MAX = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument(
        "-f",
        "--file",
        default="trace.csv",
        metavar="FILE",
        help="record to write (.csv), or bus log (.log, .blf, .asc, ...) (default: trace.csv)",
    )
    parser.add_argument(
        "-n",
        "--samples",
        type=int,
        metavar="N",
        help=f"length (default: {_SAMPLES}, or what the node can capture)",
    )
    parser.add_argument(
        "--settle",
        type=float,
        default=0.5,
        metavar="S",
        help="wait this long between excitation and trace (default: 0.5)",
    )
    parser.add_argument(
        "--json", metavar="FILE", help="write the summary here (-: standard output)"
    )
    excitation.add_arguments(parser)
    bus.add_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Captures, fetches, checks and saves. Returns the exit status."""
    path = Path(arguments.file)
    if path.suffix.lower() not in (*csvfile.ENDINGS, *buslog.writable_endings()):
        raise InputError(f"cannot write {path}: its ending is neither .csv nor that of a bus log")
    if arguments.samples is not None and arguments.samples < 1:
        raise InputError(f"-n has to be 1 or more samples, not {arguments.samples}")
    if not 0.0 <= arguments.settle < float("inf"):
        raise InputError(f"--settle has to be 0 or more seconds, not {arguments.settle}")
    terminal = Terminal()
    with bus.node_of(arguments) as node:
        trace = _Trace(node, terminal)
        info = node.connect(arguments.wait, terminal.note)
        terminal.note(f"node {node.id}: {info}")
        count = arguments.samples or min(_SAMPLES, info.trace_capacity)
        try:
            with excitation.excited(node, arguments):
                if arguments.excite:
                    trace.wait(arguments.settle)
                trace.capture(count)
            trace.upload()
        except KeyboardInterrupt:
            node.command("TraceAbort")
            raise
        terminal.clear()
    _save(trace, path)
    terminal.note(
        f"{count} samples, {count * info.control_period:.4g} s, checksum {trace.checksum:08x}"
    )
    if arguments.json != "-":
        print(path)
    if arguments.json is not None:
        write_json(
            arguments.json,
            {
                "schema": "axistwin.trace/1",
                "file": str(path),
                "node": {"id": node.id, **asdict(info)},
                "samples": count,
                "checksum": trace.checksum,
                "uploads": trace.uploads,
                "bus_errors": node.errors,
            },
        )
    return 0


class _Trace:
    """A trace on its way from the node. Make it before connecting: it keeps what the node says."""

    def __init__(self, node: bus.Node, terminal: Terminal) -> None:
        self.uploads = 0
        self.checksum = 0
        self.reports: list[can.Message] = []
        self._node = node
        self._count = 0
        self._terminal = terminal
        self._frames: dict[int, can.Message] = {}
        contract = node.contract
        self._report = contract.identifier("Report", node.id)
        self._trace = contract.identifier("Trace", node.id)
        self._channel = contract.reader("Trace", "Channel")
        self._index = contract.reader("Trace", "Index")
        node.sinks.append(self._take)

    @property
    def messages(self) -> list[can.Message]:
        """What makes the trace and explains it, in order of arrival."""
        return sorted([*self.reports, *self._frames.values()], key=lambda m: m.timestamp)

    def record(self) -> Record:
        """The trace in SI units."""
        settings = frames.Settings(node=self._node.id)
        source = f"trace of node {self._node.id}"
        collected = frames.Frames.of(self.messages)
        return frames.decode(collected, self._node.contract, source, settings, "trace")

    def capture(self, count: int) -> None:
        """Has the node capture ``count`` samples; raises BusError when it does not finish."""
        self._count = count
        node = self._node
        assert node.info is not None
        node.command("TraceArm", self._count)
        self._terminal.live(f"capturing {self._count} samples")
        node.page_flags["TraceCaptured"] = _CAPTURING
        # Simulated time may run slower than ours, but a node that hangs must not hang us.
        deadline = time.monotonic() + 10.0 + 20.0 * self._count * node.info.control_period
        while not node.wait_until(lambda: node.page_flags["TraceCaptured"] == _READY, _ASK_AGAIN):
            if time.monotonic() > deadline:
                raise BusError(f"node {node.id} does not finish its trace")
            node.command("Identify")  # in case the word of it was lost

    def upload(self) -> None:
        """Fetches all frames; what gets lost is asked for again.

        Raises BusError when the trace does not arrive whole, or does not match its checksum.
        """
        while (first := self._first_missing()) is not None:
            if self.uploads == _UPLOADS_MAX:
                raise BusError(
                    f"only {len(self._frames)} of {2 * self._count} frames of the trace arrive"
                )
            self.uploads += 1
            self._node.command("TraceUpload", first)
            self._receive()
        if self.uploads > 1:
            self._terminal.note(f"frames were lost: asked for {self.uploads - 1} times again")
        self.checksum = self._crc()
        announced = self._announced_checksum()
        if self.checksum != announced:
            raise BusError(
                f"the trace does not match its checksum ({self.checksum:08x}, node says "
                f"{announced:08x})"
            )

    def wait(self, seconds: float) -> None:
        """Lets time pass while the bus is being listened to."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._node.poll(min(left, 0.1))

    def _receive(self) -> None:
        """Receives until everything has come or nothing more does."""
        have, last = len(self._frames), time.monotonic()
        while len(self._frames) < 2 * self._count and time.monotonic() - last < _PAUSE:
            self._node.poll(0.05)
            if len(self._frames) > have:
                have, last = len(self._frames), time.monotonic()
            if self._terminal.due():
                self._terminal.live(f"fetching {50.0 * have / self._count:.0f} %")

    def _take(self, message: can.Message) -> None:
        """Takes a message: the trace's and the reports' are kept."""
        if message.is_error_frame:
            return
        if message.arbitration_id == self._report:
            self.reports.append(message)
        elif message.arbitration_id == self._trace and len(message.data) == PAYLOAD:
            payload = bytes(message.data)
            self._frames[2 * self._index(payload) + self._channel(payload)] = message

    def _announced_checksum(self) -> int:
        """What the node says the checksum is, along with everything else that it says of itself."""
        node = self._node
        node.pages.pop("TraceChecksum", None)
        node.command("Identify")
        if not node.wait_until(lambda: "TraceChecksum" in node.pages, node.answer_timeout):
            raise BusError(f"node {node.id} does not say the checksum of its trace")
        return int(node.pages["TraceChecksum"])

    def _first_missing(self) -> int | None:
        """Index of the first sample that is not whole; None when all have come."""
        for place in range(2 * self._count):
            if place not in self._frames:
                return place // 2
        return None

    def _crc(self) -> int:
        ordered = b"".join(bytes(self._frames[i].data) for i in range(2 * self._count))
        return frames.trace_checksum(np.frombuffer(ordered, np.uint8))


def _save(trace: _Trace, path: Path) -> None:
    """Writes the trace as a record or as a bus log, wholly or not at all."""
    if path.suffix.lower() in csvfile.ENDINGS:
        write_csv(trace.record(), path)
        return
    with atomic_write(path) as partial, buslog.writing(partial) as writer:
        for message in trace.messages:
            writer(message)
