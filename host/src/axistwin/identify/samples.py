"""The part of a record that an identification works on: one unbroken stretch of samples."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

from axistwin.core import Array
from axistwin.errors import NotEnoughDataError
from axistwin.record import Record

#: How the torque goes on between samples: by the trapezoidal rule of the emulated axis (Newmark's
#: method), held from each sample to the next as a real drive does it (zero-order hold), or straight
#: from one to the next, which a measured torque comes close to (first-order hold).
Hold: TypeAlias = Literal["newmark", "zoh", "foh"]
HOLDS: tuple[Hold, ...] = ("newmark", "zoh", "foh")

#: An error below this share of the signal is rounding of the record itself.
ROUNDING = 1e-6

#: Fewer samples than this are not worth a regression.
SAMPLES_MIN = 50


@dataclass(frozen=True)
class Samples:
    """Evenly spaced samples without a gap; angles are reckoned from the motor's first one.

    Arrays are (n,): ``torque`` [N m], ``theta1``, ``theta2`` [rad], ``omega1``, ``omega2``
    [rad/s]. ``resolution`` is one count of the motor and table encoder [rad], None if unknown.
    A ``linear`` axis reads N, m. In the record they begin at ``begin`` [s] after its first sample,
    with the motor at the angle ``zero`` [rad].
    """

    time_step: float
    torque: Array
    theta1: Array
    theta2: Array | None
    omega1: Array | None
    omega2: Array | None
    resolution: tuple[float | None, float | None]
    linear: bool
    begin: float = 0.0
    zero: float = 0.0

    @property
    def count(self) -> int:
        """Number of samples."""
        return len(self.torque)

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return (self.count - 1) * self.time_step

    @property
    def twist(self) -> Array:
        """theta1 - theta2 [rad], (n,)."""
        return self.theta1 - self.table

    @property
    def table(self) -> Array:
        """theta2 [rad], (n,). Raises NotEnoughDataError for a record with one encoder."""
        if self.theta2 is None:
            raise NotEnoughDataError("no table angle (theta2): two inertias take both encoders")
        return self.theta2

    @property
    def has_speeds(self) -> bool:
        """True when both speeds were measured."""
        return self.omega1 is not None and self.omega2 is not None

    def speeds(self) -> tuple[Array, Array]:
        """omega1 and omega2 [rad/s]. Raises NotEnoughDataError when they were not measured."""
        if self.omega1 is None or self.omega2 is None:
            raise NotEnoughDataError("the record has no speeds (omega1, omega2)")
        return self.omega1, self.omega2


def longest_stretch(record: Record) -> Samples:
    """The longest part of the record with no sample missing.

    Raises NotEnoughDataError when it is shorter than SAMPLES_MIN samples.
    """
    bounds = np.concatenate([[-1], record.missing, [len(record)]])
    longest = int(np.argmax(np.diff(bounds)))
    part = slice(int(bounds[longest]) + 1, int(bounds[longest + 1]))
    count = part.stop - part.start
    if count < SAMPLES_MIN:
        raise NotEnoughDataError(
            f"{record.source}: only {max(count, 0)} samples in a row, {SAMPLES_MIN} are needed"
        )
    return _cut(record, part)


def whole(record: Record) -> Samples:
    """All of the record, with what is missing as it has been interpolated."""
    return _cut(record, slice(0, len(record)))


def _cut(record: Record, part: slice) -> Samples:
    def cut(channel: Array | None, zero: float = 0.0) -> Array | None:
        return None if channel is None else channel[part] - zero

    zero = float(record.theta1[part][0])
    return Samples(
        time_step=record.time_step,
        torque=record.torque[part],
        theta1=record.theta1[part] - zero,
        theta2=cut(record.theta2, zero),
        omega1=cut(record.omega1),
        omega2=cut(record.omega2),
        resolution=record.resolution,
        linear=record.linear,
        begin=part.start * record.time_step,
        zero=zero,
    )


def check_excitation(samples: Samples) -> None:
    """Raises NotEnoughDataError when nothing pushes the axis, or nothing moves."""
    if float(np.ptp(samples.torque)) == 0.0:
        raise NotEnoughDataError(
            "the torque does not change in this record: nothing excites the axis; "
            "switch the excitation on"
        )
    if float(np.ptp(samples.theta1)) == 0.0:
        raise NotEnoughDataError(
            "the motor does not move in this record: release the brake, or excite with more torque"
        )
