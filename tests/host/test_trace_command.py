"""`axistwin trace` against a real drive: triggers, and uploads that are broken off."""

from __future__ import annotations

import json
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from axistwin.readers import read_record
from axistwin.record import Record

from .drive_process import axistwin, run, running_drive

RATE = 20_000.0


@pytest.fixture
def line(tmp_path: Path) -> Iterator[Path]:
    """The line of a drive whose torque is the excitation, from the start."""
    place = tmp_path / "line"
    fast = ("--bit-rate", "4000000", "--stream-rate", "100")
    with running_drive(place, "--rate", str(RATE), *fast, "--excite"):
        yield place


def traced(line: Path, file: Path, *arguments: str) -> tuple[Record, dict[str, object]]:
    summary = file.with_suffix(".json")
    ran = run(axistwin("trace", line, file, "--json", str(summary), *arguments))
    assert ran.returncode == 0, ran.stderr
    return read_record(file), json.loads(summary.read_text())


@pytest.mark.parametrize("edge", ["rising", "falling"])
def test_a_trace_begins_around_the_edge_that_it_waits_for(
    line: Path, tmp_path: Path, edge: str
) -> None:
    trigger = ("--trigger", f"{edge}:torque:0.2", "--pretrigger", "60", "-n", "300")
    record, summary = traced(line, tmp_path / "edge.csv", *trigger)
    assert len(record) == summary["samples"] == 300
    assert summary["trigger_sample"] == 60
    before, after = record.torque[59:61] if edge == "rising" else record.torque[59:61][::-1]
    assert before < 0.2 <= after + 1e-9


@pytest.mark.parametrize("level", ["above:torque:0.25", "below:theta1:1e3"])
def test_a_trace_waits_for_a_level(line: Path, tmp_path: Path, level: str) -> None:
    record, summary = traced(line, tmp_path / "level.csv", "--trigger", level, "-n", "50")
    assert len(record) == 50
    assert summary["trigger_sample"] in (0, None)
    if "torque" in level:
        assert record.torque[0] > 0.25 - 1e-9


def test_a_trace_may_keep_one_sample_in_many(line: Path, tmp_path: Path) -> None:
    record, summary = traced(line, tmp_path / "slow.csv", "--every", "10", "-n", "500")
    assert record.time_step == pytest.approx(10.0 / RATE)
    assert summary["time_step_s"] == record.time_step
    assert len(np.unique(record.torque)) > 100
    # the drive goes back to every sample for the next one
    record, _ = traced(line, tmp_path / "fast.csv", "-n", "50")
    assert record.time_step == pytest.approx(1.0 / RATE)


def test_a_trigger_that_does_not_come_is_given_up(line: Path, tmp_path: Path) -> None:
    file = tmp_path / "never.csv"
    never = ("--trigger", "above:torque:0.63", "--timeout", "1", "-n", "50")
    ran = run(axistwin("trace", line, file, *never))
    assert ran.returncode == 3
    assert "no trigger within 1 s (torque above 0.63)" in ran.stderr
    traced(line, file, "-n", "50")  # the drive is free for another one


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--trigger", "sideways:torque:1"), "is neither 'fault' nor like rising:torque:0.1"),
        (("--trigger", "rising:omega1:1"), "is neither 'fault' nor like rising:torque:0.1"),
        (("--trigger", "rising:torque:much"), "is no level"),
        (("--trigger", "rising:torque:nan"), "is no level"),
        (("--trigger", "rising:theta1:1e9"), "is out of range"),
        (("--pretrigger", "5"), "--pretrigger wants 0 or more samples, and a --trigger"),
        (("--arm",), "--arm wants a --trigger"),
        (("--every", "0"), "--every has to be 1 or more"),
        (("--timeout", "-1"), "--timeout has to be 0 or more"),
    ],
)
def test_what_no_drive_can_do_is_said(
    line: Path, tmp_path: Path, arguments: tuple[str, ...], words: str
) -> None:
    ran = run(axistwin("trace", line, tmp_path / "x.csv", *arguments))
    assert ran.returncode == 2
    assert words in ran.stderr
    assert not (tmp_path / "x.csv").exists()


@pytest.mark.parametrize("damage", ["none", "cut", "altered", "garbage"])
def test_an_upload_that_was_broken_off_goes_on_where_it_was(
    line: Path, tmp_path: Path, damage: str
) -> None:
    file = tmp_path / "long.csv"
    partial = tmp_path / "long.csv.part.log"
    command = axistwin("trace", line, file, "-n", "20000")
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while not (partial.exists() and partial.stat().st_size > 200_000):
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
        process.communicate()
    assert not file.exists()
    kept = partial.read_bytes()
    if damage == "cut":
        partial.write_bytes(kept[:150_007])
    elif damage == "altered":  # a trace's frame with another position, a hexadecimal digit still
        at = kept.index(b" 481#") + 12
        other = b"1" if kept[at : at + 1] == b"0" else b"0"
        partial.write_bytes(kept[:at] + other + kept[at + 1 :])
    elif damage == "garbage":
        partial.write_bytes(b"\xff\x00" * 5000)
    ran = run(axistwin("trace", line, file, "--fetch"))
    assert ran.returncode == 0, ran.stderr
    assert ("of this trace had been fetched before" in ran.stderr) == (damage != "garbage")
    assert ("does not match its checksum" in ran.stderr) == (damage == "altered")
    assert not partial.exists()
    record = read_record(file)
    assert (len(record), len(record.missing)) == (20_000, 0)
    # fetched once more as a whole it is the same
    again, _ = traced(line, tmp_path / "again.csv", "--fetch")
    for name, values in record.channels.items():
        np.testing.assert_array_equal(values, again.channels[name])


def test_what_was_fetched_of_another_trace_is_not_mixed_in(line: Path, tmp_path: Path) -> None:
    file, partial = tmp_path / "a.csv", tmp_path / "a.csv.part.log"
    command = axistwin("trace", line, file, "-n", "20000")
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        while not (partial.exists() and partial.stat().st_size > 100_000):
            assert process.poll() is None
            time.sleep(0.02)
        process.kill()
        process.communicate()
    other, _ = traced(line, tmp_path / "b.csv", "-n", "3000")
    ran = run(axistwin("trace", line, file, "--fetch"))
    assert ran.returncode == 0, ran.stderr
    assert "fetched before" not in ran.stderr
    np.testing.assert_array_equal(read_record(file).torque, other.torque)


def test_a_drive_without_a_trace_has_nothing_to_fetch(line: Path, tmp_path: Path) -> None:
    ran = run(axistwin("trace", line, tmp_path / "x.csv", "--fetch"))
    assert ran.returncode == 3
    assert "node 1 holds no trace that is complete" in ran.stderr


def test_a_fault_is_caught_with_nobody_there_and_fetched_later(tmp_path: Path) -> None:
    line, file = tmp_path / "line", tmp_path / "fault.csv"
    before, length = 150, 400
    with running_drive(line, "--limits", "0.5,1", "--watchdog", "5000"):  # 1 turn a minute
        trigger = ("--trigger", "fault", "--pretrigger", str(before), "-n", str(length))
        ran = run(axistwin("trace", line, file, "--arm", *trigger))
        assert (ran.returncode, file.exists()) == (0, False)
        assert "armed for fault" in ran.stderr
        ran = run(axistwin("trace", line, file, "--fetch"))
        assert "holds no trace that is complete" in ran.stderr
        ran = run(axistwin("log", line, tmp_path / "run.log", "--excite", "--duration", "5"))
        assert ran.returncode == 3
        assert "is in fault" in ran.stderr
        record, summary = traced(line, file, "--fetch")
    assert len(record) == length
    assert summary["trigger_sample"] == before
    assert np.any(record.torque[:before] != 0.0)
    assert np.all(record.torque[before + 1 :] == 0.0)
