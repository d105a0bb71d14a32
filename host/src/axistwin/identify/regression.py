"""Batch least squares on the equation of motion, in twist and motor coordinates.

With the twist ``q = theta1 - theta2``, Eq. 3 reads::

    q''      = -(K / Ir) q - (B / Ir) q' + T / I1,    Ir = I1 I2 / (I1 + I2)
    theta1'' = -(K / I1) q - (B / I1) q' + T / I1

so two rows of three entries hold the four parameters. The twist stays small while the angles
travel: in these coordinates the regressors are well conditioned (condition number 1.3 where the
absolute ones have 7e3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.signal

from axistwin.core import Array
from axistwin.identify.samples import Samples
from axistwin.identify.statistics import covariance, gradient, least_squares

#: The slowest pole of the filter is half the corner: e^-16, 1e-7, of its start is left after this.
_SETTLING_RADIANS = 32.0

#: Coefficients of (1 - z^-1)^k (1 + z^-1)^(3 - k), k = 0 .. 3 downwards.
_TRAPEZOIDAL = np.array([[1, 3, 3, 1], [1, 1, -1, -1], [1, -1, -1, 1], [1, -3, 3, -1]], np.float64)


@dataclass(frozen=True)
class Equations:
    """``outputs`` (n, 2), q'' and theta1'', over ``regressors`` (n, 3), q, q' and T."""

    regressors: Array
    outputs: Array


def midpoint(samples: Samples) -> Equations:
    """Equations from measured speeds: difference quotients over means of neighbouring samples.

    The trapezoidal rule (Newmark's method with 1/4, 1/2) makes them exact, so they have no bias on
    samples of such a plant. Noise on the speeds does bias them. Raises NotEnoughDataError when the
    speeds were not measured.
    """
    omega1, omega2 = samples.speeds()
    twist_speed = omega1 - omega2
    regressors = [_mean(samples.twist), _mean(twist_speed), _mean(samples.torque)]
    outputs = np.column_stack([np.diff(twist_speed), np.diff(omega1)]) / samples.time_step
    return Equations(np.column_stack(regressors), outputs)


def filtered(samples: Samples, corner: float) -> Equations:
    """Equations from positions and torque alone, through a filter with this corner [rad/s].

    Every channel passes through the same third-order Butterworth low-pass, so the equation of
    motion holds between what comes out as it holds between what went in; discretised by the
    trapezoidal rule it holds exactly for samples of that rule. Rate, acceleration and jerk take
    the place of value, rate and acceleration: unknown encoder zeros and constant loads drop out.
    """
    bank = _StateVariableFilter(corner, samples.time_step)
    twist, motor, torque = samples.twist, samples.theta1, samples.torque
    regressors = [bank.derivative(twist, 1), bank.derivative(twist, 2), bank.derivative(torque, 1)]
    outputs = [bank.derivative(twist, 3), bank.derivative(motor, 3)]
    settling = min(bank.settling, samples.count // 3)
    return Equations(np.column_stack(regressors)[settling:], np.column_stack(outputs)[settling:])


def solve(equations: Equations) -> Array:
    """I1, I2, B, K (4,) by least squares. They need not be an axis: check before use.

    Raises NotEnoughDataError when the regressors are not independent.
    """
    entries = least_squares(equations.regressors, equations.outputs).solution.T
    return _parameters(entries.ravel())


def solve_with_covariance(equations: Equations) -> tuple[Array, Array]:
    """I1, I2, B, K (4,) and their covariance (4, 4) by the delta method; raises as solve()."""
    fit = least_squares(equations.regressors, equations.outputs)
    entries = fit.solution.T.ravel()
    count, rows = equations.outputs.shape
    # each row has the regressors in its own three columns of the Jacobian
    jacobian = np.einsum("nj,ri->nrij", equations.regressors, np.eye(rows)).reshape(count, rows, -1)
    size = np.sqrt(np.mean(equations.outputs**2, axis=0))
    spread = covariance(jacobian / size[:, None], fit.residual / size)
    slope = gradient(_parameters, entries)
    return _parameters(entries), slope @ spread @ slope.T


class _StateVariableFilter:
    """F(s) = w^3 / (s^3 + 2 w s^2 + 2 w^2 s + w^3) and derivatives of what comes out of it.

    The trapezoidal rule puts 2/Dt (1 - z^-1) / (1 + z^-1) in the place of s.
    """

    def __init__(self, corner: float, time_step: float) -> None:
        # s^k over the common (1 + z^-1)^3
        self._powers = (2.0 / time_step) ** np.arange(4.0)[:, None] * _TRAPEZOIDAL
        self._gain = corner**3
        w = corner
        self._denominator = np.array([w**3, 2.0 * w**2, 2.0 * w, 1.0]) @ self._powers
        self.settling = int(_SETTLING_RADIANS / (corner * time_step)) + 1

    def derivative(self, signal: Array, order: int) -> Array:
        """Derivative of the filtered signal, as if its first sample had stood there for ever."""
        numerator = self._gain * self._powers[order]
        result: Array = scipy.signal.lfilter(numerator, self._denominator, signal - signal[0])
        return result


def _parameters(entries: Array) -> Array:
    """I1, I2, B, K from the entries of q, q', T in the rows of q'' and theta1''."""
    twist, motor = entries.reshape(2, 3)
    table = motor - twist  # theta2'' is their difference
    i1 = 1.0 / twist[2]
    k = -motor[0] * i1
    i2 = k / table[0]
    b = -twist[1] * i1 * i2 / (i1 + i2)
    return np.array([i1, i2, b, k])


def _mean(signal: Array) -> Array:
    return 0.5 * (signal[1:] + signal[:-1])
