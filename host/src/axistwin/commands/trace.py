"""`axistwin trace`: samples at the full control rate, captured by the node and fetched from it."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import can
import numpy as np

from axistwin import bus, excitation, frames
from axistwin.contract import PAYLOAD, Contract
from axistwin.errors import AxisTwinError, BusError, InputError, NodeLostError
from axistwin.logfile import LogFile
from axistwin.output import atomic_write, write_json
from axistwin.readers import buslog, csvfile
from axistwin.record import Record, write_csv
from axistwin.terminal import Terminal

_SAMPLES = 10240

# Flags of the report page TraceCaptured.
_IDLE, _CAPTURING, _READY, _UPLOADING, _ARMED = range(5)

_EDGES = ("rising", "falling", "above", "below")
_SOURCES = {"torque": "Torque", "theta1": "MotorPosition", "theta2": "TablePosition"}

# What says which trace this is: equal on the node and in what was fetched before.
_MARKS = ("TraceCaptured", "TraceChecksum", "TraceStart", "TraceDecimation", "TraceTriggered")

# A node that has not said by now that it is done is asked.
_ASK_AGAIN = 1.0

# An upload that pauses for this long has lost frames or has ended.
_PAUSE = 0.5

_UPLOADS_MAX = 10


@dataclass(frozen=True)
class Trigger:
    """What a trace waits for: a fault, or a channel (N m, rad) that crosses or is past a level."""

    kind: str
    channel: str = "torque"
    level: float = 0.0

    def __str__(self) -> str:
        return self.kind if self.kind == "fault" else f"{self.channel} {self.kind} {self.level:g}"

    def send(self, node: bus.Node) -> None:
        """Tells the node. Raises InputError for an encoder that it has not, or a level too far."""
        assert node.info is not None
        raw = 0.0
        if self.channel == "torque":
            raw = 1e4 * self.level / node.info.rated_torque
        else:
            counts = node.info.counts_per_turn[_SOURCES[self.channel] == "TablePosition"]
            if counts is None:
                raise InputError(f"--trigger: node {node.id} has no encoder for {self.channel}")
            raw = counts * self.level / (2.0 * math.pi)
        if self.kind != "fault":
            source = node.contract.value_of("Command", "TraceSource", _SOURCES[self.channel])
            node.command("TraceSource", source)
            node.command("TraceLevel", round(raw))
        kind = node.contract.value_of("Command", "TraceTrigger", self.kind.capitalize())
        node.command("TraceTrigger", kind)


def _trigger(text: str) -> Trigger:
    parts = text.split(":")
    if parts == ["fault"]:
        return Trigger("fault")
    if len(parts) != 3 or parts[0] not in _EDGES or parts[1] not in _SOURCES:
        raise argparse.ArgumentTypeError(
            f"{text!r} is neither 'fault' nor like rising:torque:0.1 "
            f"({'|'.join(_EDGES)} : {'|'.join(_SOURCES)} : level in N m or rad)"
        )
    try:
        level = float(parts[2])
    except ValueError:
        level = math.nan
    if not math.isfinite(level):
        raise argparse.ArgumentTypeError(f"{parts[2]!r} in {text!r} is no level")
    return Trigger(parts[0], parts[1], level)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument(
        "-f",
        "--file",
        default="trace.csv",
        metavar="FILE",
        help="record to write (.csv), or bus log (.log, .blf, .asc, ...) (default: trace.csv)",
    )
    group = parser.add_argument_group("trace")
    group.add_argument(
        "-n",
        "--samples",
        type=int,
        metavar="N",
        help=f"length (default: {_SAMPLES}, or what the node can capture)",
    )
    group.add_argument(
        "--every",
        type=int,
        default=1,
        metavar="N",
        help="keep one sample in N control periods, without filtering (default: 1)",
    )
    group.add_argument(
        "--trigger",
        type=_trigger,
        metavar="WHEN",
        help="begin when this happens: fault, or EDGE:CHANNEL:LEVEL with rising, falling (crosses "
        "the level), above or below (is beyond it), torque [N m], theta1 or theta2 [rad], for "
        "example rising:torque:0.1 (default: begin at once)",
    )
    group.add_argument(
        "--pretrigger",
        type=int,
        default=0,
        metavar="N",
        help="so many of the samples are from before the trigger (default: 0)",
    )
    group.add_argument(
        "--timeout",
        type=float,
        metavar="S",
        help="give up when the trigger has not come by then (default: wait until Ctrl-C)",
    )
    group.add_argument(
        "--settle",
        type=float,
        default=0.5,
        metavar="S",
        help="wait this long between excitation and trace (default: 0.5)",
    )
    later = group.add_mutually_exclusive_group()
    later.add_argument(
        "--arm",
        action="store_true",
        help="do not wait for the trigger: leave the node armed, and --fetch what it has caught "
        "later",
    )
    later.add_argument(
        "--fetch",
        action="store_true",
        help="capture nothing: fetch the trace that the node holds. One of which an upload to the "
        "same file was broken off goes on from there",
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
    _check(arguments)
    terminal = Terminal()
    partial = path.with_name(path.name + ".part.log")
    with bus.node_of(arguments) as node:
        trace = _Trace(node, terminal)
        info = node.connect(arguments.wait, terminal.note)
        terminal.note(f"node {node.id}: {info}")
        if arguments.fetch:
            trace.find(partial)
        else:
            trace.count = arguments.samples or min(_SAMPLES, info.trace_capacity)
            _capture(trace, arguments)
        if arguments.arm:
            terminal.note(f"armed for {arguments.trigger}; fetch what it catches with --fetch")
            return 0
        with LogFile(partial, terminal) as log:
            trace.upload(log, arguments.wait)
        terminal.clear()
    _save(trace, path)
    partial.unlink()
    record = trace.got.record()
    terminal.note(
        f"{len(record)} samples, {record.duration:.4g} s, {record.time_step:g} s apart, "
        f"checksum {trace.checksum:08x}"
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
                "samples": trace.count,
                "time_step_s": record.time_step,
                "trigger_sample": record.meta["frames"].get("trigger"),
                "checksum": trace.checksum,
                "uploads": trace.uploads,
                "bus_errors": node.errors,
            },
        )
    return 0


def _check(arguments: argparse.Namespace) -> None:
    """Raises InputError for what no node can do."""
    if arguments.samples is not None and arguments.samples < 1:
        raise InputError(f"-n has to be 1 or more samples, not {arguments.samples}")
    if arguments.every < 1:
        raise InputError(f"--every has to be 1 or more control periods, not {arguments.every}")
    if arguments.arm and (arguments.trigger is None or arguments.excite):
        raise InputError("--arm wants a --trigger, and goes without --excite")
    if arguments.pretrigger < 0 or (arguments.pretrigger > 0 and arguments.trigger is None):
        raise InputError("--pretrigger wants 0 or more samples, and a --trigger")
    for option in ("settle", "timeout"):
        value = getattr(arguments, option)
        if value is not None and not 0.0 <= value < math.inf:
            raise InputError(f"--{option} has to be 0 or more seconds, not {value}")


def _capture(trace: _Trace, arguments: argparse.Namespace) -> None:
    """Has the node capture what the arguments say; a trace that is not wanted any more is ended."""
    try:
        with excitation.excited(trace.node, arguments):
            if arguments.excite:
                trace.wait(arguments.settle)
            trace.capture(arguments.every, arguments.trigger, arguments.pretrigger)
            if not arguments.arm:
                trace.finish(arguments.trigger, arguments.timeout)
    except KeyboardInterrupt:
        trace.node.command("TraceAbort")
        raise


class _Collected:
    """What has come of a trace, and what the node says about it."""

    def __init__(self, contract: Contract, node_id: int) -> None:
        self.reports: list[can.Message] = []
        self.frames: dict[int, can.Message] = {}
        self._contract = contract
        self._node_id = node_id
        self._report = contract.identifier("Report", node_id)
        self._trace = contract.identifier("Trace", node_id)
        self._channel = contract.reader("Trace", "Channel")
        self._index = contract.reader("Trace", "Index")

    def take(self, message: can.Message) -> bool:
        """Takes a message; True when it is part of this."""
        if message.is_error_frame or message.is_extended_id or len(message.data) != PAYLOAD:
            return False
        if message.arbitration_id == self._report:
            self.reports.append(message)
            return True
        if message.arbitration_id == self._trace:
            payload = bytes(message.data)
            self.frames[2 * self._index(payload) + self._channel(payload)] = message
            return True
        return False

    @property
    def messages(self) -> list[can.Message]:
        """What makes the trace and explains it, in order of arrival."""
        return sorted([*self.reports, *self.frames.values()], key=lambda m: m.timestamp)

    def latest(self, pages: Sequence[str]) -> dict[str, int]:
        """What these report pages said last, as far as they have come."""
        collected = frames.Frames.of(self.reports)
        return frames.latest(collected, self._contract, self._node_id, pages)

    def record(self) -> Record:
        """The trace in SI units."""
        settings = frames.Settings(node=self._node_id)
        source = f"trace of node {self._node_id}"
        collected = frames.Frames.of(self.messages)
        return frames.decode(collected, self._contract, source, settings, "trace")


class _Trace:
    """A trace on its way from the node. Make it before connecting: it keeps what the node says."""

    def __init__(self, node: bus.Node, terminal: Terminal) -> None:
        self.node = node
        self.count = 0
        self.uploads = 0
        self.checksum = 0
        self.got = _Collected(node.contract, node.id)
        self._every = 1
        self._had: dict[int, can.Message] = {}  # fetched before
        self._log: LogFile | None = None
        self._terminal = terminal
        node.sinks.append(self._take)

    def capture(self, every: int, trigger: Trigger | None, before: int) -> None:
        """Arms the node: one sample in ``every`` periods, so many ``before`` the trigger."""
        node = self.node
        if trigger is None:
            now = node.contract.value_of("Command", "TraceTrigger", "Now")
            node.command("TraceTrigger", now)
        else:
            trigger.send(node)
        node.command("TracePretrigger", before)
        node.command("TraceDecimation", every)
        node.command("TraceArm", self.count)
        node.page_flags["TraceCaptured"] = _CAPTURING if trigger is None else _ARMED
        self._every = every

    def finish(self, trigger: Trigger | None, timeout: float | None) -> None:
        """Waits until the trace is captured. Raises BusError when it is not, or not triggered."""
        node = self.node
        assert node.info is not None
        # Simulated time may run slower than ours, but a node that hangs must not hang us.
        longest = 10.0 + 20.0 * self.count * self._every * node.info.control_period
        begin = time.monotonic()
        waiting = begin
        while not node.wait_until(lambda: node.page_flags["TraceCaptured"] == _READY, _ASK_AGAIN):
            now = time.monotonic()
            if node.page_flags["TraceCaptured"] == _ARMED:
                waiting = now
                self._terminal.live(f"waiting for {trigger}, {now - begin:.0f} s so far")
                if timeout is not None and now - begin > timeout:
                    node.command("TraceAbort")
                    raise BusError(f"no trigger within {timeout:g} s ({trigger})")
            else:
                self._terminal.live(f"capturing {self.count} samples")
                if now - waiting > longest:
                    raise BusError(f"node {node.id} does not finish its trace")
            node.command("Identify")  # in case the word of it was lost

    def find(self, partial: Path) -> None:
        """Finds out which trace the node holds, and takes what was fetched of it before.

        Raises BusError when it holds none.
        """
        marks = self._marks()
        self.count = marks["TraceCaptured"]
        if self.node.page_flags["TraceCaptured"] not in (_READY, _UPLOADING) or self.count == 0:
            raise BusError(f"node {self.node.id} holds no trace that is complete")
        if not partial.exists():
            return
        earlier = _Collected(self.node.contract, self.node.id)
        for message in buslog.messages(partial, []):
            earlier.take(message)
        if earlier.latest(_MARKS) == marks:
            self._had = earlier.frames
            have = 50.0 * len(earlier.frames) / self.count
            self._terminal.note(f"{have:.0f} % of this trace had been fetched before")

    def upload(self, log: LogFile, wait: float) -> None:
        """Fetches all frames into ``log``; what gets lost is asked for again, a lost node awaited.

        Raises BusError when the trace does not arrive whole and matching its checksum.
        """
        marks = self._marks()
        self.got.frames = dict(self._had)  # what came until now is of another upload
        for message in self.got.messages:
            log(message)
        self._log = log
        while (first := self._first_missing(marks)) is not None:
            if self.uploads == _UPLOADS_MAX:
                raise BusError(
                    f"only {len(self.got.frames)} of {2 * self.count} frames of the trace arrive; "
                    f"what has come is in {log.path}: go on with --fetch"
                )
            self.uploads += 1
            try:
                self.node.command("TraceUpload", first)
                self._receive()
            except NodeLostError as error:
                self._find_again(marks, wait, error)
            log.check()
        self._log = None
        if self.uploads > 1:
            self._terminal.note(f"frames were lost: asked for {self.uploads - 1} times again")

    def _find_again(self, marks: dict[str, int], wait: float, reason: NodeLostError) -> None:
        """Connects to a lost node again. Raises NodeLostError when it, or its trace, is gone."""
        self._terminal.note(f"{reason}; waiting up to {wait:g} s for it")
        try:
            self.node.connect(wait, lambda _: None)
            same = self._marks() == marks
        except AxisTwinError as error:
            raise NodeLostError(
                f"{reason} and has not come back ({error}); go on with --fetch when it has"
            ) from error
        if not same:
            raise NodeLostError(f"{reason}; it is back, but its trace is gone")

    def wait(self, seconds: float) -> None:
        """Lets time pass while the bus is being listened to."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self.node.poll(min(left, 0.1))

    def _receive(self) -> None:
        """Receives until everything has come or nothing more does."""
        have, last = len(self.got.frames), time.monotonic()
        while len(self.got.frames) < 2 * self.count and time.monotonic() - last < _PAUSE:
            self.node.poll(0.05)
            if len(self.got.frames) > have:
                have, last = len(self.got.frames), time.monotonic()
            if self._terminal.due():
                self._terminal.live(f"fetching {50.0 * have / self.count:.0f} %")

    def _take(self, message: can.Message) -> None:
        if self.got.take(message) and self._log is not None:
            self._log(message)

    def _marks(self) -> dict[str, int]:
        """What the node says of the trace it holds, along with everything else about itself."""
        node = self.node
        for page in _MARKS:
            node.pages.pop(page, None)
        node.command("Identify")
        if not node.wait_until(lambda: all(p in node.pages for p in _MARKS), node.answer_timeout):
            raise BusError(f"node {node.id} does not say which trace it holds")
        return {page: int(node.pages[page]) for page in _MARKS}

    def _first_missing(self, marks: dict[str, int]) -> int | None:
        """Index of the first sample that is not whole; None when all have come as were sent."""
        got = self.got.frames
        for place in range(2 * self.count):
            if place not in got:
                return place // 2
        sent = b"".join(bytes(got[place].data) for place in range(2 * self.count))
        self.checksum = frames.trace_checksum(np.frombuffer(sent, np.uint8))
        if self.checksum == marks["TraceChecksum"]:
            return None
        self._terminal.note(
            f"the trace does not match its checksum ({self.checksum:08x}, node says "
            f"{marks['TraceChecksum']:08x}): fetching it again"
        )
        got.clear()
        return 0


def _save(trace: _Trace, path: Path) -> None:
    """Writes the trace as a record or as a bus log, wholly or not at all."""
    if path.suffix.lower() in csvfile.ENDINGS:
        write_csv(trace.got.record(), path)
        return
    with atomic_write(path) as partial, buslog.writing(partial) as writer:
        for message in trace.got.messages:
            writer(message)
