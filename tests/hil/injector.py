"""A faulty piece of bus: passes frames between two CAN interfaces and harms some on their way.

    injector.py NODE_SIDE HOST_SIDE FAULT EVERY ID...

What comes from the host side passes unharmed. Of what comes from the node side, each EVERY-th frame
with one of the hexadecimal IDs (counted for each of them) suffers the FAULT. One line is printed
when it begins, and one for each frame that was harmed, as candump writes it: `181#0123456789ABCD`.

    drop        it does not arrive
    duplicate   it arrives twice
    swap        it arrives after the next one with its id
    delay       it arrives after the next 8 with its id
    cut         it arrives in the length before its own: 7 bytes for 8, 48 for 64
    count       it arrives with another sample counter, 8 off
"""

from __future__ import annotations

import selectors
import signal
import socket
import struct
import sys
from collections import Counter
from collections.abc import Callable
from types import FrameType

Send = Callable[[bytes], object]

# struct canfd_frame: id, length, flags, two reserved bytes, 64 bytes; struct can_frame has 8.
_HEADER = struct.Struct("=IBBxx")
_FD_SIZE = _HEADER.size + 64
_ID = 0x7FF
_HOLD = {"swap": 1, "delay": 8}
_CUT = {8: 7, 64: 48}
FAULTS = ("drop", "duplicate", "cut", "count", *_HOLD)


class Injector:
    """Harms each ``every``-th frame of each of the ``ids``; ``send`` passes frames on."""

    def __init__(self, fault: str, every: int, ids: list[int], send: Send) -> None:
        if fault not in FAULTS:
            raise SystemExit(f"injector: no fault {fault}; there are {', '.join(FAULTS)}")
        self._fault = fault
        self._every = every
        self._seen = Counter[int](dict.fromkeys(ids, 0))
        self._held: dict[int, tuple[int, bytes]] = {}
        self._send = send

    def take(self, frame: bytes) -> None:
        """A frame from the node."""
        identifier, length, flags = _HEADER.unpack_from(frame)
        if identifier not in self._seen:
            self._send(frame)
            return
        self._seen[identifier] += 1
        if self._seen[identifier] % self._every != 0:
            self._send(frame)
            self._release(identifier)
            return
        print(f"{identifier:X}#{frame[_HEADER.size :][:length].hex().upper()}")
        if self._fault == "duplicate":
            self._send(frame)
            self._send(frame)
        elif self._fault in _HOLD:
            self._held[identifier] = (self._seen[identifier] + _HOLD[self._fault], frame)
        elif self._fault == "cut":
            self._send(_HEADER.pack(identifier, _CUT[length], flags) + frame[_HEADER.size :])
        elif self._fault == "count":
            counter = frame[_HEADER.size] ^ 8
            self._send(frame[: _HEADER.size] + bytes([counter]) + frame[_HEADER.size + 1 :])

    def _release(self, identifier: int) -> None:
        """Sends what was held back, when its time has come."""
        due, frame = self._held.get(identifier, (0, b""))
        if frame and self._seen[identifier] >= due:
            self._send(frame)
            del self._held[identifier]


def _open(interface: str) -> socket.socket:
    side = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    side.setsockopt(socket.SOL_CAN_RAW, socket.CAN_RAW_FD_FRAMES, 1)
    side.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4 << 20)
    side.bind((interface,))
    return side


def _end(_number: int, _frame: FrameType | None) -> None:
    sys.exit(0)


def main() -> None:
    """Command line; ends with SIGTERM."""
    node_name, host_name, fault, every, *ids = sys.argv[1:]
    node, host = _open(node_name), _open(host_name)
    injector = Injector(fault, int(every), [int(text, 16) & _ID for text in ids], host.send)
    selector = selectors.DefaultSelector()
    selector.register(node, selectors.EVENT_READ, injector.take)
    selector.register(host, selectors.EVENT_READ, node.send)
    signal.signal(signal.SIGTERM, _end)
    print(f"injector: {fault} on {node_name}", flush=True)
    while True:
        for key, _ in selector.select():
            assert isinstance(key.fileobj, socket.socket)
            key.data(key.fileobj.recv(_FD_SIZE))


if __name__ == "__main__":
    main()
