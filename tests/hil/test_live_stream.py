"""The live stream on a real CAN interface: nothing is lost, and what is wrong is seen."""

from __future__ import annotations

import argparse
import json
import socket
import threading
import time
from pathlib import Path

import can
import pytest
from can.interfaces.socketcan import SocketcanBus

from axistwin import bus, frames
from axistwin.readers import read_record

from .carriers import ALONE, INTERFACE, MINUTE, OWN, SECOND, Carrier, EmulatorCarrier
from .conftest import Host, during, pages

# A minute for the node: on an emulated processor its seconds may last longer than ours.
DURATION = 60.0
PATIENCE = 300.0
RATE = 1000.0
SLOW_STREAM = ("--stream-rate", "100")


def await_samples(log: Path, samples: int) -> None:
    """Until there are as many in the file."""
    end, count = time.monotonic() + PATIENCE, 0
    with log.open() as growing:
        while count < samples:
            assert time.monotonic() < end
            time.sleep(0.5)
            count += growing.read().count(" 181#")


@pytest.mark.needs(MINUTE)
def test_a_minute_of_live_stream_without_a_lost_sample(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    log, summary = tmp_path / "minute.log", tmp_path / "minute.json"
    with during(log, lambda: await_samples(log, round(DURATION * RATE) + 10)):
        outcome = host("log", *carrier.host, "--excite", "-f", str(log), "--json", str(summary))
    print(outcome.messages)
    outcome.expect(0)

    found = json.loads(summary.read_text())
    assert found["lost"] == 0
    assert found["bus_errors"] == 0
    assert found["gaps"] == []
    assert found["samples"] >= DURATION * RATE
    assert 0.05 < found["bus_load"] < 0.35  # 2000 frames/s of at most 135 bits at 1 Mbit/s

    record = read_record(log)
    assert len(record) == found["samples"]
    assert len(record.missing) == 0
    assert record.time_step == pytest.approx(1.0 / RATE, rel=1e-4)
    assert record.counts_per_turn == (1 << 20, 1 << 20)
    assert pages(carrier)["LostSamples"] == 0


@pytest.mark.needs(INTERFACE)
def test_frames_of_others_and_frames_of_the_wrong_length_do_no_harm(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    log = tmp_path / "disturbed.log"
    with can.Bus(carrier.channel, "socketcan") as other:
        tasks = [
            other.send_periodic(
                can.Message(arbitration_id=identifier, data=data, is_extended_id=extended), 0.05
            )
            for identifier, data, extended in (
                (0x181, b"\x00" * 5, False),  # a Motor frame cut short
                (0x381, b"\x02", False),  # a report cut short
                (0x701, b"", False),  # a heartbeat that says nothing
                (0x1A5, b"\xff" * 8, False),  # another device of the bus
                (0x18FF0181, b"\xff" * 8, True),
            )
        ]
        outcome = host("log", *carrier.host, *SLOW_STREAM, "--duration", "3", "-f", str(log))
        for task in tasks:
            task.stop()
    outcome.expect(0)
    record = read_record(log)
    assert len(record) > 200
    assert len(record.missing) == 0
    assert any("Motor frames do not have 8 bytes" in warning for warning in record.warnings)


@pytest.mark.needs(ALONE)
def test_lost_frames_are_counted_and_interpolated(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    log, thinned = tmp_path / "whole.log", tmp_path / "thinned.log"
    host("log", *carrier.host, *SLOW_STREAM, "--excite", "--duration", "3", "-f", str(log)).expect(
        0
    )
    lines = log.read_text().splitlines(keepends=True)
    motor = [i for i, line in enumerate(lines) if " 181#" in line]
    dropped = [motor[20], motor[21], motor[100]]
    thinned.write_text("".join(line for i, line in enumerate(lines) if i not in dropped))
    whole, record = read_record(log), read_record(thinned)
    assert record.missing.tolist() == [20, 21, 100]
    kept = [i for i in range(len(whole)) if i not in (20, 21, 100)]
    assert (record.torque[kept] == whole.torque[kept]).all()
    assert (record.time == whole.time).all()


@pytest.mark.needs(SECOND)
def test_two_nodes_share_a_bus(carrier: EmulatorCarrier, host: Host, tmp_path: Path) -> None:
    carrier.start("--node", "1", "--stream-rate", "100", "--stream")
    carrier.start("--node", "2", "--stream-rate", "50", "--stream")
    log = tmp_path / "two.log"
    host("log", *carrier.host, "--node", "2", "--duration", "2", "-f", str(log)).expect(0)
    record = read_record(log)
    assert record.meta["node"] == 2
    assert record.time_step == pytest.approx(0.02, rel=1e-3)
    assert len(record.missing) == 0
    # the other one is in the log, too
    settings = frames.Settings(1, 0.01, 0.64, (1 << 20, 1 << 20))
    assert read_record(log, settings=settings).time_step == 0.01


@pytest.mark.needs(SECOND)
def test_two_nodes_are_logged_into_a_record_each(
    carrier: EmulatorCarrier, host: Host, tmp_path: Path
) -> None:
    """An XY table; one of its drives fails and comes back, the other one is not kept waiting."""
    carrier.start("--node", "1", "--stream-rate", "100")
    second = carrier.start("--node", "2", "--stream-rate", "50")

    def restart() -> None:
        second.kill()
        threading.Event().wait(1.5)
        second.start()

    disturbance = threading.Timer(3.0, restart)
    disturbance.start()
    log, summary = tmp_path / "table.log", tmp_path / "table.json"
    arguments = ("--duration", "10", "--wait", "30", "-f", str(log), "--json", str(summary))
    nodes = ("--node", "1", "--node", "2")
    outcome = host("log", *carrier.host, *nodes, *arguments)
    disturbance.join()
    outcome.expect(3, "node 2 is back after", "gap from")

    first, other = (read_record(log, settings=frames.Settings(node=node)) for node in (1, 2))
    assert (first.meta["node"], other.meta["node"]) == (1, 2)
    assert first.time_step == pytest.approx(0.01, rel=1e-3)
    assert other.time_step == pytest.approx(0.02, rel=1e-3)
    assert len(first) > 900
    assert len(first.missing) == len(other.missing) == 0
    assert other.meta["frames"]["restarts"] == 1
    found = json.loads(summary.read_text())
    assert [node["id"] for node in found["nodes"]] == [1, 2]
    assert [len(node["gaps"]) for node in found["nodes"]] == [0, 1]
    assert found["nodes"][0]["record"]["samples"] == len(first)


@pytest.mark.needs(OWN)
def test_what_this_computer_has_no_room_for_is_counted(carrier: Carrier) -> None:
    parser = argparse.ArgumentParser()
    bus.add_arguments(parser, several=True)
    with (
        can.Bus(carrier.channel, "socketcan") as other,
        bus.nodes_of(parser.parse_args(carrier.host)) as (shared, _),
    ):
        port = shared.open_port()
        assert isinstance(shared.bus, SocketcanBus)
        shared.bus.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        for _ in range(500):
            other.send(can.Message(arbitration_id=0x123, data=b"12345678", is_extended_id=False))
        received = 0
        while port.recv(0.0) is not None:
            received += 1
        assert 0 < received < 500
        assert received + shared.dropped == 500
