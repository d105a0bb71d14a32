"""The Cramer-Rao bound: the least scatter that any unbiased estimator can have.

The record is the axis under a torque that is not known either: what is measured of it carries noise
too. With the torque samples as unknowns beside the parameters and the state at the start, the
information about all of them is that of output sensitivities through a filter that whitens the
noise as it appears at the outputs: measurement noise plus the axis' response to the torque's noise.
That filter is Kalman's, with the torque's noise as process noise.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import scipy.linalg

from axistwin import core
from axistwin.core import Array, Axis, Motion, State
from axistwin.paper.spectral import state_matrix

_STEP = 1e-4  # relative, of the parameters: central differences leave 1e-8


@dataclass(frozen=True)
class Noise:
    """Standard deviations of white noise: ``torque`` [N m] and ``motion``, of theta1, theta2 [rad]
    and, when the speeds are measured, omega1, omega2 [rad/s]."""

    torque: float
    motion: tuple[float, ...]


def cramer_rao(axis: Axis, time_step: float, torque: Array, noise: Noise) -> Array:
    """Least relative standard deviations (4,) of I1, I2, B, K from samples under torque (n,).

    The axis starts from rest at zero, which the estimator is not told.
    """
    sensitivity = np.stack(list(_sensitivities(axis, time_step, torque, len(noise.motion))), axis=2)
    sensitivity /= np.array(noise.motion)[:, None]
    if noise.torque > 0.0:
        sensitivity = _whitened(sensitivity, axis, time_step, noise)
    columns = sensitivity.reshape(-1, sensitivity.shape[2])
    scale = np.linalg.norm(columns, axis=0)
    inverse = scipy.linalg.solve_triangular(
        np.linalg.qr(columns / scale, mode="r"), np.eye(len(scale))
    )
    result: Array = (np.linalg.norm(inverse, axis=1) / scale)[:4]
    return result


def _sensitivities(axis: Axis, time_step: float, torque: Array, channels: int) -> Iterator[Array]:
    """Derivatives (n, channels) by the logarithms of I1, I2, B, K and by the state at the start."""

    def outputs(motion: Motion) -> Array:
        columns = [motion.theta1, motion.theta2, motion.omega1, motion.omega2]
        return np.column_stack(columns[:channels])

    values = np.array([axis.I1, axis.I2, axis.B, axis.K])
    for i in range(4):
        step = np.where(np.arange(4) == i, _STEP, 0.0)
        above, below = (
            outputs(core.simulate(Axis(*(values * np.exp(by)).tolist()), time_step, torque))
            for by in (step, -step)
        )
        yield (above - below) / (2.0 * _STEP)
    size = core.simulate(axis, time_step, torque)
    unit = [float(np.std(size.twist)), float(np.std(size.twist_speed))]
    rest = np.zeros_like(torque)
    for state in (
        State(*unit[:1]),
        State(0.0, unit[1]),
        State(speed=unit[1]),
        State(angle=unit[0]),
    ):
        yield outputs(core.simulate(axis, time_step, rest, state))


def _whitened(signals: Array, axis: Axis, time_step: float, noise: Noise) -> Array:
    """Signals (n, channels, p), scaled by the measurement noise, through the whitening filter."""
    A = state_matrix(np.array([axis.I1, axis.I2, axis.B, axis.K]))
    half = 0.5 * time_step * A
    backward = np.linalg.inv(np.eye(4) - half)
    reach = backward @ np.array([0.0, 0.0, 0.5 * time_step / axis.I1, 0.0]) * noise.torque
    # state of the axis, and the noise of the last torque sample in its own unit
    F = np.zeros((5, 5))
    F[:4, :4] = backward @ (np.eye(4) + half)
    F[:4, 4] = reach
    G = np.append(reach, 1.0)
    H = np.eye(5)[: len(noise.motion)] / np.array(noise.motion)[:, None]

    P = np.diag([0.0, 0.0, 0.0, 0.0, 1.0])
    state = np.zeros((5, signals.shape[2]))
    white = np.empty_like(signals)
    for n, signal in enumerate(signals):
        root = np.linalg.cholesky(H @ P @ H.T + np.eye(len(H)))
        inverse = np.linalg.inv(root)
        gain = P @ H.T @ inverse.T
        white[n] = inverse @ (signal - H @ state)
        state = F @ (state + gain @ white[n])
        P = F @ (P - gain @ gain.T) @ F.T + np.outer(G, G)
    return white
