"""`axistwin log`: the live streams of nodes into a bus log."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from axistwin import bus, excitation, frames, logfile
from axistwin.errors import AxisTwinError, DriveFaultError, FileError, InputError, NodeLostError
from axistwin.interrupt import Interrupts
from axistwin.monitor import BusLoad, StreamMonitor
from axistwin.output import write_json
from axistwin.readers import buslog
from axistwin.sharedbus import SharedBus
from axistwin.terminal import Terminal

_DEFAULT_BIT_RATE = 1_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument(
        "-f",
        "--file",
        metavar="FILE",
        help="bus log to write; its ending says in which format: .log (candump, readable however "
        "it ends), or made of such a log at the end: .asc .blf .mf4 .trc .csv (default: "
        "axistwin-DATE-TIME.log)",
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="stop after this time (default: Ctrl-C stops)"
    )
    parser.add_argument(
        "--stream-rate",
        type=float,
        metavar="HZ",
        help="samples a second (default: the node's own; with --fd every control period)",
    )
    parser.add_argument(
        "--json", metavar="FILE", help="write the summary here (-: standard output)"
    )
    excitation.add_arguments(parser)
    bus.add_arguments(parser, several=True)


@dataclass
class Gap:
    """A time during which a node was not there: from when on [s], for how long [s], and why."""

    begin: float
    duration: float | None
    reason: str


@dataclass
class _Stream:
    """The stream of one node."""

    node: bus.Node
    info: bus.NodeInfo  # as it was found; the node itself forgets it with the connection
    monitor: StreamMonitor
    gaps: list[Gap] = field(default_factory=list)
    samples_before: int = 0
    lost: bool = False  # gone for good

    @property
    def away(self) -> bool:
        """Has the node gone, and is waited for?"""
        return bool(self.gaps) and self.gaps[-1].duration is None

    def status(self, seconds: float) -> str:
        """Part of the live line, ``seconds`` after the last time."""
        rate = (self.monitor.samples - self.samples_before) / max(seconds, 1e-3)
        self.samples_before = self.monitor.samples
        return f"{rate:7.1f} samples/s  {self.monitor.samples} samples  {self.monitor.lost} lost"


def _stream_of(node: bus.Node) -> _Stream:
    """The stream of a node that is connected."""
    assert node.info is not None
    return _Stream(node, node.info, StreamMonitor(node.contract, node.id))


@dataclass
class _Log:
    """A log being written."""

    streams: list[_Stream]
    shared: SharedBus
    file: logfile.LogFile
    load: BusLoad
    terminal: Terminal
    begin: float = field(default_factory=time.monotonic)
    shown: float = field(default_factory=time.monotonic)

    @property
    def running(self) -> list[_Stream]:
        """The streams of nodes that have not gone for good."""
        return [stream for stream in self.streams if not stream.lost]

    def elapsed(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self.begin

    def show(self) -> None:
        """Says how it goes, where it is time to."""
        if self.terminal.due():
            now = time.monotonic()
            self.terminal.live(self.status(now - self.shown, self.load.recent()))
            self.shown = now

    def status(self, seconds: float, load: float) -> str:
        """The live line: what has come in the last ``seconds``, and the bus ``load``."""
        several = len(self.streams) > 1
        parts = [
            (f"node {stream.node.id}: " if several else "") + stream.status(seconds)
            for stream in self.streams
        ]
        errors = max(stream.node.errors for stream in self.streams)
        return (
            f"{self.elapsed():7.1f} s  {'  '.join(parts)}  {errors} bus errors  "
            f"bus load {100.0 * load:.1f} % of {self.load.bit_rate / 1e6:g} Mbit/s"
        )


def run(arguments: argparse.Namespace) -> int:
    """Logs until the time is over or the user stops it.

    Returns the exit status: that of a lost node, too, when it was away in between.
    """
    if arguments.duration is not None and not arguments.duration > 0.0:
        raise InputError(f"--duration has to be a positive time, not {arguments.duration}")
    path = Path(arguments.file or f"axistwin-{datetime.now():%Y%m%d-%H%M%S}.log")
    buslog.check_writable(path)
    if getattr(arguments, "fd", False) and path.suffix.lower() == ".trc":
        raise InputError(f"cannot write {path}: TRC logs take no FD frames")
    terminal = Terminal()
    failure: AxisTwinError | None = None
    with bus.nodes_of(arguments) as (shared, nodes):
        for node in nodes:
            terminal.note(f"node {node.id}: {node.connect(arguments.wait, terminal.note)}")
        log = _Log(
            [_stream_of(node) for node in nodes],
            shared,
            logfile.LogFile(path, terminal),
            BusLoad(
                getattr(arguments, "bitrate", None) or _DEFAULT_BIT_RATE,
                getattr(arguments, "data_bitrate", None),
            ),
            terminal,
        )
        try:
            with log.file:
                _collect(log, arguments)
        except (NodeLostError, DriveFaultError, FileError) as error:
            failure = error
        terminal.clear()
    _report(log, path, arguments.json)
    if failure is not None:
        raise failure
    return NodeLostError.exit_code if any(stream.gaps for stream in log.streams) else 0


def _collect(log: _Log, arguments: argparse.Namespace) -> None:
    """Has the nodes send their streams into the log until the end; the nodes are left as found."""
    log.shared.sinks += [log.file, log.load, *(stream.monitor for stream in log.streams)]
    try:
        with contextlib.ExitStack() as stack:
            interrupts = stack.enter_context(Interrupts().taken())
            for stream in log.streams:
                stack.enter_context(_streaming(stream.node, arguments))
                stack.enter_context(excitation.excited(stream.node, arguments))
            _receive(log, arguments, interrupts)
    except KeyboardInterrupt:
        log.terminal.note("stopped")
    finally:
        log.shared.sinks.clear()


@contextlib.contextmanager
def _streaming(node: bus.Node, arguments: argparse.Namespace) -> Iterator[None]:
    """The stream runs inside; afterwards it is stopped unless it was found running."""
    found = node.streaming
    _start_stream(node, arguments)
    try:
        yield
    finally:
        if not found:
            with contextlib.suppress(AxisTwinError):  # what ended this has been said already
                node.command("StreamStop")


def _start_stream(node: bus.Node, arguments: argparse.Namespace) -> None:
    """Starts the stream, the node's own description before it: the log explains itself."""
    assert node.info is not None
    decimation = 0
    if arguments.stream_rate is not None:
        rate = 1.0 / node.info.control_period
        if not 0.0 < arguments.stream_rate <= rate:
            raise InputError(f"--stream-rate has to be positive and at most {rate:.6g} Hz")
        decimation = round(rate / arguments.stream_rate)
    node.command("Identify")
    node.command("StreamStartFd" if getattr(arguments, "fd", False) else "StreamStart", decimation)


def _receive(log: _Log, arguments: argparse.Namespace, interrupts: Interrupts) -> None:
    """Receives until the time is over; a node that has gone is waited for.

    Raises NodeLostError when none is left.
    """
    end = time.monotonic() + (arguments.duration or float("inf"))
    while (now := time.monotonic()) < end:
        timeout = min(0.1, end - now)
        for stream in log.running:
            if stream.away:
                _resume(log, stream, arguments)
                continue
            try:
                with interrupts.held():
                    stream.node.poll(timeout)
            except NodeLostError as error:
                stream.gaps.append(Gap(log.elapsed(), None, str(error)))
                log.terminal.note(f"{error}; waiting up to {arguments.wait:g} s for it")
            timeout = 0.0  # the first has waited for all of them
        log.file.check()
        log.show()


def _resume(log: _Log, stream: _Stream, arguments: argparse.Namespace) -> None:
    """Starts the stream of a node again that is back; with other nodes to care for, does not wait.

    Raises NodeLostError when it does not come back and it was the last one.
    """
    gap, node = stream.gaps[-1], stream.node
    try:
        node.connect(arguments.wait if len(log.running) == 1 else 0.0, lambda _: None)
        stream.monitor.start_afresh()
        _start_stream(node, arguments)
        if arguments.excite:
            excitation.switch_on(node, arguments)
    except AxisTwinError as error:
        if len(log.running) > 1 and log.elapsed() < gap.begin + arguments.wait:
            return
        stream.lost = True
        gone = NodeLostError(f"{gap.reason} and has not come back ({error})")
        if not log.running:
            raise gone from error
        log.terminal.note(f"{gone}; the others go on")
        return
    gap.duration = log.elapsed() - gap.begin
    log.terminal.note(f"node {node.id} is back after {gap.duration:.1f} s")


def _report(log: _Log, path: Path, json_file: str | None) -> None:
    """Says what is in the log, and what is not: read from the log itself."""
    duration = log.elapsed()
    for stream in log.streams:
        stream.samples_before = 0
    log.terminal.note(log.status(duration, log.load.mean()).strip())
    for stream in log.streams:
        for gap in stream.gaps:
            lasted = "to the end" if gap.duration is None else f"for {gap.duration:.1f} s"
            log.terminal.note(f"gap from {gap.begin:.1f} s on, {lasted}: {gap.reason}")
    if log.shared.dropped > 0:
        log.terminal.note(
            f"this computer was too busy: {log.shared.dropped} frames found no room in its kernel "
            f"(as root, or with a larger net.core.rmem_max, there is more)"
        )
    nodes = [_summary(stream, duration, found) for stream, found in _records(log, path)]
    if json_file != "-":
        print(path)
    if json_file is not None:
        write_json(
            json_file,
            {
                "schema": "axistwin.log/2",
                "file": str(path),
                "duration_s": duration,
                "samples": sum(stream.monitor.samples for stream in log.streams),
                "lost": sum(stream.monitor.lost for stream in log.streams),
                "bus_errors": max(stream.node.errors for stream in log.streams),
                "dropped_by_host": log.shared.dropped,
                "bus_load": log.load.mean(),
                "gaps": [asdict(gap) for stream in log.streams for gap in stream.gaps],
                "nodes": nodes,
            },
        )


def _records(log: _Log, path: Path) -> Iterator[tuple[_Stream, dict[str, Any]]]:
    """What the log holds of each node: the facts about its record, or why there is none."""
    contract = log.streams[0].node.contract
    source = path if path.exists() else logfile.journal_of(path)
    try:
        if not source.is_file():  # a device may have no end
            raise InputError(f"{source} is no file that could be read back")
        found, damage = buslog.read_frames(source)
    except (InputError, OSError) as error:
        for stream in log.streams:
            yield stream, {"error": str(error)}
        return
    for stream in log.streams:
        number = stream.node.id
        try:
            settings = frames.Settings(node=number)
            record = frames.decode(found, contract, str(source), settings, "stream", damage)
        except InputError as error:
            log.terminal.note(str(error))
            yield stream, {"error": str(error)}
            continue
        for warning in record.warnings:
            log.terminal.note(f"node {number}: {warning}")
        yield stream, {**record.meta["frames"], "warnings": list(record.warnings)}


def _summary(stream: _Stream, duration: float, found: dict[str, Any]) -> dict[str, Any]:
    """The summary of one node."""
    return {
        "id": stream.node.id,
        **asdict(stream.info),
        "samples": stream.monitor.samples,
        "lost": stream.monitor.lost,
        "rate_hz": stream.monitor.samples / max(duration, 1e-3),
        "gaps": [asdict(gap) for gap in stream.gaps],
        "record": found,
    }
