"""Which effects are in a record: one after another, each has to prove itself on held-out data."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from axistwin.core import Array
from axistwin.diagnose import resonance, spectrum
from axistwin.diagnose.effects import (
    DRY,
    FRICTION,
    MOTOR,
    Asymmetry,
    Coulomb,
    Disturbance,
    ExtraMode,
    Found,
    FrictionDrift,
    Kind,
    LeadError,
    Motion,
    Offset,
    Push,
    Ripple,
    Shape,
    Stribeck,
    Viscous,
    Wave,
    catalogue,
)
from axistwin.diagnose.fit import Fit, solve, solve_normal
from axistwin.diagnose.linear import Rigid, Torque
from axistwin.diagnose.replay import Replay, find_replay
from axistwin.diagnose.windows import Windows, median_spectrum
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify.samples import Hold

#: Effects that are named at most; of an axis that is told by its torque, where each is a small part
#: of what is left.
EFFECTS_MAX = 4
EFFECTS_OF_TORQUE_MAX = 6

#: What an effect has to win on the windows it is fitted to, in units of the noise squared or of
#: the error squared, and on those held out.
GAIN_MIN = 30.0
HELD_OUT_MIN = 10.0

#: A simpler effect that gains this share of what another one does comes first.
NEARLY = 0.9

#: The share of the held-out error whose loss needs no further proof.
MOST = 0.5

#: What held-out windows that hold little but noise have to gain when they do not agree; where they
#: hold nothing else chance hardly ever gives so much.
ALONE_MIN = 100.0
CHANCE_MAX = 20.0

#: The least that held-out windows gain of what the fitted ones do, which are twice as many.
AGREED = 0.25

#: Windows are few up to this share of all, and what is left of their error is nearly none.
FEW = 0.25
NEARLY_NONE = 0.1

#: Of the best trials, so many are fitted in full, if they gain this share of what the best does.
CONTENDERS = 5
CONTENDER = 0.3

#: Effects of which an axis can have several at a place.
SEVERAL = (Ripple, LeadError)

#: So many of each at most: what the core can simulate.
WAVES_MAX = 4

#: The same for a model with as many unknowns: 1 to 50 against the other one.
LIKELIER = 8.0

#: Student's t of the gain of the held-out windows.
T_MIN = 3.0

#: Waves that are tried of each kind, and the most periods a turn.
_WAVES = 4
_PERIODS_MAX = 360.0
_PERIODS_A_METRE_MAX = 5000.0

#: Samples of rest that an axis begins with that is run backwards.
_REST = 2

#: An error of so much [noise squared] may be a ripple that turns an axis back: what it moves is no
#: measure of it. Up to so many periods a turn are then all tried.
_LARGE = 10.0
_PERIODS_LARGE = 48

#: How often a moment is looked for closer to the best one.
_LEVELS = 3

#: Mean square of an error, in units of the noise, that leaves the plant where it should be.
_NEARLY_RIGHT = 2.0

#: The same where hardly anything but noise is left.
_NOISE = 1.03

#: The same where no other plant need be tried: the noise itself is known no better.
_RIGHT = 1.015

#: The same where a simulation of the effects could not bring it nearer.
_ALL = 1.003

#: Of a record that is not understood, an effect that is named leaves such a part of what was more
#: than noise, and all that are named such a rest: else any of them may be another one's image.
_PART_LEFT = 0.5
_ALL_LEFT = 0.1

#: What a further mode has to explain of what is more than noise.
_GOOD_PART = 0.3

#: So many of the best contenders are simulated.
_SIMULATED = 2

#: How often the effects that were found may be replaced by others.
_REVISIONS = 3

#: Corner frequencies that are tried, up to a share of the highest frequency, and the lines of a
#: spectrum that the taper smears.
_CORNERS = 100
_CORNER_MAX = 0.5
_TAPER_WIDTH = 4

#: So often the errors are weighted anew, unless the corner is the same but for such a share.
_WEIGHINGS = 2
_SAME_CORNER = 0.1

#: What is left has a mean square this many times that of the noise, at least: then there is more.
UNEXPLAINED = 1.1

#: Gauss-Newton steps that adjust a shape alone.
_STEPS = 4

Progress = Callable[[str], None]


@dataclass(frozen=True)
class Trial:
    """A kind of effect at its best besides a model. ``before`` and ``after`` (w,): the squared,
    weighted error of each window without and with it."""

    found: Found
    before: Array
    after: Array
    held_out: npt.NDArray[np.bool_]

    @property
    def gain(self) -> float:
        """What the fitted windows gain."""
        return float(np.sum((self.before - self.after)[~self.held_out]))

    @property
    def total(self) -> float:
        """What all held-out windows gain."""
        return float(np.sum((self.before - self.after)[self.held_out]))

    @property
    def share(self) -> float:
        """The share of the held-out error that is gained."""
        return self.total / float(np.sum(self.before[self.held_out]))

    @property
    def t(self) -> float:
        """Student's t of the gain of the held-out windows, each on a scale of its own."""
        return student(np.log(self.before / self.after)[self.held_out])

    @property
    def t_plain(self) -> float:
        """The same of the gains as they are."""
        return student((self.before - self.after)[self.held_out])


def student(values: Array) -> float:
    """Student's t of the mean of values."""
    spread = float(np.std(values, ddof=1) / np.sqrt(len(values)))
    mean = float(np.mean(values))
    return mean / max(spread, 1e-300)


class Trials:
    """Everything that the catalogue could add to a fit."""

    def __init__(self, state: State) -> None:
        self._state = state
        self.fit, self.motion = state.fit, state.motion
        self._residual = state.residual
        self._columns = state.columns
        self._held_out = state.fit.windows.held_out
        self._scale = state.scale
        self._grams = self._columns @ self._columns.transpose(0, 2, 1)
        self._rights = (self._columns @ self._residual[:, :, None])[:, :, 0]
        _, self._before = self._fitted(self._columns[:, :0], self._residual)

    def run(self, kinds: Sequence[Kind], progress: Progress) -> list[Trial]:
        """The best of each kind, the most helpful first."""
        trials = []
        for kind in kinds:
            progress(f"trying {kind.effect} at {kind.location}")
            trial = self._best(kind)
            if trial is not None:
                trials.append(self._replayed(trial) or trial)
        return sorted(trials, key=lambda trial: -trial.gain)

    def _replayed(self, trial: Trial) -> Trial | None:
        """The same beside effects as they act, where those bend the answer of the axis."""
        found, replay = trial.found, self._state.replay
        if replay is None or self._scale < _RIGHT or found.kind.sizes == 0:
            return None
        along = self.fit.by_size(found, self.motion)
        most = max(float(np.max(np.abs(column))) for column in along)
        try:
            columns = replay.by_size(found, most)
        except InputError:
            return None
        if columns is None:
            return None
        return self._trial(found, *self._fitted(np.stack(columns, axis=1), self._residual))

    def _trial(self, found: Found, sizes: Array, after: Array) -> Trial | None:
        candidate = replace(found, sizes=sizes)
        if not np.all(np.isfinite(sizes)) or not candidate.plausible:
            return None
        return Trial(candidate, self._before, after, self._held_out)

    def _best(self, kind: Kind) -> Trial | None:
        best = self._best_of(kind, self._shapes(kind))
        for level in range(_LEVELS if kind.moment else 0):
            if best is not None:
                closer = kind.around(self.motion, best.found.shape, level)
                best = self._best_of(kind, closer) or best
        if best is None or not kind.adjustable or not best.found.shape:
            return best
        return self._adjusted(best)

    def _best_of(self, kind: Kind, shapes: Sequence[Shape]) -> Trial | None:
        trials = [self._try(Found(kind, np.zeros(kind.sizes), shape)) for shape in shapes]

        def worth(trial: Trial) -> tuple[bool, float]:
            # What is slow can go with a wave that means nothing, and hide one that does.
            holds = not isinstance(kind, Wave) or significant(trial, self._state)
            return holds, trial.gain + (trial.total if kind.moment else 0.0)

        return max((trial for trial in trials if trial), key=worth, default=None)

    def _shapes(self, kind: Kind) -> Sequence[Shape]:
        if isinstance(kind, (Ripple, LeadError, Disturbance)):
            periods = self._waves(kind)
            if isinstance(kind, Ripple) and self._scale > _LARGE and not self.fit.windows.linear:
                periods = sorted({*periods, *np.arange(1.0, _PERIODS_LARGE + 1.0).tolist()})
            return [(one,) for one in periods]
        return kind.shapes(self.motion)

    def _try(self, found: Found) -> Trial | None:
        """With the best sizes for this shape."""
        if not found.kind.possible(self.motion, found.shape):
            return None
        columns = self.fit.by_size(found, self.motion)
        if columns:
            sizes, after = self._fitted(np.stack(columns, axis=1), self._residual)
        else:
            residual = self._without(found)
            sizes, after = self._fitted(self._columns[:, :0], residual)
        return self._trial(found, sizes, after)

    def _without(self, found: Found) -> Array:
        """The errors (w, n) less what an effect adds."""
        push = found.push(self.motion, self.fit.plant)
        return self._residual - self.fit.project(self.fit.answer([push]))

    def _fitted(self, own: Array, residual: Array) -> tuple[Array, Array]:
        """Least squares of errors (w, n) by the columns of the fit and further ones (w, k, n).

        Returns what the further ones take (k,), by the windows that are not held out, and the
        squared errors (w,) that are left.
        """
        cross = own @ self._columns.transpose(0, 2, 1)
        square = own @ own.transpose(0, 2, 1)
        grams = np.block([[self._grams, cross.transpose(0, 2, 1)], [cross, square]])
        rights = np.concatenate(
            [(columns @ residual[:, :, None])[:, :, 0] for columns in (self._columns, own)], axis=1
        )
        chosen = ~self._held_out
        solution = solve_normal(np.sum(grams[chosen], axis=0), np.sum(rights[chosen], axis=0))
        squares = np.sum(residual**2, axis=1)
        left: Array = squares - 2.0 * rights @ solution + (grams @ solution) @ solution
        return solution[self._columns.shape[1] :], left

    def _adjusted(self, best: Trial) -> Trial:
        """The shape adjusted by Gauss-Newton steps, the rest of the model linearised."""
        for _ in range(_STEPS):
            found = best.found
            own = np.stack(self.fit.columns(found, self.motion), axis=1)
            step, _ = self._fitted(own, self._without(found))
            for halving in range(4):
                values = found.values + step * 0.5**halving
                try:
                    trial = self._try(found.with_values(values))
                except InputError:
                    continue
                if trial is not None and trial.gain > best.gain:
                    break
            else:
                return best
            gained, best = trial.gain - best.gain, trial
            if gained < 1e-3 * abs(best.gain):
                break
        return best

    # ---- What is periodic

    def _waves(self, kind: Wave) -> list[float]:
        """The numbers of periods that promise most."""
        fit, motion = self.fit, self.motion
        solution = solve_normal(np.sum(self._grams, axis=0), np.sum(self._rights, axis=0))
        error = self._residual - np.einsum("wkn,k->wn", self._columns, solution)
        if isinstance(kind, Disturbance):
            return spectrum.lines(fit.channels(error), motion.time_step, motion.index, _WAVES)
        weights = np.ones(len(error))
        if fit.corner > 0.0:
            # Each window on a scale of its own: reversals would hide what there is all the time.
            weights /= np.mean(error**2, axis=1)
        error = error * weights[:, None]
        if isinstance(kind, LeadError):
            scores = fit.slopes(error)[1]
        else:
            scores = self.scores(error, kind.place)
        turns = np.abs(motion.speed[kind.place]) * motion.time_step / motion.turn
        nyquist = 0.45 / max(float(np.quantile(turns, 0.5)), 1e-12)
        whole = not fit.windows.linear
        argument = kind.argument(motion)
        lowest, highest = 1.0, min(nyquist, _PERIODS_MAX if whole else _PERIODS_A_METRE_MAX)
        strength = self._strength(kind, lowest, highest, weights)
        found = spectrum.peaks(argument, scores, lowest, highest, strength, _WAVES, whole)
        if isinstance(kind, LeadError):
            found = [periods for periods in found if periods != 1.0]  # that is an eccentricity
        return found

    def scores(self, error: Array, place: int) -> Array:
        """Inner products (w, l) of weighted errors (w, c l) with what unit torques at a place move.

        Those are the slopes by the angles, run backwards through the axis; it begins at rest, as
        straight lines between samples would halve the first.
        """
        backwards = np.pad(self.fit.slopes(error)[:, :, ::-1], ((0, 0), (0, 0), (_REST, 0)))
        moved, _ = self.fit.system.respond(self.motion.time_step, Torque.smooth(backwards))
        scores: Array = moved[place, :, : _REST - 1 : -1]
        return scores

    def _strength(
        self, kind: Kind, lowest: float, highest: float, weights: Array
    ) -> Callable[[Array], Array]:
        """What a wave of size 1 moves, squared, the windows with ``weights`` (w,).

        Interpolated between some numbers of periods.
        """
        fit, motion = self.fit, self.motion
        tried = np.geomspace(lowest, highest, 24)
        moved = []
        for periods in tried:
            columns = fit.by_size(Found(kind, np.zeros(2), (float(periods),)), motion)
            moved.append(sum(float(weights @ np.sum(column**2, axis=1)) for column in columns))
        logs = np.log(np.maximum(moved, 1e-300))
        return lambda wanted: np.exp(np.interp(np.log(wanted), np.log(tried), logs))


def significant(trial: Trial, state: State) -> bool:
    """Whether an effect helps a state beyond chance.

    The windows have to agree on it, or most of the error has to go. Where hardly anything but
    noise of the encoders is left, its distribution is known, and what a single window gains can be
    enough.
    """
    unknowns = max(trial.found.kind.sizes, 1) + len(trial.found.shape)
    if len(trial.found.values) == 1 and _normalised(trial, state.samples):
        return True
    scale = max(1.0, float(np.mean(trial.before)) / state.samples)
    if trial.gain <= (GAIN_MIN + 4.0 * unknowns) * scale or trial.total <= HELD_OUT_MIN * scale:
        return False
    if max(trial.t, trial.t_plain) > T_MIN or trial.share > MOST:
        return True
    if _explained(trial, state.samples):
        return True
    if scale > _NEARLY_RIGHT or state.fit.corner > 0.0:
        return False
    if trial.total > ALONE_MIN * scale:
        return True
    return scale < _NOISE and trial.total > max(CHANCE_MAX * scale, AGREED * trial.gain)


def _explained(trial: Trial, samples: int) -> bool:
    """Whether of what held-out windows have beyond noise nearly nothing is left."""
    noise = samples * np.count_nonzero(trial.held_out)
    before, after = (
        float(np.sum(errors[trial.held_out])) - noise for errors in (trial.before, trial.after)
    )
    return before > ALONE_MIN and bool(after < NEARLY_NONE * before)


def _normalised(trial: Trial, samples: int) -> bool:
    """Whether a few windows that were unlike the others become like them.

    That is what a limit does that is seldom reached, or a shaft that has got softer when the first
    transient is over. One number cannot make that of an error that has another cause, be the
    windows held out or not.
    """
    usual = float(np.median(trial.after))
    gained = trial.before - trial.after
    least = ALONE_MIN * max(usual / samples, 1.0)
    few = gained > max(least, NEARLY_NONE * float(np.max(gained)))
    if not 0 < np.count_nonzero(few) < FEW * len(few):
        return False
    excess, left = (float(np.sum(errors[few] - usual)) for errors in (trial.before, trial.after))
    return left < NEARLY_NONE * excess and float(np.sum(gained)) > NEARLY * excess


@dataclass(frozen=True)
class State:
    """A fit, and the motion it makes of the record; of a simulation of the effects if there is
    one."""

    fit: Fit
    motion: Motion
    replay: Replay | None = None

    @classmethod
    def along(cls, fit: Fit, before: Motion | None = None) -> State:
        """The fit adjusted, its effects taken along the motion; ``before`` is that known so far."""
        return cls(*fit.adjust(before))

    @classmethod
    def of(cls, fit: Fit, before: Motion | None = None) -> State:
        """The fit adjusted; with a simulation of the effects where they are not all there is."""
        return cls.along(fit, before).simulated()

    def beside(self, fit: Fit) -> State:
        """Another fit near this one, adjusted from here: to a simulation if this one is."""
        if self.replay is not None:
            replayed = State(fit, self.motion).replayed()
            if replayed.replay is not None:
                return replayed
        return State.along(fit, self.motion)

    def simulated(self) -> State:
        """With a simulation of the effects, where more is left than noise."""
        return self.replayed() if self.replay is None and self.scale > _ALL else self

    def replayed(self) -> State:
        """The same adjusted to a simulation of the effects, if that brings it nearer."""
        if self.fit.corner > 0.0:
            return self  # that is for the last digits above the noise
        replay = find_replay(self.fit, self.motion)
        if replay is None or self.fit.misfit(replay.residual) > self.fitted:
            return self
        return State(replay.fit, replay.motion, replay)

    @cached_property
    def residual(self) -> Array:
        """Weighted errors (w, c l)."""
        return self.fit.residual(self.motion) if self.replay is None else self.replay.residual

    @cached_property
    def columns(self) -> Array:
        """Derivatives (w, k, c l) of the simulation along the directions of the fit."""
        return self.fit.sensitivity(self.motion) if self.replay is None else self.replay.columns

    @cached_property
    def errors(self) -> Array:
        """Squared, of the windows (w,)."""
        errors: Array = np.sum(self.residual**2, axis=1)
        return errors

    @property
    def simulation_error(self) -> Array:
        """Measured less simulated angles (c, w, l), each window from the state that suits it."""
        if self.replay is None:
            return self.fit.simulation_error(self.motion)
        return self.fit.angles(self.residual)

    @property
    def scale(self) -> float:
        """Squared error of a sample, at least that of the noise."""
        return max(1.0, float(np.mean(self.errors)) / self.samples)

    @property
    def corner(self) -> float:
        """The frequency below which errors of the torque outweigh the noise of the encoder [rad/s].

        That of the spectrum which a white torque beside white noise makes (Fit.whitening) and that
        suits best; in logarithms and by their absolute values, so that lines do not count.
        """
        fit = self.fit
        if not isinstance(fit.plant, Rigid) or fit.noise is None:
            return 0.0
        power = median_spectrum(self.simulation_error / fit.noise[:, None, None])[0]
        step = 2.0 * np.pi / (fit.windows.length * fit.windows.time_step)
        frequency = step * np.arange(len(power), dtype=np.float64)
        beyond = slice(_TAPER_WIDTH, -1)
        tried = np.geomspace(step, _CORNER_MAX * frequency[-1], _CORNERS)
        shapes = np.log1p((tried[:, None] / frequency[beyond]) ** 4)
        misfit = np.sum(np.abs(np.log(power[beyond]) - shapes), axis=1)
        return float(tried[np.argmin(misfit)])

    @property
    def samples(self) -> int:
        """Of a window, less what its initial state takes."""
        windows = self.fit.windows
        states = len(self.fit.system.free(windows.time_step, 2))
        return windows.channels * windows.length - states

    @property
    def fitted(self) -> float:
        """The error of the windows that may be fitted to."""
        return float(np.sum(self.errors[~self.fit.windows.held_out]))

    def against(self, other: State, found: Found) -> Trial:
        """What this state gains over another one by an effect."""
        return Trial(found, other.errors, self.errors, self.fit.windows.held_out)

    @cached_property
    def covariance(self) -> Array:
        """Of the unknowns (k, k).

        Errors may be correlated within a window but not from one to the next, so the scores of the
        windows tell their spread (Liang and Zeger 1986); white noise is the least that is assumed.
        """
        columns, residual = self.columns, self.residual
        count, k = columns.shape[:2]
        gram = np.einsum("wan,wbn->ab", columns, columns, optimize=True)
        size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
        inverse = np.linalg.pinv(gram / np.outer(size, size), rcond=1e-11, hermitian=True)
        inverse /= np.outer(size, size)
        scores = np.einsum("wan,wn->wa", columns, residual, optimize=True)
        clustered = inverse @ (scores.T @ scores) @ inverse * (count / max(count - k, 1))
        white = inverse * self.scale
        more = np.sqrt(np.maximum(np.diag(white), 1e-300) / np.maximum(np.diag(clustered), 1e-300))
        more = np.maximum(more, 1.0)
        spread = clustered * np.outer(more, more)
        directions = self.fit.directions
        of_values: Array = directions @ spread @ directions.T
        return of_values

    def misfit_at(self, unknown: int, value: float) -> float:
        """The error where one unknown has another value and the others make the best of that, to
        first order. Infinite where no axis has it."""
        values = self.fit.values
        values[unknown] = value
        try:
            other = self.fit.with_values(values)
            if self.replay is not None:
                residual = self.replay.residual_of(other)
            else:
                residual = other.residual(self.motion)
        except InputError:
            return np.inf
        columns, chosen = np.delete(self.columns, unknown, axis=1), ~self.fit.windows.held_out
        step = solve(columns, residual, chosen)
        return self.fit.misfit(residual - np.einsum("wkn,k->wn", columns, step))

    def spread(self, i: int) -> Array:
        """Covariance of the values of the i-th effect."""
        chosen = self.unknowns(i)
        return self.covariance[chosen, chosen]

    def unknowns(self, i: int) -> slice:
        """Which of all unknowns are the values of the i-th effect."""
        counts = [len(one.values) for one in self.fit.found]
        start = len(self.fit.values) - sum(counts[i:])
        return slice(start, start + counts[i])

    @property
    def plausible(self) -> bool:
        """Whether an axis can have these effects, and such a motion can show them."""
        dry = [one for one in self.fit.found if isinstance(one.kind, DRY)]
        for place in {one.kind.place for one in dry}:
            if sum(float(one.sizes[0]) for one in dry if one.kind.place == place) < 0.0:
                return False  # at rest it would drive
        asymmetric = [one for one in self.fit.found if isinstance(one.kind, Asymmetry)]
        if any(abs(one.sizes[0]) > self.fit.viscous(one.kind.place) for one in asymmetric):
            return False  # in one direction it would
        return all(
            found.plausible and found.kind.possible(self.motion, found.shape)
            for found in self.fit.found
        )


def rigid_start(windows: Windows, hold: Hold) -> Rigid:
    """A first guess of a rigid axis: what its torque moves, with friction and load beside.

    Raises NotEnoughDataError when torque moves nothing.
    """
    fit = Fit(windows, hold, Rigid(1.0, 0.0))
    motion = fit.motion(None)
    command = motion.command()
    speed = np.gradient(fit.measured[0], windows.time_step, axis=1)
    pushes = [
        Push(command=np.stack([command, command])),
        Push(motor=-np.sign(speed)),
        Push(motor=np.ones_like(command)),
    ]
    columns = [fit.project(fit.answer([push])) for push in pushes]
    inverse = solve(np.stack(columns, axis=1), fit.project(fit.measured), ~windows.held_out)[0]
    if inverse <= 0.0:
        raise NotEnoughDataError(
            "the torque does not explain how the axis moves: excite it with more acceleration"
        )
    return Rigid(1.0 / float(inverse), 0.0)


def with_modes(state: State) -> list[Fit]:
    """The fit from axes with a further mode, as the record seems to show one."""
    fit = state.fit
    torque = fit.delivered(state.motion)
    zero = np.zeros_like(fit.measured)
    zero[1] = 1.0
    fits = []
    for plant, mode in resonance.find(fit.windows, torque):
        fit = replace(state.fit, plant=plant, zero=0.0, found=(*state.fit.found, mode))
        # The inertias in proportion to the torque, which a response tells far less well.
        try:
            moved = fit.answer([Push(command=np.stack([torque, torque]))])
        except InputError:  # two vibrations are one, or too fast
            continue
        columns = np.stack([fit.project(angles) for angles in (moved, zero)], axis=1)
        size, shift = solve(columns, fit.project(fit.measured), ~fit.windows.held_out)
        if size > 0.0:
            scaled = plant.with_values(plant.values / size)
            fits.append(replace(fit, plant=scaled, zero=float(shift)))
    return fits


def begin(start: Fit) -> list[State]:
    """Plants that are near enough for effects to be told, without any; one when that is clear.

    Friction and load drag both angles away from a plant that has none: while its parameters are
    adjusted there is some of both. Where even so the error is far from noise, from wherever it is
    adjusted, something else drags: then one plant is as the start, which looks at fast motion only,
    had it, and another as the adjustment left it.
    """
    channels = start.windows.channels
    dragging = (Coulomb(), Viscous(), Offset()) if channels == 2 else (Coulomb(), Offset())
    found = tuple(Found(kind, np.zeros(1), ()) for kind in dragging)
    start = start.with_noise(start.motion(None))
    best: State | None = None
    for plant in (start.plant, *start.plant.others()):
        state = State.along(replace(start, plant=plant, found=found))
        state = State.along(state.fit.with_noise(state.motion), state.motion)
        if best is None or state.scale < best.scale:
            best = state
        if best.scale < _RIGHT:
            break
    if best is not None and best.scale < _NEARLY_RIGHT:
        without = State(replace(best.fit, found=()), best.motion)
        adjusted = State.along(without.fit, without.motion)
        return [adjusted if adjusted.scale < _NEARLY_RIGHT else without]
    states = [State(start, start.motion(None))]
    if best is not None:
        states.append(State(replace(best.fit, found=(), noise=start.noise), best.motion))
    return states


@dataclass(frozen=True)
class Search:
    """The states on the way, the first without effects, and what was tried on each."""

    states: tuple[State, ...]
    trials: tuple[tuple[Trial, ...], ...]


def look(bases: Sequence[State], progress: Progress, parts: int = 1) -> Search:
    """All effects that held-out data speak for.

    Where what they leave is far more than the noise of the encoder, they are looked for once more,
    every error weighted as such errors are: then they are told by what they do to the torque.
    ``parts`` windows in a row are parts of a longer one, where the search goes on in the end.
    """
    found = _searched(bases, progress)
    last = found.states[-1]
    if last.scale < _NEARLY_RIGHT:
        if parts > 1:
            found = _lengthened(found, parts, progress)
    else:
        found = _weighted(found, bases, progress)
    return _understood(_ordered(found, progress))


def _weighted(found: Search, bases: Sequence[State], progress: Progress) -> Search:
    """Searched again with errors weighted as what the last search has left is.

    What is left when little is understood tells that badly, so it is asked again.
    """
    corner = 0.0
    for _ in range(_WEIGHINGS):
        known, corner = corner, found.states[-1].corner
        if abs(corner - known) <= _SAME_CORNER * known:
            break
        progress("weighting the errors as those of a torque")
        weighted = [State(replace(base.fit, corner=corner), base.motion) for base in bases]
        found = _searched(weighted, progress)
    return found


def _searched(bases: Sequence[State], progress: Progress) -> Search:
    """All effects with the weights that the errors of the bases have."""
    found = _extended([bases[0]], [], progress)
    for base in bases[1:]:
        if found.states[-1].scale < _RIGHT:
            break
        other = _extended([base], [], progress)
        if other.states[-1].fitted < found.states[-1].fitted:
            found = other
    found = _settled(found, progress)
    honest = min([*bases, *(State.of(base.fit, base.motion) for base in bases)], key=_fitted)
    return replace(found, states=(honest, *found.states[1:]))


def _lengthened(search: Search, parts: int, progress: Progress) -> Search:
    """The search carried on in longer windows, which show what is slow and small.

    As it was where those cannot be simulated down to noise: what is found in short ones holds.
    """
    progress("going on in longer windows")

    def longer(state: State) -> State:
        windows = state.fit.windows
        length = parts * windows.length
        return State(replace(state.fit, windows=windows.recut(length)), state.motion.recut(length))

    last = longer(search.states[-1]).replayed()
    if last.replay is None:
        last = State.of(last.fit, last.motion)
    base = longer(search.states[0])
    base = min(base, State.of(base.fit, base.motion), key=_fitted)
    known = Search((base, last), search.trials)
    chain = [*_chain(known, last.fit.found[:-1]), last] if last.fit.found else [last]
    found = _settled(_extended(chain, list(search.trials[:-1]), progress), progress)
    return found if found.states[-1].scale < _NEARLY_RIGHT else search


def _settled(found: Search, progress: Progress) -> Search:
    """Revised until every effect stands."""
    for _ in range(_REVISIONS):
        revised = _revised(found, progress)
        if revised is None:
            break
        found = revised
    return found


def _fitted(state: State) -> float:
    return state.fitted


def _extended(states: list[State], tried: list[tuple[Trial, ...]], progress: Progress) -> Search:
    """Adds effects one at a time while held-out data say so."""
    while True:
        state = states[-1]
        trials = Trials(state).run(_left(state.fit), progress)
        tried.append(tuple(trials))
        better = None
        most = EFFECTS_MAX if state.fit.corner == 0.0 else EFFECTS_OF_TORQUE_MAX
        if len(state.fit.found) < most:
            better = _best(state, trials, progress)
        if better is None:
            return Search(tuple(states), tuple(tried))
        states.append(_at_better_end(better))


def _revised(search: Search, progress: Progress) -> Search | None:
    """Every effect has to stand against all others once the rest are known.

    None when they all do.
    """
    last = search.states[-1]
    found = last.fit.found
    if len(found) < 2:
        return None
    for i in range(len(found) - 1):
        rest = (*found[:i], *found[i + 1 :])
        without = State.of(replace(last.fit, found=rest), last.motion)
        trials = Trials(without).run(_left(without.fit), progress)
        better = _best(without, trials, progress)
        if better is None:
            if not without.plausible or significant(last.against(without, found[i]), without):
                continue  # from there no way led back, but here it is
            return _extended(_chain(search, rest), list(search.trials[: len(rest)]), progress)
        if last.scale < _RIGHT and better.fit.found[-1].kind == found[i].kind:
            continue  # the same again
        if better.fitted < last.fitted - GAIN_MIN * last.scale:
            chain = _chain(search, better.fit.found)
            return _extended(chain, list(search.trials[: len(chain) - 1]), progress)
    return None


def _at_better_end(state: State) -> State:
    """The same, or if friction has come last, all of it at the other end if that fits better.

    There are as many unknowns, so a likelihood that is clearly larger decides.
    """
    ends = (*FRICTION, FrictionDrift)
    if state.fit.windows.channels < 2 or not isinstance(state.fit.found[-1].kind, ends):
        return state
    moved = tuple(
        replace(one, kind=replace(one.kind, place=1 - one.kind.place))
        if isinstance(one.kind, ends)
        else one
        for one in state.fit.found
    )
    other = State.of(replace(state.fit, found=moved), state.motion)
    if other.plausible and other.fitted < state.fitted - LIKELIER * state.scale:
        return other
    return state


def _chain(search: Search, found: Sequence[Found]) -> list[State]:
    """The states on the way to these effects, in this order."""
    states = [search.states[0]]
    for k in range(1, len(found) + 1):
        before = search.states[-1]
        states.append(State.of(replace(before.fit, found=tuple(found[:k])), before.motion))
    return states


def _ordered(search: Search, progress: Progress) -> Search:
    """What explains most comes first, and what it hid was found beside it."""
    errors = [state.fitted for state in search.states]
    gains = [before - after for before, after in pairwise(errors)]
    order = sorted(range(len(gains)), key=lambda i: -gains[i])
    last = search.states[-1]
    if order == sorted(order):
        return search
    found = [last.fit.found[i] for i in order]
    whole = last.beside(replace(last.fit, found=tuple(found)))
    states = [*_chain(search, found[:-1]), whole]
    tried = [tuple(Trials(state).run(_left(state.fit), progress)) for state in states[1:-1]]
    return Search(tuple(states), (search.trials[0], *tried, search.trials[-1]))


def _understood(search: Search) -> Search:
    """Of a record that is not understood, only what is by far the most of it is named.

    Nor is anything named whose size may be none.
    """
    states = list(search.states)
    sure = [one for i, one in enumerate(states[-1].fit.found) if _sure(states[-1], i)]
    if len(sure) < len(states) - 1:
        states = _chain(search, sure)
    if states[-1].scale > UNEXPLAINED and states[-1].fit.corner == 0.0:
        excess = [state.scale - 1.0 for state in states]
        less = [after < _PART_LEFT * before for before, after in pairwise(excess)]
        states = states[: [*less, False].index(False) + 1]
        if excess[len(states) - 1] > _ALL_LEFT * excess[0]:
            states = states[:1]
    return Search(tuple(states), search.trials[: len(states)])


def _sure(state: State, i: int) -> bool:
    """Whether the sizes of the i-th effect are not nothing."""
    one = state.fit.found[i]
    k = max(len(one.sizes), 1)  # a gap, a limit or a delay is the size of an effect without
    spread, sizes = state.spread(i)[:k, :k], one.values[:k]
    chi2 = float(sizes @ np.linalg.pinv(spread, hermitian=True) @ sizes)
    return chi2 > k * T_MIN**2


def _left(fit: Fit) -> list[Kind]:
    """The kinds that can be added: waves several times, all others once."""
    names = [found.kind.name for found in fit.found]
    frictions = [found.kind.place for found in fit.found if isinstance(found.kind, FRICTION)]
    viscous = [place for place in range(fit.windows.channels) if fit.viscous(place) > 0.0]
    return [
        kind
        for kind in catalogue(
            fit.windows.channels,
            fit.windows.linear,
            fit.corner > 0.0 and "friction_coulomb:motor" in names,
        )
        if names.count(kind.name) < (WAVES_MAX if isinstance(kind, SEVERAL) else 1)
        and (not isinstance(kind, FrictionDrift) or kind.place in frictions)
        and (not isinstance(kind, Asymmetry) or kind.place in viscous)
    ]


def _resonating(state: State, besides: State) -> list[State]:
    """The fits with a further mode that explain a good part of what the best without one leaves.

    A mode bends a whole response: with so many unknowns it would find something to better anywhere.
    """
    candidates, found = [], []
    for fit in with_modes(state):
        with contextlib.suppress(InputError):  # no two resonances are left
            candidates.append(State.along(fit, state.motion))
    for candidate in candidates:
        part = (besides.scale - candidate.scale) / (besides.scale - 1.0)
        if (
            part > _GOOD_PART
            and candidate.plausible
            and significant(candidate.against(state, candidate.fit.found[-1]), state)
        ):
            found.append(candidate)
    return found


def _best(state: State, trials: Sequence[Trial], progress: Progress) -> State | None:
    """The trials that gain most, each fitted with all the rest; the best of them that holds."""
    good = [trial for trial in trials if significant(trial, state)]
    if not good:  # fitted in full one of them may be
        excess = state.fitted * (1.0 - 1.0 / state.scale)
        good = [trial for trial in trials if trial.gain > MOST * excess > GAIN_MIN]
    contenders: list[State] = []
    for trial in good[:CONTENDERS]:
        if trial.gain < CONTENDER * good[0].gain:
            break
        progress(f"fitting {trial.found.kind.effect} at {trial.found.kind.location}")
        fit = replace(state.fit, found=(*state.fit.found, trial.found))
        with contextlib.suppress(InputError):  # an axis cannot have that beside the rest
            near = len(contenders) < _SIMULATED
            contenders.append(state.beside(fit) if near else State.along(fit, state.motion))
    contenders.sort(key=_fitted)
    fits = []
    for i, contender in enumerate(contenders):
        found = contender.fit.found[-1]
        candidate = contender.simulated() if i < _SIMULATED else contender
        if candidate.plausible and significant(candidate.against(state, found), state):
            fits.append(candidate)
    best = min(fits, key=_fitted, default=None)
    left = best or state
    if left.scale > _RIGHT and any(isinstance(trial.found.kind, ExtraMode) for trial in trials):
        progress("looking for a further resonance")
        fits += _resonating(state, left)
        best = min(fits, key=_fitted, default=None)
    if best is None:
        return None
    simpler = _simpler(best.fit.found[-1].kind)
    for one in fits:
        enough = NEARLY * (state.fitted - best.fitted)
        if one.fit.found[-1].kind == simpler and state.fitted - one.fitted > enough:
            return one
    return best


def _simpler(kind: Kind) -> Kind | None:
    """What comes first if it does nearly as well; the rest can still be added to it.

    Dry friction of one size can still fall with speed, a load can still be more with speed.
    """
    if isinstance(kind, Stribeck):
        return Coulomb(kind.place)
    return Offset(MOTOR) if isinstance(kind, Asymmetry) else None
