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
import pytest

from axistwin.readers import read_record

from .conftest import REPOSITORY, VCAN, Carrier, Emulator, Host, StartEmulator

# The contract's identifiers are those of node 0: these bits of an identifier say which message.
CONTRACT = (str(REPOSITORY / "drivers" / "contract" / "axistwin.dbc"), "-m", "0x780")
IDENTIFY, STREAM_START = "201#0100000000000000", "201#0200000000000000"
FAR = "vcan1"
PATIENCE = 60.0
ROWS, COLUMNS = 60, 160


def run(*command: str) -> str:
    """What a program says; it has to end well."""
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True, timeout=PATIENCE)
    return done.stdout


def wait_until(condition: Callable[[], bool]) -> None:
    """Waits for what another program does."""
    end = time.monotonic() + PATIENCE
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.05)


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


def candump(count: int, *, interface: str = VCAN, cause: Callable[[], object]) -> str:
    """So many frames as candump logs them, after it was there to see what causes them."""
    command = ("candump", "-L", "-n", str(count), interface)
    with listening(interface, *command) as process:
        cause()
        return process.communicate(timeout=PATIENCE)[0]


def read_screen(screen: int) -> bytes:
    """What a terminal shows next; a program that shows nothing has failed."""
    ready, _, _ = select.select([screen], [], [], PATIENCE)
    assert ready
    return os.read(screen, 65536)


def on_screen(command: tuple[str, ...], *words: str) -> None:
    """Runs a program on a terminal until it has shown all the words, and quits it by `q`."""
    screen, terminal = pty.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    environment = {**os.environ, "TERM": "xterm"}
    process = subprocess.Popen(
        command, stdin=terminal, stdout=terminal, stderr=terminal, env=environment
    )
    os.close(terminal)
    shown = b""
    try:
        end = time.monotonic() + PATIENCE
        while not all(word.encode() in shown for word in words):
            assert time.monotonic() < end, shown
            shown += read_screen(screen)
        os.write(screen, b"q")
        while process.poll() is None:
            read_screen(screen)
    except OSError:  # the terminal is gone, and so is the program
        process.wait(PATIENCE)
    finally:
        process.kill()
        os.close(screen)
    assert process.wait() == 0, shown


streaming = pytest.mark.usefixtures("streaming_node")


@pytest.fixture
def streaming_node(vcan: Carrier, start_emulator: StartEmulator) -> Emulator:
    """A node that streams."""
    return start_emulator(vcan, "--stream", "--stream-rate", "100")


@streaming
def test_a_log_of_candump_is_read_and_canplayer_plays_it_again(tmp_path: Path) -> None:
    original, again = tmp_path / "original.log", tmp_path / "again.log"
    original.write_text(candump(300, cause=lambda: run("cansend", VCAN, IDENTIFY)))
    run("ip", "link", "add", "dev", FAR, "type", "vcan")
    run("ip", "link", "set", FAR, "up")
    try:
        play = ("canplayer", "-I", str(original), f"{FAR}={VCAN}")
        again.write_text(candump(300, interface=FAR, cause=lambda: run(*play)))
    finally:
        run("ip", "link", "del", FAR)
    record, copy = read_record(original), read_record(again)
    assert len(record) > 50
    assert len(record.missing) == 0
    assert np.array_equal(record.theta1, copy.theta1)
    assert np.array_equal(record.torque, copy.torque)


@streaming
def test_python_can_logs_and_shows_what_the_node_sends(tmp_path: Path) -> None:
    bus = ("-i", "socketcan", "-c", VCAN)
    log = tmp_path / "python-can.asc"
    with listening(VCAN, sys.executable, "-m", "can.logger", *bus, "-f", str(log)) as logger:
        run("cansend", VCAN, IDENTIFY)
        wait_until(lambda: log.exists() and log.stat().st_size > 20000)
        logger.send_signal(signal.SIGINT)
        logger.wait(PATIENCE)
    record = read_record(log)
    assert len(record) > 50
    assert len(record.missing) == 0
    viewer = (sys.executable, "-m", "can.viewer", *bus)
    on_screen(viewer, "0x181", "0x281", "0x381", "0x701")


@streaming
def test_cantools_decodes_frames_by_our_contract() -> None:
    frames = candump(200, cause=lambda: run("cansend", VCAN, IDENTIFY))
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
def test_cantools_monitors_by_our_contract() -> None:
    bus = ("-i", "socketcan", "-c", VCAN)
    on_screen(
        (sys.executable, "-m", "cantools", "monitor", *bus, *CONTRACT),
        "Motor(",
        "Table(",
        "Heartbeat(",
        "State: Operational",
    )


def test_canopen_follows_the_heartbeat(vcan: Carrier, start_emulator: StartEmulator) -> None:
    network = canopen.Network()
    network.connect(interface="socketcan", channel=VCAN)
    try:
        nmt = network.add_node(1, canopen.ObjectDictionary()).nmt  # type: ignore[no-untyped-call]
        emulator = start_emulator(vcan)
        nmt.wait_for_bootup(PATIENCE)
        assert nmt.wait_for_heartbeat(PATIENCE) == "PRE-OPERATIONAL"
        run("cansend", VCAN, STREAM_START)
        wait_until(lambda: nmt.state == "OPERATIONAL")
        emulator.stop()
        wait_until(lambda: nmt.state == "STOPPED")
    finally:
        network.disconnect()


@streaming
def test_isotp_transfers_pass_beside_the_stream(tmp_path: Path) -> None:
    """Twenty consecutive frames and flow control between two others do not disturb the node."""
    sent = " ".join(f"{i % 256:02X}" for i in range(140))
    log = tmp_path / "beside.log"
    receiver = subprocess.Popen(
        ["isotprecv", "-s", "7E1", "-d", "7E9", VCAN], stdout=subprocess.PIPE, text=True
    )

    def transfer() -> None:
        run("cansend", VCAN, IDENTIFY)
        command = ["isotpsend", "-s", "7E9", "-d", "7E1", "-b", VCAN]
        subprocess.run(command, input=sent, check=True, text=True, timeout=PATIENCE)

    try:
        log.write_text(candump(300, cause=transfer))
        assert receiver.communicate(timeout=PATIENCE)[0].split() == sent.split()
    finally:
        receiver.kill()
        receiver.wait()
    assert len(read_record(log).missing) == 0


def test_the_kernels_slcan_makes_an_interface_of_a_pseudo_terminal(
    start_emulator: StartEmulator, host: Host, tmp_path: Path
) -> None:
    """It opens the channel itself, with the bit rate that ip has been told."""
    emulator = start_emulator(Carrier("pty", "pty", ()), "--stream-rate", "100")
    terminal = emulator.channel
    command = ["stdbuf", "-oL", "slcan_attach", "-w", terminal]
    holder = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, bufsize=1
    )
    try:
        assert holder.stdout is not None
        said = holder.stdout.readline()
        attached = re.match(rf"attached tty {terminal} to netdevice (\w+)$", said)
        assert attached, f"no SLCAN in this kernel? {said}"
        interface = attached[1]
        # The line discipline makes it in the first network namespace, which need not be ours.
        run(
            "nsenter",
            "--target",
            "1",
            "--net",
            "ip",
            "link",
            "set",
            interface,
            "netns",
            str(os.getpid()),
        )
        run("ip", "link", "set", interface, "type", "can", "bitrate", "1000000")
        run("ip", "link", "set", interface, "up")
        log = tmp_path / "slcan.log"
        host("log", "-i", "socketcan", "-c", interface, "--duration", "2", "-f", str(log)).expect(0)
        run("ip", "link", "set", interface, "down")
    finally:
        holder.communicate("\n", timeout=PATIENCE)
    record = read_record(log)
    assert len(record) > 100
    assert len(record.missing) == 0
    assert "bus: 0 error frames" in emulator.stop()
