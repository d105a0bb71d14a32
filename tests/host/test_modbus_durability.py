"""Whatever ends `axistwin modbus log`, what came up to a second before is read: real processes."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from axistwin.errors import InputError, NotEnoughDataError
from axistwin.history import HistoryLog
from axistwin.readers import read_record
from axistwin.record import Record

from .drive_process import EMULATOR, run
from .modbus_rig import Server, server
from .test_log_durability import grown, in_namespace
from .test_modbus import IDENTITY, history_of


@pytest.fixture
def drive() -> Iterator[Server]:
    """An emulated axis that moves, served over TCP."""
    with server(EMULATOR, "--modbus", "tcp:0", "--excite") as started:
        yield started


def command(drive: Server, record: Path, *arguments: str) -> list[str]:
    """The command line; a process may have to wait for its turn on a busy machine."""
    where = ("-c", f"tcp:127.0.0.1:{drive.port}", "--timeout", "5")
    return [
        sys.executable,
        "-m",
        "axistwin",
        "modbus",
        "log",
        *where,
        "-f",
        str(record),
        *arguments,
    ]


def status_word(drive: Server, folder: Path) -> int:
    values = folder / "values.json"
    where = ("-c", f"tcp:127.0.0.1:{drive.port}")
    read = ["", "", "", "modbus", "read", *where, "StatusWord", "--json", str(values)]
    assert run(read).returncode == 0
    return int(json.loads(values.read_text())["StatusWord"])


def test_a_logger_that_is_killed_leaves_all_but_the_last_second(
    drive: Server, tmp_path: Path
) -> None:
    target, kept = tmp_path / "run.csv", tmp_path / "run.csv.jsonl"
    with subprocess.Popen(command(drive, target), stderr=subprocess.PIPE, text=True) as process:
        grown(kept, 60_000)
        killed = time.monotonic()  # the same clock in all processes
        process.kill()
        process.communicate()
    *lines, _ = kept.read_text().split("\n")
    assert json.loads(lines[-1])["at"] >= killed - 1.0
    assert list(tmp_path.iterdir()) == [kept]
    record = read_record(kept)
    assert len(record) > 500
    assert len(record.missing) == 0
    before = kept.read_bytes()
    again = run(command(drive, target, "--duration", "1"))
    assert again.returncode == 2
    assert f"{kept} is there: a log that was not completed" in again.stderr
    assert kept.read_bytes() == before


def test_a_full_disk_ends_the_log_and_keeps_it(tmp_path: Path) -> None:
    disk, copy = tmp_path / "disk", tmp_path / "copy.jsonl"
    disk.mkdir()
    target = disk / "run.csv"
    script = """
        mount -t tmpfs -o size=128k tmpfs "$1"; kept=$2; copy=$3; shift 3
        status=0; "$@" || status=$?
        cp "$kept" "$copy"
        exit $status"""
    with server(EMULATOR, "--modbus", "tcp:0") as drive:
        arguments = (str(disk), f"{target}.jsonl", str(copy))
        ran = in_namespace(script, *arguments, *command(drive, target, "--excite"))
        assert status_word(drive, tmp_path) & 0x6F == 0x40  # the drive is left switched off
    assert ran.returncode == 3, ran.stderr
    assert (
        f"cannot write {target}.jsonl: No space left on device; what came before is in it"
        in ran.stderr
    )
    assert "Traceback" not in ran.stderr
    record = read_record(copy)
    assert len(record) > 500
    assert len(record.missing) == 0


def test_a_disk_too_full_for_the_record_keeps_the_log(drive: Server, tmp_path: Path) -> None:
    disk, copy = tmp_path / "disk", tmp_path / "copy.jsonl"
    disk.mkdir()
    target = disk / "run.csv"
    script = """
        mount -t tmpfs -o size=200k tmpfs "$1"; record=$2; copy=$3; shift 3
        status=0; "$@" || status=$?
        [ ! -e "$record" ]
        cp "$record.jsonl" "$copy"
        exit $status"""
    arguments = command(drive, target, "--duration", "2.5")
    ran = in_namespace(script, str(disk), str(target), str(copy), *arguments)
    assert ran.returncode == 3, ran.stderr
    assert f"No space left on device; what was logged is in {target}.jsonl" in ran.stderr
    assert len(read_record(copy)) > 500


@pytest.mark.parametrize("loss", ['umount --lazy "$1"', 'rm "$1"/run.csv.jsonl'])
def test_a_log_that_is_taken_away_ends_it(drive: Server, tmp_path: Path, loss: str) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    target = disk / "run.csv"
    script = f"""
        mount -t tmpfs tmpfs "$1"; folder=$1; shift
        "$@" & logger=$!
        set -- "$folder"
        until [ -s "$1"/run.csv.jsonl ]; do sleep 0.05; done
        sleep 0.5
        {loss}
        wait $logger"""
    ran = in_namespace(script, str(disk), *command(drive, target))
    assert ran.returncode == 3, ran.stderr
    assert f"cannot write {target}.jsonl: it was removed, or its file system has gone" in ran.stderr
    assert "Traceback" not in ran.stderr


def test_a_log_that_is_completed_leaves_the_record_alone(drive: Server, tmp_path: Path) -> None:
    target = tmp_path / "run.csv"
    ran = run(command(drive, target, "--duration", "0.5"))
    assert ran.returncode == 0, ran.stderr
    assert list(tmp_path.iterdir()) == [target]
    assert len(read_record(target)) > 100


def test_a_log_that_cannot_be_begun_is_said(drive: Server, tmp_path: Path) -> None:
    target = tmp_path / "nowhere" / "run.csv"
    ran = run(command(drive, target))
    assert ran.returncode == 3
    assert f"cannot write {target}.jsonl: No such file or directory" in ran.stderr


LUMPS = st.lists(st.tuples(st.integers(1, 19), st.integers(0, 5)), min_size=20, max_size=40)


def kept_history(lumps: list[tuple[int, int]], afresh: int) -> tuple[HistoryLog, str]:
    """A history with gaps, that starts afresh before this lump; and the lines kept of it."""
    lines: list[str] = []
    log, n = HistoryLog(IDENTITY, lines.append), 2**32 - 1000
    for i, (count, missing) in enumerate(lumps):
        if i == afresh:
            log.start_afresh()
        log.take(n * 1e-3, history_of(n, count, 1))
        n += count + missing
    return log, "".join(lines)


def same(one: Record, other: Record) -> bool:
    columns = all(np.array_equal(one.channels[name], other.channels[name]) for name in one.channels)
    return columns and np.array_equal(one.missing, other.missing) and one.meta == other.meta


@given(LUMPS, st.integers(1, 60), st.floats(0.0, 1.0))
def test_a_history_cut_anywhere_is_read_up_to_there(
    tmp_path_factory: pytest.TempPathFactory,
    lumps: list[tuple[int, int]],
    afresh: int,
    share: float,
) -> None:
    file = tmp_path_factory.mktemp("cut") / "cut.jsonl"
    _, text = kept_history(lumps, afresh)
    cut = text[: int(share * len(text))]
    file.write_text(cut)
    whole = lumps[: max(0, cut.count("\n") - 1)]
    try:
        expected: Record | None = kept_history(whole, afresh)[0].record(str(file), {})
    except NotEnoughDataError:
        expected = None
    found = attempt(file)
    assert (found is None) == (expected is None)
    if found is not None and expected is not None:
        assert same(found, expected)


def attempt(file: Path) -> Record | None:
    """The record of a history; None when it is refused, with one clear line."""
    try:
        return read_record(file)
    except InputError as error:
        said = str(error)
    assert "\n" not in said
    return None


ODD: Any = st.sampled_from([None, True, -1, 0, 0.5, 2**31, 2**32, 10**400, "x", [], [1], {}, 1e308])


@given(st.sampled_from([0, 1, 5]), st.integers(0, 9), ODD)
def test_a_history_that_was_changed_is_refused_or_read(
    tmp_path_factory: pytest.TempPathFactory, line: int, place: int, value: Any
) -> None:
    """Never anything but a record or one clear line."""
    file = tmp_path_factory.mktemp("odd") / "odd.jsonl"
    lines = kept_history([(19, 0)] * 20, 99)[1].splitlines()
    values = json.loads(lines[line])
    inner = values["identity"] if line == 0 and place > 1 else values
    inner[list(inner)[place % len(inner)]] = value
    lines[line] = json.dumps(values)
    file.write_text("\n".join(lines) + "\n")
    attempt(file)
