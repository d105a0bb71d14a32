"""The drive as a host sees it: enabled step by step, stopped by its limits and by silence."""

from __future__ import annotations

import itertools
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import can
import pytest

from axistwin import bus
from axistwin.contract import load_contract
from axistwin.errors import CommandRefusedError, DriveFaultError

from .carriers import CLOCK, FD, INTERFACE, VCAN, Carrier
from .conftest import Host, connected

CONTRACT = load_contract()

# As short as a drive is built with, where the host's silence is what a test is about [ms].
WATCHDOG = 400


def poll_until(node: bus.Node, condition: Callable[[], bool]) -> None:
    assert node.wait_until(condition, 20.0)


def test_a_host_enables_stops_and_enables_again(carrier: Carrier) -> None:
    carrier.start()
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


def test_limits_stop_the_drive_and_say_why(carrier: Carrier) -> None:
    carrier.start()
    with connected(carrier) as node:
        poll_until(node, lambda: "SpeedLimit" in node.pages)
        with pytest.raises(CommandRefusedError, match="the argument is out of range"):
            node.command("SpeedLimit", node.pages["SpeedLimit"] + 1)
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
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    with connected(carrier) as node:
        node.command("SpeedLimit", 1)
    log = tmp_path / "fault.log"
    outcome = host("log", *carrier.host, "--excite", "--duration", "2", "-f", str(log))
    outcome.expect(3, "node 1 is in fault, its torque off: the axis is faster than its speed limit")


@pytest.mark.needs(INTERFACE, CLOCK)
def test_torque_stops_soon_after_the_last_heartbeat_of_a_killed_host(carrier: Carrier) -> None:
    """By the node's own clock, the sample counter of its stream, in the order of the bus."""
    carrier.start()
    with connected(carrier) as node:
        node.command("HostHeartbeat", CONTRACT.host << 16 | WATCHDOG)
        node.command("StreamStart", 10)  # of 10 kHz
    command = [sys.executable, "-m", "axistwin", "excite", "on", *carrier.host]
    heartbeat = CONTRACT.identifier("Heartbeat", CONTRACT.host)
    motor = CONTRACT.identifier("Motor", 1)
    counter = CONTRACT.reader("Motor", "Counter")
    seen: list[can.Message] = []
    killed = False
    with (
        can.Bus(interface="socketcan", channel=carrier.channel) as observer,
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
    assert stopped % 65536 <= WATCHDOG + 100  # samples 1 ms apart


@pytest.mark.needs(FD)
def test_every_sample_of_ten_kilohertz_comes_on_can_fd(carrier: Carrier) -> None:
    carrier.start()
    samples = CONTRACT.identifier("Samples", 1)
    counter = CONTRACT.reader("Samples", "Counter")
    with (
        connected(carrier) as node,
        can.Bus(interface="socketcan", channel=VCAN, fd=True) as observer,
    ):
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
