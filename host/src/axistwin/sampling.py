"""Samples at any times put on an even grid, and what has to be said about that."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from axistwin.errors import InputError

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Times may be off the even grid by this share of a time step: rounding, no more.
UNEVEN_MAX = 1e-2

#: Time stamps that jitter are off by less than this many time steps: more is a gap, or a drift.
_JITTER_MAX = 20.0

#: Uneven samples are missing where they are more than so many usual steps apart.
_GAP = 2.5

#: An axis that moves at this share of its usual speed advances by what its speed says, times a
#: whole number but for this part of one; so many times that is not one where samples stumble.
_MOVING = 0.5
_PART_OF_STEP = 0.3
_STUMBLES_MIN = 5

#: It has to be so many counts of the encoder that it advances by; advances that differ by this
#: share of the largest angle are the same.
_COUNTS_MIN = 4.0
_ROUNDING = 1e-12

#: Where samples are so many time steps apart, at most, those in between are interpolated then;
#: where so many stumbles as above follow each other within so many samples, nobody knows when they
#: were.
_BRIDGED = 3
_STUMBLE_APART = 10


@dataclass(frozen=True)
class Sampling:
    """Even samples (n,): ``time`` [s] every ``time_step`` [s], and the ``channels`` by name.

    ``missing`` are the indices of those that were not there and have been interpolated.
    """

    time: Array
    time_step: float
    channels: dict[str, Array]
    missing: Indices
    warnings: tuple[str, ...]


def evenly(time: Array, channels: Mapping[str, Array], source: str) -> Sampling:
    """Samples (n,) at an increasing ``time`` [s] as even ones; ``theta1`` is one of the channels.

    Samples that lie on an even grid are put there. Samples that do not get a warning: where the
    motion shows that only their time stamps jitter they are kept as they are, else they are
    resampled by linear interpolation. Even time stamps are not believed where ``theta1`` repeats
    and jumps although ``omega1`` goes on. Raises InputError, naming the source, when something is
    no number, time does not increase, or more samples are missing than there are.
    """
    step = _usual_step(time, channels, source)
    grid = _even_grid(time, step)
    if grid is not None:
        advances = _advances(channels, *grid)
        if advances is not None:
            return _where_it_moves(time, channels, advances)
        return _on_grid(time[0], channels, *grid)
    jitter = _stamp_jitter(time, channels["theta1"])
    if jitter is not None:
        return _by_number(time, channels, jitter)
    return _resampled(time, channels, step)


def _usual_step(time: Array, channels: Mapping[str, Array], source: str) -> float:
    """The median distance of samples [s], once all is checked. Raises InputError."""
    for name, values in {"t": time, **channels}.items():
        if values.shape != time.shape or values.ndim != 1:
            raise InputError(f"{source}: {name} has shape {values.shape}, t {time.shape}")
        if not np.all(np.isfinite(values)):
            at = int(np.argmin(np.isfinite(values)))
            raise InputError(f"{source}: {name} is {values[at]} at sample {at}")
    if len(time) < 2:
        raise InputError(f"{source}: {len(time)} samples are no record")
    steps = np.diff(time)
    if np.any(steps <= 0.0):
        at = int(np.argmax(steps <= 0.0)) + 1
        raise InputError(
            f"{source}: time does not increase at sample {at} ({time[at]:g} s after "
            f"{time[at - 1]:g} s)"
        )
    # Half the samples have to be there: otherwise a wild time would ask for a huge grid.
    step = float(np.sort(steps)[(len(steps) - 1) // 2])
    if (time[-1] - time[0]) / step > 2 * len(time):
        at = int(np.argmax(steps))
        raise InputError(
            f"{source}: more samples are missing than there are (steps of {step:g} s, but "
            f"{steps[at]:g} s after sample {at})"
        )
    return step


def _even_grid(time: Array, step: float) -> tuple[float, Indices] | None:
    """Time step and places (n,) of samples on an even grid; None when they are on none."""
    places = np.concatenate([[0], np.cumsum(np.rint(np.diff(time) / step))]).astype(np.int64)
    if np.any(np.diff(places) == 0):
        return None
    fitted = float(time[-1] - time[0]) / float(places[-1])
    off = np.abs(time - time[0] - fitted * places)
    return (fitted, places) if np.max(off) <= UNEVEN_MAX * fitted else None


def _on_grid(begin: float, channels: Mapping[str, Array], step: float, places: Indices) -> Sampling:
    """What is there stays as it is: only what is missing is interpolated."""
    numbers = np.arange(places[-1] + 1)
    missing = np.setdiff1d(numbers, places)
    found = {name: np.interp(numbers, places, values) for name, values in channels.items()}
    for name, values in channels.items():
        found[name][places] = values
    return Sampling(begin + step * numbers, step, found, missing, _lacking(missing, numbers))


def _by_number(time: Array, channels: Mapping[str, Array], jitter: float) -> Sampling:
    """Samples that are even although their time stamps are not."""
    step = float(time[-1] - time[0]) / (len(time) - 1)
    warning = (
        f"{_uneven(time)}, but the motion is even: taken as every {step:.6g} s, the time stamps "
        f"are off by up to {jitter:.3g} s"
    )
    numbers = np.arange(len(time))
    return Sampling(
        time[0] + step * numbers, step, dict(channels), np.zeros(0, np.int64), (warning,)
    )


def _resampled(time: Array, channels: Mapping[str, Array], step: float) -> Sampling:
    """Samples interpolated every time step; where there were none for long they are missing."""
    grid = np.arange(time[0], time[-1], step)
    found = {name: np.interp(grid, time, values) for name, values in channels.items()}
    steps = np.diff(time)
    behind = np.searchsorted(time, grid, side="right") - 1
    missing = np.flatnonzero(steps[np.minimum(behind, len(steps) - 1)] > _GAP * step)
    ahead = np.minimum(behind + 1, len(time) - 1)
    off = np.minimum(grid - time[behind], np.abs(time[ahead] - grid))
    between = np.sum(off > UNEVEN_MAX * step)
    warning = (
        f"{_uneven(time)}: resampled every {step:.6g} s, {between} of {len(grid)} samples are "
        "interpolated"
    )
    return Sampling(grid, step, found, missing, (warning, *_lacking(missing, grid)))


def _uneven(time: Array) -> str:
    steps = np.diff(time)
    return f"the time base is uneven (steps of {steps.min():.6g} to {steps.max():.6g} s)"


def _lacking(missing: Indices, samples: npt.NDArray[Any]) -> tuple[str, ...]:
    """The warning that some are."""
    if len(missing) == 0:
        return ()
    return (f"{len(missing)} of {len(samples)} samples are missing",)


def _advances(channels: Mapping[str, Array], step: float, places: Indices) -> Indices | None:
    """Over how many time steps the motor went from each sample to the next (n - 1,), as its angle
    and its speed have it; None where they agree with the time stamps, or tell nothing."""
    if "omega1" not in channels or places[-1] != len(places) - 1:
        return None
    speed = 0.5 * (channels["omega1"][1:] + channels["omega1"][:-1])
    moving = np.abs(speed) > _MOVING * np.quantile(np.abs(speed), 0.9)
    if not np.any(moving):
        return None
    turned, wanted = np.diff(channels["theta1"]), step * speed[moving]
    times = turned[moving] / wanted
    whole = np.maximum(np.rint(times), 0.0)
    if np.max(np.abs(times - whole)) > _PART_OF_STEP or np.sum(whole != 1.0) < _STUMBLES_MIN:
        return None
    apart = np.diff(np.unique(turned))
    rounding = _ROUNDING * np.max(np.abs(channels["theta1"]))
    count = np.min(apart[apart > rounding], initial=np.inf)
    if np.min(np.abs(wanted)) < _COUNTS_MIN * count:  # by one count, it is at times by none or two
        return None
    advances = np.ones(len(speed), np.int64)
    advances[moving] = whole
    return advances


def _where_it_moves(time: Array, channels: Mapping[str, Array], advances: Indices) -> Sampling:
    """Samples at the steps of an even ``time`` that they advance by: without repeats, and where few
    in a row are lost interpolated. Where they stumble again and again there is none."""
    at = np.flatnonzero(advances != 1)
    runs = np.split(at, np.flatnonzero(np.diff(at) > _STUMBLE_APART) + 1)
    fresh = np.concatenate([[True], advances > 0])
    for run in runs:
        if len(run) >= _STUMBLES_MIN:
            fresh[run[0] + 1 : run[-1] + 1] = False
    places = np.concatenate([[0], np.cumsum(advances)])[fresh]
    lost = np.setdiff1d(np.arange(places[-1]), places)
    around = np.searchsorted(places, lost)
    bridged = places[around] - places[around - 1] <= _BRIDGED
    filled = np.union1d(places, lost[bridged])
    found = {name: np.interp(filled, places, values[fresh]) for name, values in channels.items()}
    step = float(time[-1] - time[0]) / (len(time) - 1)
    sampling = _on_grid(time[0], found, step, filled)
    warning = (
        "theta1 has spikes of the sampling, where omega1 goes on: "
        f"{np.sum(advances == 0)} samples are repeats and "
        f"{np.sum(np.maximum(advances - 1, 0))} are lost; put where the motion has them, log every "
        "sample once, with its own time"
    )
    return replace(sampling, warnings=(warning, *sampling.warnings))


def _stamp_jitter(time: Array, angle: Array) -> float | None:
    """How far time stamps are off even samples [s]; None when the samples themselves are uneven.

    An arrival time jitters while the samples are even, and late ones come in bursts. Where
    neighbouring steps differ, an angle lies between its neighbours by number if so, else by time.
    """
    step = float(time[-1] - time[0]) / (len(time) - 1)
    off = float(np.max(np.abs(time - time[0] - step * np.arange(len(time)))))
    before, after = np.diff(time)[:-1], np.diff(time)[1:]
    differ = np.abs(before - after) > UNEVEN_MAX * (before + after)
    first, middle, last = angle[:-2][differ], angle[1:-1][differ], angle[2:][differ]
    before, after = before[differ], after[differ]
    by_time = np.abs(middle - (after * first + before * last) / (before + after))
    by_number = np.abs(middle - 0.5 * (first + last))
    even = float(np.sum(by_number)) < float(np.sum(by_time)) and off < _JITTER_MAX * step
    return off if even else None
