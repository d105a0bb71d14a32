"""The linear axis, which answers any torque at motor and table, exactly.

What an effect adds to Eq. 3 is a torque somewhere, or an error of an encoder. Given the motion that
was measured, the torque is known but for its size; the linear axis then answers in proportion, so
that all sizes are found by least squares. Simulated by the core's exact step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import numpy.typing as npt

from axistwin import core
from axistwin.core import Array, Axis
from axistwin.errors import InputError

Complexes = npt.NDArray[np.complex128]


@dataclass(frozen=True)
class Torque:
    """What acts at each of c places (c, w, l) [N m]: from each sample to the next it goes straight
    from ``first`` to ``last``."""

    first: Array
    last: Array

    @classmethod
    def smooth(cls, values: Array) -> Torque:
        """A smooth course through values (c, w, l) at the samples.

        Straight lines between samples carry less of what is fast: of an oscillation of x radians a
        sample the share (sin(x/2) / (x/2))^2, about 1 - x^2 / 12. The second difference, about
        -x^2, makes up for that.
        """
        bent = values.copy()
        bent[:, :, 1:-1] -= np.diff(values, 2, axis=2) / 12.0
        return cls(bent, np.concatenate([bent[:, :, 1:], bent[:, :, -1:]], axis=2))


class Linear(Protocol):
    """What moves in proportion to the torque; c channels and places, s states."""

    def respond(
        self, time_step: float, torque: Torque, states: Array | None = None
    ) -> tuple[Array, Array]:
        """Angles [rad] and speeds [rad/s] (c, w, l) under a torque at each place.

        Each window starts in its state (w, s), at rest unless given.
        """

    def free(self, time_step: float, length: int) -> Array:
        """The motion (s, c, l) without torque from each unit state."""

    def starts(self, states: Array) -> Array:
        """States (w, s) as core.simulate_windows() has them."""

    def states(self, starts: Array) -> Array:
        """The way back."""


class Plant(Linear, Protocol):
    """A linear axis with ``values`` (k,), the parameters ``names``."""

    @property
    def names(self) -> tuple[str, ...]:
        """Of the parameters."""

    @property
    def values(self) -> Array:
        """The parameters (k,)."""

    def with_values(self, values: Array) -> Plant:
        """The same kind of axis with other parameters (k,)."""

    @property
    def directions(self) -> Array:
        """Changes of the parameters (k, k), a column each, that a record tells well apart.

        Each is about the size of the parameters, so that derivatives along them are comparable.
        """

    def others(self) -> Sequence[Plant]:
        """Plants that look alike from afar, to begin with instead."""


@dataclass(frozen=True)
class TwoInertias:
    """The axis of Eq. 3. States: of the centre of mass angle, speed; of the twist likewise."""

    axis: Axis
    names = ("I1", "I2", "B", "K")

    @property
    def values(self) -> Array:
        return np.array([self.axis.I1, self.axis.I2, self.axis.B, self.axis.K])

    def with_values(self, values: Array) -> TwoInertias:
        return TwoInertias(Axis(*values.tolist()))

    @property
    def directions(self) -> Array:
        """All in proportion, the share of the table, stiffness and damping each alone.

        The first two leave the vibration as it is. Inertias changed one by one would all move the
        axis as a whole, beside which what they do to the twist is lost in rounding.
        """
        a = self.axis
        total = a.I1 + a.I2
        reduced = a.I1 * a.I2 / total
        share = (a.I1 - a.I2) / total  # of the reduced inertia, which follows
        damping = max(a.B, _DAMPING_MIN * a.K / self.frequency)
        columns = [
            (a.I1, a.I2, a.B, a.K),
            (-reduced, reduced, a.B * share, a.K * share),
            (0.0, 0.0, 0.0, a.K),
            (0.0, 0.0, damping, 0.0),
        ]
        directions: Array = np.array(columns).T
        return directions

    def others(self) -> Sequence[Plant]:
        total, wn = self.axis.I1 + self.axis.I2, self.frequency
        return [
            TwoInertias(core.axis_from_modal((1.0 - share) * total, share * total, wn, _DAMPING))
            for share in _SHARES
        ]

    @property
    def frequency(self) -> float:
        """Natural frequency [rad/s]."""
        return core.modal(self.axis).wn

    def respond(
        self, time_step: float, torque: Torque, states: Array | None = None
    ) -> tuple[Array, Array]:
        a = self.axis
        total = a.I1 + a.I2
        reduced = a.I1 * a.I2 / total
        laws = ((0.0, 0.0), (a.B / reduced, a.K / reduced))
        shares = ((1.0 / total, 1.0 / total), (1.0 / a.I1, -1.0 / a.I2))
        moved = []
        for i, (law, (motor, table)) in enumerate(zip(laws, shares, strict=True)):
            first, last = (motor * t[0] + table * t[1] for t in (torque.first, torque.last))
            start = None if states is None else states[:, 2 * i : 2 * i + 2]
            moved.append(core.respond(*law, time_step, first, last, start))
        (body, body_speed), (twist, twist_speed) = moved
        motor_share, table_share = a.I2 / total, -a.I1 / total
        return (
            np.stack([body + motor_share * twist, body + table_share * twist]),
            np.stack(
                [body_speed + motor_share * twist_speed, body_speed + table_share * twist_speed]
            ),
        )

    def free(self, time_step: float, length: int) -> Array:
        nothing = np.zeros((2, 4, length))
        angles, _ = self.respond(time_step, Torque(nothing, nothing), np.eye(4))
        free: Array = angles.transpose(1, 0, 2)
        return free

    def starts(self, states: Array) -> Array:
        body, body_speed, twist, twist_speed = states.T
        share = self.axis.I2 / (self.axis.I1 + self.axis.I2)
        columns = (twist, twist_speed, body_speed + share * twist_speed, body + share * twist)
        return np.stack(columns, axis=1)

    def states(self, starts: Array) -> Array:
        twist, twist_speed, speed, angle = starts.T
        share = self.axis.I2 / (self.axis.I1 + self.axis.I2)
        columns = (angle - share * twist, speed - share * twist_speed, twist, twist_speed)
        return np.stack(columns, axis=1)


@dataclass(frozen=True)
class ThreeInertias:
    """The axis of Eq. 3 with a further inertia on a spring on its table: ``frequency`` [rad/s] and
    ``damping_ratio`` of that alone, the table held, ``mass_ratio`` in units of I2.

    States: of the centre of mass angle, speed; of the twist of the shaft likewise; of the further
    inertia against the table likewise. Raises InputError for what does not swing twice.
    """

    axis: Axis
    frequency: float
    damping_ratio: float
    mass_ratio: float

    def __post_init__(self) -> None:
        if min(self.frequency, self.damping_ratio, self.mass_ratio) < 0.0:
            raise InputError("a further mode has neither negative inertia nor negative damping")

    def respond(
        self, time_step: float, torque: Torque, states: Array | None = None
    ) -> tuple[Array, Array]:
        a = self.axis
        total = a.I1 + a.I2 * (1.0 + self.mass_ratio)
        first, last = ((t[0] + t[1]) / total for t in (torque.first, torque.last))
        start = None if states is None else states[:, :2]
        angle, speed = core.respond(0.0, 0.0, time_step, first, last, start)
        angles, speeds = np.stack([angle, angle]), np.stack([speed, speed])

        shares = self._table + np.array([(1.0, 0.0), (0.0, 0.0)])  # of motor and table
        pushed = np.array([(0.0, 0.0), (1.0 / a.I1, -1.0 / a.I2), (0.0, 0.0), (0.0, -1.0 / a.I2)])
        poles, vectors = self._swings
        inverse = np.linalg.inv(np.concatenate([vectors, vectors.conj()], axis=1))[:2]
        for pole, vector, row in zip(poles, vectors.T, inverse, strict=True):
            drive = row @ pushed
            start = None if states is None else states[:, 2:] @ row
            swing = _swing(complex(pole), time_step, torque, drive, start)
            for moved, part in ((angles, vector[::2]), (speeds, vector[1::2])):
                for channel, share in zip(moved, 2.0 * shares @ part, strict=True):
                    channel += share.real * swing[0] - share.imag * swing[1]
        return angles, speeds

    def free(self, time_step: float, length: int) -> Array:
        nothing = np.zeros((2, 6, length))
        angles, _ = self.respond(time_step, Torque(nothing, nothing), np.eye(6))
        free: Array = angles.transpose(1, 0, 2)
        return free

    def starts(self, states: Array) -> Array:
        body, body_speed, twist, twist_speed, further, further_speed = states.T
        own, share = self._table
        columns = (
            twist,
            twist_speed,
            body_speed + (1.0 + own) * twist_speed + share * further_speed,
            body + (1.0 + own) * twist + share * further,
            -further,
            -further_speed,
        )
        return np.stack(columns, axis=1)

    def states(self, starts: Array) -> Array:
        twist, twist_speed, speed, angle, behind, behind_speed = starts.T
        own, share = self._table
        columns = (
            angle - (1.0 + own) * twist + share * behind,
            speed - (1.0 + own) * twist_speed + share * behind_speed,
            twist,
            twist_speed,
            -behind,
            -behind_speed,
        )
        return np.stack(columns, axis=1)

    @property
    def _table(self) -> Array:
        """Where the table is against the centre of mass, by twist and by the further inertia."""
        a = self.axis
        total = a.I1 + a.I2 * (1.0 + self.mass_ratio)
        return -np.array([a.I1, a.I2 * self.mass_ratio]) / total

    @property
    def _swings(self) -> tuple[Complexes, Complexes]:
        """The relative states (4,) are 2 Re(V z), z' = poles z + drive: poles (2,), V (4, 2)."""
        a, p, m = self.axis, self.frequency, self.mass_ratio
        shaft = np.array([a.K, a.B, 0.0, 0.0])
        carried = np.array([0.0, 0.0, p**2, 2.0 * self.damping_ratio * p])
        system = np.zeros((4, 4))
        system[0, 1] = system[2, 3] = 1.0
        system[1] = -(1.0 / a.I1 + 1.0 / a.I2) * shaft - m * carried
        system[3] = -shaft / a.I2 - (1.0 + m) * carried
        poles, vectors = np.linalg.eig(system)
        above = poles.imag > 0.0
        if np.count_nonzero(above) != 2:
            raise InputError("an axis with a further mode swings twice")
        return poles[above], vectors[:, above]


def _swing(
    pole: complex, time_step: float, torque: Torque, drive: Complexes, start: Complexes | None
) -> tuple[Array, Array]:
    """Real and imaginary part (w, l) of z' = pole z + drive (2,) torque, from start (w,).

    Each part of the drive moves an oscillator q with the poles ``pole`` and its conjugate; what it
    makes of z is q' - conj(pole) q.
    """
    law = (-2.0 * pole.real, abs(pole) ** 2)
    states = None
    if start is not None:
        first_angle = start.imag / pole.imag
        states = np.stack([first_angle, start.real + pole.real * first_angle], axis=1)
    moved = []
    for part, begun in ((drive.real, states), (drive.imag, None)):
        first, last = (part[0] * t[0] + part[1] * t[1] for t in (torque.first, torque.last))
        angle, speed = core.respond(*law, time_step, first, last, begun)
        moved.append((speed - pole.real * angle, pole.imag * angle))
    (real, imaginary), (along, across) = moved
    return real - across, imaginary + along


#: Shares of the table in the inertia, and a damping ratio, to begin with.
_SHARES = (0.1, 0.25, 0.5, 0.75)
_DAMPING = 0.04

#: Twice a damping ratio: no damping is as good as this much.
_DAMPING_MIN = 2e-3


@dataclass(frozen=True)
class Rigid:
    """One inertia with viscous friction; what one encoder shows. States: angle, speed."""

    inertia: float
    viscous: float
    names = ("I", "viscous")

    @property
    def values(self) -> Array:
        return np.array([self.inertia, self.viscous])

    def with_values(self, values: Array) -> Rigid:
        return Rigid(*values.tolist())

    @property
    def directions(self) -> Array:
        """All in proportion, and friction alone."""
        return np.array([(self.inertia, 0.0), (self.viscous, self.inertia)])

    def others(self) -> Sequence[Plant]:
        return []

    def respond(
        self, time_step: float, torque: Torque, states: Array | None = None
    ) -> tuple[Array, Array]:
        damping = self.viscous / self.inertia
        first, last = (t[0] / self.inertia for t in (torque.first, torque.last))
        angle, speed = core.respond(damping, 0.0, time_step, first, last, states)
        return angle[None], speed[None]

    def free(self, time_step: float, length: int) -> Array:
        nothing = np.zeros((1, 2, length))
        angles, _ = self.respond(time_step, Torque(nothing, nothing), np.eye(2))
        free: Array = angles.transpose(1, 0, 2)
        return free

    def starts(self, states: Array) -> Array:
        angle, speed = states.T
        nothing = np.zeros_like(angle)
        return np.stack([nothing, nothing, speed, angle], axis=1)

    def states(self, starts: Array) -> Array:
        return starts[:, [3, 2]]
