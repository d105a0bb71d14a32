"""The time base of a stream: its sample counter, told apart from whatever else came along.

The counter has 16 bits and is all that is trusted; the time of arrival says how often it has gone
round unseen, which frames cannot belong to it, and how fast the node's clock runs. Frames may be
late by any time, some of them, but never early: what decides is the lower envelope of the delays.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]
Flags = npt.NDArray[np.bool_]

#: The counter wraps around here.
WRAP = 1 << 16

# Two ways to count agree when they put a sample at the same time, give or take this [s] or this
# share of the counter's turn, whichever is less; on top the share of the time between, for clocks.
_AGREE = 0.25
_AGREE_TURN = 0.125
_AGREE_CLOCKS = 500e-6

# Frames of one node do not overtake each other by more samples than this.
_OVERTAKEN_MAX = 64

# The delays of so many frames are looked at for one that was not late: seconds of a full bus.
_WINDOW = 1 << 15

# Host time a sample is measured over so many frames; a node that is off by more than the share does
# not run in real time (an emulator that was told to run as fast as it can).
_PACE_FRAMES = 64
_PACE_BLOCKS = 8
_REAL_TIME = 0.1

# So many ways to count are kept in mind; of more the ones with the fewest frames are given up.
_OPEN_MAX = 8

# With more contradictions than one in so many frames there is no counting to be found.
_CONTRADICTED_MAX = 4

# Clock fit: blocks whose promptest frame is taken, and how far off a block may be, in sigmas.
_BLOCKS = 200
_BLOCK_FRAMES = 16
_OUTLIER = 3.0


def counted(counter: Indices) -> Indices:
    """Steps (n - 1,) of a 16-bit counter (n,) from one frame to the next, the short way round."""
    return (np.diff(counter) + WRAP // 2) % WRAP - WRAP // 2


@dataclass(frozen=True)
class Counting:
    """Which of n frames were counted together, and how: ``part`` (n,), ``count`` (n,) in it.

    ``count`` is the counter without its wrap. Parts are numbered in the order of their first frame.
    ``contradictory``: there are so many contradictions that this is not the work of one node.
    """

    part: Indices
    count: Indices
    contradictory: bool = False


def follow(time: Array, counter: Indices, period: float, cuts: Flags) -> Counting:
    """Finds out what has been counted together.

    ``time`` (n,) of arrival [s], ``counter`` (n,) modulo 2^16, ``period`` of the counter [s] by the
    node's clock, ``cuts`` (n - 1,): the counter is known to start afresh there. Frames whose
    counter does not fit the time of their arrival are in parts of their own. Cost: O(n).
    """
    part, count = np.zeros(len(time), np.int64), np.zeros(len(time), np.int64)
    edges = [0, *(np.flatnonzero(cuts) + 1).tolist(), len(time)]
    parts, contradictory = 0, False
    for begin, end in itertools.pairwise(edges):
        one = slice(begin, end)
        found = _follow(time[one], counter[one], period)
        part[one], count[one] = found.part + parts, found.count
        parts += 1 + int(found.part.max(initial=-1))
        contradictory |= found.contradictory
    return Counting(part, count, contradictory)


def _follow(time: Array, counter: Indices, period: float) -> Counting:
    step = counted(counter)
    count = np.concatenate([counter[:1], counter[:1] + np.cumsum(step)])
    period = _pace(time, count, period)
    agree = min(_AGREE, _AGREE_TURN * WRAP * period)
    late = np.diff(time) - period * step
    # Where the counter goes straight on the host was busy: it would not, had it started afresh.
    straight = (step >= 0) & (step <= _OVERTAKEN_MAX) & (late > 0.0)
    straight &= late < 0.5 * WRAP * period
    jumps = np.flatnonzero((np.abs(late) > agree) & ~straight) + 1
    if len(jumps) == 0:
        return Counting(np.zeros(len(time), np.int64), count)
    if len(jumps) > len(time) // _CONTRADICTED_MAX + 1:
        return Counting(np.zeros(len(time), np.int64), count, contradictory=True)
    return _link(time, count, period, agree, jumps)


def _link(time: Array, count: Indices, period: float, agree: float, jumps: Indices) -> Counting:
    """Links pieces between jumps to parts: a piece goes on where its counts fit in time."""
    origin = time - period * count  # when the count was 0, and the delay
    part, unwrapped = np.zeros(len(time), np.int64), count.copy()
    edges = [0, *jumps.tolist(), len(time)]
    open_parts: list[_Open] = []
    parts = 0
    for begin, end in itertools.pairwise(edges):
        at = float(np.min(origin[begin : begin + _WINDOW][: end - begin]))
        chosen, turns = None, 0
        for candidate in open_parts:
            turns = round((at - candidate.origin) / (period * WRAP))
            off = abs(at - turns * period * WRAP - candidate.origin)
            passed = float(time[begin]) - candidate.time
            ahead = int(count[begin]) + turns * WRAP - candidate.count
            if off <= agree + _AGREE_CLOCKS * passed and ahead >= -_OVERTAKEN_MAX:
                chosen = candidate
                break
        if chosen is None:
            if len(open_parts) == _OPEN_MAX:
                open_parts.remove(min(open_parts, key=lambda part: part.frames))
            chosen, turns = _Open(parts), 0
            open_parts.append(chosen)
            parts += 1
        part[begin:end] = chosen.number
        unwrapped[begin:end] += turns * WRAP
        latest = float(np.min(origin[max(begin, end - _WINDOW) : end]))
        chosen.origin = latest - turns * period * WRAP
        chosen.time, chosen.count = float(time[end - 1]), int(unwrapped[end - 1])
        chosen.frames += end - begin
        open_parts.sort(key=lambda part: part.time, reverse=True)
    return Counting(part, unwrapped)


@dataclass
class _Open:
    """A part that may go on: when its count was 0 [s], its last frame, and how many it has."""

    number: int
    origin: float = 0.0
    time: float = 0.0
    count: int = 0
    frames: int = 0


def _pace(time: Array, count: Indices, period: float) -> float:
    """Host time between two counts: the node's own period unless it does not run in real time."""
    counts = count[_PACE_FRAMES::_PACE_FRAMES] - count[:-_PACE_FRAMES:_PACE_FRAMES]
    times = time[_PACE_FRAMES::_PACE_FRAMES] - time[:-_PACE_FRAMES:_PACE_FRAMES]
    on = (counts > 0) & (times > 0.0)
    if np.count_nonzero(on) < _PACE_BLOCKS:
        return period
    measured = float(np.median(times[on] / counts[on]))
    return measured if abs(measured / period - 1.0) > _REAL_TIME else period


@dataclass(frozen=True)
class Clock:
    """The node's clock by the host's: the first count at ``start`` [s], one every ``period`` [s].

    ``drift`` is the share by which ``period`` is longer than the node says, ``error`` its standard
    error.
    """

    start: float
    period: float
    drift: float
    error: float

    @property
    def significant(self) -> bool:
        """Is the drift more than chance, and than the time stamps' own 20 ppm?"""
        return abs(self.drift) > max(5.0 * self.error, 20e-6)


def fit_clock(time: Array, count: Indices, period: float) -> Clock | None:
    """Fits the node's clock to times of arrival (n,) [s] of counts (n,) that it sent.

    The promptest frame of each of many blocks counts, and of these the median of all slopes
    (Theil-Sen) says which blocks were late as a whole; a line is fitted to the rest. None where
    frames are too few, or the node does not run in real time.
    """
    count = count - count[0]
    delay = time - time[0] - period * count
    blocks = min(_BLOCKS, len(time) // _BLOCK_FRAMES)
    if blocks < _PACE_BLOCKS:
        return None
    order = np.argsort(count, kind="stable")
    edges = np.linspace(0, len(time), blocks, endpoint=False).astype(np.int64)
    prompt = np.array([block[np.argmin(delay[block])] for block in np.split(order, edges[1:])])
    x, y = count[prompt].astype(np.float64), delay[prompt]
    i, j = np.triu_indices(blocks, 1)
    apart = x[j] != x[i]
    if not np.any(apart):
        return None
    slope = float(np.median((y[j] - y[i])[apart] / (x[j] - x[i])[apart]))
    off = y - slope * x
    off -= np.median(off)
    sigma = 1.4826 * float(np.median(np.abs(off)))
    kept = np.abs(off) <= _OUTLIER * sigma
    if np.count_nonzero(kept) < 3 or np.ptp(x[kept]) == 0.0:
        kept = np.ones(blocks, bool)
    centre = float(np.mean(x[kept]))
    spread = float(np.sum((x[kept] - centre) ** 2))
    level = float(np.mean(y[kept]))
    slope = float(np.sum((x[kept] - centre) * y[kept])) / spread
    rest = y[kept] - level - slope * (x[kept] - centre)
    error = float(np.sqrt(np.sum(rest**2) / max(1, len(rest) - 2) / spread))
    if abs(slope) > _REAL_TIME * period:
        return None
    start = float(time[0]) + level - slope * centre
    return Clock(start, period + slope, slope / period, error / period)
