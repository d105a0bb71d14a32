"""An axis with effects by scipy's adaptive integration, for the tests to check the C core against.

The equations of motion are written down once more, in absolute angles. Wherever they are not
smooth - an inertia comes to rest or breaks away, the shaft meets or leaves a flank, the load
changes - the integration is stopped by an event at that very moment and started anew. Nothing of
the core is used.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.integrate

Array = npt.NDArray[np.float64]
Torque = Callable[[float], float]


def _nothing(*_: float) -> float:
    return 0.0


@dataclass(frozen=True)
class Friction:
    """Dry and viscous friction of one inertia, viscous more so in the positive direction."""

    coulomb: float = 0.0
    viscous: float = 0.0
    stribeck: float = 0.0
    speed: float = 1.0
    drift: float = 0.0
    asymmetry: float = 0.0

    def limit(self, w: float, t: float) -> float:
        """What dry friction can hold or does hold against motion at speed w."""
        share = float(np.exp(-((w / self.speed) ** 2)))
        return (self.coulomb + self.stribeck * share) * (1.0 + self.drift * t)

    def drag(self, w: float, t: float) -> float:
        """Viscous friction."""
        return (self.viscous * w + self.asymmetry * abs(w)) * (1.0 + self.drift * t)


@dataclass(frozen=True)
class Reference:
    """An axis I1, I2, B, K and what acts on it; ``mode`` is (frequency, damping, mass ratio)."""

    axis: tuple[float, float, float, float]
    torque: Torque
    friction: tuple[Friction, Friction] = (Friction(), Friction())
    gap: float = 0.0
    hardening: float = 0.0
    stiffness_drift: float = 0.0
    load: tuple[float, float] | None = None
    mode: tuple[float, float, float] | None = None
    motor: Callable[[float, float], float] = _nothing
    table: Torque = _nothing

    def run(self, times: Array, start: Array) -> Array:
        """Angles and speeds (n, 4): motor, table; from ``start`` (4,) at times[0]."""
        third = [start[1], start[3]] if self.mode else []
        y = np.array([start[0], start[1], start[2], start[3], *third])
        found = np.empty((len(times), 4))
        moments = [] if self.load is None else [self.load[1]]
        t = float(times[0])
        for end in [*moments, float(times[-1])]:
            while t < end:
                t, y = self._smooth(t, end, y, times, found)
        return found

    def _smooth(
        self, t: float, end: float, y: Array, times: Array, found: Array
    ) -> tuple[float, Array]:
        """Integrates to the next event or the end; fills in what lies in between."""
        contact = self._contact(y)
        signs = self._signs(t, y, contact)
        y = y.copy()
        for i in (0, 1):
            if signs[i] == 0:
                y[2 + i] = 0.0
        events = self._events(signs, contact)
        solution: Any = scipy.integrate.solve_ivp(
            lambda s, x: self._rates(s, x, signs, contact),
            (t, end),
            y,
            method="DOP853",
            rtol=1e-9,
            atol=1e-12,
            events=events,
            dense_output=True,
            max_step=1e-3,  # an event that comes and goes within a step would not be seen
        )
        reached = float(solution.t[-1])
        inside = (times >= t) & (times <= reached)
        if np.any(inside):
            found[inside] = solution.sol(times[inside])[:4].T
        return reached, solution.y[:, -1]

    def _contact(self, y: Array) -> int:
        """The flank that the shaft is at or moves into: -1, 0 (in the play), 1."""
        if self.gap == 0.0:
            return 1
        twist, rate = y[0] - y[1], y[2] - y[3]
        beyond = abs(twist) - self.gap / 2.0
        side = int(np.sign(twist))
        if abs(beyond) < 1e-11:  # an event has brought it here
            return side if side * rate > 0.0 else 0
        return side if beyond > 0.0 else 0

    def _shaft(self, t: float, y: Array, contact: int) -> float:
        if contact == 0:
            return 0.0
        z = y[0] - y[1] - contact * self.gap / 2.0
        K = self.axis[3] * (1.0 + self.stiffness_drift * t)
        return float(K * z + self.hardening * z**3 + self.axis[2] * (y[2] - y[3]))

    def _forces(self, t: float, y: Array, contact: int) -> tuple[float, float, float]:
        """All torques but dry friction, on motor, table and further inertia."""
        shaft = self._shaft(t, y, contact)
        motor = self.torque(t) + self.motor(t, y[0]) - shaft - self.friction[0].drag(y[2], t)
        table = self.table(t) + shaft - self.friction[1].drag(y[3], t)
        mode = 0.0
        if self.mode is not None:
            p, z, ratio = self.mode
            mode = ratio * self.axis[1] * (p**2 * (y[1] - y[4]) + 2 * z * p * (y[3] - y[5]))
        return motor, table - mode, mode

    def _inertias(self, t: float) -> tuple[float, float]:
        loaded = self.load is not None and t >= self.load[1]
        return self.axis[0], self.axis[1] * (1.0 + (self.load[0] if self.load and loaded else 0.0))

    def _signs(self, t: float, y: Array, contact: int) -> tuple[int, int]:
        """Which way each inertia slides, 0 when it sticks."""
        forces = self._forces(t, y, contact)
        signs = []
        for i in (0, 1):
            limit = self.friction[i].limit(0.0, t)
            if limit == 0.0:
                signs.append(1)
            elif abs(y[2 + i]) > 1e-9:
                signs.append(int(np.sign(y[2 + i])))
            else:
                # just beyond the limit it breaks away: an event stops exactly there
                breaks = abs(forces[i]) > limit * (1.0 - 1e-9)
                signs.append(int(np.sign(forces[i])) if breaks else 0)
        return signs[0], signs[1]

    def _rates(self, t: float, y: Array, signs: tuple[int, int], contact: int) -> list[float]:
        forces = self._forces(t, y, contact)
        inertia = self._inertias(t)
        rates = [y[2], y[3]]
        for i in (0, 1):
            dry = signs[i] * self.friction[i].limit(y[2 + i], t)
            stuck = signs[i] == 0
            rates.append(0.0 if stuck else (forces[i] - dry) / inertia[i])
        if self.mode is not None:
            rates += [y[5], forces[2] / (self.mode[2] * self.axis[1])]
        return rates

    def _events(self, signs: tuple[int, int], contact: int) -> list[Any]:
        events: list[Any] = []
        for i in (0, 1):
            if self.friction[i].limit(0.0, 0.0) == 0.0:
                continue
            if signs[i] == 0:
                events.append(self._break_away(i, contact))
            else:
                events.append(_at_rest(i, signs[i]))
        if self.gap > 0.0:
            sides = (contact,) if contact else (-1, 1)
            events += [self._at_flank(side, -1 if contact else 1) for side in sides]
        return events

    def _at_flank(self, side: int, direction: int) -> _Event:
        return _Event(lambda _t, y: side * (y[0] - y[1]) - self.gap / 2.0, direction)

    def _break_away(self, i: int, contact: int) -> _Event:
        def excess(t: float, y: Array) -> float:
            return abs(self._forces(t, y, contact)[i]) - self.friction[i].limit(0.0, t)

        return _Event(excess, 1)


class _Event:
    """An event that ends the integration when its function crosses zero in one direction."""

    terminal = True

    def __init__(self, function: Callable[[float, Array], float], direction: float) -> None:
        self._function = function
        self.direction = direction

    def __call__(self, t: float, y: Array) -> float:
        return float(self._function(t, y))


def _at_rest(i: int, sign: int) -> _Event:
    return _Event(lambda _t, y: y[2 + i], -sign)
