"""A record cut into windows, and the noise of its encoders.

A simulation drifts away from an axis in the end, because its angle is the torque integrated twice.
So everything is compared in windows, each with an initial state of its own. Every third window is
held out: no parameter is fitted to it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
import scipy.signal

from axistwin.core import Array
from axistwin.diagnose.channels import resolution
from axistwin.errors import NotEnoughDataError
from axistwin.record import Record

#: A window is this long unless given [s]; a rigid axis, which only drifts, is looked at for half.
WINDOW = 0.5

#: Windows there have to be at least, and samples in each.
WINDOWS_MIN = 9
LENGTH_MIN = 24

#: Stretches of windows in a part of them, at least.
_STRETCHES_MIN = 6

#: The golden section.
_GOLDEN = 0.5 * (np.sqrt(5.0) - 1.0)

#: Samples that are looked at, spread over the record: more make no answer better.
SAMPLES_MAX = 400_000

#: Every so many windows one is held out.
FOLD = 3

#: The upper part of the frequency range, where a simulation error is noise of the encoders.
_NOISE_BAND = 0.7

#: Lines of a spectrum that the taper smears the lowest ones over, and lines that are as one then.
_TAPER_WIDTH = 4
_TAPER_LINES = 2.0

#: Parts of a spectrum that are looked at, each up to a certain factor above the last; the excess
#: that is beyond chance, and that which the floor may be wrong by.
_BANDS = 12
_SURE = 5.0
_FLOOR_SPREAD = 0.03

#: Of an exponential distribution with mean 1, which a line of a spectrum has.
_MEDIAN = np.log(2.0)


@dataclass(frozen=True)
class Windows:
    """``index`` (w, l): the samples of each window. Channels are cut to (w, l) by cut().

    ``time`` (w, l) [s] from the first sample of the record, ``angles`` (c, w, l) as measured [rad],
    ``torque`` (n,) of the whole record [N m], ``held_out`` (w,). A ``linear`` axis reads m, N.
    ``steps`` (c) [rad]: of encoders that are seen to round, else None.
    """

    index: npt.NDArray[np.int64]
    time_step: float
    angles: Array
    torque: Array
    held_out: npt.NDArray[np.bool_]
    linear: bool
    steps: tuple[float | None, ...]

    @property
    def count(self) -> int:
        """Number of windows."""
        return len(self.index)

    @property
    def length(self) -> int:
        """Samples in a window."""
        return int(self.index.shape[1])

    @property
    def channels(self) -> int:
        """Number of encoders."""
        return len(self.angles)

    @property
    def time(self) -> Array:
        """Since the first sample of the record [s], (w, l)."""
        time: Array = self.time_step * self.index.astype(np.float64)
        return time

    def cut(self, values: Array) -> Array:
        """Values (n,) of a channel in windows (w, l)."""
        cut: Array = values[self.index]
        return cut

    def unseen(self, moment: float) -> tuple[float, float]:
        """From which time to which [s] the windows see as little as at a moment: a gap between two
        of them, or the moment alone."""
        time = self.time.ravel()
        k = int(np.clip(np.searchsorted(time, moment), 1, len(time) - 1))
        gap = float(time[k - 1]), float(time[k])
        return gap if gap[1] - gap[0] > 1.5 * self.time_step else (moment, moment)

    def part(self, samples: int) -> Windows:
        """Windows with about so many samples, in stretches that are spread over the record; all
        where those are not even twice as many.

        Each stretch has its place by the golden section: were they in step, one wave would look
        like another. What is held out stays so.
        """
        stretches = self.count // FOLD
        wanted = max(_STRETCHES_MIN, samples // (FOLD * self.length))
        if stretches < 2 * wanted:
            return self
        ends = np.arange(wanted + 1) * stretches // wanted
        places = np.arange(wanted) * _GOLDEN % 1.0
        firsts = FOLD * (ends[:-1] + (places * np.diff(ends)).astype(np.int64))
        chosen = (firsts[:, None] + np.arange(FOLD)).ravel()
        return replace(
            self,
            index=self.index[chosen],
            angles=self.angles[:, chosen],
            held_out=self.held_out[chosen],
        )

    def recut(self, length: int) -> Windows:
        """The same samples in windows of another length: so many parts of each, or so many of them
        in a row, which lie side by side if they are parts of one."""
        index = self.index.reshape(-1, length)
        return replace(
            self,
            index=index,
            angles=self.angles.reshape(self.channels, -1, length),
            held_out=_held_out(len(index)),
        )


def cut(record: Record, window: float | None = None) -> Windows:
    """Windows of about ``window`` [s] in the unbroken parts of a record.

    Raises NotEnoughDataError when there are too few.
    """
    if window is None:
        window = 0.5 * WINDOW if record.theta2 is None else WINDOW
    bounds = np.concatenate([[-1], record.missing, [len(record)]])
    longest = int(np.max(np.diff(bounds))) - 1
    length = min(round(window / record.time_step), longest // WINDOWS_MIN)
    length = max(length, LENGTH_MIN)
    starts = [
        start
        for first, end in zip(bounds[:-1] + 1, bounds[1:], strict=True)
        for start in range(int(first), int(end) - length + 1, length)
    ]
    if len(starts) < WINDOWS_MIN:
        raise NotEnoughDataError(
            f"{record.source}: {len(record)} samples with {len(record.missing)} missing are too "
            f"few: {WINDOWS_MIN * LENGTH_MIN} in a row at least, better some seconds"
        )
    keep = max(WINDOWS_MIN, SAMPLES_MAX // length)
    chosen = np.unique(np.linspace(0, len(starts) - 1, min(keep, len(starts))).astype(np.int64))
    index = np.array(starts, np.int64)[chosen, None] + np.arange(length)
    angles = [record.theta1] if record.theta2 is None else [record.theta1, record.theta2]
    return Windows(
        index,
        record.time_step,
        np.stack([angle[index] for angle in angles]),
        record.torque,
        _held_out(len(index)),
        record.linear,
        tuple(resolution(angle) for angle in angles),
    )


def _held_out(count: int) -> npt.NDArray[np.bool_]:
    """Which of so many windows are held out."""
    held_out: npt.NDArray[np.bool_] = np.arange(count) % FOLD == FOLD - 1
    return held_out


def median_spectrum(errors: Array) -> Array:
    """Power (c, f) of simulation errors (c, w, l), of white noise its square: the median of the
    windows, which single ones do not move."""
    median: Array = np.median(_spectra(errors), axis=1) / _MEDIAN
    return median


def noise_floor(errors: Array) -> Array:
    """Size (c,) of the white noise in simulation errors (c, w, l).

    From the upper end of their spectrum, where no motion of an axis is left; the median, so that
    lines in it do not count.
    """
    power = _spectra(errors)
    upper = power[:, :, int(_NOISE_BAND * power.shape[2]) : -1]
    size: Array = np.sqrt(np.median(upper, axis=(1, 2)) / _MEDIAN)
    return size


def floor_spread(errors: Array) -> float:
    """Standard deviation of the power of a noise_floor(), in units of it, which is found in
    simulation errors (w, l) of a channel: that of the median of so many lines."""
    count, length = errors.shape
    lines = count * (1.0 - _NOISE_BAND) * (length // 2) / _TAPER_LINES
    return float(1.0 / (_MEDIAN * np.sqrt(lines)))


def coloured(errors: Array, floor: float) -> bool:
    """Whether simulation errors (w, l) of a channel hold more than white noise of that size in some
    part of their spectrum, which is little of all where the part is narrow."""
    power = np.mean(_spectra(errors[None]), axis=(0, 1)) / floor**2
    highest = int(_NOISE_BAND * len(power))
    edges = np.unique(np.geomspace(_TAPER_WIDTH, highest, _BANDS + 1).astype(np.int64))
    lines = np.diff(edges)
    excess = np.add.reduceat(power[:highest], edges[:-1]) / lines - 1.0
    spread = np.sqrt(_TAPER_LINES / (lines * len(errors)))
    return bool(np.any(excess > _SURE * spread + _FLOOR_SPREAD))


def _spectra(errors: Array) -> Array:
    """Power (c, w, f), of white noise its square on the average."""
    taper = scipy.signal.windows.blackmanharris(errors.shape[2])
    power: Array = np.abs(np.fft.rfft(errors * taper, axis=2)) ** 2 / np.sum(taper**2)
    return power
