"""Simulating a worn axis: the core, and what a Python user writes with scipy instead.

Dry friction is what makes it hard. In Python it is smoothed, T tanh(w / 0.01 rad/s), or every
moment at which an inertia sticks or breaks away is an event of solve_ivp.
"""

from __future__ import annotations

import functools
import importlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.integrate
import worn
from numpy.typing import NDArray

from axistwin.core import Effect
from axistwin.model import Model

Array = NDArray[np.float64]
Motion = tuple[Array, Array]  # theta1, theta2 (n,) [rad]

SAMPLES = 5_000  # of the record
SMOOTHING = 0.01  # [rad/s]


def core(torque: Array, substeps: int) -> Motion:
    """The core, with so many steps from sample to sample."""
    friction = Effect("friction_coulomb", "table", {"torque": worn.COULOMB})
    return Model(worn.AXIS, (friction,)).simulate(torque, worn.TIME_STEP, substeps=substeps)


def held(torque: Array, t: float) -> float:
    """The torque at a time."""
    return float(torque[min(int(t / worn.TIME_STEP), len(torque) - 1)])


def smoothed(torque: Array, **how: Any) -> Motion:
    """solve_ivp with smoothed friction, no step longer than a sample."""
    axis = worn.AXIS

    def rates(t: float, y: Array) -> list[float]:
        shaft = axis.B * (y[2] - y[3]) + axis.K * (y[0] - y[1])
        friction = worn.COULOMB * np.tanh(y[3] / SMOOTHING)
        motor = (held(torque, t) - shaft) / axis.I1
        return [y[2], y[3], motor, (shaft - friction) / axis.I2]

    times = worn.TIME_STEP * np.arange(len(torque))
    solved = scipy.integrate.solve_ivp(
        rates, (0.0, times[-1]), np.zeros(4), t_eval=times, max_step=worn.TIME_STEP, **how
    )
    return solved.y[0], solved.y[1]


def with_events(torque: Array) -> Motion:
    """solve_ivp that is stopped where the table sticks and started anew where it breaks away."""
    module = importlib.import_module("effects_reference")  # of tests/host
    axis = worn.AXIS
    reference = module.Reference(
        (axis.I1, axis.I2, axis.B, axis.K),
        functools.partial(held, torque),
        friction=(module.Friction(), module.Friction(coulomb=worn.COULOMB)),
    )
    times = worn.TIME_STEP * np.arange(len(torque), dtype=np.float64)
    motion = reference.run(times, np.zeros(4))
    return motion[:, 0], motion[:, 1]


WAYS: dict[str, Callable[[Array], Motion]] = {
    "core_2": functools.partial(core, substeps=2),
    "core_8": functools.partial(core, substeps=8),
    "core_32": functools.partial(core, substeps=32),
    "solve_ivp_rk45": smoothed,
    "solve_ivp_lsoda": functools.partial(smoothed, method="LSODA", rtol=1e-6, atol=1e-9),
    "solve_ivp_events": with_events,
}


def measure(way: str) -> dict[str, float]:
    """Time for 5 s of the record [s], and errors: twist (rms, of its own), theta1 (most, rad)."""
    record = worn.record()
    torque, true = record.torque[:SAMPLES], record.motion[:SAMPLES]
    begin = time.perf_counter()
    theta1, theta2 = WAYS[way](torque)
    seconds = time.perf_counter() - begin
    twist = true[:, 0] - true[:, 1]
    error = theta1 - theta2 - twist
    return {
        "seconds": seconds,
        "twist_error": float(np.sqrt(np.mean(error**2)) / np.std(twist)),
        "theta1_error": float(np.max(np.abs(theta1 - true[:, 0]))),
    }
