"""Clouds, curves through them, and spectra, drawn into the axes of a panel."""

from __future__ import annotations

import itertools

import numpy as np
import numpy.typing as npt
import scipy.signal
from matplotlib.axes import Axes
from matplotlib.ticker import NullFormatter, StrMethodFormatter

from axistwin.core import Array
from axistwin.diagnose.panels import COLOURS

#: Points in a cloud, bins for means and for a curve through it.
_POINTS, _MEANS, _CURVE = 5000, 24, 160

#: A bin has this many samples at least, or no mean.
_BIN_MIN = 12

#: The scale shows all but this share of the points at either end, which may be far away.
_OUTLIERS = 0.002

#: Samples in a piece of which a spectrum is taken, at most.
_PIECE = 2048

#: Values that span less than this factor need no logarithmic scale.
_SPAN = 20.0

_PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"))


def scale(values: Array, unit: str) -> tuple[float, str]:
    """Factor and unit with the prefix in which the largest value is 1 or more."""
    largest = float(np.quantile(np.abs(values), 1.0 - _OUTLIERS))
    for factor, prefix in _PREFIXES:
        if factor * largest >= 1.0:
            return factor, prefix + unit
    return 1.0, unit


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def legend(axes: Axes, columns: int) -> None:
    """A legend above the curves, for which room is made."""
    low, high = axes.get_ylim()
    if axes.get_yscale() == "log":
        axes.set_ylim(low, high * (high / low) ** 0.25)
    else:
        axes.set_ylim(low, high + 0.2 * (high - low))
    axes.legend(loc="upper right", ncols=columns)


def logarithmic(axes: Axes) -> None:
    """A logarithmic scale upwards where values span it, with plain numbers; else one from zero."""
    data = axes.dataLim
    if data.minposy * _SPAN > data.y1:
        axes.set_ylim(0.0, 1.05 * data.y1)
        return
    axes.set_yscale("log")
    axes.yaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.yaxis.set_minor_formatter(NullFormatter())


def cloud(axes: Axes, x: Array, y: Array, colour: str) -> None:
    """Points (n,), thinned out evenly, as a picture."""
    step = max(1, len(x) // _POINTS)
    axes.plot(x[::step], y[::step], ".", ms=2.0, mew=0.0, color=colour, alpha=0.65, rasterized=True)


def limits(*clouds: Array) -> tuple[float, float]:
    """A scale that shows points (n,) without the few that are far away."""
    ends = [np.quantile(values, (_OUTLIERS, 1.0 - _OUTLIERS)) for values in clouds]
    low, high = float(np.min(ends)), float(np.max(ends))
    room = 0.08 * (high - low) or 1.0
    return low - room, high + room


def means(axes: Axes, x: Array, y: Array) -> None:
    """Means of a cloud (n,) in bins, with twice their standard errors.

    Neighbouring samples are not independent: an error counts as many of them as are, by the
    correlation between neighbours of what is left about the means.
    """
    bins = _bins(x, _MEANS)
    mean = np.array([float(np.mean(y[chosen])) for chosen in bins])
    rest = y.copy()
    for chosen, middle in zip(bins, mean, strict=True):
        rest[chosen] -= middle
    alike = _alike(rest)
    spread = np.array([float(np.std(y[chosen])) / np.sqrt(len(chosen)) for chosen in bins])
    at = np.array([float(np.mean(x[chosen])) for chosen in bins])
    points(axes, at, mean, 2.0 * np.sqrt(alike) * spread)


def points(axes: Axes, x: Array, y: Array, error: Array) -> None:
    """Points with bars of ``error`` to either side."""
    axes.errorbar(x, y, error, fmt="o", ms=3.2, lw=1.0, capsize=0, color=COLOURS["ink"], zorder=3.0)


def curve(axes: Axes, x: Array, y: Array) -> None:
    """What an effect adds: the mean of its values (n,), which the other motion spreads little."""
    bins = _bins(x, _CURVE)
    axes.plot(
        [float(np.mean(x[chosen])) for chosen in bins],
        [float(np.mean(y[chosen])) for chosen in bins],
        color=COLOURS["curve"],
        lw=2.0,
        zorder=4.0,
    )


def spectrum(time: Array, values: Array) -> tuple[Array, Array]:
    """Frequency [Hz] and amplitude spectral density [1/sqrt(Hz)] of samples (n,) with gaps.

    Welch's method in the pieces between gaps, averaged.
    """
    step = float(np.median(np.diff(time)))
    gaps = np.flatnonzero(np.diff(time) > 1.5 * step) + 1
    pieces = np.split(values, gaps)
    length = min(_PIECE, max(len(piece) for piece in pieces))
    found = [
        scipy.signal.welch(piece, 1.0 / step, nperseg=length)
        for piece in pieces
        if len(piece) >= length
    ]
    density = np.sqrt(np.mean([power for _, power in found], axis=0))
    return found[0][0][1:], density[1:]


def _bins(x: Array, count: int) -> list[npt.NDArray[np.int64]]:
    """Indices of the samples in bins of equal width, of those that have enough."""
    low, high = limits(x)
    place = np.floor((x - low) / (high - low) * count)
    order = np.argsort(place, kind="stable")
    ends = np.searchsorted(place[order], np.arange(count + 1))
    bins = [order[first:end] for first, end in itertools.pairwise(ends)]
    return [chosen for chosen in bins if len(chosen) >= _BIN_MIN]


def _alike(values: Array) -> float:
    """How many neighbours say the same, by the correlation of the first lag."""
    centred = values - values.mean()
    power = float(centred @ centred)
    if power == 0.0:
        return 1.0
    lag1 = min(max(float(centred[1:] @ centred[:-1]) / power, 0.0), 0.98)
    return (1.0 + lag1) / (1.0 - lag1)
