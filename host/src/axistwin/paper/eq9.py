"""The paper's regression (Eqs. 9 and 10), how its tables read it, and what is wrong with it.

Eq. 9 fits X[k+1] = (1 + Dt A) X[k] + Dt C T[k], forward Euler, to samples of Newmark's method, for
which X[k+1] = F X[k] + G (T[k] + T[k+1]) / 2 holds with F = (1 - Dt A / 2)^-1 (1 + Dt A / 2). So

* F is read as if it were 1 + Dt A. In the twist that divides the stiffness by
  D = 1 + zeta x + x^2 / 4 and turns the damping B into B (1 + x / (4 zeta)) / D, x = wn Dt;
* T[k+1] is left out. As far as T[k] and the states foretell it, it is credited to them, which
  depends on the signal: that is all there is in the errors of I1, I2 and the rest of B.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from axistwin import core
from axistwin.core import Array, Axis, Motion
from axistwin.paper import native
from axistwin.paper.settings import AXIS, RMS, Setting

#: Multisines c cos(2 pi n j / N) + s sin(2 pi n j / N), (c, s) for j = 1, 2, ..., with which the
#: regression gives Tables 3 and 4 to the printed digits. They are fitted (from random starts, least
#: squares on the errors of I1, I2 and B): they show that there are such signals, not which one
#: the authors used.
FITTED_LINES = {
    "a": (
        (1.0, -0.1691),
        (0.4012, 0.1110),
        (0.0778, 0.0685),
        (-0.4307, -0.0493),
        (-0.2449, -0.0309),
    ),
    "b": (
        (-0.3508, -0.5110),
        (-1.0, 0.5066),
        (-0.1090, 0.4608),
        (-0.0208, 0.2704),
        (0.0098, 0.1949),
        (0.0174, 0.1491),
        (0.0132, 0.1218),
    ),
}


def multisine(length: int, lines: npt.ArrayLike) -> Array:
    """A period (length,) with lines (L, 2), cosine and sine, from harmonic 1 on; rms RMS [N m]."""
    amplitudes = np.asarray(lines, np.float64)
    harmonic = np.arange(1, len(amplitudes) + 1)
    phase = 2.0 * np.pi * (np.outer(np.arange(length), harmonic) % length) / length
    signal = np.cos(phase) @ amplitudes[:, 0] + np.sin(phase) @ amplitudes[:, 1]
    result: Array = signal * (RMS / np.sqrt(np.mean(signal**2)))
    return result


def fitted_torque(setting: Setting) -> Array:
    """A period of the signal that gives the paper's Tables 3 and 4 in this setting [N m]."""
    return multisine(setting.N, FITTED_LINES[setting.key])


def states(motion: Motion) -> Array:
    """The states of Eq. 8 (n, 4): theta1, omega1, theta2, omega2."""
    return np.column_stack([motion.theta1, motion.omega1, motion.theta2, motion.omega2])


@dataclass(frozen=True)
class Rows:
    """Eq. 9 without its unknowns: ``A`` (n - 1, 5), ``b`` (n - 1, 4); N samples make N - 1 rows."""

    A: Array
    b: Array


def rows(motion: Motion, torque: Array, *, mean_torque: bool = False) -> Rows:
    """The rows of Eq. 9; with ``mean_torque`` the mean of T[k] and T[k+1] in place of T[k]."""
    X = states(motion)
    T = (torque[:-1] + torque[1:]) / 2.0 if mean_torque else torque[:-1]
    return Rows(np.column_stack([X[:-1], T]), X[1:])


def least_squares(given: Rows) -> Array:
    """Eq. 10: phi (5, 4), by QR on scaled columns, which is what the normal equations mean."""
    scale = np.linalg.norm(given.A, axis=0)
    result: Array = np.linalg.lstsq(given.A / scale, given.b, rcond=None)[0] / scale[:, None]
    return result


def recursive(given: Rows, prior: float, every: int | None = None) -> Array:
    """Eqs. 14-16 by axt_rls over the same rows: phi (k, 5, 4) after ``every`` rows and the last.

    Rows are scaled by powers of two to about 1; ``prior`` is P0 in those units.
    """
    scale = _power_of_two(np.abs(given.A).max(axis=0))
    output_scale = _power_of_two(np.abs(given.b).max(axis=0))
    run = native.recursive_least_squares(
        given.A / scale, given.b / output_scale, prior=prior, every=every
    )
    result: Array = np.swapaxes(run.theta, 1, 2) * output_scale / scale[:, None]
    return result


def _power_of_two(size: Array) -> Array:
    result: Array = 2.0 ** np.ceil(np.log2(size))
    return result


def read(phi: Array, time_step: float, given_I2: float = AXIS.I2) -> Axis:
    """The parameters from phi as the paper's tables have them.

    As printed, Eq. 9 has no inertia beside T, so only K/I1, K/I2, B/I1 and B/I2 can be read off it
    and one inertia has to be given: the true I2. K from theta1 -> omega2, I1 and I2 from the ratios
    of the angle entries, B from omega1 -> omega1.
    """
    K = phi[0, 3] * given_I2 / time_step
    I1 = -K * time_step / phi[0, 1]
    I2 = -given_I2 * phi[0, 3] / phi[2, 3]
    B = (1.0 - phi[1, 1]) * I1 / time_step
    return Axis(float(I1), float(I2), float(B), float(K))


def identify(setting: Setting, torque: Array) -> Axis:
    """Tables 3 and 4 for a signal: simulated by Newmark's method, regressed by Eqs. 9 and 10."""
    motion = core.simulate(AXIS, setting.time_step, torque)
    return read(least_squares(rows(motion, torque)), setting.time_step)
