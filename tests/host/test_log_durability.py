"""Whatever ends a log, what came up to a second before is in it: real processes, a real full disk.

The emulated drive is on a pseudo-terminal, so these tests need no CAN interface.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import can
import numpy as np
import pytest

from axistwin.errors import FileError, InputError
from axistwin.frames import Frames
from axistwin.logfile import LogFile
from axistwin.readers import buslog, read_record
from axistwin.record import Record
from axistwin.terminal import Terminal

from .drive_process import axistwin, run, running_drive
from .test_stream_faults import KNOWN, classical, flexible

RATE = 500.0
START_MAX = 60.0


@pytest.fixture
def drive(tmp_path: Path) -> Iterator[Path]:
    """An emulated drive; its line."""
    line = tmp_path / "line"
    with running_drive(line, "--stream-rate", str(RATE)):
        yield line


def command(line: Path, log: Path, *arguments: str) -> list[str]:
    return axistwin("log", line, log, *arguments)


def grown(file: Path, size: int) -> None:
    """Waits until the log has this size."""
    end = time.monotonic() + START_MAX
    while not (file.exists() and file.stat().st_size >= size):
        assert time.monotonic() < end, f"{file} does not grow"
        time.sleep(0.02)


def in_namespace(script: str, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Runs a shell script where it may mount things that nobody else sees."""
    as_root = [] if os.geteuid() == 0 else ["--map-root-user"]
    return subprocess.run(
        ["unshare", "--mount", *as_root, "sh", "-euc", script, "sh", *arguments],
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.parametrize("ending", [".log", ".blf", ".mf4"])
def test_a_logger_that_is_killed_leaves_all_but_the_last_second(
    drive: Path, tmp_path: Path, ending: str
) -> None:
    log = tmp_path / f"run{ending}"
    written = log if ending == ".log" else tmp_path / f"run{ending}.log"
    with subprocess.Popen(command(drive, log), stderr=subprocess.PIPE, text=True) as process:
        grown(written, 100_000)
        killed = time.time()
        process.kill()
        process.communicate()
    found, _ = buslog.read_frames(written)
    assert found.time[-1] >= killed - 1.0
    record = read_record(written)
    assert len(record.missing) == 0
    assert len(record) > 500
    if written != log:
        before = written.read_bytes()
        again = run(command(drive, log, "--duration", "1"))
        assert again.returncode == 2
        assert f"{written} is there: a log that was not completed" in again.stderr
        assert written.read_bytes() == before


@pytest.mark.parametrize("ending", [".log", ".mf4"])
def test_a_full_disk_ends_the_log_and_keeps_it(drive: Path, tmp_path: Path, ending: str) -> None:
    disk, copy = tmp_path / "disk", tmp_path / "copy.log"
    disk.mkdir()
    log = disk / f"run{ending}"
    script = """
        mount -t tmpfs -o size=128k tmpfs "$1"; written=$2; copy=$3; shift 3
        status=0; "$@" || status=$?
        cp "$written" "$copy"
        exit $status"""
    written = log if ending == ".log" else disk / f"run{ending}.log"
    ran = in_namespace(script, str(disk), str(written), str(copy), *command(drive, log, "--excite"))
    assert ran.returncode == 3, ran.stderr
    assert (
        f"cannot write {written}: No space left on device; what came before is in it" in ran.stderr
    )
    assert "Traceback" not in ran.stderr
    record = read_record(copy)
    assert len(record) > 500
    assert len(record.missing) == 0
    stopped(drive, tmp_path)


def test_a_disk_too_full_for_the_other_format_keeps_the_log(drive: Path, tmp_path: Path) -> None:
    disk, copy = tmp_path / "disk", tmp_path / "copy.log"
    disk.mkdir()
    script = """
        mount -t tmpfs -o size=256k tmpfs "$1"; log=$2; copy=$3; shift 3
        status=0; "$@" || status=$?
        [ ! -e "$log" ]
        cp "$log.log" "$copy"
        exit $status"""
    log = disk / "run.asc"
    arguments = command(drive, log, "--duration", "3")
    ran = in_namespace(script, str(disk), str(log), str(copy), *arguments)
    assert ran.returncode == 3, ran.stderr
    assert f"No space left on device; what was logged is in {log}.log" in ran.stderr
    assert len(read_record(copy)) > 500


@pytest.mark.parametrize(
    "loss", ['umount --lazy "$1"', 'rm "$1"/run.log', 'mv "$1"/run.log "$1"/other.log']
)
def test_a_log_that_is_taken_away_ends_it(drive: Path, tmp_path: Path, loss: str) -> None:
    disk = tmp_path / "disk"
    disk.mkdir()
    log = disk / "run.log"
    script = f"""
        mount -t tmpfs tmpfs "$1"; folder=$1; shift
        "$@" & logger=$!
        set -- "$folder"
        until [ -s "$1"/run.log ]; do sleep 0.05; done
        sleep 0.5
        {loss}
        wait $logger"""
    ran = in_namespace(script, str(disk), *command(drive, log))
    assert ran.returncode == 3, ran.stderr
    assert f"cannot write {log}: it was removed, or its file system has gone" in ran.stderr
    assert "Traceback" not in ran.stderr
    stopped(drive, tmp_path)


def test_other_formats_are_made_of_the_log_at_the_end(drive: Path, tmp_path: Path) -> None:
    for ending in (".asc", ".blf", ".mf4", ".trc", ".csv"):
        log, summary = tmp_path / f"run{ending}", tmp_path / "run.json"
        ran = run(command(drive, log, "--duration", "1", "--json", str(summary)))
        assert ran.returncode == 0, ran.stderr
        record = read_record(log)
        assert len(record.missing) == 0
        found = json.loads(summary.read_text())
        assert len(record) == found["samples"] == found["nodes"][0]["record"]["samples"]
        assert not (tmp_path / f"run{ending}.log").exists()


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_a_logger_that_is_told_to_end_completes_its_log(
    drive: Path, tmp_path: Path, number: signal.Signals
) -> None:
    def heed() -> None:  # a shell has what it runs in the background ignore Ctrl-C
        signal.signal(signal.SIGINT, signal.SIG_DFL)

    log = tmp_path / "run.blf"
    with subprocess.Popen(
        command(drive, log), stderr=subprocess.PIPE, text=True, preexec_fn=heed
    ) as process:
        grown(tmp_path / "run.blf.log", 20_000)
        process.send_signal(number)
        _, said = process.communicate(timeout=60)
    assert process.returncode == 0, said
    assert "stopped" in said
    assert len(read_record(log)) > 100


def stopped(line: Path, folder: Path) -> None:
    """Checks that the drive was left as it was found: no stream, no torque."""
    trace = folder / "afterwards.csv"
    ran = run(axistwin("trace", line, trace, "-n", "100"))
    assert ran.returncode == 0, ran.stderr
    record = read_record(trace)
    assert (record.torque == 0.0).all()


@pytest.mark.parametrize("ending", [".log", ".asc", ".blf", ".mf4", ".csv"])
def test_fd_frames_are_kept_in_every_format_that_takes_them(ending: str, tmp_path: Path) -> None:
    stream = flexible(1200, 65_000)
    log = LogFile(tmp_path / f"fd{ending}", Terminal())
    with log:
        for message in messages_of(stream.sent):
            log(message)
    record = read_record(log.path, settings=KNOWN)
    assert (len(record), len(record.missing)) == (1200, 0)
    stream.check(record)
    assert list(tmp_path.iterdir()) == [log.path]


def test_a_format_that_takes_no_fd_frames_is_not_made(tmp_path: Path) -> None:
    ran = run(command(tmp_path / "nothing", tmp_path / "fd.trc", "--fd"))
    assert ran.returncode == 2
    assert "TRC logs take no FD frames" in ran.stderr
    log = LogFile(tmp_path / "fd.trc", Terminal())
    for message in messages_of(flexible(60).sent):
        log(message)
    with pytest.raises(FileError, match=r"what was logged is in .*fd\.trc\.log"):
        log.close()
    assert list(tmp_path.iterdir()) == [tmp_path / "fd.trc.log"]
    assert len(read_record(tmp_path / "fd.trc.log", settings=KNOWN)) == 60


def messages_of(sent: Frames) -> Iterator[can.Message]:
    """Frames as python-can has them."""
    rows = zip(sent.time, sent.identifier, sent.length, sent.payload, strict=True)
    for moment, identifier, length, payload in rows:
        yield can.Message(
            timestamp=float(moment),
            arbitration_id=int(identifier),
            data=payload[:length].tobytes(),
            is_extended_id=False,
            is_fd=bool(length > 8),
            channel="vcan0",
        )


# Readers that cannot read a file leave it open.
@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("ending", [".log", ".asc", ".blf", ".mf4", ".trc", ".csv", ".db"])
def test_a_log_cut_anywhere_reads_right_or_not_at_all(tmp_path: Path, ending: str) -> None:
    """Whatever is read of it is what was sent: no format may give a wrong number."""
    whole, cut = tmp_path / f"whole{ending}", tmp_path / f"cut{ending}"
    stream = classical(1500, 65_000)
    with can.Logger(whole) as writer:
        for message in messages_of(stream.sent):
            writer(message)
        time.sleep(1.5 if ending == ".db" else 0.0)  # or it loses frames: see writable_endings()
    content = whole.read_bytes()
    for share in [*np.random.default_rng(1).random(25).tolist(), 1.0]:
        cut.write_bytes(content[: int(share * len(content))])
        record = attempt(cut)
        if record is None:
            assert share < 0.05 or ending in (".mf4", ".db")
            continue
        stream.check(record)
        assert len(record.missing) == 0
        complete = ending in (".mf4", ".db")
        assert len(record) >= (1500 if complete else share * 1500 - 150)


def attempt(log: Path) -> Record | None:
    """The record of a log; None when it is refused, with one clear line."""
    try:
        return read_record(log, settings=KNOWN)
    except InputError as error:
        said = str(error)
    assert "\n" not in said
    return None
