"""What a measurement makes of a motion: white noise on every channel, or encoders alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from axistwin import core
from axistwin.core import Array, Motion, State

_TURN = 2.0 * np.pi


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


def quantisation(counts_per_turn: int) -> NoiseLevel:
    """White noise of the power that an encoder's rounding has, and nothing else."""
    return NoiseLevel(0.0, _TURN / counts_per_turn / float(np.sqrt(12.0)), 0.0)


def measure(
    motion: Motion, torque: Array, level: NoiseLevel, rng: np.random.Generator
) -> tuple[Motion, Array]:
    """Motion and torque (n,) with white Gaussian noise on torque, both angles and both speeds."""
    angles = level.angle * rng.standard_normal((2, len(motion)))
    speeds = level.speed * rng.standard_normal((2, len(motion)))
    samples = motion.samples.copy()
    samples["twist"] += angles[0] - angles[1]
    samples["twist_speed"] += speeds[0] - speeds[1]
    samples["speed"] += speeds[0]
    samples["fraction"] += angles[0] / _TURN
    measured = Motion(motion.precision, samples)
    return measured, torque + level.torque * rng.standard_normal(len(torque))


def read_encoders(
    motion: Motion, counts_per_turn: int, rng: np.random.Generator
) -> npt.NDArray[np.int32]:
    """Counts (n, 2) of encoders at motor and table whose zeros lie anywhere within a count."""
    motor, table = rng.uniform(0.0, 1.0 / counts_per_turn, 2)
    samples = motion.samples.copy()
    samples["fraction"] += motor
    samples["twist"] += (motor - table) * _TURN
    shifted = Motion(motion.precision, samples)
    return core.read_encoders(shifted, (counts_per_turn, counts_per_turn))


def central_differences(
    counts: npt.NDArray[np.int32], counts_per_turn: int, time_step: float
) -> Motion:
    """Motion (n - 2,) from counts (n, 2): the speed at a sample from its two neighbours."""
    angles = counts / counts_per_turn
    speeds = (angles[2:] - angles[:-2]) * (_TURN / (2.0 * time_step))
    angles = angles[1:-1]
    samples = np.zeros(len(angles), core.motion([State()]).samples.dtype)
    samples["twist"] = (angles[:, 0] - angles[:, 1]) * _TURN
    samples["twist_speed"] = speeds[:, 0] - speeds[:, 1]
    samples["speed"] = speeds[:, 0]
    samples["fraction"] = angles[:, 0]
    return Motion("float64", samples)
