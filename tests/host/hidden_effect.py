"""An emulated axis with an effect that nobody told the host of: found, flashed back, measured."""

from __future__ import annotations

import json
import os
import secrets
from collections.abc import Callable
from pathlib import Path

import numpy as np

from axistwin import compare, model, readers
from axistwin.cli import main
from axistwin.core import Axis, Effect
from axistwin.model import Model

#: Soft enough for a drive at 1 kHz: its shaft vibrates at 12 Hz.
AXIS = Axis(1e-3, 5e-4, 1.5e-3, 2.0)
DRIVE = ("--rate", "1000", "--excitation", "2048,50,0.2", "--counts", "65536")
SAMPLES = 4000

#: What may be hidden: effect, location, parameter, from, to.
CHOICES = (
    ("friction_coulomb", "table", "torque", 0.01, 0.03),
    ("backlash", "shaft", "gap", 0.02, 0.05),
    ("delay", "encoder2", "time", 2e-3, 5e-3),
)

#: Records an axis with this drive, as a CSV file.
Trace = Callable[[Model, Path], None]


def draw() -> Effect:
    """A new one each time, or that of $SEED; which is said."""
    seed = int(os.environ.get("SEED") or secrets.randbits(32))
    random = np.random.default_rng(seed)
    effect, location, parameter, low, high = CHOICES[random.integers(len(CHOICES))]
    hidden = Effect(effect, location, {parameter: random.uniform(low, high)})
    print(f"SEED={seed} hides {hidden}")
    return hidden


def check(hidden: Effect, trace: Trace, folder: Path) -> None:
    """The tool names the effect, and an axis with the extended model is the axis that had it."""
    worn, ideal = Model(AXIS, (hidden,)), Model(AXIS)
    first, second = folder / "first.csv", folder / "second.csv"
    answer, extended = folder / "answer.json", folder / "extended.toml"
    trace(worn, first)
    asked = ["diagnose", str(first), "--hold", "newmark"]
    assert main([*asked, "--json", str(answer), "--model", str(extended)]) == 1
    found = json.loads(answer.read_text())
    named = found["findings"][0]
    assert (named["effect"], named["location"]) == (hidden.effect, hidden.location)
    for name, value in hidden.params.items():
        assert abs(named["params"][name] / value - 1.0) < 0.02
    assert found["error"]["extended"] < 0.05 * found["error"]["base"]

    twin = model.read(extended)
    assert error_of(twin, first) < 0.05 * error_of(ideal, first)
    trace(twin, second)
    assert error_of(worn, second) < 0.05 * error_of(ideal, second)


def error_of(axis: Model, file: Path) -> float:
    """The rms error of theta1 of a model on a record [rad]."""
    return compare.compare(axis, readers.read_record(file), hold="newmark")[0].rms
