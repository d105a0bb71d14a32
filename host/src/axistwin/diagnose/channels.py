"""What can be wrong with a channel by itself: coarse, clipped, repeated or disturbed samples."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from axistwin.core import Array
from axistwin.sampling import Indices

_Mask = npt.NDArray[np.bool_]

#: Differences that a quantisation step is found from: at most, and at least.
_DIFFERENCES_MAX = 100_000
_DIFFERENCES_MIN = 100

#: Bins of their histogram, and the bins that a step has to be wide to show.
_BINS = 4096
_BINS_A_STEP = 8

#: How well they have to fit, and those of all sizes with the step refined.
_FIT_MIN = 0.9
_FIT_ALL_MIN = 0.7

#: Multiples that have to occur, this often; or how exact (rms, in steps) one and zero have to be.
_MULTIPLES_MIN = 4
_MULTIPLE_SHARE_MIN = 0.01
_EXACT = 1e-3

#: Steps that are this small against the values are those of the numbers in the machine.
_ROUNDING = 1e-12

#: Samples that a channel may dwell at its end without being clipped, and times a torque has to.
_DWELL_MIN = 3
_DWELLS_MIN = 3

#: Samples that an angle stands still for when it is cut off, and its speed before as a share of the
#: usual one.
_STILL_MIN = 10
_AT_SPEED = 0.3

#: What stands at its end for more of the time stands still; what is in between its ends for less of
#: it is a square wave; what stays where it is in between, too, for more of that time has levels.
_DWELL_SHARE_MAX = 0.5
_BETWEEN_SHARE_MIN = 0.1
_LEVELS_SHARE_MAX = 0.2

#: The signal would have gone on by this many quantisation steps had it not been clipped.
_BEYOND = 6.0

#: An outlier is this many times further off its neighbours than these usually are from each other,
#: and that large against the whole signal; how many make a warning, and at what share of all they
#: are no outliers but the signal.
_OUTLIER = 2.5
_OUTLIER_SIZE = 0.5
_OUTLIERS_MIN = 3
_OUTLIER_SHARE_MAX = 0.03

#: Samples that say what is usual.
_BLOCK = 64

#: Repeats that make a warning: in number, and as a share of all samples; and the share of those
#: of an encoder that is read too often.
_REPEATS_MIN = 5
_REPEAT_SHARE_MIN = 2e-4
_HELD_SHARE = 0.2

#: A repeated sample shows against steps of this many counts on either side.
_CLEAR_STEP = 6.0


def resolution(values: Array) -> float | None:
    """The quantisation step of values (n,), in their unit; None when they are not quantised.

    Values of an encoder differ by whole counts. The mean of exp(2 pi i d / step) is 1 when all
    differences d are multiples of the step, and almost 1 when a file printed them with a few digits
    less; a Fourier transform of their histogram shows it for all steps at once. The coarsest one is
    the answer.
    """
    steps = np.abs(np.diff(values))
    smallest = _ROUNDING * float(np.max(np.abs(values)))
    differences = steps[steps > smallest]
    repeats = len(differences) < len(steps)
    differences = np.sort(differences[:: len(differences) // _DIFFERENCES_MAX + 1])
    reach = float(differences[-1]) if len(differences) > 0 else 0.0
    while reach > _BINS_A_STEP * smallest:
        within = differences[: np.searchsorted(differences, reach, side="right")]
        if len(within) < _DIFFERENCES_MIN:
            return None
        step = _common_step(within, reach)
        if step is not None and _many_multiples(within / step, repeats):
            step = _refined(step, differences)
            if np.mean(np.cos(2.0 * np.pi / step * differences)) > _FIT_ALL_MIN:
                return step
        reach *= 0.25
    return None


def _common_step(differences: Array, reach: float) -> float | None:
    """The coarsest step that differences (k,) up to ``reach`` are multiples of."""
    histogram = np.histogram(differences, _BINS, (0.0, reach))[0]
    padded = 4 * _BINS
    # each bin stands for its middle
    turned = np.exp(-1j * np.pi * np.arange(padded // 2 + 1) / padded)
    fit = (np.fft.rfft(histogram, padded) * turned).real / len(differences)
    fit = fit[: padded // _BINS_A_STEP]
    apart = np.flatnonzero(fit < 0.5 * _FIT_MIN)
    if len(apart) == 0:
        return None
    beyond = fit[apart[0] :]
    good = np.flatnonzero(beyond > _FIT_MIN)
    if len(good) == 0:
        return None
    top = int(good[0] + np.argmax(beyond[good[0] : good[0] + 4]))
    return 4.0 * reach / float(apart[0] + top)


def _many_multiples(differences: Array, repeats: bool) -> bool:
    """Are differences (k,), in steps, multiples of it and not of one speed with its noise?"""
    multiples, counts = np.unique(np.rint(differences), return_counts=True)
    if np.sum(counts > _MULTIPLE_SHARE_MIN * len(differences)) >= _MULTIPLES_MIN:
        return True
    off = float(np.sqrt(np.mean((differences - np.rint(differences)) ** 2)))
    return off < _EXACT and len(multiples) + repeats > 1


def _refined(step: float, differences: Array) -> float:
    """The same step from ever more counts at once: the error of one is divided by their number."""
    reach = 4.0 * step
    while True:
        within = differences[differences < reach]
        times = np.rint(within / step)
        if np.any(times > 0.0):
            step = float(within @ times / (times @ times))
        if reach > differences[-1]:
            return step
        reach *= 2.0


@dataclass(frozen=True)
class Dwell:
    """A channel that is cut off at ``level``: ``times`` often, for a ``share`` of its samples."""

    level: float
    times: int
    share: float


def clipped(values: Array, step: float | None, *, smooth: bool) -> Dwell | None:
    """Where values (n,) are cut off at their largest or smallest, None when they are not.

    A signal that is cut off comes to its end at speed, stays there and leaves at speed. What slows
    down is no more than quantised; what is there most of the time, or on other levels too, switches
    between levels. A ``smooth`` channel, an angle, does not stop within a sample.
    """
    found = [_dwell(values, step or 0.0, smooth), _dwell(-values, step or 0.0, smooth)]
    if found[1] is not None:
        found[1] = Dwell(-found[1].level, found[1].times, found[1].share)
    both = [dwell for dwell in found if dwell is not None]
    return max(both, key=lambda dwell: dwell.share, default=None)


def _dwell(values: Array, step: float, smooth: bool) -> Dwell | None:
    top = float(np.max(values))
    at_top = values >= top - 0.5 * step
    starts, ends = _runs(at_top)
    long = (ends - starts >= _DWELL_MIN) & (starts > 1)
    starts, ends = starts[long], ends[long]
    share = float(np.mean(at_top))
    between = ~at_top[1:] & (values[1:] > np.min(values) + 0.5 * step)
    if len(starts) == 0 or share > _DWELL_SHARE_MAX or np.mean(between) < _BETWEEN_SHARE_MIN:
        return None
    cut = _stops_dead if smooth else _cut_off
    return Dwell(top, len(starts), share) if cut(values, step, starts, ends, between) else None


def _stops_dead(values: Array, step: float, starts: Indices, ends: Indices, between: _Mask) -> bool:
    """Does an angle arrive at speed, and then stay?"""
    speed = float(np.median(np.abs(np.diff(values)[between])))
    arrival = (values[starts - 1] - values[starts - 2])[ends - starts >= _STILL_MIN]
    return len(arrival) > 0 and bool(np.median(arrival) > _AT_SPEED * speed + 2.0 * step)


def _cut_off(values: Array, step: float, starts: Indices, ends: Indices, between: _Mask) -> bool:
    """Would a torque have gone on, and does it have no other levels?"""
    inside = ends < len(values)
    starts, ends = starts[inside], ends[inside]
    if len(starts) < _DWELLS_MIN or np.mean(np.diff(values)[between] == 0.0) > _LEVELS_SHARE_MAX:
        return False
    lengths = ends - starts
    before = values[np.maximum(starts - lengths, 0)]
    after = values[np.minimum(ends - 1 + lengths, len(values) - 1)]
    # a parabola that leaves the level as steeply as it came, over the time of the dwell
    beyond = 0.125 * (2.0 * values[starts] - before - after)
    return bool(np.median(beyond) > _BEYOND * step)


def repeated(values: Array, step: float | None) -> tuple[int, float]:
    """How often an angle (n,) stands still between clear steps, and for what share of the samples.

    A sample that was read twice, or an encoder that is read more often than it is sampled. Zero
    when steps of one or two counts are as frequent as steps of none: noise does that. A few samples
    in a row may be friction that sticks, they count when they are everywhere.
    """
    steps = np.diff(values)
    count = step or 0.0
    still = _between_clear_steps(steps, steps == 0.0, count)
    small = (steps != 0.0) & (np.abs(steps) < 0.5 * _CLEAR_STEP * count)
    by_noise = _between_clear_steps(steps, small, count)
    if np.sum(still) < _HELD_SHARE * len(values):
        still = still[still == 1]
    times, share = len(still), float(np.sum(still)) / len(values)
    if times < _REPEATS_MIN or share < _REPEAT_SHARE_MIN or times <= len(by_noise):
        return 0, 0.0
    return times, share


def _between_clear_steps(steps: Array, mask: _Mask, count: float) -> Indices:
    """Lengths of the runs in a mask (n,) with a clear step the same way on either side."""
    starts, ends = _runs(mask)
    near = (starts >= 1) & (ends < len(steps)) & (ends - starts <= _BLOCK)
    starts, ends = starts[near], ends[near]
    before, after = steps[starts - 1], steps[ends]
    clear = np.minimum(np.abs(before), np.abs(after)) > _CLEAR_STEP * count
    return (ends - starts)[clear & (before * after > 0.0)]


@dataclass(frozen=True)
class Outliers:
    """Samples that stand alone: indices ``at`` (k,), and the ``largest`` by its size."""

    at: Indices
    largest: float


def outliers(values: Array, step: float | None) -> Outliers | None:
    """Samples of values (n,) that stick out from their neighbours by far more than is usual there.

    The two samples on either side say where it should be; edges and levels do not stick out. None
    when there are hardly any, or so many that they are what the signal is.
    """
    if len(values) < 3 * _BLOCK:
        return None
    around = np.stack([values[:-4], values[1:-3], values[3:-1], values[4:]])
    low, high = np.min(around, axis=0), np.max(around, axis=0)
    inner = values[2:-2]
    off = np.maximum(np.maximum(inner - high, low - inner), 0.0)
    blocks = len(off) // _BLOCK
    usual = np.median((high - low)[: blocks * _BLOCK].reshape(blocks, _BLOCK), axis=1)
    # what is usual in a block or in one beside it, whichever is more
    padded = np.pad(usual, 1, mode="edge")
    usual = np.max([padded[:-2], usual, padded[2:], np.full(blocks, np.median(usual))], axis=0)
    limit = np.pad(np.repeat(_OUTLIER * usual, _BLOCK), (0, len(off) - blocks * _BLOCK), "edge")
    limit = np.maximum(limit, _OUTLIER_SIZE * float(np.sqrt(np.mean(values**2))))
    found = np.flatnonzero(off > limit + _CLEAR_STEP * (step or 0.0))
    if not _OUTLIERS_MIN <= len(found) <= _OUTLIER_SHARE_MAX * len(values):
        return None
    return Outliers(found + 2, float(np.max(off[found])))


def _runs(mask: _Mask) -> tuple[Indices, Indices]:
    """First index and end of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return edges[::2], edges[1::2]
