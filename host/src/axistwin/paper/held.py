"""The bias-free form for torque that is held from each sample to the next, as a drive does.

Between samples x = [q, q'] then moves exactly by x[k+1] = F x[k] + G T[k] with F = exp(A h), and
the difference quotient obeys

    (x[k+1] - x[k]) / h = N (x[k+1] + x[k]) / 2 + M T[k]
    N = (2 / h) tanh(A h / 2),   M = A^-1 N C

A is the companion matrix [[0, 1], [-k, -d]], C = [0, 1 / I1], and a function of a 2 x 2 matrix is
a 1 + b A with two numbers a and b. So

    N = [[a, b], [-b k, a - b d]],   M = [-a / (k I1), b / I1]

and the physics are ratios to the entry b of q' in the rate of q, which is found along with the
rest: k = -N21 / b, d = (N11 - N22) / b, 1 / I1 = M2 / b. Neither a logarithm nor the time step is
needed. Torque that is linear between samples of Newmark's method has a = 0, b = 1; taking that for
granted here (the Cayley transform) is wrong by about x^2 / 12, x = wn h.

The rigid body r = theta1 - s q, with a guess s of I2 / (I1 + I2), gains exactly h T[k] / (I1 + I2)
of speed in each step, and the guess's error times the gain of q'.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from axistwin.core import Array, Axis, Motion, Precision
from axistwin.paper import native
from axistwin.paper.settings import AXIS, MODAL, RMS


@dataclass(frozen=True)
class HeldEquations:
    """Scaled equations y (n, 3) = phi (n, 3) theta': rates of q, q', r' on q, q', T.

    A scaled entry (output, input) of theta times ``scale[input] / output_scale[output]`` is the
    entry in physical units. ``share`` is the guess of I2 / (I1 + I2) in r.
    """

    phi: Array
    y: Array
    scale: Array
    output_scale: Array
    share: float
    precision: Precision


def equations(motion: Motion, torque: Array, time_step: float) -> HeldEquations:
    """The equations between the samples of a motion under held torque (n,) [N m].

    All arithmetic is in the motion's own precision; scaling is by powers of two, which costs no
    digit.
    """
    real = np.dtype(motion.precision).type
    inertia = AXIS.I1 + AXIS.I2
    share = real(AXIS.I2 / inertia)
    twist = RMS / (AXIS.I1 * MODAL.wn**2)
    scale = _per_power_of_two(np.array([twist, twist * MODAL.wn, RMS]))
    output_scale = _per_power_of_two(
        np.array([twist * MODAL.wn, twist * MODAL.wn**2, RMS / inertia])
    )
    samples = motion.samples
    q, rate = samples["twist"], samples["twist_speed"]
    body_speed = samples["speed"] - share * rate
    half, per_step = real(0.5), real(1.0 / time_step)
    phi = np.column_stack(
        [half * (q[1:] + q[:-1]), half * (rate[1:] + rate[:-1]), torque[:-1].astype(real)]
    )
    y = np.column_stack([np.diff(q), np.diff(rate), np.diff(body_speed)]) * per_step
    return HeldEquations(
        (phi * scale.astype(real)).astype(np.float64),
        (y * output_scale.astype(real)).astype(np.float64),
        scale,
        output_scale,
        float(share),
        motion.precision,
    )


def _per_power_of_two(size: Array) -> Array:
    result: Array = 2.0 ** -np.floor(np.log2(size))
    return result


def parameters(given: HeldEquations, theta: Array, *, cayley: bool = False) -> Axis:
    """The axis from one solution theta (3, 3), in the precision of the equations.

    ``cayley`` reads it as if the torque had been linear between samples: b = 1, a = 0.
    """
    real = np.dtype(given.precision).type
    entry = (theta * given.scale / given.output_scale[:, None]).astype(real)
    a, b = (real(0.0), real(1.0)) if cayley else (entry[0, 0], entry[0, 1])
    I1 = b / entry[1, 2]
    motor = entry[2, 0] + real(given.share) * entry[1, 0]  # row of theta1'' = r'' + s q''
    K = -motor * I1 / b
    I2 = K * b / (motor - entry[1, 0])
    B = (a - entry[1, 1]) / b * (I1 * I2 / (I1 + I2))
    return Axis(float(I1), float(I2), float(B), float(K))


def identify(given: HeldEquations, every: int | None = None) -> native.Regression:
    """Eqs. 14-16 over the equations; read the solutions by parameters()."""
    return native.recursive_least_squares(
        given.phi,
        given.y,
        prior=native.PRIOR[given.precision],
        every=every,
        precision=given.precision,
    )
