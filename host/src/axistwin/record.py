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
from axistwin.sampling import UNEVEN_MAX, Array, Indices, evenly

#: Channels beside time, in the order in which they are written.
CHANNELS = ("torque", "theta1", "theta2", "omega1", "omega2")

#: A record has these channels at least.
REQUIRED = ("torque", "theta1")

#: What the first line of a CSV file that write_csv() made begins with.
CSV_TAG = "# axistwin record "


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
        if off > UNEVEN_MAX:
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
    """A record from samples at any increasing ``time`` [s], put where sampling.evenly() has them.

    ``properties`` are further arguments of Record. Raises InputError as evenly() does.
    """
    arrays = {name: np.asarray(values, np.float64) for name, values in channels.items()}
    sampling = evenly(np.asarray(time, np.float64), arrays, source)
    described: dict[str, Any] = {**sampling.channels, **properties}
    return Record(
        time=sampling.time,
        time_step=sampling.time_step,
        missing=sampling.missing,
        source=source,
        warnings=warnings + sampling.warnings,
        **described,
    )


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
