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
    """A serial line: two pseudo-terminals and what carries bytes between them.

    ``to_server`` and ``to_client`` may damage what passes.
    """

    def __init__(self) -> None:
        self.to_server: Damage = bytes
        self.to_client: Damage = bytes
        self._ends = [os.openpty() for _ in range(2)]
        for _, end in self._ends:
            tty.setraw(end)
        self.server, self.client = (os.ttyname(end) for _, end in self._ends)
        self._stop, self._stopped = os.pipe()
        self._thread = threading.Thread(target=self._carry)
        self._thread.start()

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
        os.write(self._ends[0][0], lump)

    def _carry(self) -> None:
        (server, _), (client, _) = self._ends
        while True:
            ready, _, _ = select.select([server, client, self._stop], [], [])
            if self._stop in ready:
                return
            for source, target in ((server, client), (client, server)):
                if source in ready:
                    lump = os.read(source, 4096)
                    damage = self.to_client if source == server else self.to_server
                    os.write(target, damage(lump))


@contextlib.contextmanager
def line() -> Iterator[Line]:
    """A serial line for the length of a test."""
    opened = Line()
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
