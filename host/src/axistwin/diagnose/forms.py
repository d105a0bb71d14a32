"""Forms that no effect of the catalogue has, to see whether what a record holds is none of them.

Each is a sum of functions of one quantity, free enough for any smooth law of it, or for any way in
which it is remembered. Where such a sum does for windows that no fit has seen what the catalogue
cannot do, the cause has no name here, and what has been named may be an image of it.
"""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from axistwin.core import Array
from axistwin.diagnose.effects import (
    Coulomb,
    Kind,
    Motion,
    Push,
    Shaft,
    Shape,
    torque_at,
    torque_between,
    total,
)
from axistwin.diagnose.linear import Plant

#: Degrees of the polynomials: what is constant or straight has a name.
_DEGREES = range(2, 9)

#: Powers of a speed, each of which either direction has for itself.
_POWERS = range(2, 6)

#: Reaches of the elements that give way before they slip: of what an axis travels in a window, and
#: of the rms of the twist.
_TRAVELS = np.geomspace(3e-4, 0.1, 6)
_TWISTS = np.geomspace(0.05, 2.0, 6)

#: Waves a turn of uneven friction.
_WAVES = (1.0, 2.0, 3.0)


class Form(Kind):
    """A form that no effect of the catalogue has; its sizes have no names."""

    terms: ClassVar[int] = len(_DEGREES)

    @property
    def sizes(self) -> int:
        """How many there are."""
        return self.terms


class TorqueCurve(Form):
    """A drive whose torque is no straight line of the command."""

    effect = "torque_curve"

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [Push(command=np.stack([term, term])) for term in _polynomials(motion.command())]


class SpeedCurve(Form):
    """Friction that goes with speed in some smooth way, in each direction in one of its own."""

    effect = "speed_curve"
    terms = 2 * len(_POWERS)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        speed = motion.speed[self.place]
        ways = [np.maximum(way * speed, 0.0) / np.max(np.abs(speed)) for way in (1.0, -1.0)]
        return [torque_at(self.place, way**power) for way in ways for power in _POWERS]


class TwistCurve(Form, Shaft):
    """A shaft whose torque goes with its twist in some smooth way."""

    effect = "twist_curve"

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [torque_between(term) for term in _polynomials(motion.twist)]


class UnevenFriction(Form):
    """Dry friction that is more here and less there on a turn."""

    effect = "uneven_friction"
    terms = 2 * len(_WAVES)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        (push,) = Coulomb(self.place).pushes(motion, plant, ())
        turned = motion.angle[self.place] * (2.0 * np.pi / motion.turn)
        return [
            total([push], [wave(periods * turned)])
            for periods in _WAVES
            for wave in (np.sin, np.cos)
        ]


class Presliding(Form):
    """Friction of parts that give way before they slip."""

    effect = "presliding"
    terms = len(_TRAVELS)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        way = motion.angle[self.place]
        travel = float(np.mean(np.sum(np.abs(np.diff(way, axis=1)), axis=1)))
        return [torque_at(self.place, -term) for term in slipping(way, travel * _TRAVELS)]


class Hysteresis(Form, Shaft):
    """A shaft that gives back less than it took, however slow it is."""

    effect = "hysteresis"
    terms = len(_TWISTS)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        rms = float(np.sqrt(np.mean(motion.twist**2)))
        return [torque_between(term) for term in slipping(motion.twist, rms * _TWISTS)]


def forms(channels: int) -> list[Form]:
    """Every form that a record with so many encoders can show."""
    found: list[Form] = [TorqueCurve()]
    for place in range(channels):
        found += [SpeedCurve(place), UnevenFriction(place), Presliding(place)]
    return [*found, TwistCurve(), Hysteresis()] if channels == 2 else found


def _polynomials(values: Array) -> list[Array]:
    """Those of Legendre, over the range in which the values are."""
    scaled = values / max(float(np.max(np.abs(values))), 1e-300)
    terms = np.asarray(np.polynomial.legendre.legvander(scaled, _DEGREES[-1]), np.float64)
    return [terms[..., degree] for degree in _DEGREES]


def slipping(way: Array, reaches: Array) -> list[Array]:
    """What springs carry of their most (w, l) that are pulled along a way (w, l) and each slip as
    soon as they are stretched by more than their reach (Prandtl 1928).

    Windows go on where the one before them ended. A spring has forgotten after two reaches how it
    began, so the windows can all be gone through at once, and once more from where those end.
    """
    limit = reaches[:, None]
    between = np.concatenate([[0.0], way[1:, 0] - way[:-1, -1]])
    steps = np.concatenate([between[:, None], np.diff(way, axis=1)], axis=1)
    stretched = np.zeros((len(reaches), *way.shape))
    for _ in range(2):
        now = np.roll(stretched[:, :, -1], 1, axis=1)
        for i in range(way.shape[1]):
            now = np.clip(now + steps[:, i], -limit, limit)
            stretched[:, :, i] = now
    return list(stretched / limit[:, :, None])
