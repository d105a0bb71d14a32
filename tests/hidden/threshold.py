"""How large a hidden effect is, in detection thresholds.

The unit is what an ideal observer would need. He knows the record's noise, the shape of the effect
and of everything that could be taken for it, and looks at windows of half a second whose initial
states are free. What the parameters of Eq. 3 and the zero of encoder 2 could imitate is of no use
to him, nor is what the second hidden effect of the record could, nor what another effect could that
can pass for this one: the same effect at the other places, other kinds of friction, another effect
of that period; of an effect that is not in the catalogue all its kin together. Of the noise-free
change r of both encoders' signals that the effect makes, what then remains has the signal-to-noise
ratio

    sqrt(sum (r1 / sigma1)^2 + sum (r2 / sigma2)^2)

and an effect is at its detection threshold where this is 10: with look-alikes the least over them,
taken one at a time. The size in thresholds is the ratio divided by 10; for effects that are linear
in their size that is size over threshold.

The change in a window is that between the axis with all its effects and the axis with all but this
one, started in the same state, under the same torque. What parameters imitate is taken linear.

Not told apart, because no record can: an offset at motor and table (they differ by a constant
twist, which is the zero of encoder 2), and a lead error of one period a turn and an eccentricity of
encoder 2 (they are the same formula). See score.py.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.linalg
from catalogue import UNKNOWN, Hidden
from truth import Array, Run, Truth, compiled, simulate

WINDOW = 0.5  # [s]
UNIT = 10.0

# A delay shows the state before the window's first samples, which a start there does not have.
_BLIND = 8


def size_in_thresholds(
    truth: Truth,
    hidden: Sequence[Hidden],
    which: int,
    run: Run,
    time_step: float,
    noise: tuple[float, float],
) -> float:
    """The size of hidden[which] in `run`, which is `truth` (without effects) with all of them.

    ``noise`` are the rms errors of both encoders' readings [rad].
    """
    windows = _Windows(truth, run, time_step, noise)
    change = windows.change(hidden, which)
    nuisance = [*windows.base()]
    nuisance += [windows.change(hidden, i) for i in range(len(hidden)) if i != which]
    alternatives = windows.look_alikes(hidden[which]) or [[]]
    rest = [windows.unexplained(change, [*nuisance, *columns]) for columns in alternatives]
    return min(rest) / UNIT


class _Windows:
    """A run cut into windows; signals are (w, 2 L): both encoders in units of their noise."""

    def __init__(
        self, truth: Truth, run: Run, time_step: float, noise: tuple[float, float]
    ) -> None:
        self._truth, self._step, self._noise = truth, time_step, noise
        self._length = round(WINDOW / time_step)
        self._count = len(run.command) // self._length
        used = self._count * self._length
        self._command = run.command[:used]
        self._states = run.states[:used]
        self._starts = self._states[:: self._length]
        self._shown = run.shown[:used]
        self._free = self._free_motion()

    def _signal(self, angles: Array) -> Array:
        """(w, 2 L) of angles (n, 2)."""
        scaled = (angles / np.array(self._noise)).reshape(self._count, self._length, 2)
        scaled[:, :_BLIND] = 0.0
        return np.ascontiguousarray(scaled.transpose(0, 2, 1)).reshape(self._count, -1)

    def change(self, hidden: Sequence[Hidden], which: int) -> Array:
        """What hidden[which] changes."""
        without = self._truth
        for i, effect in enumerate(hidden):
            if i != which:
                without = effect.into(without)
        other = simulate(
            without, self._step, self._command, start=self._starts, window=self._length
        )
        return self._signal(self._shown - other.shown)

    def _linear(
        self, truth: Truth, torque: tuple[Array, Array] | None = None, start: Array | None = None
    ) -> Array:
        """Angles (n, 2) of the axis without effects, by the matrix exponential."""
        inverse = np.array([1.0 / truth.I1, 1.0 / truth.I2])
        shaft = np.array([[1.0, -1.0], [-1.0, 1.0]]) * inverse[:, None]
        A, B = np.zeros((4, 4)), np.zeros((4, 2))
        A[:2, 2:] = np.eye(2)
        A[2:, :2], A[2:, 2:] = -truth.K * shaft, -truth.B * shaft
        B[2:] = np.diag(inverse)
        held = scipy.linalg.expm(np.block([[A, B], [np.zeros((2, 6))]]) * self._step)
        acting = np.zeros((len(self._command), 2))
        for i, values in enumerate(torque or ()):
            acting[:, i] = values
        begin = np.zeros((self._count, 4)) if start is None else start
        return _held_motion(held[:4, :4].copy(), held[:4, 4:].copy(), acting, begin, self._length)

    def base(self) -> list[Array]:
        """What small changes of I1, I2, B, K and of the zero of encoder 2 would do."""
        torque = (self._command, np.zeros_like(self._command))
        start = self._starts[:, :4].copy()
        columns = []
        for name in ("I1", "I2", "B", "K"):
            value = getattr(self._truth, name)
            ends = [
                self._linear(self._truth._replace(**{name: value * share}), torque, start)
                for share in (1.0 + 1e-4, 1.0 - 1e-4)
            ]
            columns.append(self._signal(ends[0] - ends[1]))
        zero = np.zeros((len(self._command), 2))
        zero[:, 1] = 1.0
        return [*columns, self._signal(zero)]

    def _free_motion(self) -> Array:
        """Orthonormal (2 L, 4): how a window can move by itself."""
        angles = [
            self._linear(self._truth, start=np.tile(unit, (self._count, 1)))[: self._length]
            for unit in np.eye(4)
        ]
        scaled = np.stack(angles, axis=-1) / np.array(self._noise)[:, None]
        scaled[:_BLIND] = 0.0
        flat = scaled.transpose(1, 0, 2).reshape(-1, 4)
        return np.linalg.qr(flat / np.linalg.norm(flat, axis=0))[0]

    def unexplained(self, change: Array, columns: Sequence[Array]) -> float:
        """Norm of what is left of a change by free motion and the columns."""
        stack = np.stack([change, *columns], axis=-1)
        own = np.einsum("lk,wlc->wkc", self._free, stack)
        rest = (stack - np.einsum("lk,wkc->wlc", self._free, own)).reshape(-1, stack.shape[-1])
        size = np.linalg.norm(rest, axis=0)
        rest = rest[:, size > 0.0] / size[size > 0.0]
        if size[0] == 0.0:
            return 0.0
        # R of the columns before the change: its last entry is what they leave of it
        triangle = scipy.linalg.qr(np.roll(rest, -1, axis=1), mode="r", check_finite=False)[0]
        return float(abs(triangle[rest.shape[1] - 1, -1]) * size[0])

    # ---- What could be taken for it

    def look_alikes(self, effect: Hidden) -> list[list[Array]]:
        """Signatures of each other effect that it could be taken for."""
        name = effect.effect
        if name in ("friction_coulomb", "friction_viscous", "friction_stribeck"):
            return self._frictions(effect)
        if name == "disturbance":
            t = self._step * np.arange(len(self._command), dtype=np.float64)
            other = 1 if effect.location == "motor" else 0
            return [[self._at(other, wave) for wave in _waves(effect.params["frequency"] * t)]]
        if name == "delay":
            places = {"torque", "encoder1", "encoder2"} - {effect.location}
            return [[self._late(place)] for place in sorted(places)]
        if name in ("torque_ripple", "lead_error", "encoder_eccentricity"):
            return self._periodic(effect)
        if name in UNKNOWN:
            return [self._kin(effect)]
        return []

    def _acting(self, motor: Array | None, table: Array | None) -> Array:
        """What torques (n,) at motor and table would do that change from sample to sample."""
        means = [
            np.zeros(len(self._command)) if t is None else 0.5 * (t + np.append(t[1:], t[-1]))
            for t in (motor, table)
        ]
        return self._signal(self._linear(self._truth, (means[0], means[1])))

    def _at(self, place: int, torque: Array) -> Array:
        return self._acting(None, torque) if place else self._acting(torque, None)

    def _kin(self, effect: Hidden) -> list[Array]:
        """All that an effect without a name may be taken for; see score.KIN."""
        if effect.effect == "torque_fall":
            excess = [
                np.clip(self._command, -limit, limit) - self._command
                for limit in np.max(np.abs(self._command)) * np.array([0.5, 0.7, 0.85])
            ]
            nothing = np.zeros_like(self._command)
            return [self._signal(self._linear(self._truth, (e, nothing))) for e in excess]
        if effect.effect == "hysteresis":
            twist = self._states[:, 0] - self._states[:, 1]
            shapes = [twist**3, np.sign(twist)]
            return [self._acting(-shape, shape) for shape in shapes]
        place = 0 if effect.location == "motor" else 1
        speed = self._states[:, 2 + place]
        near = [np.exp(-((speed / (share * np.std(speed))) ** 2)) for share in (0.1, 0.3)]
        shapes = [np.sign(speed), speed, *(np.sign(speed) * level for level in near)]
        return [self._at(place, shape) for shape in shapes]

    def _frictions(self, effect: Hidden) -> list[list[Array]]:
        found = []
        for place in (0, 1):
            speed = self._states[:, 2 + place]
            shapes = {"friction_coulomb": np.sign(speed), "friction_viscous": speed}
            if "speed" in effect.params:
                near = np.exp(-((speed / effect.params["speed"]) ** 2))
                shapes["friction_stribeck"] = near * np.sign(speed)
            here = effect.location == ("motor", "table")[place]
            found += [
                [self._at(place, shape)]
                for name, shape in shapes.items()
                if not (here and name == effect.effect)
            ]
        return found

    def _late(self, place: str) -> Array:
        if place == "torque":
            earlier = np.append(self._command[:1], self._command[:-1])
            late = (earlier - self._command, np.zeros_like(earlier))
            return self._signal(self._linear(self._truth, late))
        angles = np.zeros((len(self._command), 2))
        encoder = 0 if place == "encoder1" else 1
        angles[:, encoder] = self._states[:, 2 + encoder]
        return self._signal(angles)

    def _periodic(self, effect: Hidden) -> list[list[Array]]:
        """The same number of periods as a ripple, as a lead error, as an eccentricity."""
        periods = effect.params.get("periods", 1.0)
        once = periods == 1.0
        found = []
        if effect.effect != "torque_ripple":
            found.append([self._at(0, wave) for wave in _waves(periods * self._states[:, 0])])
        for encoder, names in enumerate((["encoder1"] if once else [], ["table", "encoder2"])):
            if names and effect.location not in names:
                found.append(
                    [
                        self._signal(wave[:, None] * np.eye(2)[encoder])
                        for wave in _waves(periods * self._states[:, encoder])
                    ]
                )
        return found


def _waves(angle: Array) -> tuple[Array, Array]:
    return np.sin(angle), np.cos(angle)


@compiled
def _held_motion(A: Array, B: Array, torque: Array, start: Array, window: int) -> Array:
    """Angles (n, 2) of x+ = A x + B torque, put into the next of `start` every so many samples."""
    angles = np.empty((len(torque), 2))
    x = np.zeros(4)
    new = np.zeros(4)
    for at in range(len(torque)):
        if at % window == 0:
            x[:] = start[at // window]
        angles[at, 0] = x[0]
        angles[at, 1] = x[1]
        for i in range(4):
            total = B[i, 0] * torque[at, 0] + B[i, 1] * torque[at, 1]
            for j in range(4):
                total += A[i, j] * x[j]
            new[i] = total
        x[:] = new
    return angles
