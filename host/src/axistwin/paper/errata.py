"""What is misprinted or inconsistent in the paper, in numbers; docs/paper.md lists it in words."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from axistwin import core
from axistwin.core import Array, Axis, Motion, State
from axistwin.paper import eq9
from axistwin.paper.report import Report, Value
from axistwin.paper.settings import AXIS, SETTINGS, Setting, errors


def run(report: Report) -> None:
    """The study of the errata."""
    report.study("Errata", _values())


@dataclass(frozen=True)
class Model:
    """Matrices of x' = A x + C T for x = theta1, omega1, theta2, omega2."""

    A: Array
    C: Array


def eq8(axis: Axis) -> Model:
    """Eq. 8, with the sign of C right: positive torque accelerates the motor."""
    shaft = np.array([-axis.K, -axis.B, axis.K, axis.B])
    A = np.array([[0.0, 1.0, 0.0, 0.0], shaft / axis.I1, [0.0, 0.0, 0.0, 1.0], -shaft / axis.I2])
    return Model(A, np.array([0.0, 1.0 / axis.I1, 0.0, 0.0]))


def eq8_as_printed(axis: Axis) -> Model:
    """Eq. 8 with C = [0, -1/I1, 0, 0]."""
    right = eq8(axis)
    return Model(right.A, -right.C)


def misfit(model: Model, motion: Motion, torque: Array, time_step: float) -> float:
    """How badly a model explains the motion, by the trapezoidal rule: rms relative to the rates."""
    X = eq9.states(motion)
    rate = np.diff(X, axis=0) / time_step
    mean, mean_torque = (X[:-1] + X[1:]) / 2.0, (torque[:-1] + torque[1:]) / 2.0
    left = rate - mean @ model.A.T - np.outer(mean_torque, model.C)
    return float(np.linalg.norm(left) / np.linalg.norm(rate))


def euler_growth(setting: Setting) -> float:
    """Largest |1 + Dt lambda| over the eigenvalues of Eq. 8: above 1, Eq. 9 is unstable."""
    return float(np.max(np.abs(1.0 + setting.time_step * np.linalg.eigvals(eq8(AXIS).A))))


def euler_motion(setting: Setting, torque: Array, *, late: bool = True) -> Array:
    """States (n, 4) by Eq. 9 as a simulator, from rest; Eq. 17 as printed without ``late``."""
    model = eq8(AXIS)
    X = np.zeros((len(torque), 4))
    acting = torque if late else np.roll(torque, -1)
    for n in range(len(torque) - 1):
        X[n + 1] = X[n] + setting.time_step * (model.A @ X[n] + model.C * acting[n])
    return X


def newmark_slowness(setting: Setting) -> float:
    """By how much Newmark's method lowers the natural frequency [%], in closed form."""
    x = setting.x
    return 100.0 * (1.0 - 2.0 / x * float(np.arctan(x / 2.0)))


def newmark_slowness_measured(setting: Setting) -> float:
    """The same from a free undamped vibration: q[n-1] + q[n+1] = 2 cos(w Dt) q[n]."""
    axis = replace(AXIS, B=0.0)
    h = setting.time_step
    twist = core.simulate(axis, h, np.zeros(setting.N), State(twist=1e-3)).twist
    middle = twist[1:-1]
    cosine = float(middle @ (twist[:-2] + twist[2:]) / (2.0 * middle @ middle))
    return 100.0 * (1.0 - float(np.arccos(cosine)) / (core.modal(axis).wn * h))


def _values() -> Iterator[Value]:
    for setting in SETTINGS:
        column, h = setting.title, setting.time_step
        torque = setting.torque()
        motion = core.simulate(AXIS, h, torque)
        yield Value("|1 + Dt lambda| of Eq. 9", column, euler_growth(setting))
        peak = float(np.max(np.abs(euler_motion(setting, torque))))
        yield Value("largest state, Eq. 9 as a simulator", column, peak)
        yield Value("Newmark: natural frequency low by", column, newmark_slowness(setting), "%")
        measured = newmark_slowness_measured(setting)
        yield Value("Newmark: natural frequency low by, measured", column, measured, "%")
        for name, model in (("right", eq8(AXIS)), ("as printed", eq8_as_printed(AXIS))):
            yield Value(f"misfit of Eq. 8, {name}", column, misfit(model, motion, torque, h))
        yield from _entries(setting, motion, torque)
    for N, k in ((512, 10), (2048, 10), (2048, 40), (512, 36), (2048, 146)):
        setting = Setting("", N, k)
        found = errors(eq9.identify(setting, setting.torque()))
        yield Value("K by Eq. 9", setting.title, float(found[3]), "%")
        yield Value("x", setting.title, setting.x)


def _entries(setting: Setting, motion: Motion, torque: Array) -> Iterator[Value]:
    """Errors of K and B from each of the entries that contain them, inertias given."""
    h = setting.time_step
    phi = eq9.least_squares(eq9.rows(motion, torque))
    K = {
        "theta1 -> omega1": -phi[0, 1] * AXIS.I1,
        "theta1 -> omega2": phi[0, 3] * AXIS.I2,
        "theta2 -> omega1": phi[2, 1] * AXIS.I1,
        "theta2 -> omega2": -phi[2, 3] * AXIS.I2,
    }
    B = {
        "omega1 -> omega1": (1.0 - phi[1, 1]) * AXIS.I1,
        "omega1 -> omega2": phi[1, 3] * AXIS.I2,
        "omega2 -> omega1": phi[3, 1] * AXIS.I1,
        "omega2 -> omega2": (1.0 - phi[3, 3]) * AXIS.I2,
    }
    for name, true, entries in (("K", AXIS.K, K), ("B", AXIS.B, B)):
        for entry, value in entries.items():
            error = 100.0 * float(value / h / true - 1.0)
            yield Value(f"{name} from {entry}", setting.title, error, "%")
