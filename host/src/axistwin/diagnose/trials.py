"""What each effect of the catalogue gains beside a model, and whether that is beyond chance."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from axistwin.core import Array
from axistwin.diagnose import spectrum
from axistwin.diagnose.effects import Disturbance, Found, Kind, LeadError, Ripple, Shape, Wave
from axistwin.diagnose.fit import NEARLY_RIGHT, RIGHT, solve_normal
from axistwin.diagnose.forms import Form
from axistwin.diagnose.linear import Torque
from axistwin.diagnose.parallel import each
from axistwin.diagnose.state import State, Trial
from axistwin.errors import InputError

#: What an effect has to win on the windows it is fitted to, in units of the noise squared or of
#: the error squared, and on those held out.
GAIN_MIN = 30.0
HELD_OUT_MIN = 10.0

#: The share of the held-out error whose loss needs no further proof.
MOST = 0.5

#: Student's t of the gain of the held-out windows.
T_MIN = 3.0

#: What held-out windows that hold little but noise have to gain when they do not agree; where they
#: hold nothing else chance hardly ever gives so much.
_ALONE_MIN = 100.0
_CHANCE_MAX = 20.0

#: The least that held-out windows gain of what the fitted ones do, which are twice as many.
_AGREED = 0.25

#: Mean square of an error, in units of the noise, where hardly anything else is left.
_NOISE = 1.03

#: Windows are few up to this share of all; what is left of their error is nearly none, what they
#: gain is nearly all of it.
_FEW = 0.25
_NEARLY_NONE = 0.1
_NEARLY_ALL = 0.9

#: Waves that are tried of each kind, and the most periods a turn.
_WAVES = 4
_PERIODS_MAX = 360.0
_PERIODS_A_METRE_MAX = 5000.0

#: Lines are slow from so many periods in the record up to so many in a window.
_SLOW_PERIODS = 4.0
_FAST_PERIODS = 1.5

#: Samples of rest that an axis begins with that is run backwards.
_REST = 2

#: An error of so much [noise squared] may be a ripple that turns an axis back: what it moves is no
#: measure of it. Up to so many periods a turn are then all tried.
_LARGE = 10.0
_PERIODS_LARGE = 48

#: How often a moment is looked for closer to the best one.
_LEVELS = 3

#: Gauss-Newton steps that adjust a shape alone.
_STEPS = 4

Progress = Callable[[str], None]


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

        def trial(kind: Kind) -> Trial | None:
            progress(f"trying {kind.effect} at {kind.location}")
            best = self._best(kind)
            return None if best is None else self._replayed(best) or best

        trials = [one for one in each(trial, kinds) if one is not None]
        return sorted(trials, key=lambda trial: -trial.gain)

    def _replayed(self, trial: Trial) -> Trial | None:
        """The same beside effects as they act, where those bend the answer of the axis.

        Of an axis with next to nothing left only what seems to help it.
        """
        found, replay = trial.found, self._state.replay
        if replay is None or found.kind.sizes == 0:
            return None
        if self._scale < RIGHT and not significant(trial, self._state):
            return None
        if isinstance(found.kind, Form):  # which the core cannot simulate
            return None
        along = self.fit.by_size(found, self.motion)
        most = max(float(np.max(np.abs(column))) for column in along)
        if most == 0.0:  # a speed that it falls off by, say, that the axis is never as slow as
            return None
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

        def order(trial: Trial) -> tuple[bool, float]:
            # What is slow can go with a wave that means nothing, and hide one that does.
            holds = not isinstance(kind, Wave) or significant(trial, self._state)
            return holds, trial.worth

        return max((trial for trial in trials if trial), key=order, default=None)

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
                if trial is not None and trial.worth > best.worth:
                    break
            else:
                return best
            gained, best = trial.worth - best.worth, trial
            if gained < 1e-3 * abs(best.worth):
                break
        return best

    # ---- What is periodic

    def _waves(self, kind: Wave) -> list[float]:
        """The numbers of periods that promise most."""
        fit, motion = self.fit, self.motion
        solution = solve_normal(np.sum(self._grams, axis=0), np.sum(self._rights, axis=0))
        error = self._residual - np.einsum("wkn,k->wn", self._columns, solution)
        if isinstance(kind, Disturbance):
            lines = spectrum.lines(fit.channels(error), motion.time_step, motion.index, _WAVES)
            return lines + self._slow_lines(kind, error)
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
            if found and any(found[0] % counts == 0.0 for counts in self._counts(highest)):
                return []  # the rounding of an encoder, and images of that
            found = [periods for periods in found if periods != 1.0]  # that is an eccentricity
        return found

    def _slow_lines(self, kind: Disturbance, error: Array) -> list[float]:
        """The frequencies [rad/s] about as slow as a window that promise most.

        Little is left of such a line in a window that begins as it likes; what is, is another one
        in each.
        """
        motion = self.motion
        lowest = _SLOW_PERIODS * 2.0 * np.pi / float(motion.time[-1, -1] - motion.time[0, 0])
        highest = _FAST_PERIODS * 2.0 * np.pi / (self.fit.windows.length * motion.time_step)
        scores = self.scores(error, kind.place)
        strength = self._strength(kind, lowest, highest, np.ones(len(error)))
        return spectrum.peaks(motion.time, scores, lowest, highest, strength, _WAVES, whole=False)

    def _counts(self, most: float) -> list[int]:
        """The counts a turn of coarse encoders, of those that have up to ``most``."""
        turn = self.motion.turn
        steps = (step for step in self.fit.windows.steps if step is not None)
        return [round(turn / step) for step in steps if 1.0 <= turn / step <= most]

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
    if _normalised(trial, state.samples):
        return True
    scale = max(1.0, float(np.mean(trial.before)) / state.samples)
    if trial.gain <= (GAIN_MIN + 4.0 * unknowns) * scale or trial.total <= HELD_OUT_MIN * scale:
        return False
    if max(trial.t, trial.t_plain) > T_MIN or trial.share > MOST:
        return True
    if _explained(trial, state.samples):
        return True
    if scale > NEARLY_RIGHT or state.fit.corner > 0.0:
        return False
    if trial.total > _ALONE_MIN * scale:
        return True
    return scale < _NOISE and trial.total > max(_CHANCE_MAX * scale, _AGREED * trial.gain)


def _explained(trial: Trial, samples: int) -> bool:
    """Whether of what held-out windows have beyond noise nearly nothing is left."""
    noise = samples * np.count_nonzero(trial.held_out)
    before, after = (
        float(np.sum(errors[trial.held_out])) - noise for errors in (trial.before, trial.after)
    )
    return before > _ALONE_MIN and bool(after < _NEARLY_NONE * before)


def _normalised(trial: Trial, samples: int) -> bool:
    """Whether a few windows that were unlike the others become like them.

    That is what a limit does that is seldom reached, a shaft that has got softer when the first
    transient is over, or a further mode that only this one shows. One number cannot make that of an
    error that has another cause, be the windows held out or not; nor can several, of which each
    may leave a part of what the others do.
    """
    usual = float(np.median(trial.after))
    gained = trial.before - trial.after
    least = _ALONE_MIN * max(usual / samples, 1.0)
    few = gained > max(least, _NEARLY_NONE * float(np.max(gained)))
    if not 0 < np.count_nonzero(few) < _FEW * len(few):
        return False
    excess, left = (float(np.sum(errors[few] - usual)) for errors in (trial.before, trial.after))
    part = _NEARLY_NONE ** len(trial.found.values)
    return left < part * excess and float(np.sum(gained)) > _NEARLY_ALL * excess
