"""What a measurement makes of a motion: white noise on every channel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from axistwin import core
from axistwin.core import Array, Motion, State


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviations of the noise on torque [N m], on angles [rad] and on speeds [rad/s]."""

    torque: float
    angle: float
    speed: float


def noise_level(motion: Motion, torque: Array, decibels: float) -> NoiseLevel:
    """Noise that is ``decibels`` below the rms of the torque, of the twist and of its rate.

    Not of the angles themselves: those drift, and what says anything about the axis is the twist.
    """
    share = 10.0 ** (-decibels / 20.0)
    channels = (torque, motion.twist, motion.twist_speed)
    return NoiseLevel(*(share * float(np.std(channel)) for channel in channels))


def measure(
    motion: Motion, torque: Array, level: NoiseLevel, rng: np.random.Generator
) -> tuple[Motion, Array]:
    """Motion and torque (n,) with white Gaussian noise on torque, both angles and both speeds."""
    n = len(torque)
    theta1, theta2 = (
        angle + level.angle * rng.standard_normal(n) for angle in (motion.theta1, motion.theta2)
    )
    omega1, omega2 = (
        speed + level.speed * rng.standard_normal(n) for speed in (motion.omega1, motion.omega2)
    )
    rows = np.column_stack([theta1 - theta2, omega1 - omega2, omega1, theta1]).tolist()
    measured = core.motion((State(*row) for row in rows), motion.precision)
    return measured, torque + level.torque * rng.standard_normal(n)
