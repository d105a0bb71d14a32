"""Programs that we did not write, on the same bus: they understand the node, and it them."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import select
import signal
import struct
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import canopen
import numpy as np
import pyte
import pytest

from axistwin.readers import read_record

from .carriers import CLOCK, INTERFACE, OWN, REPOSITORY, Carrier, EmulatorCarrier
from .conftest import wait_until

# The contract's identifiers are those of node 0: these bits of an identifier say which message.
CONTRACT = (str(REPOSITORY / "drivers" / "contract" / "axistwin.dbc"), "-m", "0x780")
IDENTIFY, STREAM_START = "201#0100000000000000", "201#0200000064000000"  # one of 100 samples
STREAM_SLOWLY = "201#02000000E8030000"  # one of 1000: all that a monitor reads, it has to write
FAR = "vcan1"
PATIENCE = 300.0
ROWS, COLUMNS = 30, 100


def run(*command: str) -> str:
    """What a program says; it has to end well."""
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True, timeout=PATIENCE)
    return done.stdout


def somebody_listens(interface: str) -> bool:
    """Has a program opened the interface for all frames? A node does not: it wants a few."""
    receivers = Path("/proc/net/can/rcvlist_all").read_text().splitlines()
    return any(line.split()[:1] == [interface] for line in receivers)


@contextmanager
def listening(interface: str, *command: str) -> Iterator[subprocess.Popen[str]]:
    """A program that has begun to listen on an interface, and that ends with this."""
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        wait_until(lambda: somebody_listens(interface))
        yield process
    finally:
        process.kill()
        process.communicate()


def candump(count: int, interface: str, *, cause: Callable[[], object]) -> str:
    """So many frames as candump logs them, after it was there to see what causes them."""
    command = ("candump", "-L", "-n", str(count), interface)
    with listening(interface, *command) as process:
        cause()
        return process.communicate(timeout=PATIENCE)[0]


def read_from(terminal: int) -> bytes:
    """What a program writes next; one that writes nothing has failed."""
    ready, _, _ = select.select([terminal], [], [], PATIENCE)
    assert ready
    return os.read(terminal, 65536)


def on_screen(command: tuple[str, ...], *words: str, typed: str = "") -> None:
    """Runs a program on a terminal until all the words are on its screen at once, and quits it by
    `q`; this is typed first.

    Where a line of text changes, a program writes no more than the characters that do: so the words
    are looked for on the screen, and not in what is written.
    """
    screen = pyte.Screen(COLUMNS, ROWS)
    stream = pyte.ByteStream(screen)
    ours, its = pty.openpty()
    fcntl.ioctl(its, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    environment = {**os.environ, "TERM": "linux"}  # which is what pyte emulates
    process = subprocess.Popen(command, stdin=its, stdout=its, stderr=its, env=environment)
    os.close(its)
    shown = ""
    try:
        os.write(ours, typed.encode())
        end = time.monotonic() + PATIENCE
        while not all(word in shown for word in words):
            assert time.monotonic() < end, shown
            stream.feed(read_from(ours))
            shown = "\n".join(screen.display)
        os.write(ours, b"q")
        while process.poll() is None:
            read_from(ours)
    except OSError:  # the terminal is gone, and so is the program
        process.wait(PATIENCE)
    finally:
        process.kill()
        process.wait()
        os.close(ours)
    assert process.returncode == 0, shown


pytestmark = pytest.mark.needs(INTERFACE)
streaming = pytest.mark.usefixtures("streaming_node")


@pytest.fixture
def streaming_node(carrier: Carrier) -> None:
    """A node that streams."""
    carrier.start()
    run("cansend", carrier.channel, STREAM_START)


@streaming
def test_a_log_of_candump_is_read_and_canplayer_plays_it_again(
    carrier: Carrier, tmp_path: Path
) -> None:
    near = carrier.channel
    original, again = tmp_path / "original.log", tmp_path / "again.log"
    original.write_text(candump(300, near, cause=lambda: run("cansend", near, IDENTIFY)))
    run("ip", "link", "add", "dev", FAR, "type", "vcan")
    run("ip", "link", "set", FAR, "up")
    try:
        play = ("canplayer", "-I", str(original), f"{FAR}={near}")
        again.write_text(candump(300, FAR, cause=lambda: run(*play)))
    finally:
        run("ip", "link", "del", FAR)
    record, copy = read_record(original), read_record(again)
    assert len(record) > 50
    assert len(record.missing) == 0
    assert np.array_equal(record.theta1, copy.theta1)
    assert np.array_equal(record.torque, copy.torque)


@streaming
def test_python_can_logs_and_shows_what_the_node_sends(carrier: Carrier, tmp_path: Path) -> None:
    bus = ("-i", "socketcan", "-c", carrier.channel)
    log = tmp_path / "python-can.asc"
    command = (sys.executable, "-m", "can.logger", *bus, "-f", str(log))
    with listening(carrier.channel, *command) as logger:
        run("cansend", carrier.channel, IDENTIFY)
        wait_until(lambda: log.exists() and log.stat().st_size > 20000)
        logger.send_signal(signal.SIGINT)
        logger.wait(PATIENCE)
    record = read_record(log)
    assert len(record) > 50
    assert len(record.missing) == 0
    viewer = (sys.executable, "-m", "can.viewer", *bus)
    on_screen(viewer, "0x181", "0x281", "0x381", "0x701")


@streaming
def test_cantools_decodes_frames_by_our_contract(carrier: Carrier) -> None:
    frames = candump(200, carrier.channel, cause=lambda: run("cansend", carrier.channel, IDENTIFY))
    command = (sys.executable, "-m", "cantools", "decode", "--single-line", *CONTRACT)
    decoded = subprocess.run(command, input=frames, capture_output=True, check=True, text=True)
    assert "Unknown frame id" not in decoded.stdout
    for said in (
        r"Motor\(Counter: \d+, Position: -?\d+ counts, Torque: 0.0 permille\)",
        r"Table\(Counter: \d+, Position: -?\d+ counts, StatusWord: \w+",
        r"Command\(Code: Identify",
        r"Report\(Page: RatedTorque, .*RatedTorque: 640 mN m\)",
        r"Heartbeat\(State: Operational\)",
    ):
        assert re.search(said, decoded.stdout), decoded.stdout[-3000:]


@streaming
@pytest.mark.needs(CLOCK)
def test_cantools_monitors_by_our_contract(carrier: Carrier) -> None:
    run("cansend", carrier.channel, STREAM_SLOWLY)
    bus = ("-i", "socketcan", "-c", carrier.channel)
    on_screen(
        (sys.executable, "-m", "cantools", "monitor", *bus, *CONTRACT),
        "Motor(",
        "Table(",
        "Heartbeat(",
        "State: Operational",
        typed="fMotor|Table|Heartbeat\n",  # a filter: all pages of the report are more than fit
    )


@contextmanager
def canopen_master(interface: str) -> Iterator[canopen.nmt.NmtMaster]:
    """What python-canopen knows of the node with id 1 on an interface."""
    network = canopen.Network()
    network.connect(interface="socketcan", channel=interface)
    try:
        yield network.add_node(1, canopen.ObjectDictionary()).nmt  # type: ignore[no-untyped-call]
    finally:
        network.disconnect()


def test_canopen_follows_the_heartbeat(carrier: Carrier) -> None:
    carrier.start()
    with canopen_master(carrier.channel) as master:
        assert master.wait_for_heartbeat(PATIENCE) == "PRE-OPERATIONAL"
        run("cansend", carrier.channel, STREAM_START)
        wait_until(lambda: master.state == "OPERATIONAL")


@pytest.mark.needs(OWN)
def test_canopen_sees_a_node_start_and_end(carrier: EmulatorCarrier) -> None:
    with canopen_master(carrier.channel) as master:
        emulator = carrier.start()
        master.wait_for_bootup(PATIENCE)
        assert master.wait_for_heartbeat(PATIENCE) == "PRE-OPERATIONAL"
        emulator.stop()
        wait_until(lambda: master.state == "STOPPED")


@streaming
def test_isotp_transfers_pass_beside_the_stream(carrier: Carrier, tmp_path: Path) -> None:
    """Twenty consecutive frames and flow control between two others do not disturb the node."""
    near = carrier.channel
    sent = " ".join(f"{i % 256:02X}" for i in range(140))
    log = tmp_path / "beside.log"
    receiver = subprocess.Popen(
        ["isotprecv", "-s", "7E1", "-d", "7E9", near], stdout=subprocess.PIPE, text=True
    )

    def transfer() -> None:
        run("cansend", near, IDENTIFY)
        command = ["isotpsend", "-s", "7E9", "-d", "7E1", "-b", near]
        subprocess.run(command, input=sent, check=True, text=True, timeout=PATIENCE)

    try:
        log.write_text(candump(300, near, cause=transfer))
        assert receiver.communicate(timeout=PATIENCE)[0].split() == sent.split()
    finally:
        receiver.kill()
        receiver.wait()
    assert len(read_record(log).missing) == 0
