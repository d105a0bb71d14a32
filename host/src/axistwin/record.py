"""A record: what an axis did, sampled evenly, in SI units. Readers make it, analyses take it."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from axistwin.errors import InputError
from axistwin.output import atomic_write

Array = npt.NDArray[np.float64]
Indices = npt.NDArray[np.int64]

#: Channels beside time, in the order in which they are written.
CHANNELS = ("torque", "theta1", "theta2", "omega1", "omega2")

#: A record has these channels at least.
REQUIRED = ("torque", "theta1")

#: What the first line of a CSV file that write_csv() made begins with.
CSV_TAG = "# axistwin record "

# Times may be off the even grid by this share of a time step: rounding, no more.
_UNEVEN_MAX = 1e-2

# An axis that moves at this share of its usual speed advances by what its speed says, times a whole
# number but for this part of one; so many times that is not one where the samples stumble.
_MOVING = 0.5
_PART_OF_STEP = 0.3
_STUMBLES_MIN = 5

# It has to be so many counts of the encoder that it advances by; advances that differ by this share
# of the largest angle are the same.
_COUNTS_MIN = 4.0
_ROUNDING = 1e-12

# Where samples are so many time steps apart, at most, those in between are interpolated then; where
# so many stumbles as above follow each other within so many samples it is not known when they were.
_BRIDGED = 3
_STUMBLE_APART = 10

# Time stamps that jitter are off by less than this many time steps: more is a gap, or a drift.
_JITTER_MAX = 20.0


@dataclass(frozen=True)
class Record:
    """Evenly spaced samples of one axis.

    Arrays are (n,), read-only: ``time`` [s], ``torque`` [N m], ``theta1`` motor and ``theta2``
    table angle [rad], ``omega1``, ``omega2`` their speeds [rad/s]; None for what was not measured.
    A ``linear`` axis reads N, m, m/s. ``time_step`` [s] is the distance of two samples.
    ``counts_per_turn`` of the encoders at motor and table, a metre for a linear axis, None where
    unknown. ``missing`` are the indices of samples that were lost and have been interpolated.
    ``source`` says where the record comes from, ``warnings`` what is wrong with it, one line each;
    ``meta`` is anything else that JSON can hold.

    Raises InputError when a sample is not finite, lengths differ or time is uneven.
    """

    time: Array
    torque: Array
    theta1: Array
    time_step: float
    theta2: Array | None = None
    omega1: Array | None = None
    omega2: Array | None = None
    counts_per_turn: tuple[int | None, int | None] = (None, None)
    missing: Indices = field(default_factory=lambda: np.zeros(0, np.int64))
    source: str = "record"
    warnings: tuple[str, ...] = ()
    meta: Mapping[str, Any] = field(default_factory=dict)
    linear: bool = False

    def __post_init__(self) -> None:
        for name in ("time", *CHANNELS):
            values = getattr(self, name)
            if values is not None:
                object.__setattr__(self, name, _read_only(values, np.float64))
        object.__setattr__(self, "missing", _read_only(self.missing, np.int64))
        self._check_arrays()
        self._check_time()
        for counts in self.counts_per_turn:
            if counts is not None and counts < 1:
                raise InputError(f"{self.source}: {counts} counts a turn; 1 or more are possible")

    def __len__(self) -> int:
        return len(self.time)

    def _check_arrays(self) -> None:
        n = len(self.time)
        if n < 2:
            raise InputError(f"{self.source}: {n} samples are no record")
        for name, values in {"t": self.time, **self.channels}.items():
            if values.shape != (n,):
                raise InputError(
                    f"{self.source}: {name} has {values.size} samples in {values.ndim} dimensions, "
                    f"t has {n}"
                )
            if not np.all(np.isfinite(values)):
                at = int(np.argmin(np.isfinite(values)))
                raise InputError(f"{self.source}: {name} is {values[at]} at sample {at}")
        inside = np.all((self.missing >= 0) & (self.missing < n))
        if not inside or np.any(np.diff(self.missing) <= 0):
            raise InputError(f"{self.source}: the missing samples are not indices in order")

    def _check_time(self) -> None:
        if not 0.0 < self.time_step < np.inf:
            raise InputError(f"{self.source}: a time step of {self.time_step} s is not possible")
        even = self.time[0] + self.time_step * np.arange(len(self.time))
        off = float(np.max(np.abs(self.time - even))) / self.time_step
        if off > _UNEVEN_MAX:
            raise InputError(
                f"{self.source}: samples are up to {off:.3g} time steps off an even time base"
            )

    @property
    def channels(self) -> dict[str, Array]:
        """The channels that were measured, by name."""
        named = {name: getattr(self, name) for name in CHANNELS}
        return {name: values for name, values in named.items() if values is not None}

    @property
    def resolution(self) -> tuple[float | None, float | None]:
        """One count of the motor and of the table encoder [rad], None where unknown."""
        turn = 1.0 if self.linear else 2.0 * np.pi
        motor, table = (None if n is None else turn / n for n in self.counts_per_turn)
        return motor, table

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return (len(self) - 1) * self.time_step


def from_samples(
    time: npt.ArrayLike,
    channels: Mapping[str, npt.ArrayLike],
    *,
    source: str,
    warnings: tuple[str, ...] = (),
    **properties: Any,
) -> Record:
    """A record from samples at any increasing ``time`` [s].

    Samples that lie on an even grid are put there, what is missing in between is interpolated and
    listed. Samples that do not get a warning: where the motion shows that only their time stamps
    jitter they are kept as they are, else they are resampled by linear interpolation. Even time
    stamps are not believed where ``theta1`` repeats and jumps although ``omega1`` goes on.
    ``properties`` are further arguments of Record. Raises InputError when time does not increase,
    or more samples are missing than there are.
    """
    raw_time = np.asarray(time, np.float64)
    raw = {name: np.asarray(values, np.float64) for name, values in channels.items()}
    for name, values in {"t": raw_time, **raw}.items():
        if values.shape != raw_time.shape or values.ndim != 1:
            raise InputError(f"{source}: {name} has shape {values.shape}, t {raw_time.shape}")
        if not np.all(np.isfinite(values)):
            at = int(np.argmin(np.isfinite(values)))
            raise InputError(f"{source}: {name} is {values[at]} at sample {at}")
    if len(raw_time) < 2:
        raise InputError(f"{source}: {len(raw_time)} samples are no record")
    steps = np.diff(raw_time)
    if np.any(steps <= 0.0):
        at = int(np.argmax(steps <= 0.0)) + 1
        raise InputError(
            f"{source}: time does not increase at sample {at} ({raw_time[at]:g} s after "
            f"{raw_time[at - 1]:g} s)"
        )
    # Half the samples have to be there: otherwise a wild time would ask for a huge grid.
    step = float(np.sort(steps)[(len(steps) - 1) // 2])
    if (raw_time[-1] - raw_time[0]) / step > 2 * len(raw_time):
        at = int(np.argmax(steps))
        raise InputError(
            f"{source}: more samples are missing than there are (steps of {step:g} s, but "
            f"{steps[at]:g} s after sample {at})"
        )
    even = _even_grid(raw_time, steps, step)
    if even is not None and (advances := _advances(raw, *even)) is not None:
        raw_time, raw = _as_it_moves(raw_time, raw, advances)
        even = _even_grid(raw_time, np.diff(raw_time), even[0])
        repeats, lost = np.sum(advances == 0), np.sum(np.maximum(advances - 1, 0))
        warnings += (
            f"theta1 has spikes of the sampling, where omega1 goes on: {repeats} samples are "
            f"repeats and {lost} are lost; put where the motion has them, log every sample once, "
            "with its own time",
        )
    jitter = None if even is not None else _stamp_jitter(raw_time, raw["theta1"])
    uneven = f"the time base is uneven (steps of {steps.min():.6g} to {steps.max():.6g} s)"
    missing = np.zeros(0, np.int64)
    if even is not None:
        step, places = even
        missing = np.setdiff1d(np.arange(places[-1] + 1), places)
        grid = raw_time[0] + step * np.arange(places[-1] + 1)
        # What is there stays as it is: only what is missing is interpolated.
        found = {name: np.interp(grid, grid[places], values) for name, values in raw.items()}
        for name, values in raw.items():
            found[name][places] = values
    elif jitter is not None:
        step = float(raw_time[-1] - raw_time[0]) / (len(raw_time) - 1)
        grid, found = raw_time[0] + step * np.arange(len(raw_time)), raw
        warnings += (
            f"{uneven}, but the motion is even: taken as every {step:.6g} s, the time stamps are "
            f"off by up to {jitter:.3g} s",
        )
    else:
        grid = np.arange(raw_time[0], raw_time[-1], step)
        found = {name: np.interp(grid, raw_time, values) for name, values in raw.items()}
        behind = np.searchsorted(raw_time, grid, side="right") - 1
        missing = np.flatnonzero(steps[np.minimum(behind, len(steps) - 1)] > 2.5 * step)
        ahead = np.minimum(behind + 1, len(raw_time) - 1)
        off = np.minimum(grid - raw_time[behind], np.abs(raw_time[ahead] - grid))
        between = np.sum(off > _UNEVEN_MAX * step)
        warnings += (
            f"{uneven}: resampled every {step:.6g} s, {between} of {len(grid)} samples are "
            "interpolated",
        )
    if len(missing) > 0:
        warnings += (f"{len(missing)} of {len(grid)} samples are missing",)
    return Record(
        time=grid,
        time_step=step,
        missing=missing,
        source=source,
        warnings=warnings,
        **found,
        **properties,
    )


def _even_grid(time: Array, steps: Array, step: float) -> tuple[float, Indices] | None:
    """Time step and places (n,) of samples on an even grid; None when they are on none."""
    places = np.concatenate([[0], np.cumsum(np.rint(steps / step))]).astype(np.int64)
    if np.any(np.diff(places) == 0):
        return None
    fitted = float(time[-1] - time[0]) / float(places[-1])
    off = np.abs(time - time[0] - fitted * places)
    return (fitted, places) if np.max(off) <= _UNEVEN_MAX * fitted else None


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


def _as_it_moves(
    time: Array, channels: Mapping[str, Array], advances: Indices
) -> tuple[Array, dict[str, Array]]:
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
    return time[0] + (time[1] - time[0]) * filled, found


def _stamp_jitter(time: Array, angle: Array) -> float | None:
    """How far time stamps are off even samples [s]; None when the samples themselves are uneven.

    An arrival time jitters while the samples are even, and late ones come in bursts. Where
    neighbouring steps differ, an angle lies between its neighbours by number if so, else by time.
    """
    step = float(time[-1] - time[0]) / (len(time) - 1)
    off = float(np.max(np.abs(time - time[0] - step * np.arange(len(time)))))
    before, after = np.diff(time)[:-1], np.diff(time)[1:]
    differ = np.abs(before - after) > _UNEVEN_MAX * (before + after)
    first, middle, last = angle[:-2][differ], angle[1:-1][differ], angle[2:][differ]
    before, after = before[differ], after[differ]
    by_time = np.abs(middle - (after * first + before * last) / (before + after))
    by_number = np.abs(middle - 0.5 * (first + last))
    even = float(np.sum(by_number)) < float(np.sum(by_time)) and off < _JITTER_MAX * step
    return off if even else None


def write_csv(record: Record, path: str | Path) -> None:
    """Writes a record as CSV: a comment line with all that is no column, a header, the samples.

    Reading it back gives the same record to the last bit. Either the whole file appears, or none.
    Raises FileError.
    """
    head = {
        "time_step": record.time_step,
        "counts_per_turn": record.counts_per_turn,
        "missing": record.missing.tolist(),
        "linear": record.linear,
        "warnings": record.warnings,
        "meta": {"source": record.source, **record.meta},
    }
    columns = {"t": record.time, **record.channels}
    with atomic_write(path) as partial, partial.open("w", encoding="utf-8") as file:
        file.write(f"{CSV_TAG}{json.dumps(head)}\n")
        file.write(",".join(columns) + "\n")
        file.writelines(_rows(columns))


def _rows(columns: Mapping[str, Array]) -> Iterator[str]:
    for row in zip(*(values.tolist() for values in columns.values()), strict=True):
        yield ",".join(map(repr, row)) + "\n"


def _read_only(values: npt.ArrayLike, dtype: npt.DTypeLike) -> npt.NDArray[Any]:
    array = np.array(values, dtype)
    array.flags.writeable = False
    return array
