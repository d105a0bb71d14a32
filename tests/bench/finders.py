"""Finding the term that a simulation lacks: what pysindy and sysidentpy make of a record.

    finders.py RECORD.npz FINDER     one answer as JSON on standard output

Run by diagnosis.py in an environment of its own, for what these packages ask of numpy is not what
the others do. RECORD has `time_step` [s], `torque` (n,) [N m] and `angles` (n, 2) [rad] of motor
and table. The first half is to learn from, windows of the second are simulated from their first
samples. Both get the speeds as differences, for there are no others.
"""

from __future__ import annotations

import importlib
import json
import sys
import time
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

WINDOW = 0.5  # [s] of each simulation
WINDOWS = 10
THRESHOLDS = (0.1, 1.0, 10.0, 30.0, 100.0, 200.0, 300.0, 500.0, 1000.0, 3000.0)
FRICTION = "sign(w2)"
# What the axis of Eq. 3 has; everything else that is found is a term too many.
LINEAR = ("twist", "w1", "w2", "T")


@dataclass(frozen=True)
class Record:
    """Torque (n,), states (n, 3): twist, speeds of motor and table."""

    time_step: float
    torque: Array
    states: Array

    @property
    def half(self) -> int:
        """Samples to learn from."""
        return len(self.torque) // 2

    def windows(self) -> list[slice]:
        """Parts of the second half."""
        length = round(WINDOW / self.time_step)
        return [slice(self.half + i * length, self.half + (i + 1) * length) for i in range(WINDOWS)]


def read(path: str) -> Record:
    """The record with its speeds."""
    with np.load(path) as file:
        time_step, torque, angles = float(file["time_step"]), file["torque"], file["angles"]
    speeds = np.gradient(angles, time_step, axis=0)
    return Record(time_step, torque, np.column_stack([angles[:, 0] - angles[:, 1], speeds]))


@dataclass(frozen=True)
class Found:
    """Whether dry friction is named, how many terms beside it, its torque [N m], and a simulation
    of the table's speed in a part of the record."""

    named: bool
    terms_too_many: int | None
    torque: float | None
    simulate: Callable[[slice], Array]


def unseen_error(record: Record, found: Found) -> float:
    """The rms error of the table's speed in the windows, of its own size there."""
    wanted = np.array([record.states[part, 2] for part in record.windows()])
    simulated = np.array([found.simulate(part) for part in record.windows()])
    return float(np.sqrt(np.mean((simulated - wanted) ** 2)) / np.std(wanted))


def sindy(record: Record, threshold: float) -> Any:
    """Sparse regression on a library that has what a person would suspect: sign and cube of all."""
    pysindy = importlib.import_module("pysindy")
    library = pysindy.CustomLibrary(
        [lambda x: x, lambda x: np.sign(x), lambda x: x**3],
        [lambda x: x, lambda x: f"sign({x})", lambda x: f"{x}^3"],
    )
    optimizer = pysindy.STLSQ(threshold=threshold, alpha=1e-9, normalize_columns=True)
    model = pysindy.SINDy(optimizer=optimizer, feature_library=library)
    learn = slice(record.half)
    model.fit(
        record.states[learn],
        t=record.time_step,
        u=record.torque[learn, np.newaxis],
        feature_names=["twist", "w1", "w2", "T"],
    )
    return model


def pysindy(record: Record) -> Found:
    """Thresholds are tried, and the one that predicts the unseen half best is kept."""
    unseen = slice(record.half, None)
    models = [sindy(record, threshold) for threshold in THRESHOLDS]
    scores = [
        model.score(record.states[unseen], t=record.time_step, u=record.torque[unseen, np.newaxis])
        for model in models
    ]
    return sindy_answer(record, models[int(np.argmax(scores))])


def pysindy_by_hand(record: Record) -> Found:
    """The threshold is the one at which the fewest terms beside dry friction are left: whoever
    chooses it has to know the answer."""
    answers = [sindy_answer(record, sindy(record, threshold)) for threshold in THRESHOLDS]
    named = [answer for answer in answers if answer.named]
    return min(named or answers, key=lambda answer: answer.terms_too_many or 0)


def sindy_answer(record: Record, model: Any) -> Found:
    """What a model says of the table's friction, and how it simulates."""
    names = model.get_feature_names()
    motor, table = (
        dict(zip(names, row, strict=True)) for row in np.asarray(model.coefficients())[1:]
    )
    found = [name for row in (motor, table) for name, value in row.items() if value != 0.0]
    extra = [name for name in found if name not in LINEAR]
    named = table[FRICTION] != 0.0
    # T / I1 and -K twist / I1 at the motor, K twist / I2 at the table
    inertia = -motor["twist"] / motor["T"] / table["twist"]

    def rates(state: Array, torque: Array) -> Array:
        predicted: Array = model.predict(state[np.newaxis], u=torque[np.newaxis])[0]
        return predicted

    def simulate(part: slice) -> Array:
        """By Runge-Kutta from sample to sample: adaptive steps stand still where a sign jumps."""
        step, states = record.time_step, [record.states[part.start]]
        for torque in record.torque[part.start : part.stop - 1, np.newaxis]:
            y = states[-1]
            k1 = rates(y, torque)
            k2 = rates(y + 0.5 * step * k1, torque)
            k3 = rates(y + 0.5 * step * k2, torque)
            k4 = rates(y + step * k3, torque)
            states.append(y + step / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4))
        return np.array(states)[:, 2]

    torque = float(-table[FRICTION] * inertia) if named else None
    return Found(bool(named), len(extra) - int(named), torque, simulate)


def sysidentpy(record: Record) -> Found:
    """A polynomial NARX model of the table's speed by forward regression (FROLS), its size by
    Akaike's criterion. Its terms are past samples, so that none can be dry friction."""
    selection = importlib.import_module("sysidentpy.model_structure_selection")
    basis = importlib.import_module("sysidentpy.basis_function")
    model = selection.FROLS(
        order_selection=True,
        n_info_values=20,
        ylag=4,
        xlag=4,
        info_criteria="aic",
        basis_function=basis.Polynomial(degree=2),
    )
    torque, speed = record.torque[:, np.newaxis], record.states[:, 2:]
    model.fit(X=torque[: record.half], y=speed[: record.half])

    def simulate(part: slice) -> Array:
        return np.asarray(model.predict(X=torque[part], y=speed[part])[:, 0])

    return Found(False, None, None, simulate)


FINDERS: dict[str, Callable[[Record], Found]] = {
    "pysindy": pysindy,
    "pysindy_by_hand": pysindy_by_hand,
    "sysidentpy": sysidentpy,
}


def main() -> int:
    """One finder on one record."""
    path, finder = sys.argv[1:]
    record = read(path)
    warnings.simplefilter("ignore")
    package = finder.split("_")[0]
    importlib.import_module(package)  # not in the time
    begin = time.perf_counter()
    found = FINDERS[finder](record)
    seconds = time.perf_counter() - begin
    answer = {
        "version": importlib.import_module("importlib.metadata").version(package),
        "seconds": seconds,
        "named": found.named,
        "terms_too_many": found.terms_too_many,
        "torque": found.torque,
        "unseen_error": unseen_error(record, found),
    }
    json.dump(answer, sys.stdout)
    return 0


if __name__ == "__main__":
    sys.exit(main())
