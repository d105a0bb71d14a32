"""The Cramer-Rao bound: the least scatter that any unbiased estimator can have.

The record is the axis under a torque that is not known either: what is measured of it carries noise
too. With the torque samples as unknowns beside the parameters and the state at the start, the
information about all of them is that of output sensitivities through a filter that whitens the
noise as it appears at the outputs: measurement noise plus the axis' response to the torque's noise.
That filter is Kalman's, with the torque's noise as process noise.
"""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import scipy.linalg

from axistwin import core
from axistwin.core import Array, Axis, State
from axistwin.paper.measurement import NoiseLevel
from axistwin.paper.spectral import state_matrix

_STEP = 1e-4  # relative, of the parameters: central differences leave 1e-8


def cramer_rao(
    axis: Axis,
    time_step: float,
    torque: Array,
    level: NoiseLevel,
    *,
    start: State | None = None,
    speeds: bool = True,
) -> Array:
    """Least relative standard deviations (4,) of I1, I2, B, K from samples under torque (n,).

    Both angles are measured, and with ``speeds`` both speeds. The axis starts from ``start``, at
    rest at angle 0 unless given; the estimator is not told.
    """
    deviation = np.array([level.angle, level.angle, level.speed, level.speed][: 4 if speeds else 2])
    sensitivity = _sensitivities(axis, time_step, torque, start or State(), len(deviation))
    sensitivity /= deviation[:, None]
    if level.torque > 0.0:
        sensitivity = _whitened(sensitivity, axis, time_step, level.torque, deviation)
    columns = sensitivity.reshape(-1, sensitivity.shape[2])
    scale = np.linalg.norm(columns, axis=0)
    r = np.linalg.qr(columns / scale, mode="r")
    inverse = scipy.linalg.solve_triangular(r, np.eye(len(r)))
    result: Array = (np.linalg.norm(inverse, axis=1) / scale)[:4]
    return result


def _sensitivities(
    axis: Axis, time_step: float, torque: Array, start: State, channels: int
) -> Array:
    """Derivatives (n, channels, 8) by the logarithms of I1, I2, B, K and by the state at the start.

    The response is linear in that state, so a small vibration or drift is its derivative.
    """

    def outputs(axis: Axis, torque: Array, start: State) -> Array:
        motion = core.simulate(axis, time_step, torque, start)
        columns = [motion.theta1, motion.theta2, motion.omega1, motion.omega2]
        return np.column_stack(columns[:channels])

    values = np.array(astuple(axis))
    columns = []
    for step in _STEP * np.eye(4):
        above, below = (Axis(*(values * np.exp(sign * step)).tolist()) for sign in (1.0, -1.0))
        difference = outputs(above, torque, start) - outputs(below, torque, start)
        columns.append(difference / (2.0 * _STEP))
    twist, speed = 1e-3, 1e-3 * core.modal(axis).wn
    free = (State(twist=twist), State(twist_speed=speed), State(speed=speed), State(angle=twist))
    columns += [outputs(axis, np.zeros_like(torque), state) for state in free]
    return np.stack(columns, axis=2)


def _whitened(
    signals: Array, axis: Axis, time_step: float, torque: float, deviation: Array
) -> Array:
    """Signals (n, channels, p), scaled by ``deviation``, through the whitening filter."""
    A = state_matrix(np.array(astuple(axis)))
    half = 0.5 * time_step * A
    backward = np.linalg.inv(np.eye(4) - half)
    reach = backward @ np.array([0.0, 0.0, 0.5 * time_step / axis.I1, 0.0]) * torque
    # state of the axis, and the noise of the last torque sample in its own unit
    F = np.zeros((5, 5))
    F[:4, :4] = backward @ (np.eye(4) + half)
    F[:4, 4] = reach
    G = np.append(reach, 1.0)
    H = np.eye(5)[: len(deviation)] / deviation[:, None]

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
