"""The error of a model on a record: simulated freely over windows, nothing of the model fitted.

An axis drifts away from any simulation in the end, because its angle is the torque integrated
twice. So a record is cut into windows, and at the start of each the state - angle, speed, twist,
its speed and the zero of the table encoder - is adjusted to what was measured in the window.

The other way round there is nothing to drift: the torque that the model needs for the measured
motion against the one that acted (inverse.py), over the whole record, in a band of frequencies.
"""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.optimize

from axistwin import inverse
from axistwin.core import Array, State
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify.band import Band
from axistwin.identify.samples import Hold, Samples, longest_stretch
from axistwin.model import Model
from axistwin.record import Record

SCHEMA = "axistwin.compare/1"

#: A window has this many samples at least: several times as many as there are unknowns.
WINDOW_MIN = 20

#: Samples whose slope is the first guess of a speed.
_FEW = 5

#: Step of the differences, in units of what the unknowns are like.
_DIFFERENCE = 1e-5

Progress = Callable[[str], None]


def _silent(_: str) -> None:
    pass


@dataclass(frozen=True)
class ChannelError:
    """How far a simulated channel is from the measured one, over all windows.

    ``rms`` of the difference in ``unit``; ``relative`` to the rms of the measured channel about its
    mean in each window, a torque to its rms; ``worst`` is where the window with the largest rms
    begins [s]. A torque is compared ``below`` a frequency [Hz].
    """

    name: str
    unit: str
    rms: float
    relative: float
    worst: float
    below: float | None = None

    def to_json(self) -> dict[str, Any]:
        """As JSON holds it."""
        entry = {
            "unit": self.unit,
            "rms": self.rms,
            "relative": self.relative,
            "worst_window_at_s": self.worst,
        }
        return entry if self.below is None else {**entry, "below_hz": self.below}


def compare(
    model: Model,
    record: Record,
    *,
    window: float = 0.5,
    hold: Hold = "zoh",
    bandwidth: float | None = None,
    progress: Progress = _silent,
) -> tuple[ChannelError, ...]:
    """The errors of theta1, and with two encoders of theta2 and the twist, over windows [s].

    Then that of the torque for motion up to ``bandwidth`` [Hz], as Band.of() has it; not of a
    record too short for it. Raises InputError for a window, a bandwidth or a model that does not
    fit the record, NotEnoughDataError when the record is shorter than the shortest window.
    """
    if model.linear != record.linear:
        kinds = {False: "rotary", True: "linear"}
        raise InputError(
            f"the model is {kinds[model.linear]}, the record {kinds[record.linear]} (--linear)"
        )
    samples = longest_stretch(record)
    length = min(round(window / samples.time_step), samples.count)
    if length < WINDOW_MIN:
        raise NotEnoughDataError(
            f"a window of {window:g} s or the record has less than {WINDOW_MIN} samples"
        )
    starts = range(0, samples.count - length + 1, length)
    measured, simulated = [], []
    for start in starts:
        progress(f"compare: {start * samples.time_step:.3g} of {samples.duration:.3g} s")
        part = _Window(model, samples, start, length, hold)
        measured.append(part.measured)
        simulated.append(part.simulated())
    errors = _errors(np.array(measured), np.array(simulated), samples, length)
    with contextlib.suppress(NotEnoughDataError):
        band = Band.of(samples, bandwidth)
        errors += (torque_error(model, samples, band, hold, length * samples.time_step),)
    return errors


def torque_error(
    model: Model, samples: Samples, band: Band, hold: Hold = "zoh", window: float = 0.5
) -> ChannelError:
    """How far the torque needed is from the one that acted, below the highest of the band."""
    found = inverse.torque(model, samples, band, hold)
    part = (found.time / window).astype(np.int64)
    squares = np.bincount(part, found.residual**2) / np.maximum(np.bincount(part), 1)
    size = float(np.sqrt(np.mean(found.measured**2)))
    return ChannelError(
        found.name,
        found.unit,
        found.rms,
        found.rms / size if size > 0.0 else np.inf,
        float(np.argmax(squares)) * window,
        band.highest,
    )


class _Window:
    """A part of the record, and the model's answer to its torque from any state."""

    def __init__(self, model: Model, samples: Samples, start: int, length: int, hold: Hold) -> None:
        part = slice(start, start + length)
        self._time_step = samples.time_step
        self._hold = hold
        self._model = model.later(samples.begin + start * samples.time_step)
        self._zero = samples.zero
        self._torque = samples.torque[part]
        columns = [samples.theta1[part]]
        if samples.theta2 is not None:
            columns.append(samples.theta2[part])
        self.measured: Array = np.column_stack(columns)

    def simulated(self) -> Array:
        """The channels (n, c) from the state that suits them best."""
        guess = self._guess()
        spans = np.ptp(self.measured, axis=0)
        size = [spans[0], spans[0] / (len(self.measured) * self._time_step)]
        if len(guess) > len(size):
            twist = float(np.ptp(self.measured[:, 0] - self.measured[:, 1]))
            size += [twist, twist * self._model.natural_frequency, twist]
        scale = np.maximum(np.array(size), 1e-12)

        def error(x: Array, count: int) -> Array:
            off = self._run(guess + scale * x, count) - self.measured[:count]
            return np.asarray(off.ravel(), np.float64)

        # Where an axis sticks from some states and not from others, the error has minima beside the
        # right one. Over few samples it has not, and from there on each next part lies near.
        found = np.zeros(len(guess))
        for count in _growing(len(self.measured)):
            found = scipy.optimize.least_squares(
                error, found, diff_step=[_DIFFERENCE], args=(count,)
            ).x
        return self._run(guess + scale * found, len(self.measured))

    def _guess(self) -> Array:
        """The state that the first samples show, and the zero that the mean of the twist shows."""
        few = min(len(self.measured), _FEW)
        time = self._time_step * np.arange(few, dtype=np.float64)
        slopes, values = np.polyfit(time, self.measured[:few], 1)
        if len(slopes) == 1:
            return np.array([values[0], slopes[0]])
        guess = np.array([values[0], slopes[0], 0.0, slopes[0] - slopes[1], 0.0])
        for _ in range(2):
            off = self._run(guess, len(self.measured)) - self.measured
            shift = float(np.mean(off[:, 0] - off[:, 1]))
            guess[4] += shift
            guess[2] = values[0] - values[1] + guess[4]
        return guess

    def _run(self, unknowns: Array, count: int) -> Array:
        """The first samples (count, c) from a state and with a zero of the twist."""
        angle, speed, *rest = (float(value) for value in unknowns)
        twist, twist_speed, zero = rest or (0.0, 0.0, 0.0)
        state = State(twist, twist_speed, speed, self._zero + angle)
        theta1, theta2 = self._model.simulate(
            self._torque[:count], self._time_step, state, hold=self._hold
        )
        channels = [theta1 - self._zero, theta2 - self._zero + zero]
        return np.column_stack(channels[: self.measured.shape[1]])


def _growing(count: int) -> list[int]:
    """Numbers of samples up to ``count``, each about half as many again as the one before."""
    counts = [count]
    while counts[-1] * 2 // 3 >= WINDOW_MIN:
        counts.append(counts[-1] * 2 // 3)
    return counts[::-1]


def _errors(
    measured: Array, simulated: Array, samples: Samples, length: int
) -> tuple[ChannelError, ...]:
    """Of channels (windows, n, c)."""
    names = ["theta1", "theta2"][: measured.shape[2]]
    if len(names) == 2:
        names.append("twist")
        measured, simulated = (
            np.concatenate([both, both[:, :, :1] - both[:, :, 1:]], axis=2)
            for both in (measured, simulated)
        )
    error = np.sqrt(np.mean((simulated - measured) ** 2, axis=1))
    size = np.std(measured, axis=1)
    found = []
    for c, name in enumerate(names):
        rms = float(np.sqrt(np.mean(error[:, c] ** 2)))
        whole = float(np.sqrt(np.mean(size[:, c] ** 2)))
        worst = int(np.argmax(error[:, c])) * length * samples.time_step
        unit = "m" if samples.linear else "rad"
        found.append(ChannelError(name, unit, rms, rms / whole if whole > 0.0 else np.inf, worst))
    return tuple(found)
