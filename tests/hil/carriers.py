"""What carries the frames between a node and the host, and what a carrier cannot do.

A test that takes the fixture `carrier` runs on each of CARRIERS that has what the test `needs`, and
does not know which it is. LACKS says what a carrier has not, and why: a test that needs it is not
collected there.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import pytest
from board import Board

VCAN = "vcan0"
ATTACHED = "attached0"  # what the kernel makes of a line
REPOSITORY = Path(__file__).resolve().parent.parent.parent
# In a guest on a busy machine a process may have to wait for its turn longer than a drive would.
PATIENCE = ("--heartbeat-timeout", "3")
# The same the other way round: where it is not what a test is about, a drive waits for its host.
# Control rate and room for a trace are those of a microcontroller.
AS_BUILT = ("--watchdog", "5000", "--rate", "10000", "--trace-size", "8192")
READY = re.compile(r"axistwin-emulator: node (\d+) on (\w+) (\S+), ")


class Node(Protocol):
    """A node that can be started, again and again, and lose its power."""

    def start(self) -> None:
        """Powers it up."""

    def kill(self) -> None:
        """Ends it as a power failure would."""


class Emulator:
    """The emulator, a process, on a bus as its option --bus names it."""

    def __init__(self, bus: str, options: tuple[str, ...]) -> None:
        program = os.environ.get("AXISTWIN_EMULATOR") or str(
            REPOSITORY / "build" / "axistwin-emulator"
        )
        self._command = [program, "--bus", bus, *AS_BUILT, *options]
        self._process: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Starts the process, and waits until it says that it is on the bus."""
        self._process = subprocess.Popen(self._command, stdout=subprocess.PIPE, text=True)
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        assert READY.match(line), f"{self._command} says {line!r}"

    def kill(self) -> None:
        """Kills the process, if it has not ended."""
        if self._process is not None:
            self._process.kill()
            self._process.communicate()
            self._process = None

    def stop(self) -> str:
        """Ends it properly; returns its last words."""
        assert self._process is not None
        self._process.terminate()
        output, _ = self._process.communicate(timeout=30)
        assert self._process.returncode == 0
        self._process = None
        return output


class Carrier(ABC):
    """A bus, as python-can names it: an ``interface``, and a ``channel``.

    ``host`` is what the host's command line says to get there. Use it as a context manager: nodes
    that were started on it end with it.
    """

    def __init__(self, interface: str, channel: str) -> None:
        self.channel = channel
        self.host = ("-i", interface, "-c", channel, *PATIENCE)
        self._nodes: list[Node] = []

    def __enter__(self) -> Carrier:
        return self

    def __exit__(self, *_: object) -> None:
        for node in self._nodes:
            node.kill()

    @abstractmethod
    def start(self) -> Node:
        """Starts a node."""


class EmulatorCarrier(Carrier):
    """A carrier with emulators on a bus as their option --bus names it."""

    def __init__(self, bus: str, interface: str, channel: str) -> None:
        super().__init__(interface, channel)
        self._bus = bus

    def start(self, *options: str) -> Emulator:
        """Starts an emulator; a test that gives it ``options`` needs OPTIONS."""
        emulator = Emulator(self._bus, options)
        self._nodes.append(emulator)
        emulator.start()
        return emulator


class BoardCarrier(Carrier):
    """A carrier with one ``node``, which is a ``board`` or stands on it."""

    def __init__(self, board: Board, node: Node, interface: str, channel: str) -> None:
        super().__init__(interface, channel)
        self._board = board
        self._node = node

    def __exit__(self, *_: object) -> None:
        super().__exit__()
        self._board.close()

    def start(self) -> Node:
        """Starts the node."""
        self._nodes.append(self._node)
        self._node.start()
        return self._node


class Attached:
    """A node with SLCAN on a terminal, and the interface that the kernel makes of it.

    They come and go together, as with an adapter on USB.
    """

    def __init__(self, node: Node, terminal: str) -> None:
        self._node = node
        self._terminal = terminal
        self._holder: subprocess.Popen[str] | None = None

    def start(self) -> None:
        """Starts the node, and has the kernel open its channel."""
        self._node.start()
        command = ["stdbuf", "-oL", "slcan_attach", "-w", self._terminal]
        self._holder = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
        )
        assert self._holder.stdout is not None
        said = self._holder.stdout.readline()
        found = re.match(rf"attached tty {self._terminal} to netdevice (\w+)$", said)
        assert found, f"no SLCAN in this kernel? {said}"
        # The line discipline makes it in the first network namespace, which need not be ours.
        first = ["nsenter", "--target", "1", "--net"]
        ours = ["netns", str(os.getpid()), "name", ATTACHED]
        subprocess.run([*first, "ip", "link", "set", found[1], *ours], check=True)
        up = ["type", "can", "bitrate", "1000000"]
        subprocess.run(["ip", "link", "set", ATTACHED, "up", *up], check=True)

    def kill(self) -> None:
        """Takes both away."""
        self._node.kill()
        if self._holder is not None:
            self._holder.communicate("\n", timeout=30)
            self._holder = None


def _vcan(_: Path) -> EmulatorCarrier:
    """SocketCAN: a virtual interface; a failure, not a skip, where there is none."""
    if VCAN not in [name for _, name in socket.if_nameindex()]:
        pytest.fail(f"there is no {VCAN} here; run these tests through tests/tools/with-vcan")
    return EmulatorCarrier(VCAN, "socketcan", VCAN)


def _pty(folder: Path) -> EmulatorCarrier:
    """SLCAN on a pseudo-terminal."""
    link = str(folder / "slcan")
    return EmulatorCarrier(f"pty:{link}", "slcan", link)


def _free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def _tcp(_: Path) -> EmulatorCarrier:
    """SLCAN over TCP."""
    port = _free_port()
    return EmulatorCarrier(f"tcp:{port}", "slcan", f"socket://127.0.0.1:{port}")


def _firmware(_: Path) -> BoardCarrier:
    """SLCAN on a UART of the board, which leads to a TCP socket."""
    port = _free_port()
    board = Board(f"socket,host=127.0.0.1,port={port},server=on,wait=off")
    return BoardCarrier(board, board, "slcan", f"socket://127.0.0.1:{port}")


def _interface(_: Path) -> BoardCarrier:
    """SLCAN on a UART of the board, which leads to a terminal, and the interface that is there."""
    board = Board("pty")
    return BoardCarrier(board, Attached(board, board.terminal), "socketcan", ATTACHED)


CARRIERS: dict[str, Callable[[Path], Carrier]] = {
    "vcan": _vcan,
    "pty": _pty,
    "tcp": _tcp,
    "firmware": _firmware,
    "interface": _interface,
}

# What a test may need of a carrier. An interface of the network, to
INTERFACE = "share with other programs"
OWN = "harm, fill, or have without a node"
FD = "send CAN FD frames over"
CLOCK = "meet a node on whose clock the host goes, too"
# The emulator, for
OPTIONS = "a node that is built or set as no host can"
SECOND = "a second node"
# Nothing special, but time, and once is enough:
MINUTE = "a minute"
ALONE = "any stream, for what the host does by itself"

_LINE = "an SLCAN line is its two ends: one host, one node"
_NO_FD = "SLCAN of python-can, of the kernel and of the firmware is classical CAN"
_BUILT = "an image is built once"
_ON_PTY = "see pty"
_ON_VCAN = "see vcan"

LACKS: dict[str, dict[str, str]] = {
    "vcan": {
        ALONE: _ON_PTY,
    },
    "pty": {
        INTERFACE: _LINE,
        OWN: _LINE,
        SECOND: _LINE,
        FD: _NO_FD,
        MINUTE: _ON_VCAN,
    },
    "tcp": {
        INTERFACE: _LINE,
        OWN: _LINE,
        SECOND: _LINE,
        FD: _NO_FD,
        OPTIONS: _ON_PTY,
        MINUTE: _ON_VCAN,
        ALONE: _ON_PTY,
    },
    "firmware": {
        INTERFACE: _LINE,
        OWN: _LINE,
        SECOND: _LINE,
        FD: _NO_FD,
        OPTIONS: _BUILT,
        ALONE: _ON_PTY,
    },
    "interface": {
        OWN: "it comes and goes with its node",
        SECOND: _LINE,
        FD: _NO_FD,
        CLOCK: "the seconds of a guest last longer than those of the board outside",
        OPTIONS: _BUILT,
        MINUTE: "see firmware",
        ALONE: _ON_PTY,
    },
}
