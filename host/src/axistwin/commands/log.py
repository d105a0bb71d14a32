"""`axistwin log`: the live stream of a node into a bus log."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from datetime import datetime
from pathlib import Path

from axistwin import bus, excitation
from axistwin.errors import AxisTwinError, InputError, NodeLostError
from axistwin.monitor import BusLoad, StreamMonitor
from axistwin.output import write_json
from axistwin.readers import buslog
from axistwin.terminal import Terminal

_DEFAULT_BIT_RATE = 1_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    parser.add_argument(
        "-f",
        "--file",
        metavar="FILE",
        help="bus log to write; its ending says in which format: .log (candump), .asc, .blf, .mf4, "
        ".trc, .csv, .db (default: axistwin-DATE-TIME.log)",
    )
    parser.add_argument(
        "--duration", type=float, metavar="S", help="stop after this time (default: Ctrl-C stops)"
    )
    parser.add_argument(
        "--stream-rate", type=float, metavar="HZ", help="samples a second (default: the node's own)"
    )
    parser.add_argument(
        "--json", metavar="FILE", help="write the summary here (-: standard output)"
    )
    excitation.add_arguments(parser)
    bus.add_arguments(parser)


@dataclass
class Gap:
    """A time during which the node was not there: from when on [s], for how long [s], and why."""

    begin: float
    duration: float | None
    reason: str


@dataclass
class _Log:
    """A log being written."""

    node: bus.Node
    monitor: StreamMonitor
    load: BusLoad
    terminal: Terminal
    begin: float = field(default_factory=time.monotonic)
    gaps: list[Gap] = field(default_factory=list)

    def elapsed(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self.begin

    def status(self, load: float, rate: float) -> str:
        """The live line."""
        return (
            f"{self.elapsed():7.1f} s  {rate:7.1f} samples/s  {self.monitor.samples} samples  "
            f"{self.monitor.lost} lost  {self.node.errors} bus errors  "
            f"bus load {100.0 * load:.1f} % of {self.load.bit_rate / 1e6:g} Mbit/s"
        )


def run(arguments: argparse.Namespace) -> int:
    """Logs until the time is over or the user stops it.

    Returns the exit status: that of a lost node, too, when it was away in between.
    """
    if arguments.duration is not None and not arguments.duration > 0.0:
        raise InputError(f"--duration has to be a positive time, not {arguments.duration}")
    path = Path(arguments.file or f"axistwin-{datetime.now():%Y%m%d-%H%M%S}.log")
    terminal = Terminal()
    with bus.node_of(arguments) as node:
        info = node.connect(arguments.wait, terminal.note)
        terminal.note(f"node {node.id}: {info}")
        log = _Log(
            node,
            StreamMonitor(node.contract, node.id),
            BusLoad(getattr(arguments, "bitrate", None) or _DEFAULT_BIT_RATE),
            terminal,
        )
        failure: NodeLostError | None = None
        with buslog.writing(path) as write:
            node.sinks += [write, log.monitor, log.load]
            try:
                with _streaming(log, arguments), excitation.excited(node, arguments):
                    _stream(log, arguments)
            except NodeLostError as error:
                failure = error
            except KeyboardInterrupt:
                terminal.note("stopped")
        terminal.clear()
    _report(log, path, arguments.json)
    if failure is not None:
        raise failure
    return NodeLostError.exit_code if log.gaps else 0


@contextlib.contextmanager
def _streaming(log: _Log, arguments: argparse.Namespace) -> Iterator[None]:
    """The stream runs inside; afterwards it is stopped unless it was found running."""
    found = log.node.streaming
    _start_stream(log.node, arguments)
    try:
        yield
    finally:
        if not found:
            with contextlib.suppress(AxisTwinError):  # what ended this has been said already
                log.node.command("StreamStop")


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
    node.command("StreamStart", decimation)


def _stream(log: _Log, arguments: argparse.Namespace) -> None:
    """Receives until the time is over; a node that has gone is waited for."""
    end = time.monotonic() + (arguments.duration or float("inf"))
    before, at = log.monitor.samples, time.monotonic()
    while (now := time.monotonic()) < end:
        try:
            log.node.poll(min(0.1, end - now))
        except NodeLostError as error:
            _resume(log, arguments, error)
        if log.terminal.due():
            now = time.monotonic()
            rate = (log.monitor.samples - before) / max(now - at, 1e-3)
            before, at = log.monitor.samples, now
            log.terminal.live(log.status(log.load.recent(), rate))


def _resume(log: _Log, arguments: argparse.Namespace, reason: NodeLostError) -> None:
    """Waits for the node to come back and starts the stream again.

    Raises NodeLostError when it does not come back.
    """
    gap = Gap(log.elapsed(), None, str(reason))
    log.gaps.append(gap)
    log.terminal.note(f"{reason}; waiting up to {arguments.wait:g} s for it")
    try:
        log.node.connect(arguments.wait, lambda _: None)
        log.monitor.start_afresh()
        _start_stream(log.node, arguments)
        if arguments.excite:
            excitation.switch_on(log.node, arguments)
    except AxisTwinError as error:
        raise NodeLostError(f"{reason} and has not come back ({error})") from error
    gap.duration = log.elapsed() - gap.begin
    log.terminal.note(f"node {log.node.id} is back after {gap.duration:.1f} s")


def _report(log: _Log, path: Path, json_file: str | None) -> None:
    """Says what is in the log, and what is not."""
    duration = log.elapsed()
    rate = log.monitor.samples / max(duration, 1e-3)
    log.terminal.note(log.status(log.load.mean(), rate).strip())
    for gap in log.gaps:
        lasted = "to the end" if gap.duration is None else f"for {gap.duration:.1f} s"
        log.terminal.note(f"gap from {gap.begin:.1f} s on, {lasted}: {gap.reason}")
    if json_file != "-":
        print(path)
    if json_file is not None:
        assert log.node.info is not None
        write_json(
            json_file,
            {
                "schema": "axistwin.log/1",
                "file": str(path),
                "node": {"id": log.node.id, **asdict(log.node.info)},
                "duration_s": duration,
                "samples": log.monitor.samples,
                "lost": log.monitor.lost,
                "rate_hz": rate,
                "bus_errors": log.node.errors,
                "bus_load": log.load.mean(),
                "gaps": [asdict(gap) for gap in log.gaps],
            },
        )
