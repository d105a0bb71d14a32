"""Maximum likelihood on the lines of a periodic excitation, from the average of its periods.

The average of P periods is again a record of the same linear axis, whatever the transient, with
1/P of the noise's power. At line k of its discrete Fourier transform the trapezoidal rule
(Newmark's method with 1/4, 1/2) turns Eq. 8 into::

    (s I - A) X = C U + (A - 2/Dt) z / (z + 1) d,    z = exp(2 pi j k / N), s = 2/Dt (z - 1)/(z + 1)

exactly, where d is by how much the state at the end of the average differs from that at its start:
transient and drift, four unknowns beside the parameters. With noise of known power on the measured
motion and on the torque, the parameters minimise sum e' V^-1 e over the lines, e = Y - X(U) and V
the covariance of e (R. Pintelon and J. Schoukens, System Identification: A Frequency Domain
Approach, the errors-in-variables chapter). The power comes from how the periods differ, and the
start from a linear regression on the same lines: nothing else has to be known.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
import scipy.linalg

from axistwin import core
from axistwin.core import Array, Axis
from axistwin.errors import NotEnoughDataError

Complex: TypeAlias = npt.NDArray[np.complex128]

_STATES = 4  # theta1, theta2, omega1, omega2
_AXIS = 4  # I1, I2, B, K
_ROUNDS = 30
_SETTLED = 1e-3  # of a standard error


@dataclass(frozen=True)
class Average:
    """The average of P periods of N samples, as its Fourier transform at the excited lines.

    ``torque`` (lines,) and ``motion`` (lines, channels): theta1, theta2 and, when measured, omega1
    and omega2. ``torque_power`` and ``motion_power`` (channels,) are the powers of their noise at a
    line. ``z`` (lines,) is exp(2 pi j k / N).
    """

    time_step: float
    z: Complex
    torque: Complex
    motion: Complex
    torque_power: float
    motion_power: Array


@dataclass(frozen=True)
class Fit:
    """The axis found and the standard errors of I1, I2, B, K (4,), relative."""

    axis: Axis
    relative_error: Array


def average(
    time_step: float,
    N: int,
    lines: npt.NDArray[np.int64],
    torque: Array,
    motion: Array,
    rounding: float = 0.0,
) -> Average:
    """Average of the whole periods of N samples in torque (n,) and motion (n, 2 or 4).

    The power of the noise is taken from second differences over the periods of the later half,
    which steady motion and drift leave at zero. Of motion in steps of ``rounding`` the total is
    known, one twelfth of a step squared: what does not differ from period to period repeats, and
    averaging does not lessen it. Raises NotEnoughDataError with fewer than five periods.
    """
    P = len(torque) // N
    if P < 5:
        raise NotEnoughDataError(f"{P} periods do not tell noise from motion: five are needed")
    periods = np.column_stack([torque, motion])[: P * N].reshape(P, N, -1)
    spectrum = np.fft.fft(periods.mean(axis=0), axis=0)[lines]
    later = periods[min(P // 2, P - 3) :]
    variance = np.mean(np.diff(later, 2, axis=0) ** 2, axis=(0, 1)) / 6.0
    repeating = np.maximum(rounding**2 / 12.0 - variance[1:], 0.0)
    torque_power, motion_power = variance[0] / P, variance[1:] / P + repeating
    z = np.exp(2j * np.pi * lines / N)
    return Average(
        time_step, z, spectrum[:, 0], spectrum[:, 1:], N * float(torque_power), N * motion_power
    )


def rough(data: Average) -> Axis:
    """A start from angles and torque alone: linear least squares on the equation of motion.

    Divided by (s + w)^2, w in the middle of the excited band, so that noise weighs neither most at
    the lowest lines nor at the highest. Raises NotEnoughDataError when what it finds is no axis.
    """
    s, transient = _bilinear(data)
    weight = 1.0 / (s + np.median(np.abs(s))) ** 2
    motor, twist = data.motion[:, 0], data.motion[:, 0] - data.motion[:, 1]
    regressors = [twist, s * twist, data.torque, transient, transient * s]
    outputs = [s**2 * twist, s**2 * motor]
    solution, _ = _least_squares(
        _real(np.column_stack(regressors) * weight[:, None]),
        _real(np.column_stack(outputs) * weight[:, None]),
    )
    entries = solution[:3].T.tolist()
    c = core._load("float64")
    rows = c.ffi.new("axt_rows *", {"twist": entries[0], "body": entries[1]})
    axis = c.ffi.new("axt_axis *")
    status = c.lib.axt_axis_from_rows(rows, 0.0, axis)
    core._check(c, status, "least squares on the lines of the excitation")
    return core._axis_of(axis)


def maximum_likelihood(data: Average, start: Axis) -> Fit:
    """The axis that makes these averages likeliest, by Gauss-Newton steps from a start near it.

    Raises NotEnoughDataError when it does not settle.
    """
    logs = np.log([start.I1, start.I2, start.B, start.K])
    for _ in range(_ROUNDS):
        step, spread = _step(data, logs)
        logs = logs + np.clip(step, -0.5, 0.5)
        if np.all(np.abs(step) < _SETTLED * spread):
            return Fit(Axis(*(float(value) for value in np.exp(logs))), spread)
    raise NotEnoughDataError("maximum likelihood did not settle: average more periods")


def _bilinear(data: Average) -> tuple[Complex, Complex]:
    """s and z / (z + 1) at the lines."""
    z = data.z
    return 2.0 / data.time_step * (z - 1.0) / (z + 1.0), z / (z + 1.0)


def _real(values: Complex) -> Array:
    return np.concatenate([values.real, values.imag])


def state_matrix(axis: Array) -> Array:
    """A of Eq. 8 for I1, I2, B, K."""
    I1, I2, B, K = axis
    shaft = np.array([-K, K, -B, B])
    return np.array([[0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0], shaft / I1, -shaft / I2])


def _derivatives(A: Array) -> Array:
    """Derivatives (4, 4, 4) of A by the logarithms of I1, I2, B, K."""
    motor, table = np.zeros((2, _STATES, _STATES))
    motor[2], table[3] = A[2], A[3]
    damping = (motor + table) * [0.0, 0.0, 1.0, 1.0]
    stiffness = (motor + table) * [1.0, 1.0, 0.0, 0.0]
    return np.array([-motor, -table, damping, stiffness])


def _step(data: Average, logs: Array) -> tuple[Array, Array]:
    """A Gauss-Newton step of the logarithms of I1, I2, B, K, and their standard errors.

    The response is linear in d, so d is found anew each time. Of the torque the likeliest value
    under the present axis stands in the derivatives (the measured one would bias them).
    """
    s, transient = _bilinear(data)
    channels = len(data.motion_power)
    A = state_matrix(np.exp(logs))
    C = np.array([0.0, 0.0, np.exp(-logs[0]), 0.0])
    resolvent = np.linalg.inv(s[:, None, None] * np.eye(_STATES) - A)
    gain = resolvent @ C
    drift = resolvent @ (A - 2.0 / data.time_step * np.eye(_STATES)) * transient[:, None, None]

    g = gain[:, :channels]
    noise = data.torque_power * g[:, :, None] * g[:, None].conj() + np.diag(data.motion_power)
    whiten = np.linalg.inv(np.linalg.cholesky(noise))

    def whitened(states: Complex) -> Array:
        """Columns (lines, states, p) as real equations of unit variance, those measured."""
        flat = (whiten @ states[:, :channels]).reshape(-1, states.shape[2])
        equations: Array = _real(flat) * np.sqrt(2.0)
        return equations

    error = data.motion - g * data.torque[:, None]
    d, _ = _least_squares(whitened(drift), whitened(error[:, :, None]))
    error -= (drift @ d)[:, :channels, 0]
    weighted = np.linalg.solve(noise, error[:, :, None])[:, :, 0]
    torque = data.torque + data.torque_power * np.sum(g.conj() * weighted, axis=1)
    # X + z / (z + 1) d, on which the derivatives of A act
    state = gain * torque[:, None] + (drift @ d)[:, :, 0] + transient[:, None] * d[:, 0]
    columns = [(resolvent @ (dA @ state.T).T[:, :, None]) for dA in _derivatives(A)]
    columns[0] -= (gain * torque[:, None])[:, :, None]
    jacobian = whitened(np.concatenate([*columns, drift], axis=2))
    step, spread = _least_squares(jacobian, whitened(error[:, :, None]))
    return step[:_AXIS, 0], spread[:_AXIS]


def _least_squares(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Solution (p, m) by QR with scaled columns, and its standard errors (p,) for unit noise."""
    scale = np.linalg.norm(matrix, axis=0)
    q, r = np.linalg.qr(matrix / scale)
    inverse = scipy.linalg.solve_triangular(r, np.eye(len(r)))
    solution: Array = inverse @ (q.T @ right) / scale[:, None]
    return solution, np.linalg.norm(inverse, axis=1) / scale
