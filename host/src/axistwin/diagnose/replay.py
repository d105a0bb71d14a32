"""The effects simulated as they act, where so far they were taken along a motion that was known.

Along a known motion the axis stays linear and sizes follow in one step, which finds effects. But
what an effect changes in the motion changes the effect: friction stops an axis, a gap lets it go.
For the last digits the core simulates axis and effects together, every window from a state of its
own, and all unknowns are adjusted to that, those states with them.
"""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from axistwin import core
from axistwin.core import Array, Axis, Effect
from axistwin.diagnose.effects import (
    DRY,
    Backlash,
    Eccentricity,
    EncoderDelay,
    ExtraMode,
    Found,
    Hardening,
    LeadError,
    Motion,
    Saturation,
    TorqueDelay,
)
from axistwin.diagnose.fit import RIGHT, Fit, solve_normal
from axistwin.diagnose.linear import ThreeInertias, TwoInertias
from axistwin.errors import InputError
from axistwin.model import Model

#: What acts outside of the axis: on the command and in the encoders. Known as the motion is.
_OUTSIDE = (TorqueDelay, EncoderDelay, Saturation, LeadError, Eccentricity)

#: What has the stiffness go with the twist.
_BENDING = (Backlash, Hardening)

#: A step of the simulation turns the vibration by so much at most; by less, down to another limit,
#: where the error of all steps together were more than this [noise squared], which an effect could
#: be taken for. What only leads the way, as derivatives do, needs no finer ones.
_STEP_MAX = 0.1
_STEP_MIN = 0.006
_STEP_ERROR = 20.0

#: Differences of initial states, in units of the noise, and of sizes, in units of themselves.
_STATE_STEP = 0.05
_STEP = 1e-5

#: How sure an initial state is of itself, in such differences: one that has no effect stays.
_STATE_SPREAD = 2e5

#: What an effect moves [noise] that is only just there.
_LITTLE_MOVED = 0.05

_ROUNDS = 8
_HALVINGS = 4

#: A gain that is none: so many squares of the noise, and such a share of all errors; from afar.
_NO_GAIN = 0.1
_LITTLE = 1e-5
_LITTLE_FROM_AFAR = 1e-2

#: Mean square of the error of a window, in units of the noise, from which on it is an outlier; and
#: how often such a one is begun anew on each of its ever longer parts. When there are more than
#: this share of them it is not the beginnings that are wrong; nor are they when so many are left of
#: those that have been begun anew.
_OUTLIER = 2.0
_BEGINNINGS = 2
_OUTLIERS_MAX = 0.8
_OUTLIERS_AGAIN = 0.25

#: Samples that are simulated at least, if a window has so many; and an error of these [noise
#: squared] from which no way leads to one that is about noise.
_HORIZON_MIN = 48
_HOPELESS = 3.0

#: Parts of a window that are simulated one after another from afar.
_HORIZONS = (16, 8, 4, 2)


@dataclass(frozen=True)
class Replay:
    """A fit adjusted to its simulation, and the motion of that.

    ``residual`` (w, c l): weighted errors. ``columns`` (w, k, c l): the derivatives of the
    simulation along the directions of the fit, less what initial states explain.
    """

    fit: Fit
    motion: Motion
    residual: Array
    columns: Array
    _replaying: _Replaying
    _point: _Point
    _of_states: Array

    @property
    def starts(self) -> Array:
        """The states (w, s) that windows begin from, as core.simulate_windows() has them."""
        return self._point.starts

    @property
    def substeps(self) -> int:
        """Steps of the simulation from one sample to the next."""
        return self._replaying.substeps

    def residual_of(self, fit: Fit) -> Array:
        """The errors of other unknowns (w, c l), less what initial states explain.

        Raises InputError for unknowns that no axis can have.
        """
        residual = self._replaying.residual_of(self._point, fit)[:, :, None]
        _, explained = _eliminated(self._of_states, residual)
        left: Array = (residual - explained)[:, :, 0]
        return left

    def by_size(self, found: Found, most: float) -> list[Array] | None:
        """Derivatives (w, c l) by the sizes of a further effect, less what initial states explain.

        ``most`` is what size 1 moves at most, about. None for what acts outside of the axis.
        """
        if _outside(found) or isinstance(found.kind, ExtraMode):
            return None
        of_sizes = self._replaying.by_size(self._point, found, _LITTLE_MOVED / most)
        _, explained = _eliminated(self._of_states, of_sizes)
        return list((of_sizes - explained).transpose(2, 0, 1))


def find_replay(fit: Fit, motion: Motion, near: Replay | None = None) -> Replay | None:
    """The fit adjusted once more, from where it is; its windows begin as those of one that is
    ``near``, or as the first of several there that are parts of one here, if they can.

    Where the stiffness goes with the twist a vibration may be periods off at the end of a window,
    which no small step mends: what is left with such an effect is looked at from afar, too.

    None where the axis with its effects is linear, or would have to be one that no axis is.
    """
    if all(_linear(one) for one in fit.found) or fit.noise is None:
        return None
    found: Replay | None = None
    with contextlib.suppress(InputError):  # parameters that no axis has
        replaying = _Replaying(fit, motion)
        found = (replaying.adjusted_from(near) if near else None) or replaying.adjusted()
        bends = isinstance(fit.found[-1].kind, _BENDING)
        if found is None or (bends and found.fit.scale(found.residual) > RIGHT):
            afar = _Replaying(fit, motion).adjusted_from_afar()
            if found is None or fit.misfit(afar.residual) < fit.misfit(found.residual):
                return afar
    return found


@dataclass(frozen=True)
class _Point:
    """Unknowns, and what they make of the record: ``starts`` (w, s) as core.simulate_windows() has
    them, with angles from where the motor was; ``played`` (2, w, l), angles by the core; ``angles``
    as measured and ``speeds`` (c, w, l)."""

    fit: Fit
    starts: Array
    played: Array
    angles: Array
    speeds: Array
    residual: Array


class _Replaying:
    """``motion`` is that along which errors of encoders are known."""

    def __init__(self, fit: Fit, motion: Motion) -> None:
        self._fit, self._motion = fit, motion
        self._windows = fit.windows
        self._horizon = fit.windows.length
        noise = float(np.min(fit.noise)) if fit.noise is not None else 0.0
        slow = 4.0 / (self._windows.length * self._windows.time_step)
        fast = fit.plant.frequency if isinstance(fit.plant, TwoInertias) else 0.0
        mode = 0.0
        if isinstance(fit.system, ThreeInertias):
            mode = fit.system.frequency * float(np.sqrt(1.0 + fit.system.mass_ratio))
        self._free = slice(0 if fast else 2, 6 if mode else 4)
        steps = np.array([1.0, fast, slow, 1.0, 1.0, mode])
        self._state_steps = (_STATE_STEP * noise * steps)[self._free]
        # A fit that is far off may vibrate faster than samples tell: finer steps would not help it.
        self._turned = min(max(fast, mode) * fit.windows.time_step, np.pi)
        self.substeps = self._fine_enough()

    def adjusted(self) -> Replay | None:
        """From where the windows seem to begin; None if that is far off."""
        point = self._beginning(self._fit)
        return self._replay(self._rounds(point)) if self._near(point) else None

    def adjusted_from_afar(self) -> Replay:
        """Raises InputError where there is no way to begin."""
        return self._replay(self._rounds(self._from_afar()))

    def adjusted_from(self, near: Replay) -> Replay | None:
        """The same where windows begin as those of another one, or as the first of several that are
        parts of them; None if that is far off."""
        known = near.starts[:: self._windows.length // near.fit.windows.length]
        # What is new takes other beginnings, as it does of an axis that is linear.
        before = self._seeming(replace(near.fit, windows=self._windows))
        starts = self._seeming(self._fit)
        columns = slice(min(starts.shape[1], before.shape[1]))
        starts[:, columns] += (known - before)[:, columns]
        point = self._begun(self._point(self._fit, starts), _OUTLIERS_MAX)
        return self._replay(self._rounds(point)) if self._near(point) else None

    def _replay(self, point: _Point) -> Replay:
        of_states, columns = self._derivatives(point)
        _, explained = _eliminated(of_states, columns)
        left = (columns - explained).transpose(0, 2, 1)
        return Replay(point.fit, self._motion, point.residual, left, self, point, of_states)

    def _beginning(self, fit: Fit) -> _Point:
        """A fit in windows that start as their motion seems to begin."""
        return self._point(fit, self._seeming(fit))

    def _seeming(self, fit: Fit) -> Array:
        """The starts (w, s) of a fit whose effects act along the motion."""
        return fit.system.starts(fit.starts(self._motion))

    def _from_afar(self) -> _Point:
        """Far off, a simulation soon has nothing in common with what it is adjusted to: short ones
        first. Plants that are alike from afar are all tried on those."""
        length = self._windows.length
        parts = sorted({max(length // part, min(_HORIZON_MIN, length)) for part in _HORIZONS})
        self._horizon = parts[0]
        enough, self.substeps = self.substeps, self._steps(_STEP_MAX)
        best: _Point | None = None
        for plant in (self._fit.plant, *self._fit.plant.others()):
            try:
                point = self._rounds(self._beginning(replace(self._fit, plant=plant)))
            except InputError:
                continue
            if best is None or self._misfit(point) < self._misfit(best):
                best = point
            if self._near(best):
                break
        if best is None or not self._near(best, _HOPELESS):
            raise InputError("no axis behaves like that")
        for self._horizon in parts[1:]:
            best = self._rounds(best)
        self._horizon, self.substeps = length, enough
        return best

    def _rounds(self, point: _Point) -> _Point:
        """Adjusted as far as the horizon."""
        whole = self._horizon == self._windows.length
        point = self._point(point.fit, point.starts)
        most = _OUTLIERS_MAX
        for _ in range(_ROUNDS):
            point, most = self._begun(point, most), _OUTLIERS_AGAIN
            little = _LITTLE if whole and self._near(point) else _LITTLE_FROM_AFAR
            least = _NO_GAIN + little * self._misfit(point)
            moved = self._step(point, least)
            if moved is None:
                return point
            gained, point = self._misfit(point) - self._misfit(moved), moved
            if whole:
                self._motion = point.fit.motion_of(self._motion, point.angles, point.speeds)
            if gained < least:
                break
        return self._begun(point, most)

    def _fine_enough(self) -> int:
        """Steps from one sample to the next whose error is little against the noise.

        It goes with the square of a step, or faster: two numbers of steps tell it.
        """
        fit, starts = self._fit, self._seeming(self._fit)

        def of_effects(substeps: int) -> Array:
            both = (fit, _linearised(fit))
            played, linear = (self._played(one, starts, substeps=substeps)[0] for one in both)
            angles: Array = (played - linear)[: self._windows.channels]
            return angles

        few, finest = self._steps(_STEP_MAX), self._steps(_STEP_MIN)
        missed = 4.0 / 3.0 * fit.project(of_effects(2 * few) - of_effects(few))
        error = float(np.sum(missed**2))
        enough = few * (error / _STEP_ERROR) ** 0.25
        return int(np.clip(np.ceil(enough), few, finest)) if np.isfinite(enough) else finest

    def _steps(self, turn: float) -> int:
        """From one sample to the next, if the vibration turns by so much in one."""
        return max(2, int(np.ceil(self._turned / turn)))

    @property
    def _dry(self) -> bool:
        """Does friction hold the axis at times?"""
        return any(isinstance(one.kind, DRY) for one in self._fit.found)

    @property
    def _samples(self) -> int:
        """Of a window, up to the horizon."""
        return self._windows.channels * self._horizon

    def _near(self, point: _Point, times: float = 1.0) -> bool:
        """Is the error about that of noise, or so many times that?"""
        return self._misfit(point) < times * _OUTLIER * self._samples * self._windows.count

    # ---- Unknowns of all windows

    def _misfit(self, point: _Point) -> float:
        """Squared errors where the fit may look; an outlier counts with its logarithm.

        Where friction or play lets an axis go a little too late, a window can be far off.
        """
        mean = _squares(point.residual)[~self._windows.held_out] / self._samples
        beyond = _OUTLIER * (1.0 + np.log(np.maximum(mean / _OUTLIER, 1.0)))
        return float(np.sum(np.minimum(mean, beyond))) * self._samples

    def _step(self, point: _Point, least: float) -> _Point | None:
        """A better point, None if there is none on the way, or none that gains the least."""
        of_states, columns = self._derivatives(point)
        both = np.concatenate([columns, point.residual[:, :, None]], axis=2)
        back, explained = _eliminated(of_states, both)
        left = both - explained
        before = _squares(point.residual)
        weights = 1.0 / np.maximum(before / (_OUTLIER * self._samples), 1.0)
        left *= np.sqrt(weights)[:, None, None]
        own, error = left[:, :, :-1], left[:, :, -1]
        chosen = ~self._windows.held_out
        gram = np.einsum("wna,wnb->ab", own[chosen], own[chosen], optimize=True)
        right = np.einsum("wna,wn->a", own[chosen], error[chosen], optimize=True)
        step = solve_normal(gram, right)
        if float(np.sum(weights * before - _squares(error))) + float(right @ step) < least:
            return None
        states = (back[:, :, -1] - back[:, :, :-1] @ step) * self._state_steps
        step = point.fit.directions @ step
        for halving in range(_HALVINGS):
            share = 0.5**halving
            starts = point.starts.copy()
            starts[:, self._free] += share * states
            try:
                fit = point.fit.moved(share * step)
                moved = self._point(fit, starts)
                lost = _squares(moved.residual) > np.maximum(before, _OUTLIER * self._samples)
                if np.any(lost):  # by beginnings of their own, which all others need not wait for
                    starts[lost] = point.starts[lost]
                    moved = self._point(fit, starts)
            except InputError:
                continue
            if self._misfit(moved) < self._misfit(point):
                return moved
        return None

    # ---- The beginning of each window

    def _begun(self, point: _Point, most: float) -> _Point:
        """Every window from the best start that can be found for it, unless those that are off are
        more than a share of all.

        Friction and play have an axis forget how it began, so that no small step of a whole window
        leads to a better beginning: its first part is made right first, then more and more; from
        where the window before it ends, from where it seems to begin and from rest.
        """
        starts, errors = point.starts.copy(), _squares(point.residual)
        off = _OUTLIER * self._samples
        if not 0 < np.count_nonzero(errors > off) < most * self._windows.count:
            return point
        for first in self._beginnings(point):
            which = np.flatnonzero(errors > off)
            tried = first[which]
            with contextlib.suppress(InputError):  # from there it would leave all bounds
                for part in (8, 2, 1):
                    for _ in range(_BEGINNINGS):
                        tried = self._begun_nearer(point, which, tried, self._horizon // part)
                    error = _squares(self._residual(point, which, tried, self._horizon))
                    better = error < errors[which]
                    starts[which[better]] = tried[better]
                    errors[which[better]] = error[better]
            if np.all(errors <= off):
                break
        begun = self._point(point.fit, starts)
        gained = np.sum(_squares(begun.residual)) < np.sum(_squares(point.residual))
        return begun if gained else point

    def _beginnings(self, point: _Point) -> Iterator[Array]:
        """Starts (w, s) that windows could have instead."""
        if self._horizon == self._windows.length:
            yield self._carried_on(point)
        yield point.starts
        if self._dry:
            rest: Array = point.starts.copy()
            rest[:, 1:3] = rest[:, 5:] = 0.0
            yield rest

    def _carried_on(self, point: _Point) -> Array:
        """The starts (w, s), each where the window before it ends, if that is the sample before."""
        windows = self._windows
        carried: Array = point.starts.copy()
        after = 1 + np.flatnonzero(windows.index[1:, 0] == windows.index[:-1, -1] + 1)
        if len(after) == 0:
            return carried
        before = after - 1
        ends = self._played(point.fit, point.starts[before], before, windows.length + 1)[..., -1]
        (motor, table), (speed, table_speed) = ends
        shift = windows.angles[0, before, 0] - windows.angles[0, after, 0]
        states = (motor - table, speed - table_speed, speed, motor + shift)
        carried[after, :4] = np.stack(states, axis=1)
        return carried

    def _begun_nearer(
        self, point: _Point, which: npt.NDArray[np.intp], starts: Array, horizon: int
    ) -> Array:
        """Starts (w, s) of windows that are better up to a ``horizon``, or as they were."""
        residual = self._residual(point, which, starts, horizon)
        columns = []
        for step in np.diag(self._state_steps):
            moved = starts.copy()
            moved[:, self._free] += step
            columns.append(residual - self._residual(point, which, moved, horizon))
        back, _ = _eliminated(np.stack(columns, axis=2), residual[:, :, None])
        change = back[:, :, 0] * self._state_steps
        found: Array = starts.copy()
        left, error = np.arange(len(which)), _squares(residual)
        for halving in range(_HALVINGS):
            moved = starts[left]
            moved[:, self._free] += change[left] * 0.3**halving
            better = _squares(self._residual(point, which[left], moved, horizon)) < error[left]
            found[left[better]] = moved[better]
            left = left[~better]
            if len(left) == 0:
                break
        return found

    def _residual(
        self, point: _Point, which: npt.NDArray[np.intp], starts: Array, horizon: int
    ) -> Array:
        """Errors (w, c h) of some windows from other starts (w, s), up to a horizon."""
        played = self._played(point.fit, starts, which, horizon)[0]
        moved = self._vectors(point.fit, played - point.played[:, which, :horizon])
        before = point.residual[which].reshape(len(which), self._windows.channels, -1)
        residual: Array = before[:, :, :horizon].reshape(moved.shape) - moved
        return residual

    # ---- Simulation

    def _point(self, fit: Fit, starts: Array) -> _Point:
        """Raises InputError for unknowns that no axis can have."""
        linear = _linearised(fit)
        simulated = linear.simulate(self._motion, fit.system.states(starts))
        angles, speeds = (one[:, :, : self._horizon] for one in simulated)
        played = self._played(fit, starts)
        # What the steps of the core miss is nearly the same with and without effects.
        more = (played - self._played(linear, starts))[:, : self._windows.channels]
        angles, speeds = angles + more[0], speeds + more[1]
        residual = fit.vectors(fit.measured[:, :, : self._horizon] - angles)
        if not np.all(np.isfinite(residual)):
            raise InputError("the simulation has left all bounds")
        return _Point(fit, starts, played[0], angles, speeds, residual)

    def _played(
        self,
        fit: Fit,
        starts: Array,
        which: npt.NDArray[np.intp] | None = None,
        horizon: int | None = None,
        substeps: int | None = None,
    ) -> Array:
        """Angles and speeds (2, 2, w, l) of motor and table, of some windows, by the core."""
        windows, motion = self._windows, self._motion
        chosen = slice(None) if which is None else which
        outside = [one.push(motion, fit.plant) for one in fit.found if _outside(one)]
        torque = np.mean(fit.commanded(outside, windows.cut(windows.torque)), axis=0)
        torque = np.pad(torque, ((0, 0), (0, 1)), "edge")  # the last one is held, too
        axis, effects = self._in_core(fit)
        turn = 2.0 * np.pi / motion.turn
        absolute = starts.copy()
        absolute[:, 3] += windows.angles[0, chosen, 0]
        angles, speeds = core.simulate_windows(
            axis,
            effects,
            windows.time_step,
            torque[chosen, : horizon or self._horizon] * self._force(fit) / turn,
            windows.time[chosen, 0],
            absolute * turn,
            substeps or self.substeps,
        )
        return np.stack([angles / turn + starts[:, 3:4], speeds / turn])

    def _force(self, fit: Fit) -> float:
        """Inertias and torques are so many times larger in the core: then no range is left."""
        return 1.0 / float(fit.plant.values[0])

    def _in_core(self, fit: Fit) -> tuple[Axis, tuple[Effect, ...]]:
        effects = [
            Effect(one.kind.effect, one.kind.location, dict(one.params))
            for one in fit.found
            if not _outside(one)
        ]
        if isinstance(fit.plant, TwoInertias):
            axis = fit.plant.axis
        else:  # a table hangs on it by a shaft that carries nothing
            inertia, viscous = fit.plant.values.tolist()
            axis = Axis(inertia, inertia, 0.0, 1e-4 * inertia)
            effects.append(Effect("friction_viscous", "motor", {"coefficient": viscous}))
        return Model(axis, tuple(effects), self._windows.linear).rotary(self._force(fit))

    def residual_of(self, point: _Point, fit: Fit) -> Array:
        """Errors (w, c l) of another fit from the same starts."""
        return self._point(fit, point.starts).residual

    # ---- Derivatives

    def _derivatives(self, point: _Point) -> tuple[Array, Array]:
        """By the steps of the initial states (w, c l, s) and along the directions (w, c l, k)."""
        fit, (substeps, played) = point.fit, self._roughly(point)

        def change(other: Fit, starts: Array) -> Array:
            moved = self._played(other, starts, substeps=substeps)[0]
            return self._vectors(fit, moved - played)

        of_states = []
        for step in np.diag(self._state_steps):
            starts = point.starts.copy()
            starts[:, self._free] += step
            of_states.append(change(fit, starts))

        def along(direction: Array) -> Array:
            return change(fit.with_values(fit.values + _STEP * direction), point.starts) / _STEP

        directions = fit.directions.T
        columns = [along(direction) for direction in directions[: len(fit.plant.names)]]
        if self._windows.channels == 2:
            zero = np.zeros_like(point.angles)
            zero[1] = 1.0
            columns.append(fit.vectors(zero))
        for one in fit.found:
            first = len(columns)
            if _outside(one):
                moves = fit.moves(one, self._motion)
                columns += [fit.vectors(angles[:, :, : self._horizon]) for angles in moves]
                continue
            if isinstance(one.kind, ExtraMode):
                columns += map(along, directions[first : first + len(one.values)])
                continue
            size = float(np.linalg.norm(one.sizes))
            for i, value in enumerate(one.values):
                more = _STEP * size if i < len(one.sizes) else one.kind.difference * abs(value)
                values = fit.values
                values[first + i] += more
                columns.append(change(fit.with_values(values), point.starts) / more)
        return np.stack(of_states, axis=2), np.stack(columns, axis=2)

    def _roughly(self, point: _Point) -> tuple[int, Array]:
        """Rough steps from one sample to the next, and the angles (2, w, l) that they make."""
        substeps = self._steps(_STEP_MAX)
        if substeps == self.substeps:
            return substeps, point.played
        return substeps, self._played(point.fit, point.starts, substeps=substeps)[0]

    def by_size(self, point: _Point, found: Found, little: float) -> Array:
        """By the sizes of a further effect (w, c l, k), as far as a ``little`` of it tells."""
        substeps, played = self._roughly(point)
        columns = []
        for sizes in little * np.eye(len(found.sizes)):
            more = replace(point.fit, found=(*point.fit.found, replace(found, sizes=sizes)))
            moved = self._played(more, point.starts, substeps=substeps)[0] - played
            columns.append(self._vectors(point.fit, moved) / little)
        return np.stack(columns, axis=2)

    def _vectors(self, fit: Fit, angles: Array) -> Array:
        return fit.vectors(angles[: self._windows.channels])


def _outside(one: Found) -> bool:
    return isinstance(one.kind, _OUTSIDE)


def _linear(one: Found) -> bool:
    """Does the axis with it answer as a linear one, which is simulated exactly?"""
    return _outside(one) or isinstance(one.kind, ExtraMode)


def _linearised(fit: Fit) -> Fit:
    """The fit without what makes its axis another than a linear one."""
    return replace(fit, found=tuple(one for one in fit.found if _linear(one)))


def _squares(residual: Array) -> Array:
    """Of the windows (w,)."""
    squares: Array = np.sum(residual**2, axis=1)
    return squares


def _eliminated(of_states: Array, columns: Array) -> tuple[Array, Array]:
    """Of columns (w, n, k) what initial states explain: the states (w, s, k), and what they do."""
    gram = of_states.transpose(0, 2, 1) @ of_states
    gram += np.eye(gram.shape[1]) / _STATE_SPREAD**2
    states = np.linalg.solve(gram, of_states.transpose(0, 2, 1) @ columns)
    return states, of_states @ states
