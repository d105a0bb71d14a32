"""`axistwin modbus`: the registers of a node, its commands and its history, over TCP or RTU."""

from __future__ import annotations

import argparse
import contextlib
import time
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Any

from axistwin import history, modbus
from axistwin.errors import (
    AxisTwinError,
    BusError,
    ContractError,
    FileError,
    InputError,
    NotEnoughDataError,
)
from axistwin.journal import Journal
from axistwin.output import write_json
from axistwin.record import Record, write_csv
from axistwin.registers import Register, Value, load_table
from axistwin.terminal import Terminal

# Between two reads [s]: a drive that is enabled wants to hear its host.
_INTERVAL_MAX = 0.1


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Adds the arguments of the command."""
    verbs = parser.add_subparsers(dest="action", metavar="ACTION", required=True)

    read = verbs.add_parser("read", help="show registers", description="Shows registers.")
    read.add_argument("names", nargs="*", metavar="REGISTER", help="names (default: all)")
    read.add_argument("--json", metavar="FILE", help="write them here (-: standard output)")
    read.set_defaults(carry_out=_read)

    write = verbs.add_parser(
        "write", help="give a command", description="Gives a command, write key first."
    )
    write.add_argument(
        "command",
        metavar="COMMAND",
        help=f"such as ExcitationOn, of the wire contract, or {modbus.HISTORY_DECIMATION}",
    )
    write.add_argument(
        "argument", nargs="?", type=float, default=0.0, metavar="ARGUMENT", help="(default: 0)"
    )
    write.set_defaults(carry_out=_write)

    log = verbs.add_parser(
        "log", help="record the history", description="Records samples by polling the history."
    )
    log.add_argument(
        "-f", "--file", metavar="FILE", help="record to write (default: axistwin-DATE-TIME.csv)"
    )
    log.add_argument(
        "--duration", type=float, metavar="S", help="stop after this time (default: Ctrl-C stops)"
    )
    log.add_argument(
        "--rate", type=float, metavar="HZ", help="samples a second (default: the node's own)"
    )
    log.add_argument(
        "--excite",
        action="store_true",
        help="enable the drive and switch the excitation on meanwhile, both off at the end",
    )
    log.add_argument("--json", metavar="FILE", help="write the summary here (-: standard output)")
    log.set_defaults(carry_out=_log)

    for verb in (read, write, log):
        modbus.add_arguments(verb)


def run(arguments: argparse.Namespace) -> int:
    """Connects and carries out what was asked for. Returns the exit status."""
    terminal = Terminal()
    carry_out: Callable[[modbus.Client, dict[str, Value], argparse.Namespace, Terminal], int]
    carry_out = arguments.carry_out
    with modbus.client_of(arguments) as client:
        identity = client.connect(arguments.wait, terminal.note)
        return carry_out(client, identity, arguments, terminal)


def _read(
    client: modbus.Client,
    _identity: dict[str, Value],
    arguments: argparse.Namespace,
    _terminal: Terminal,
) -> int:
    registers = [_register(name) for name in arguments.names]
    if not registers:
        registers = list(load_table().registers.values())
    values: dict[str, Value] = {}
    for block in dict.fromkeys(register.block for register in registers):
        values.update(client.read(block))
    shown = {register.name: values[register.name] for register in registers}
    if arguments.json is not None:
        write_json(arguments.json, shown)
    if arguments.json != "-":
        for register in registers:
            print(f"{register.name:<22} {_text(shown[register.name])} {register.unit}".rstrip())
    return 0


def _write(
    client: modbus.Client,
    _identity: dict[str, Value],
    arguments: argparse.Namespace,
    _terminal: Terminal,
) -> int:
    client.command(arguments.command, arguments.argument)
    print(f"node {client.id}: {arguments.command} done")
    return 0


def _log(
    client: modbus.Client,
    identity: dict[str, Value],
    arguments: argparse.Namespace,
    terminal: Terminal,
) -> int:
    if arguments.duration is not None and not arguments.duration > 0.0:
        raise InputError(f"--duration has to be a positive time, not {arguments.duration}")
    path = Path(arguments.file or f"axistwin-{datetime.now():%Y%m%d-%H%M%S}.csv")
    journal = history.journal_of(path)
    if journal.exists():
        raise InputError(
            f"{journal} is there: a log that was not completed. Read it as it is, then move it away"
        )
    found = client.read_history(0)["HistoryDecimation"]
    assert isinstance(found, int)
    decimation = _decimation(arguments.rate, identity) or found
    logged = _Log(client, identity, decimation, Journal(journal), terminal)
    failure: AxisTwinError | None = None
    try:
        with logged.journal:
            client.keep_history(decimation)
            with client.excited() if arguments.excite else contextlib.nullcontext():
                logged.poll(arguments)
    except (BusError, FileError) as error:
        failure = error
    except KeyboardInterrupt:
        terminal.note("stopped")
    terminal.clear()
    meta = {}
    if not isinstance(failure, BusError):
        try:
            meta = modbus.node_estimate(client)
            client.keep_history(found)
        except BusError as error:
            failure = failure or error
    if isinstance(failure, FileError):
        raise failure
    record = _complete(logged, path, f"{arguments.channel} node {client.id}", meta, failure)
    for warning in record.warnings:
        terminal.note(warning)
    terminal.note(logged.status())
    if arguments.json != "-":
        print(path)
    if arguments.json is not None:
        write_json(
            arguments.json,
            {
                "schema": "axistwin.modbus-log/1",
                "file": str(path),
                "node": client.id,
                "duration_s": logged.elapsed(),
                "samples": logged.history.samples,
                "lost": logged.history.lost,
                "reads": logged.reads,
                "gaps": logged.gaps,
            },
        )
    if failure is not None:
        raise failure
    return BusError.exit_code if logged.gaps else 0


def _complete(
    logged: _Log,
    path: Path,
    source: str,
    meta: dict[str, Any],
    failure: AxisTwinError | None,
) -> Record:
    """Makes the record of what was logged, and removes the journal then, or when it is empty.

    Raises NotEnoughDataError, or why there is not enough; FileError.
    """
    try:
        record = logged.history.record(source, meta)
    except NotEnoughDataError as error:
        if logged.history.samples == 0:
            logged.journal.path.unlink()
            raise failure or error from None
        kept = f"{failure or error}; what was logged is in {logged.journal.path}"
        raise type(failure or error)(kept) from None
    try:
        write_csv(record, path)
    except FileError as error:
        raise FileError(f"{error}; what was logged is in {logged.journal.path}") from error
    logged.journal.path.unlink()
    return record


class _Log:
    """A history being logged."""

    def __init__(
        self,
        client: modbus.Client,
        identity: dict[str, Value],
        decimation: int,
        journal: Journal,
        terminal: Terminal,
    ) -> None:
        period = identity["ControlPeriod"]
        assert isinstance(period, float)
        self.history = history.HistoryLog(identity, journal.write)
        self.journal = journal
        self.reads = 0
        self.gaps: list[str] = []
        self._client = client
        self._terminal = terminal
        self._begin = time.monotonic()
        self._length = load_table().registers["HistoryTorque"].length
        self._interval = min(self._length * decimation * period, _INTERVAL_MAX)
        self._decimation = decimation

    def elapsed(self) -> float:
        """Time since the start [s]."""
        return time.monotonic() - self._begin

    def status(self) -> str:
        """The live line."""
        elapsed = self.elapsed()
        return (
            f"{elapsed:.1f} s  {self.history.samples} samples  {self.history.lost} lost  "
            f"{self.reads / max(elapsed, 1e-3):.0f} reads/s"
        )

    def poll(self, arguments: argparse.Namespace) -> None:
        """Reads until the time is over; a node that has gone is waited for."""
        end = self._begin + (arguments.duration or float("inf"))
        while (now := time.monotonic()) < end:
            taken = 0
            try:
                taken = self.history.take(now, self._client.read_history(self.history.next))
                self.reads += 1
                if taken == 0:
                    self.history.watch(now, self._client.read_history(0))
            except BusError as error:
                self._resume(error, arguments.wait)
            self.journal.check()
            if self._terminal.due():
                self._terminal.live(self.status())
            if taken < self._length:  # else there is more already
                time.sleep(max(0.0, min(self._interval, end - time.monotonic())))

    def _resume(self, reason: BusError, wait: float) -> None:
        """Waits for the node to come back. Raises BusError when it does not."""
        begin = self.elapsed()
        self._terminal.note(f"{reason}; waiting up to {wait:g} s for it")
        try:
            self._client.connect(wait, lambda _: None)
            self._client.keep_history(self._decimation)
            self.history.watch(time.monotonic(), self._client.read_history(0))
        except ContractError:
            raise
        except BusError as error:
            raise BusError(f"{reason} and has not come back ({error})") from error
        self.gaps.append(f"from {begin:.1f} s to {self.elapsed():.1f} s: {reason}")
        self._terminal.note(f"node {self._client.id} is back: gap {self.gaps[-1]}")


def _register(name: str) -> Register:
    try:
        return load_table().registers[name]
    except KeyError:
        known = ", ".join(load_table().registers)
        raise InputError(f"there is no register {name}; there are {known}") from None


def _decimation(rate: float | None, identity: dict[str, Value]) -> int | None:
    """Control periods between samples at this rate."""
    if rate is None:
        return None
    period = identity["ControlPeriod"]
    assert isinstance(period, float)
    if not 0.0 < rate <= 1.0 / period * (1.0 + 1e-6):
        raise InputError(f"--rate has to be positive and at most {1.0 / period:.6g} Hz")
    return max(1, round(1.0 / (period * rate)))


def _text(value: Value) -> str:
    """As a person reads it: floats as the single precision numbers that they are."""
    if isinstance(value, tuple):
        return " ".join(map(_text, value))
    return f"{value:.7g}" if isinstance(value, float) else str(value)
