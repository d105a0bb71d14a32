"""Hardware in the loop: the emulated node as a process of its own, the host against it.

On a SocketCAN interface, which has to be there (tests/tools/with-vcan provides it), and on SLCAN
over a pseudo-terminal and over TCP.
"""

from __future__ import annotations

import os
import re
import socket
import subprocess
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from axistwin.cli import main

VCAN = "vcan0"
REPOSITORY = Path(__file__).resolve().parent.parent.parent
# In a guest on a busy machine a process may have to wait for its turn longer than a drive would.
PATIENCE = ("--heartbeat-timeout", "3")
# The same the other way round: where it is not what a test is about, a drive waits for its host.
WATCHDOG = ("--watchdog", "5000")
READY = re.compile(r"axistwin-emulator: node (\d+) on (\w+) (\S+), ")


@dataclass(frozen=True)
class Carrier:
    """A way for frames to travel: the emulator's argument, and the host's."""

    name: str
    bus: str
    host: tuple[str, ...]


@dataclass
class Emulator:
    """An emulated node that runs on a carrier."""

    carrier: Carrier
    arguments: tuple[str, ...]
    process: subprocess.Popen[str] = field(init=False)
    channel: str = field(init=False)  # an interface, a terminal, or an address

    def __post_init__(self) -> None:
        self.start()

    def start(self) -> None:
        """Starts the process, or starts it again, and waits until it is on the bus."""
        program = os.environ.get("AXISTWIN_EMULATOR") or str(
            REPOSITORY / "build" / "axistwin-emulator"
        )
        command = [program, "--bus", self.carrier.bus, *WATCHDOG, *self.arguments]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        ready = READY.match(line)
        assert ready, f"{command} says {line!r}"
        self.channel = ready[3]

    def kill(self) -> None:
        """Ends it as a power failure would."""
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()

    def stop(self) -> str:
        """Ends it properly; returns its last words."""
        self.process.terminate()
        output, _ = self.process.communicate(timeout=30)
        assert self.process.returncode == 0
        return output


StartEmulator = Callable[..., Emulator]


@dataclass(frozen=True)
class Outcome:
    """What a command said, and its exit status."""

    status: int
    output: str
    messages: str

    def expect(self, status: int, *words: str) -> None:
        """Checks the exit status, that the words were said, and that nothing crashed."""
        assert self.status == status, self.messages
        for word in words:
            assert word in self.messages
        assert "Traceback" not in self.messages


Host = Callable[..., Outcome]


@pytest.fixture(params=["vcan", "pty", "tcp"])
def carrier(request: pytest.FixtureRequest, tmp_path: Path) -> Carrier:
    """Each carrier in turn."""
    if request.param == "pty":
        link = str(tmp_path / "slcan")
        return Carrier("pty", f"pty:{link}", ("-i", "slcan", "-c", link, *PATIENCE))
    if request.param == "tcp":
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            port = probe.getsockname()[1]
        channel = f"socket://127.0.0.1:{port}"
        return Carrier("tcp", f"tcp:{port}", ("-i", "slcan", "-c", channel, *PATIENCE))
    return vcan_carrier()


@pytest.fixture
def vcan() -> Carrier:
    """The SocketCAN interface."""
    return vcan_carrier()


def vcan_carrier() -> Carrier:
    """The SocketCAN interface; a failure, not a skip, where there is none."""
    if VCAN not in [name for _, name in socket.if_nameindex()]:
        pytest.fail(f"there is no {VCAN} here; run these tests through tests/tools/with-vcan")
    return Carrier("vcan", VCAN, ("-i", "socketcan", "-c", VCAN, *PATIENCE))


@pytest.fixture
def start_emulator() -> Iterator[StartEmulator]:
    """Starts emulators that end with the test."""
    started: list[Emulator] = []

    def start(carrier: Carrier, *arguments: str) -> Emulator:
        started.append(Emulator(carrier, arguments))
        return started[-1]

    yield start
    for emulator in started:
        if emulator.process.poll() is None:
            emulator.kill()


@pytest.fixture
def host(capfd: pytest.CaptureFixture[str]) -> Host:
    """Runs a command line of the host, in this process."""

    def run(*arguments: str) -> Outcome:
        capfd.readouterr()
        try:
            status = main(arguments)
        except SystemExit as end:
            status = end.code if isinstance(end.code, int) else 1
        captured = capfd.readouterr()
        return Outcome(status, captured.out, captured.err)

    return run
