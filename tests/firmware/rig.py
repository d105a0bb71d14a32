"""A board that runs the firmware, and what a test holds of it: both serial lines byte by byte, its
power, and a debugger."""

from __future__ import annotations

import os
import re
import select
import socket
import struct
import subprocess
from collections import deque
from pathlib import Path

import can
from board import IMAGES, board_command

from axistwin.contract import load_contract
from axistwin.registers import load_table

CONTRACT = load_contract()
NODE = 1


def slcan_line(message: can.Message) -> bytes:
    """A classical frame with 11 bits of identifier as a line."""
    return b"t%03X%d%s\r" % (
        message.arbitration_id,
        message.dlc,
        bytes(message.data).hex().upper().encode(),
    )


def command(name: str, argument: float = 0) -> bytes:
    """A command to the node as a line."""
    return slcan_line(CONTRACT.command(NODE, name, argument))


#: Its frames, by identifier.
KINDS = {
    CONTRACT.identifier(kind, NODE): kind
    for kind in ("Heartbeat", "Emergency", "Report", "Motor", "Table", "Trace")
}
SILENCE = 60.0  # [s]

#: What opens the channel, whatever stood there before.
OPEN = b"\r\rC\rO\r"
HEARTBEAT = slcan_line(CONTRACT.host_heartbeat())
FAULT_RESET = slcan_line(CONTRACT.control(NODE, "FaultReset"))
#: What enables operation.
ENABLE = HEARTBEAT + b"".join(
    slcan_line(CONTRACT.control(NODE, word)) for word in ("Shutdown", "SwitchOn", "EnableOperation")
)


class Line:
    """A serial line: two pipes, which carry single bytes faster than a socket does."""

    def __init__(self, folder: Path, name: str) -> None:
        self._path = folder / name
        for end in ("in", "out"):
            os.mkfifo(f"{self._path}.{end}")
        # open at both ends at once, or opening would wait for QEMU
        self.input = os.open(f"{self._path}.in", os.O_RDWR)
        self.output = os.open(f"{self._path}.out", os.O_RDWR)
        self._rest = b""
        self._frames: deque[tuple[str, bytes]] = deque()

    @property
    def chardev(self) -> str:
        """What QEMU calls it."""
        return f"pipe,path={self._path}"

    def close(self) -> None:
        """Closes both."""
        os.close(self.input)
        os.close(self.output)

    def write(self, data: bytes) -> None:
        """Sends; waits while the board has not taken what was sent before."""
        while data:
            data = data[os.write(self.input, data) :]

    def read(self) -> bytes:
        """What has come, one byte at least. A board that says nothing at all is not well."""
        assert select.select([self.output], [], [], SILENCE)[0], "the board has fallen silent"
        return os.read(self.output, 1 << 16)

    def frame(self) -> tuple[str, bytes]:
        """The node's next classical frame: kind and data."""
        while not self._frames:
            lines = re.split(rb"[\r\a]", self._rest + self.read())
            self._rest = lines.pop()
            for text in lines:
                found = re.fullmatch(rb"t([0-9A-F]{3})[0-8]((?:[0-9A-F]{2})*)", text)
                if found and (kind := KINDS.get(int(found[1], 16))):
                    self._frames.append((kind, bytes.fromhex(found[2].decode())))
        return self._frames.popleft()

    def wait_for(self, kind: str, page: str | None = None) -> bytes:
        """The data of the node's next frame of a kind, a report of this page; within 30 s of the
        node's own time."""
        number = None if page is None else CONTRACT.value_of("Report", "Page", page)
        heartbeats = 0
        while heartbeats < 300:
            found, data = self.frame()
            if found == kind and number in (None, data[0]):
                return data
            heartbeats += found == "Heartbeat"
        raise AssertionError(f"no {kind} {page or ''}")

    def wait_for_page(self, name: str) -> float:
        """The value of the next report page of this name."""
        return CONTRACT.value("Report", name, self.wait_for("Report", name))


def crc16(data: bytes) -> bytes:
    """The checksum of Modbus RTU (serial line specification V1.02, 6.2.2), bit by bit."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xA001 if crc & 1 else 0)
    return struct.pack("<H", crc)


class Debugger:
    """GDB's remote protocol, as far as memory goes: the processor stops while it is connected."""

    def __init__(self, path: Path) -> None:
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(SILENCE)
        self._socket.connect(str(path))
        self._received = b""

    def _packet(self) -> str:
        while not (found := re.search(rb"\$([^#]*)#..", self._received)):
            self._received += self._socket.recv(1 << 16)
        self._received = self._received[found.end() :]
        self._socket.sendall(b"+")
        return found[1].decode()

    def _ask(self, text: str) -> str:
        self._socket.sendall(f"${text}#{sum(text.encode()) & 0xFF:02x}".encode())
        while (answer := self._packet()).startswith("T"):
            pass  # that it has stopped
        return answer

    def write(self, address: int, data: bytes) -> None:
        """Puts bytes into memory, code included."""
        assert self._ask(f"M{address:x},{len(data):x}:{data.hex()}") == "OK"

    def read(self, address: int) -> int:
        """A word of memory."""
        return int(struct.unpack("<I", bytes.fromhex(self._ask(f"m{address:x},4")))[0])

    def release(self) -> None:
        """Lets the processor go on."""
        assert self._ask("D") == "OK"
        self._socket.close()


class Rig:
    """The board at work. Use board_at_work()."""

    def __init__(self, folder: Path, image: str, icount: str | None) -> None:
        self.image = image
        self.can = Line(folder, "can")
        self.modbus = Line(folder, "modbus")
        self._debugger = folder / "gdb"
        self._process = subprocess.Popen(
            board_command(
                self.can.chardev,
                self.modbus.chardev,
                "stdio",
                image,
                icount,
                ("-gdb", f"unix:{self._debugger},server=on,wait=off"),
            ),
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def reset(self) -> None:
        """Presses the reset button; the first time, switches the power on."""
        assert self._process.stdin is not None
        self._process.stdin.write(b"system_reset\ncont\n")
        self._process.stdin.flush()

    def close(self) -> None:
        """Switches everything off."""
        self._process.kill()
        self._process.communicate()
        self.can.close()
        self.modbus.close()

    def debug(self) -> Debugger:
        """A debugger that has stopped the processor."""
        return Debugger(self._debugger)

    def address(self, symbol: str) -> int:
        """Where the image has something."""
        table = subprocess.run(
            ["arm-none-eabi-nm", str(IMAGES / f"{self.image}.elf")],
            capture_output=True,
            text=True,
            check=True,
        )
        found = re.search(rf"^(\w+) \w {symbol}$", table.stdout, re.MULTILINE)
        assert found, f"no {symbol}"
        return int(found[1], 16)

    def registers(self, first: str, count: int) -> tuple[int, ...]:
        """Registers of 16 bits, over Modbus."""
        address = load_table().registers[first].address
        request = struct.pack(">BBHH", NODE, 3, address, count)
        for _ in range(20):  # a busy machine may tear a request apart: masters ask again
            self.modbus.write(request + crc16(request))
            answer = b""
            while select.select([self.modbus.output], [], [], 3.0)[0]:
                answer += self.modbus.read()
                if len(answer) == 5 + 2 * count:
                    assert answer[-2:] == crc16(answer[:-2])
                    return struct.unpack(f">{count}H", answer[3:-2])
        raise AssertionError("no answer over Modbus")
