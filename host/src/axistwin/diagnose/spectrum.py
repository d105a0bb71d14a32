"""Where something periodic hides: the periods that would reduce a simulation error most.

The simulation error is first turned into a torque by the axis run backwards: the inner product of
that `score` with any torque is the inner product of the error with what the torque would move. One
Fourier transform over an angle (or over time) then tries all periods at once.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import scipy.signal

from axistwin.core import Array

#: Points of the transform for each period of the fastest wave.
_POINTS = 8
_POINTS_MAX = 2**22

#: How finely the peaks are found: the transform is this many times longer than the data.
_PADDING = 4


def peaks(
    argument: Array,
    scores: Array,
    lowest: float,
    highest: float,
    strength: Callable[[Array], Array],
    count: int,
    whole: bool,
) -> list[float]:
    """The ``count`` best numbers of periods, best first.

    ``argument`` (w, l) [rad] is what the wave is periodic in, ``scores`` (w, l) what a torque is
    worth there. ``lowest`` to ``highest`` number of periods are looked at; with ``whole`` only
    whole numbers are. ``strength`` tells for numbers of periods (p,) what a wave of size 1 moves,
    squared.
    """
    start, end = float(np.min(argument)), float(np.max(argument))
    reach = end - start
    if reach <= 0.0:
        return []
    points = int(
        min(_POINTS_MAX, 2 ** np.ceil(np.log2(_POINTS * highest * reach / (2.0 * np.pi) + 8)))
    )
    at, share = np.divmod((argument - start).ravel() * ((points - 2) / reach), 1.0)
    lower = at.astype(np.int64)
    binned = np.bincount(lower, scores.ravel() * (1.0 - share), points)
    binned += np.bincount(lower + 1, scores.ravel() * share, points)
    length = min(_PADDING * points, _POINTS_MAX)
    spectrum = np.abs(np.fft.rfft(binned, length)) ** 2
    periods = np.arange(len(spectrum)) * (2.0 * np.pi * (points - 2) / (reach * length))
    apart = 2.0 * np.pi / reach
    lowest = max(lowest, apart)
    if whole:
        wanted = np.arange(np.ceil(lowest), np.floor(min(highest, periods[-1])) + 1.0)
        found = np.interp(wanted, periods, spectrum)
    else:
        inside = (periods >= lowest) & (periods <= highest)
        wanted, found = periods[inside], spectrum[inside]
    if len(wanted) == 0:
        return []
    return _highest(wanted, found / np.maximum(strength(wanted), 1e-300), apart, count)


def lines(errors: Array, time_step: float, index: npt.NDArray[np.int64], count: int) -> list[float]:
    """The ``count`` strongest lines [rad/s] in errors (c, w, l) of the samples ``index`` (w, l).

    A linear axis answers a periodic torque at its own frequency. Each window is tapered, so that
    slow errors do not spread.
    """
    length = errors.shape[2]
    first = int(index[0, 0])
    spread = np.zeros((len(errors), int(index[-1, -1]) - first + 1))
    spread[:, index - first] = errors * scipy.signal.windows.hann(length)
    points = 2 ** int(np.ceil(np.log2(spread.shape[1])) + 1)
    power = np.sum(np.abs(np.fft.rfft(spread, points, axis=1)) ** 2, axis=0)
    frequencies = np.arange(len(power)) * (2.0 * np.pi / (points * time_step))
    inside = (frequencies > 2.0 * np.pi / (length * time_step)) & (
        frequencies < 0.9 * np.pi / time_step
    )
    apart = 4.0 * np.pi / (length * time_step)
    return _highest(frequencies[inside], power[inside], apart, count)


def _highest(places: Array, values: Array, apart: float, count: int) -> list[float]:
    """The places of the highest values that are some way apart."""
    best: list[float] = []
    for i in np.argsort(values)[::-1]:
        if all(abs(places[i] - other) > 1.5 * apart for other in best):
            best.append(float(places[i]))
        if len(best) == count:
            break
    return best
