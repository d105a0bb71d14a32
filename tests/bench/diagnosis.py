"""Finding what a simulation lacks, on one record: `axistwin diagnose` beside what Python has.

A record of a worn axis (worn.py); finders.py has the others, in an environment of their own.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import worn
from toolchain import BUILD, BenchError, run

from axistwin.core import State
from axistwin.diagnose import diagnose
from axistwin.diagnose.result import Diagnosis
from axistwin.model import Model
from axistwin.record import Record

FINDERS = ("axistwin", "pysindy", "pysindy_by_hand", "sysidentpy")
PEERS = BUILD / "peers"  # their environment
REQUIREMENTS = ("pysindy>=2.1,<3", "sysidentpy>=0.9,<1")
TIMEOUT = 900.0

# As finders.py: windows of the second half, each from its first samples.
WINDOW = 500
WINDOWS = 10


def measure(finder: str) -> dict[str, Any]:
    """Seconds; whether the friction was named, its torque [N m] and that error, how many terms
    besides; the error of the table's speed in windows of the unseen half, of its own size."""
    record = worn.record()
    answer = ours(record) if finder == "axistwin" else theirs(record, finder)
    if answer["torque"] is not None:
        answer["torque_error"] = abs(answer["torque"] / worn.COULOMB - 1.0)
    return answer


def ours(record: worn.Worn) -> dict[str, Any]:
    """Of the first half, as the others; and the time that the whole record takes."""
    seconds, found = timed(record, len(record.torque) // 2)
    places = [(finding.effect, finding.location) for finding in found.findings]
    wanted = ("friction_coulomb", "table")
    named = wanted in places
    return {
        "seconds": seconds,
        "seconds_for_60_s": timed(record, len(record.torque))[0],
        "named": named,
        "terms_too_many": len(places) - int(named),
        "torque": found.findings[places.index(wanted)].params["torque"] if named else None,
        "unseen_error": unseen_error(record, found.model),
    }


def timed(record: worn.Worn, count: int) -> tuple[float, Diagnosis]:
    """The diagnosis of the first samples, and how long it takes [s]."""
    theta1, theta2 = record.measured[:count].T.copy()
    given = Record(
        time=record.time[:count],
        torque=record.torque[:count],
        theta1=theta1,
        theta2=theta2,
        time_step=worn.TIME_STEP,
        counts_per_turn=(int(worn.COUNTS), int(worn.COUNTS)),
    )
    begin = time.perf_counter()
    found = diagnose(given)
    return time.perf_counter() - begin, found


def unseen_error(record: worn.Worn, model: Model) -> float:
    """As finders.unseen_error()."""
    half = len(record.torque) // 2
    speeds = np.gradient(record.measured, worn.TIME_STEP, axis=0)
    wanted, simulated = [], []
    for first in range(half, half + WINDOWS * WINDOW, WINDOW):
        part = slice(first, first + WINDOW)
        theta1, theta2 = record.measured[first]
        omega1, omega2 = speeds[first]
        start = State(theta1 - theta2, omega1 - omega2, omega1, theta1)
        _, table = model.simulate(record.torque[part], worn.TIME_STEP, start)
        wanted.append(speeds[part, 1])
        simulated.append(np.gradient(table, worn.TIME_STEP))
    error = np.array(simulated) - np.array(wanted)
    return float(np.sqrt(np.mean(error**2)) / np.std(wanted))


def theirs(record: worn.Worn, finder: str) -> dict[str, Any]:
    """The answer of finders.py."""
    path = BUILD / "worn.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    np.savez(path, time_step=worn.TIME_STEP, torque=record.torque, angles=record.measured)
    command = [str(interpreter()), "tests/bench/finders.py", str(path), finder]
    answer: dict[str, Any] = json.loads(run(command, TIMEOUT))
    return answer


def interpreter() -> Path:
    """Of the environment of the others, which is made where it is missing."""
    python = PEERS / "bin" / "python"
    ready = PEERS / "ready"
    if not ready.exists():
        run(["python3", "-m", "venv", "--clear", str(PEERS)])
        install = [str(python), "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
        try:
            run([*install, *REQUIREMENTS])
        except BenchError as error:
            raise BenchError(f"cannot install {' '.join(REQUIREMENTS)}: {error}") from error
        ready.touch()
    return python
