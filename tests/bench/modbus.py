"""Modbus over TCP: reads a second beside a plain libmodbus server, and what they do to the loop.

Both servers answer the same client, in turn, several times; the medians are compared. Only the
ratio says something about other machines. Ours runs a 20 kHz control loop at the same time.
"""

from __future__ import annotations

import os
import re
import statistics
import subprocess
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from bus import EMULATOR, lateness
from toolchain import BUILD, BenchError, run

CLIENTS = {"one_client": 1, "sixteen_clients": 16}
ROUNDS = 3
SECONDS = 2.0
JITTER_SECONDS = 6.0

LOAD = str(BUILD / "modbus_load")
PLAIN = str(BUILD / "modbus_plain")
OURS = [EMULATOR, "--modbus", "tcp:0", "--excite"]
PORT = re.compile(r"(?:modbus tcp 127\.0\.0\.1:|^)(\d+)$")

Figures = dict[str, Any]


@contextmanager
def server(command: list[str]) -> Iterator[tuple[subprocess.Popen[str], int]]:
    """A server that runs, and its port, with which its first line ends."""
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            assert process.stdout is not None
            found = PORT.search(process.stdout.readline().rstrip())
            if found is None:
                raise BenchError(f"{command[0]} does not start")
            yield process, int(found[1])
        finally:
            process.kill()


def load(port: int, clients: int, seconds: float) -> tuple[float, float, float]:
    """Reads a second, and median and 99 % quantile of what a read took [us]."""
    printed = run([LOAD, str(port), str(clients), str(seconds)])
    reads, took, median, slow = map(float, printed.split())
    return reads / took, median, slow


def compare(clients: int) -> Figures:
    """Both servers under so many clients."""
    measured: dict[str, list[tuple[float, float, float]]] = {"ours": [], "plain": []}
    for _ in range(ROUNDS):
        for name, command in (("ours", OURS), ("plain", [PLAIN])):
            with server(command) as (_, port):
                measured[name].append(load(port, clients, SECONDS))
    rate, median, slow = map(statistics.median, zip(*measured["ours"], strict=True))
    plain = statistics.median(rate for rate, *_ in measured["plain"])
    return {
        "reads_per_s": rate,
        "p50_us": median,
        "p99_us": slow,
        "libmodbus_reads_per_s": plain,
        "ratio": rate / plain,
    }


def jitter(clients: int) -> Figures:
    """How late the control loop wakes up [us] under so many clients, 0 or more."""
    with tempfile.TemporaryDirectory() as folder:
        histogram = Path(folder) / "jitter.csv"
        command = [*OURS, "--jitter", str(histogram)]
        command += ["--realtime-priority", "80"] if os.geteuid() == 0 else []
        with server(command) as (process, port):
            if clients > 0:
                load(port, clients, JITTER_SECONDS)
            else:
                time.sleep(JITTER_SECONDS)
            process.terminate()
            process.communicate(timeout=30)
        return lateness(histogram)


def measure() -> Figures:
    """Everything."""
    return {
        **{name: compare(clients) for name, clients in CLIENTS.items()},
        "jitter_no_client": jitter(0),
        **{f"jitter_{name}": jitter(clients) for name, clients in CLIENTS.items()},
    }
