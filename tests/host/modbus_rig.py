"""A Modbus server that runs, and lines to reach it by."""

from __future__ import annotations

import contextlib
import os
import re
import select
import socket
import struct
import subprocess
import threading
import tty
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from board import Board

REPOSITORY = Path(__file__).resolve().parent.parent.parent

#: With the sanitizers: what goes wrong in memory is a failure.
SANITIZED = REPOSITORY / "build" / "sanitized" / "axistwin-emulator"

#: The portable server of the microcontrollers, on a serial port.
PORTABLE = REPOSITORY / "build" / "modbus-rtu-node"

_TCP = re.compile(r"modbus tcp 127\.0\.0\.1:(\d+)")

#: What happens to bytes on a line.
Damage = Callable[[bytes], bytes]


@dataclass
class Server:
    """A process that serves registers: over TCP at ``port``."""

    process: subprocess.Popen[str]
    port: int

    def is_alive(self) -> bool:
        """Has it not ended?"""
        return self.process.poll() is None

    def stop(self) -> str:
        """Ends it properly; its last words. Fails when it ended otherwise or said an error."""
        self.process.terminate()
        output, _ = self.process.communicate(timeout=30)
        assert self.process.returncode == 0, output
        return output


@contextlib.contextmanager
def server(*command: str | Path) -> Iterator[Server]:
    """A server from its first line of output to the end of the test, when it must still be well."""
    process = subprocess.Popen(list(map(str, command)), stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        found = _TCP.search(line)
        started = Server(process, int(found[1]) if found else 0)
        assert line, f"{command} does not start"
        yield started
        if started.is_alive():
            started.stop()
    finally:
        if process.poll() is None:
            process.kill()
        process.wait()
        assert process.stdout is not None
        process.stdout.close()


class Line:
    """A serial line between pseudo-terminals ``server`` and ``client``, and what carries its bytes.

    ``far`` is the server's end where that is not a pseudo-terminal. ``to_server`` and ``to_client``
    may damage what passes, lump by lump: what came with no more than ``pause`` [s] in between.
    """

    def __init__(self, far: int | None = None) -> None:
        self.to_server: Damage = bytes
        self.to_client: Damage = bytes
        self.pause = 0.0
        self._ends = [os.openpty() for _ in range(2)]
        for _, end in self._ends:
            tty.setraw(end)
        self.server, self.client = (os.ttyname(end) for _, end in self._ends)
        (near_server, _), (self._near_client, _) = self._ends
        self._near_server = near_server if far is None else far
        self._stop, self._stopped = os.pipe()
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

    def cut(self) -> None:
        """Nothing arrives at the server any more."""
        self.to_server = lambda _: b""

    def mend(self) -> None:
        """Everything arrives again."""
        self.to_server = bytes

    def close(self) -> None:
        """Takes the line away."""
        os.close(self._stopped)
        self._thread.join()
        for master, end in self._ends:
            os.close(master)
            os.close(end)
        os.close(self._stop)

    def send(self, lump: bytes) -> None:
        """To the server, as if the client had."""
        os.write(self._near_server, lump)

    def _carry(self) -> None:
        server, client = self._near_server, self._near_client
        while True:
            ready, _, _ = select.select([server, client, self._stop], [], [])
            if self._stop in ready:
                return
            for source, target in ((server, client), (client, server)):
                if source in ready:
                    lump = os.read(source, 4096)
                    while self.pause > 0.0 and select.select([source], [], [], self.pause)[0]:
                        lump += os.read(source, 4096)
                    damage = self.to_client if source == server else self.to_server
                    os.write(target, damage(lump))


@contextlib.contextmanager
def line(far: int | None = None) -> Iterator[Line]:
    """A serial line for the length of a test."""
    opened = Line(far)
    try:
        yield opened
    finally:
        opened.close()


def crc16(message: bytes) -> bytes:
    """CRC-16 of the serial line, bit by bit as the specification describes it, low byte first."""
    crc = 0xFFFF
    for byte in message:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


class Master(Protocol):
    """A client that says what it is told to."""

    def ask(self, pdu: bytes) -> bytes:
        """The answer to a proper request: the PDU."""


class Raw:
    """A TCP client that says what it is told to."""

    def __init__(self, port: int, timeout: float = 10.0) -> None:
        self.socket = socket.create_connection(("127.0.0.1", port), timeout)

    def __enter__(self) -> Raw:
        return self

    def __exit__(self, *_: object) -> None:
        self.socket.close()

    def send(self, lump: bytes) -> None:
        """Whatever it is."""
        self.socket.sendall(lump)

    def receive(self) -> bytes:
        """The next answer: unit id and PDU; nothing when the server has hung up."""
        try:
            header = self._exactly(6)
            return self._exactly(struct.unpack(">H", header[4:])[0]) if header else b""
        except ConnectionResetError:
            return b""

    def ask(self, pdu: bytes, unit: int = 1) -> bytes:
        """The answer to a proper request: the PDU."""
        self.send(adu(pdu, unit))
        return self.receive()[1:]

    def _exactly(self, count: int) -> bytes:
        got = b""
        while len(got) < count:
            lump = self.socket.recv(count - len(got))
            if not lump:
                return b""
            got += lump
        return got


def adu(pdu: bytes, unit: int = 1, transaction: int = 0) -> bytes:
    """A request over TCP."""
    return struct.pack(">HHHB", transaction, 0, len(pdu) + 1, unit) + pdu


def read_pdu(address: int, count: int, function: int = 3) -> bytes:
    """A request to read registers."""
    return struct.pack(">BHH", function, address, count)


def write_pdu(address: int, value: int) -> bytes:
    """A request to write one register."""
    return struct.pack(">BHH", 6, address, value)


class RawLine:
    """A client on a serial line, at ``device``, that talks to ``unit``."""

    def __init__(self, device: str, unit: int) -> None:
        self._port = os.open(device, os.O_RDWR | os.O_NOCTTY)
        self._unit = bytes([unit])

    def __enter__(self) -> RawLine:
        return self

    def __exit__(self, *_: object) -> None:
        os.close(self._port)

    def ask(self, pdu: bytes) -> bytes:
        """The answer to a proper request to read: the PDU."""
        request = self._unit + pdu
        os.write(self._port, request + crc16(request))
        answer = self._exactly(3)
        answer += self._exactly(answer[2])
        assert self._exactly(2) == crc16(answer)
        return answer[1:]

    def _exactly(self, count: int) -> bytes:
        got = b""
        while len(got) < count:
            ready, _, _ = select.select([self._port], [], [], 10.0)
            assert ready, "no answer"
            got += os.read(self._port, count - len(got))
        return got


class Power(Protocol):
    """What can be switched on, off as by a power failure, and on again."""

    def start(self) -> None:
        """On."""

    def kill(self) -> None:
        """Off."""


class Emulator:
    """An emulator with the sanitizers, at 10 kHz like a microcontroller. Use as a context manager.

    It serves registers at ``modbus``; its axis moves from the start.
    """

    def __init__(self, modbus: str) -> None:
        self._command = (SANITIZED, "--rate", "10000", "--excite", "--modbus", modbus)
        self._stack = contextlib.ExitStack()

    def __enter__(self) -> Emulator:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def start(self) -> None:
        """Starts a process."""
        self._running = self._stack.enter_context(server(*self._command))

    def kill(self) -> None:
        """Kills it."""
        self._running.process.kill()
        self._running.process.wait()


@dataclass
class Station:
    """A node that serves registers, on ``line`` if on any; what comes while it is off is lost.

    ``where`` is what the command line says to get there; ``master`` makes a client.
    """

    power: Power
    where: tuple[str, ...]
    master: Callable[[], contextlib.AbstractContextManager[Master]]
    line: Line | None = None

    def start(self) -> None:
        """Switches it on."""
        if self.line is not None:
            self.line.mend()
        self.power.start()

    def kill(self) -> None:
        """Switches it off."""
        if self.line is not None:
            self.line.cut()
        self.power.kill()


@contextlib.contextmanager
def over_tcp() -> Iterator[Station]:
    """The emulator over TCP."""
    with socket.create_server(("127.0.0.1", 0)) as probe:
        port = probe.getsockname()[1]
    with Emulator(f"tcp:{port}") as emulator:
        yield Station(emulator, ("-c", f"tcp:127.0.0.1:{port}"), lambda: Raw(port))


def _on(opened: Line, power: Power) -> Station:
    where = ("-c", f"rtu:{opened.client}", "-b", "115200", "--parity", "N")
    return Station(power, where, lambda: RawLine(opened.client, 1), opened)


@contextlib.contextmanager
def on_a_line() -> Iterator[Station]:
    """The emulator on a serial line."""
    with line() as opened, Emulator(f"rtu:{opened.server},115200,N") as emulator:
        yield _on(opened, emulator)


@contextlib.contextmanager
def firmware_on_a_line() -> Iterator[Station]:
    """The firmware with its UART for Modbus on a serial line."""
    near, far = socket.socketpair()
    fd = far.fileno()
    with (
        near,
        far,
        line(near.fileno()) as opened,
        Board(modbus=f"socket,fd={fd}", fds=[fd], excited=True) as board,
    ):
        yield _on(opened, board)
