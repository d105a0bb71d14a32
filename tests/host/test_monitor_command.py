"""`axistwin monitor`: what it hears, without a word to the bus."""

from __future__ import annotations

import json
from pathlib import Path

import can
import pytest

from axistwin.commands import monitor
from axistwin.contract import load_contract

from .drive_process import axistwin, run, running_drive
from .test_frames import Axis, message, stream
from .test_log_durability import messages_of
from .test_stream_faults import classical

CONTRACT = load_contract()


def test_a_drive_is_shown_and_summed_up(tmp_path: Path) -> None:
    line, summary = tmp_path / "line", tmp_path / "seen.json"
    with running_drive(line, "--stream", "--stream-rate", "200"):
        command = axistwin("monitor", line, summary, "--duration", "2.5")
        command[command.index("-f")] = "--json"
        ran = run(command)
    assert ran.returncode == 0, ran.stderr
    found = json.loads(summary.read_text())
    assert [node["id"] for node in found["nodes"]] == [1]
    node = found["nodes"][0]
    assert (node["state"], node["drive"]) == ("Operational", "SwitchOnDisabled")
    assert node["samples"] > 100
    assert (node["lost"], node["restarts"], node["two_nodes"]) == (0, 0, False)
    assert 0.0 < found["bus_load"] < 0.2


def test_no_node_at_all_is_said(tmp_path: Path) -> None:
    line, summary = tmp_path / "line", tmp_path / "seen.json"
    with running_drive(line, "--node", "1"):
        command = axistwin("monitor", line, summary, "--node", "7", "--duration", "1")
        command[command.index("-f")] = "--json"
        ran = run(command)
    assert ran.returncode == 3
    assert "heard no heartbeat of a node" in ran.stderr
    assert json.loads(summary.read_text())["nodes"] == []


def test_every_node_is_heard_and_nobody_else(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 0.0
    monkeypatch.setattr("axistwin.commands.monitor.time.monotonic", lambda: now)
    listener = monitor._Listener(CONTRACT, None)
    for item in stream(Axis(20), node=9):  # has these identifiers, but no heartbeat
        listener(item)
    first, second = list(messages_of(classical(100).sent)), stream(Axis(100), node=2)
    for i, pair in enumerate(zip(first, second, strict=True)):
        if i % 4 == 0:
            for node in (1, 2, 2):  # there are two with id 2
                listener(message("Heartbeat", {"State": 5}, now, node))
        if i != 100:  # lost
            listener(pair[0])
        listener(pair[1])
        now += 0.025
    listener(can.Message(is_error_frame=True))
    listener(can.Message(arbitration_id=0x701, data=b"\x00\x00", is_extended_id=False))
    assert sorted(listener.nodes) == [1, 2]
    one, two = listener.nodes[1], listener.nodes[2]
    assert (one.stream.samples, one.stream.lost) == (99, 1)
    assert (two.stream.samples, two.stream.lost) == (100, 0)
    assert (monitor._drive(CONTRACT, one), one.state) == ("OperationEnabled", "Operational")
    assert (one.twice(now), two.twice(now)) == (False, True)
    assert monitor._sample(CONTRACT, one).startswith("torque ")
    assert listener.errors == 1
    listener(message("Heartbeat", {"State": 0}, now, 1))
    assert (one.restarts, one.state) == (1, "BootUp")
