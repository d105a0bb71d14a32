"""The bus: what it carries without a loss, how promptly, and what that costs.

    bus.py FILE MEMBER...   measures on the vcan0 that is here, and writes JSON

The rest of the bench calls measure(), which runs this program where there is a vcan0. Where that is
an emulated machine, its clock counts its own instructions: times are those of the bus and of that
machine, whatever this one does meanwhile.
"""

from __future__ import annotations

import csv
import json
import os
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from toolchain import BenchError

EMULATOR = "build/axistwin-emulator"
VCAN = "vcan0"
LAST_WORDS = re.compile(r"(\d+) samples, (\d+) overruns, (\d+) lost")

# 1 Mbit/s, all of it: 7,300 frames of samples and some 95 others, at 135 bits and less.
FULL_BUS = ("--bit-rate", "1000000", "--rate", "3650", "--stream-rate", "3650")
FD_STREAM = ("--bit-rate", "1000000,5000000", "--rate", "10000")
FD_HOST = ("--fd", "--bitrate", "1000000", "--data-bitrate", "5000000")

ON_VCAN = ("full_bus", "ten_minutes", "fd", "candump", "round_trip")
MEMBERS = (*ON_VCAN, "jitter")
# What takes too long for every day is measured when it is asked for by name.
ON_DEMAND = ("ten_minutes",)

JITTER_RATE = 10000
JITTER_SECONDS = 20
ROUND_TRIPS = 200
WAKE = 1e-3  # the emulator's default [s]

# struct can_frame: id, length, padding, 8 bytes.
_FRAME = struct.Struct("=IB3x8s")
_COMMAND, _MOTOR = 0x201, 0x181
_START, _STOP = 2, 3

Figures = dict[str, Any]


@dataclass
class Cost:
    """What a program has used."""

    seconds: float  # of processor time
    output: str


@contextmanager
def emulator(*arguments: str) -> Iterator[Callable[[], Cost]]:
    """A node on vcan0; what is given ends it and says its last words and what it has cost."""
    command = [EMULATOR, "--bus", VCAN, *arguments]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    if not process.stdout.readline().startswith("axistwin-emulator: node"):
        raise BenchError(f"{' '.join(command)} does not start")

    def end() -> Cost:
        process.terminate()
        return wait_for(process)

    try:
        yield end
    finally:
        if process.poll() is None:
            process.kill()
            process.wait()


def wait_for(process: subprocess.Popen[str]) -> Cost:
    """Waits for the end of a program, which has to be a good one."""
    output = process.stdout.read() if process.stdout is not None else ""
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode != 0:
        raise BenchError(f"{process.args!r} ends with {process.returncode}: {output}")
    return Cost(used.ru_utime + used.ru_stime, output)


def count_lines(path: Path) -> int:
    """Frames in a candump log."""
    with path.open("rb") as lines:
        return sum(1 for _ in lines)


def log_stream(folder: Path, seconds: float, arguments: tuple[str, ...], *host: str) -> Figures:
    """A node that streams and `axistwin log` for so many seconds of the bus."""
    log, summary = folder / "stream.log", folder / "stream.json"
    command = [sys.executable, "-m", "axistwin", "log", "-i", "socketcan", "-c", VCAN]
    command += ["--heartbeat-timeout", "5", "--duration", str(seconds), *host]
    with emulator(*arguments) as end:
        logger = wait_for(
            subprocess.Popen(
                [*command, "-f", str(log), "--json", str(summary)],
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                text=True,
            )
        )
        node = end()
    found = LAST_WORDS.search(node.output)
    if found is None:
        raise BenchError(f"the emulator does not say what it has done: {node.output}")
    said = json.loads(summary.read_text())
    frames = count_lines(log)
    log.unlink()
    return {
        "seconds": said["duration_s"],
        "frames": frames,
        "frames_per_s": frames / said["duration_s"],
        "samples_per_s": said["samples"] / said["duration_s"],
        "bus_load": said["bus_load"],
        "lost": said["lost"],
        "lost_by_node": int(found[3]),
        "overruns": int(found[2]),
        "logger_cpu_s": logger.seconds,
        "emulator_cpu_s": node.seconds,
    }


def candump(folder: Path, seconds: float) -> Figures:
    """candump instead of `axistwin log`."""
    log = folder / "candump.log"
    with emulator(*FULL_BUS, "--stream"), log.open("wb") as output:
        process = subprocess.Popen(["candump", "-L", VCAN], stdout=output, text=True)
        time.sleep(seconds)
        process.send_signal(signal.SIGINT)
        cost = wait_for(process)
    return {"frames": count_lines(log), "logger_cpu_s": cost.seconds}


def us_per_frame(short: Figures, long: Figures) -> float:
    """Processor time for one more frame, by two runs: what the start costs is in both."""
    more = long["frames"] - short["frames"]
    return float(1e6 * (long["logger_cpu_s"] - short["logger_cpu_s"]) / more)


def compare_with_candump(folder: Path) -> Figures:
    """What one frame costs candump and us."""
    ours = us_per_frame(log_stream(folder, 4.0, FULL_BUS), log_stream(folder, 12.0, FULL_BUS))
    theirs = us_per_frame(candump(folder, 4.0), candump(folder, 12.0))
    return {"ours_us_per_frame": ours, "us_per_frame": theirs, "ratio": ours / theirs}


def round_trips(count: int) -> Figures:
    """From sending StreamStart to the first sample's arrival [us]."""
    times = []
    phase = random.Random(1)  # the node looks at its bus at every wake-up
    with emulator("--rate", "20000", "--stream-rate", "20000"), bus_socket() as bus:
        for _ in range(count):
            command(bus, _STOP)
            quiet_for(bus, 0.02)
            time.sleep(phase.uniform(0.0, 2.0 * WAKE))
            begin = time.monotonic_ns()
            command(bus, _START)
            while _FRAME.unpack(bus.recv(_FRAME.size))[0] != _MOTOR:
                pass
            times.append((time.monotonic_ns() - begin) / 1e3)
    times.sort()
    return {
        "count": count,
        "p50_us": quantile(times, 0.5),
        "p99_us": quantile(times, 0.99),
        "max_us": times[-1],
    }


def bus_socket() -> socket.socket:
    """A socket on the bus, all frames."""
    bus = socket.socket(socket.PF_CAN, socket.SOCK_RAW, socket.CAN_RAW)
    bus.bind((VCAN,))
    return bus


def command(bus: socket.socket, code: int) -> None:
    """Sends a command without an argument."""
    bus.settimeout(10.0)
    bus.send(_FRAME.pack(_COMMAND, 8, bytes([code]).ljust(8, b"\0")))


def quiet_for(bus: socket.socket, seconds: float) -> None:
    """Reads until no sample has come for so long."""
    last = time.monotonic()
    while (left := last + seconds - time.monotonic()) > 0:
        bus.settimeout(left)
        try:
            frame = bus.recv(_FRAME.size)
        except TimeoutError:
            return
        if _FRAME.unpack(frame)[0] == _MOTOR:
            last = time.monotonic()


def quantile(ordered: list[float], share: float) -> float:
    """The smallest value that this share of all does not exceed."""
    return ordered[min(len(ordered) - 1, int(share * len(ordered)))]


def jitter(loaded: bool) -> Figures:
    """How late the control loop wakes up [us], on this machine."""
    busy = [sys.executable, "-c", "while True: pass"]
    with tempfile.TemporaryDirectory() as folder:
        histogram = Path(folder) / "jitter.csv"
        command = [EMULATOR, "--bus", "pty", "--duration", str(JITTER_SECONDS)]
        command += ["--rate", str(JITTER_RATE), "--wake", str(JITTER_RATE)]
        command += ["--realtime-priority", "80"] if os.geteuid() == 0 else []
        command += ["--jitter", str(histogram)]
        others = [subprocess.Popen(busy) for _ in range(os.cpu_count() or 1)] if loaded else []
        try:
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        finally:
            for other in others:
                other.kill()
                other.wait()
        return lateness(histogram)


def lateness(histogram: Path) -> Figures:
    """What the emulator's --jitter has written, in figures [us]."""
    with histogram.open(newline="") as rows:
        bins = [(int(row["lateness_us"]), int(row["wakes"])) for row in csv.DictReader(rows)]
    return {
        "wakes": sum(wakes for _, wakes in bins),
        "p50_us": bin_quantile(bins, 0.5),
        "p99_us": bin_quantile(bins, 0.99),
        "p99_9_us": bin_quantile(bins, 0.999),
        "max_us": bins[-1][0],
        "histogram": bins,
    }


def bin_quantile(bins: list[tuple[int, int]], share: float) -> int:
    """The lowest bin that this share of all does not exceed."""
    left = share * sum(wakes for _, wakes in bins)
    for lateness, wakes in bins:
        left -= wakes
        if left <= 0:
            return lateness
    return bins[-1][0]


def measure_on_vcan(wanted: list[str]) -> Figures:
    """The members that need a bus, on the one that is here."""
    figures: Figures = {}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if "full_bus" in wanted:
            figures["full_bus"] = log_stream(folder, 60.0, FULL_BUS)
        if "ten_minutes" in wanted:
            figures["ten_minutes"] = log_stream(folder, 600.0, FULL_BUS)
        if "fd" in wanted:
            figures["fd"] = log_stream(folder, 10.0, FD_STREAM, *FD_HOST)
        if "candump" in wanted:
            figures["candump"] = compare_with_candump(folder)
        if "round_trip" in wanted:
            figures["round_trip"] = round_trips(ROUND_TRIPS)
    return figures


def measure(wanted: list[str]) -> Figures:
    """The members that are wanted, each where it can be measured."""
    figures: Figures = {}
    on_vcan = [member for member in wanted if member in ON_VCAN]
    if on_vcan:
        result = Path("build") / "bus.json"
        result.unlink(missing_ok=True)
        program = [sys.executable, __file__, str(result), *on_vcan]
        if subprocess.run(["tests/tools/with-vcan", *program]).returncode != 0:
            raise BenchError("the bus could not be measured")
        figures.update(json.loads(result.read_text()))
    if "jitter" in wanted:
        figures["jitter"] = {"idle": jitter(False), "loaded": jitter(True)}
    return figures


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(json.dumps(measure_on_vcan(sys.argv[2:])))
