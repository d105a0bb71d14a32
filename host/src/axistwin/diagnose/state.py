"""A model that is fitted to a record, and what another effect gains over it."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np
import numpy.typing as npt

from axistwin.core import Array
from axistwin.diagnose.effects import DRY, Asymmetry, Found, Motion
from axistwin.diagnose.fit import Fit, solve
from axistwin.diagnose.linear import Rigid
from axistwin.diagnose.parallel import each
from axistwin.diagnose.replay import Replay, find_replay
from axistwin.diagnose.windows import coloured, median_spectrum
from axistwin.errors import InputError

#: Mean square of an error, in units of the noise, which a simulation of the effects could not bring
#: nearer.
_ALL = 1.003

#: Corner frequencies that are tried, up to a share of the highest frequency, and the lines of a
#: spectrum that the taper smears.
_CORNERS = 100
_CORNER_MAX = 0.5
_TAPER_WIDTH = 4


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
    def worth(self) -> float:
        """What tells its shape: held-out windows, too, where all of it may lie in one of them."""
        return self.gain + (self.total if self.found.kind.moment else 0.0)

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
            replayed = State(fit, self.motion).replayed(self.replay)
            if replayed.replay is not None:
                return replayed
        return State.along(fit, self.motion)

    def simulated(self) -> State:
        """With a simulation of the effects, where more is left than noise."""
        return self.replayed() if self.replay is None and self.scale > _ALL else self

    def replayed(self, near: Replay | None = None) -> State:
        """The same adjusted to a simulation of the effects, if that brings it nearer; ``near``
        there is another one, in the same windows or in parts of them. See find_replay()."""
        if self.fit.corner > 0.0:
            return self  # that is for the last digits above the noise
        replay = find_replay(self.fit, self.motion, near)
        if replay is None or self.fit.misfit(replay.residual) > self.fitted:
            return self
        return State(replay.fit, replay.motion, replay)

    def heard(self) -> State:
        """The same along its motion, weighted by the noise in its own errors."""
        return State(self.fit.hearing(self.simulation_error), self.motion)

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
        """Squared, of the windows (w,); infinite where something has run away."""
        errors = np.sum(self.residual**2, axis=1)
        finite: Array = np.where(np.isnan(errors), np.inf, errors)
        return finite

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
    def coloured(self) -> bool:
        """Do the errors of an encoder hold more than white noise in a part of their spectrum?"""
        noise = self.fit.noise
        pairs = () if noise is None else zip(self.simulation_error, noise, strict=True)
        return any(coloured(error, float(floor)) for error, floor in pairs)

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
        """What this state gains over another one by an effect; the noise that further initial
        states explain is no gain."""
        after = self.errors + (other.samples - self.samples)
        return Trial(found, other.errors, after, self.fit.windows.held_out)

    def excess(self, *, held_out: bool) -> float:
        """The error of the windows that are held out, or of the others, beyond noise."""
        errors = self.errors[self.fit.windows.held_out == held_out]
        return float(np.sum(errors - self.samples))

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


Item = TypeVar("Item")


def possible(fitted: Callable[[Item], State], items: Iterable[Item]) -> list[State]:
    """States fitted to each item, on all cores, but for those that no axis can have."""

    def run(item: Item) -> State | None:
        with contextlib.suppress(InputError):
            return fitted(item)
        return None

    return [state for state in each(run, items) if state is not None]
