"""The host against a real node: traces, and everything that can be wrong with a node."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest

from axistwin import core
from axistwin.readers import read_record

from .carriers import ALONE, INTERFACE, OWN, REPOSITORY, Carrier
from .conftest import Host, pages

LENGTH, LINES, RMS = 2048, 272, 0.2  # up to twice the resonance
PERIOD = 1e-4
COUNTS = 1 << 20

# SLCAN through python-can takes 0.3 ms a frame on a fast machine and much more on an emulated one:
# where the stream does not matter it is slow.
SLOW_STREAM = ("--stream-rate", "50")


def recorded_by_the_node(samples: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int32]]:
    """Raw torque (n,) and counts (n, 2) of the axis from the start of its excitation.

    Not from the bus: the same core, in the drive's precision, does again what the node does.
    """
    table = core.schroeder(LENGTH, LINES, RMS, precision="float32").astype(np.float32)
    unit = np.float32(640) * np.float32(1e-3) * np.float32(0.1) * np.float32(1e-3)
    raw = np.trunc(table / unit + np.copysign(np.float32(0.5), table)).astype(np.int64)
    periods = 1 + samples // LENGTH
    torque = np.concatenate([[0.0], np.tile(raw.astype(np.float32) * unit, periods)])
    motion = core.simulate(core.paper_axis(), PERIOD, torque, precision="float32")
    counts = core.read_encoders(motion, (COUNTS, COUNTS))[1:]
    return np.tile(raw, periods), counts


def test_a_trace_is_bit_for_bit_what_the_node_recorded(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    file, summary = tmp_path / "trace.csv", tmp_path / "trace.json"
    excitation = ("--excite", "--length", str(LENGTH), "--lines", str(LINES), "--rms", str(RMS))
    arguments = ("-n", "2048", "-f", str(file), "--json", str(summary))
    host("trace", *carrier.host, *excitation, *arguments).expect(0)
    assert json.loads(summary.read_text())["bus_errors"] == 0

    record = read_record(file)
    assert len(record) == 2048
    assert len(record.missing) == 0
    assert record.time_step == pytest.approx(PERIOD, rel=1e-7)
    assert record.theta2 is not None
    torque = np.rint(record.torque / 0.64e-4).astype(np.int64)
    scale = COUNTS / (2.0 * np.pi)
    counts = np.rint(np.column_stack([record.theta1, record.theta2]) * scale).astype(np.int64)

    node_torque, node_counts = recorded_by_the_node(int(pages(carrier)["Periods"]))
    matches = [
        begin
        for begin in np.flatnonzero(node_counts[:-2047, 0] == counts[0, 0])
        if np.array_equal(node_torque[begin : begin + 2048], torque)
        and np.array_equal(node_counts[begin : begin + 2048], counts)
    ]
    assert len(matches) == 1


def test_the_wrong_node_id_is_said(carrier: Carrier, host: Host) -> None:
    carrier.start()
    outcome = host("trace", *carrier.host, "--node", "7", "--wait", "1")
    outcome.expect(3, "no answer from node 7; heard heartbeats of node 1")


def test_the_wrong_contract_version_is_said(carrier: Carrier, host: Host, tmp_path: Path) -> None:
    carrier.start()
    ours = (REPOSITORY / "drivers" / "contract" / "axistwin.dbc").read_text()
    version = re.compile(r'(?<=BA_ "ContractVersion" )\d+')
    found = version.search(ours)
    assert found
    others = int(found[0]) + 1
    other = tmp_path / "other.dbc"
    other.write_text(version.sub(str(others), ours))
    log = tmp_path / "x.log"
    outcome = host("log", *carrier.host, "--dbc", str(other), "-f", str(log))
    said = f"node 1 speaks contract version {found[0]}", f"other.dbc is version {others}"
    outcome.expect(3, *said, "--dbc")
    assert not log.exists()


def test_a_node_that_starts_after_the_host_is_waited_for(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    later = threading.Timer(1.5, carrier.start)
    later.start()
    log = tmp_path / "late.log"
    outcome = host(
        "log", *carrier.host, *SLOW_STREAM, "--wait", "30", "--duration", "2", "-f", str(log)
    )
    later.join()
    outcome.expect(0, "waiting up to")
    assert len(read_record(log)) > 50


@pytest.mark.needs(OWN)
def test_no_node_at_all_is_said(carrier: Carrier, host: Host) -> None:
    outcome = host("trace", *carrier.host, "--wait", "1")
    outcome.expect(3, "no answer from node 1; heard nothing on the bus")


@pytest.mark.needs(OWN)
@pytest.mark.usefixtures("carrier")
def test_a_bus_that_is_not_there_is_said(host: Host, tmp_path: Path) -> None:
    outcome = host("log", "-i", "socketcan", "-c", "vcan9", "--wait", "0")
    outcome.expect(3, "cannot open socketcan vcan9: there is no such CAN interface")
    nowhere = str(tmp_path / "nowhere")
    outcome = host("log", "-i", "slcan", "-c", nowhere, "--wait", "0")
    outcome.expect(3, f"cannot open slcan {nowhere}: there is no such device")


def test_a_node_that_restarts_in_mid_stream_leaves_a_gap_that_is_stated(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    node = carrier.start()

    def restart() -> None:
        node.kill()
        threading.Event().wait(1.5)
        node.start()

    disturbance = threading.Timer(3.0, restart)
    disturbance.start()
    log = tmp_path / "gap.log"
    outcome = host(
        "log", *carrier.host, *SLOW_STREAM, "--duration", "10", "--wait", "30", "-f", str(log)
    )
    disturbance.join()
    outcome.expect(3, "waiting up to 30 s", "node 1 is back after", "gap from")
    record = read_record(log)
    assert any("starts afresh" in warning for warning in record.warnings)
    assert len(record) > 50
    assert len(record.missing) == 0


def test_what_came_before_a_node_was_lost_is_kept(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    node = carrier.start()
    threading.Timer(3.0, node.kill).start()
    log = tmp_path / "lost.log"
    outcome = host(
        "log", *carrier.host, *SLOW_STREAM, "--duration", "60", "--wait", "1", "-f", str(log)
    )
    outcome.expect(3, "has not come back", "gap from", "to the end")
    assert len(read_record(log)) > 50


def test_an_interrupted_log_leaves_the_node_as_it_was(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    log = tmp_path / "interrupted.log"
    threading.Timer(6.0, os.kill, (os.getpid(), signal.SIGINT)).start()
    excite = ("--excite", "--length", "512", "--lines", "5", "--rms", "0.05")
    outcome = host("log", *carrier.host, *SLOW_STREAM, *excite, "-f", str(log))
    outcome.expect(0, "stopped")
    assert np.std(read_record(log).torque[-50:]) > 0.01
    # Torque 0 and no stream: that is how a trace without --excite finds it.
    trace = tmp_path / "afterwards.csv"
    host("trace", *carrier.host, "-n", "200", "-f", str(trace)).expect(0)
    assert np.all(read_record(trace).torque == 0.0)


@pytest.mark.needs(INTERFACE)
def test_the_excitation_is_switched(carrier: Carrier, host: Host, tmp_path: Path) -> None:
    carrier.start()
    settings = ("--length", "512", "--lines", "5", "--rms", "0.05")
    command = [sys.executable, "-m", "axistwin", "excite", "on", *settings, *carrier.host]
    other = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        assert other.stdout is not None
        assert other.stdout.readline() == "node 1: excitation on\n"
        for switch, rms in (("on", 0.05), ("off", 0.0)):
            if switch == "off":
                outcome = host("excite", "off", *carrier.host)
                outcome.expect(0)
                assert outcome.output == "node 1: excitation off\n"
            trace = tmp_path / f"{switch}.csv"
            host("trace", *carrier.host, "-n", "512", "-f", str(trace)).expect(0)
            torque = read_record(trace).torque
            assert np.sqrt(np.mean(torque**2)) == pytest.approx(rms, rel=1e-3)
        _, said = other.communicate(timeout=30)
    finally:
        other.kill()
    assert other.returncode == 3
    assert "the excitation was ended by another host" in said


def test_what_a_node_cannot_do_is_said(carrier: Carrier, host: Host, tmp_path: Path) -> None:
    carrier.start()
    too_many = int(pages(carrier)["TraceCapacity"]) + 1
    file = tmp_path / "trace.csv"
    outcome = host("trace", *carrier.host, "-n", str(too_many), "-f", str(file))
    outcome.expect(3, f"node 1 refuses TraceArm {too_many}: it has no room for that")
    assert not file.exists()


@pytest.mark.needs(ALONE)
def test_a_file_that_cannot_be_written_is_said(
    carrier: Carrier, host: Host, tmp_path: Path
) -> None:
    carrier.start()
    for verb in ("log", "trace"):
        outcome = host(verb, *carrier.host, "-f", str(tmp_path / "no" / "such" / "folder.asc"))
        outcome.expect(3, "cannot write", "No such file or directory")
    full = tmp_path / "full.log"
    full.symlink_to("/dev/full")
    outcome = host("log", *carrier.host, "-f", str(full), "--duration", "3")
    outcome.expect(3, "cannot write", "No space left on device")
    outcome = host("log", *carrier.host, "-f", str(tmp_path / "x.odt"))
    outcome.expect(2, "cannot write", "x.odt")
