"""The drive as a host sees it: enabled step by step, stopped by its limits and by silence."""

from __future__ import annotations

import argparse
import itertools
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import can
import pytest

from axistwin import bus
from axistwin.contract import load_contract
from axistwin.errors import CommandRefusedError, DriveFaultError

from .conftest import VCAN, Carrier, Host, StartEmulator

CONTRACT = load_contract()
RATE = 10000

# Where the host's silence is not what a test is about, and where it is [ms].
PATIENT, WATCHDOG = "5000", 400


@contextmanager
def connected(carrier: Carrier) -> Iterator[bus.Node]:
    parser = argparse.ArgumentParser()
    bus.add_arguments(parser)
    arguments = parser.parse_args(carrier.host)
    with bus.node_of(arguments) as node:
        node.connect(10.0, lambda _: None)
        yield node


def poll_until(node: bus.Node, condition: Callable[[], bool]) -> None:
    assert node.wait_until(condition, 20.0)


def test_a_host_enables_stops_and_enables_again(
    carrier: Carrier, start_emulator: StartEmulator
) -> None:
    start_emulator(carrier, "--stream-rate", "50", "--watchdog", PATIENT)
    with connected(carrier) as node:
        with pytest.raises(CommandRefusedError, match="operation is not enabled"):
            node.command("ExcitationOn")
        node.enable()
        assert node.state == "OperationEnabled"
        with pytest.raises(CommandRefusedError, match="not while operation is enabled"):
            node.command("SpeedLimit", 100)
        node.quick_stop()
        assert node.state == "QuickStopActive"
        node.enable()
        assert node.state == "OperationEnabled"
        node.disable()
        assert node.state == "SwitchOnDisabled"


def test_limits_stop_the_drive_and_say_why(vcan: Carrier, start_emulator: StartEmulator) -> None:
    start_emulator(vcan, "--limits", "0.5,60", "--watchdog", PATIENT)
    with connected(vcan) as node:
        with pytest.raises(CommandRefusedError, match="the argument is out of range"):
            node.command("SpeedLimit", 61)
        for limits, why in (
            ({"TravelMax": 1000}, "left its travel range"),
            ({"TravelMax": 2**31 - 1, "SpeedLimit": 50}, "faster than its speed limit"),
        ):
            for name, value in limits.items():
                node.command(name, value)
            node.enable()
            node.set_torque(0.001)
            poll_until(node, lambda: node.fault is not None)
            with pytest.raises(DriveFaultError, match=why):
                node.check_drive()
            node.reset_fault()
            assert node.fault is None


def test_a_log_says_that_the_drive_went_into_fault(
    vcan: Carrier, start_emulator: StartEmulator, host: Host, tmp_path: Path
) -> None:
    start_emulator(vcan, "--limits", "0.5,1", "--watchdog", PATIENT)
    log = tmp_path / "fault.log"
    outcome = host("log", *vcan.host, "--excite", "--duration", "2", "-f", str(log))
    outcome.expect(3, "node 1 is in fault, its torque off: the axis is faster than its speed limit")


def test_torque_stops_half_a_second_after_the_last_heartbeat_of_a_killed_host(
    vcan: Carrier, start_emulator: StartEmulator
) -> None:
    """By the node's own clock, the sample counter of its stream, in the order of the bus."""
    start_emulator(
        vcan, "--rate", str(RATE), "--stream-rate", "1000", "--stream", "--watchdog", "400"
    )
    command = [sys.executable, "-m", "axistwin", "excite", "on", *vcan.host]
    heartbeat = CONTRACT.identifier("Heartbeat", CONTRACT.host)
    motor = CONTRACT.identifier("Motor", 1)
    counter = CONTRACT.reader("Motor", "Counter")
    seen: list[can.Message] = []
    killed = False
    with (
        can.Bus(interface="socketcan", channel=VCAN) as observer,
        subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process,
    ):
        assert process.stdout is not None
        assert process.stdout.readline() == "node 1: excitation on\n"
        while observer.recv(0.0) is not None:
            pass
        end = time.monotonic() + 20.0
        while time.monotonic() < end and (message := observer.recv(1.0)) is not None:
            if message.arbitration_id in (heartbeat, motor):
                seen.append(message)
            if not killed and sum(m.arbitration_id == heartbeat for m in seen) == 3:
                process.send_signal(signal.SIGKILL)
                process.wait()
                killed = True
                end = time.monotonic() + 3.0
    assert killed
    last = max(i for i, m in enumerate(seen) if m.arbitration_id == heartbeat)
    samples = [m for m in seen[last:] if m.arbitration_id == motor]
    acting = [i for i, m in enumerate(samples) if any(m.data[6:8])]
    assert samples[-1].data[6:8] == b"\0\0"
    assert len(acting) > 100  # torque went on for a while
    stopped = counter(bytes(samples[acting[-1]].data)) - counter(bytes(samples[0].data))
    assert stopped % 65536 <= 500  # samples 1 ms apart


def test_every_sample_of_ten_kilohertz_comes_on_can_fd(
    vcan: Carrier, start_emulator: StartEmulator
) -> None:
    start_emulator(
        vcan, "--rate", str(RATE), "--bit-rate", "1000000,5000000", "--watchdog", PATIENT
    )
    samples = CONTRACT.identifier("Samples", 1)
    counter = CONTRACT.reader("Samples", "Counter")
    with connected(vcan) as node, can.Bus(interface="socketcan", channel=VCAN, fd=True) as observer:
        assert int(node.pages["Features"]) & 1
        node.command("StreamStartFd")
        end = time.monotonic() + 3.0
        counters = []
        while time.monotonic() < end:
            message = observer.recv(1.0)
            if message is not None and message.arbitration_id == samples:
                assert message.is_fd
                assert len(message.data) == 64
                counters.append(counter(bytes(message.data)))
        node.command("StreamStop")
        node.command("Identify")
        poll_until(node, lambda: "LostSamples" in node.pages)
        assert node.pages["LostSamples"] == 0
    steps = {(b - a) % 65536 for a, b in itertools.pairwise(counters)}
    assert steps == {6}
    assert len(counters) > 1000
