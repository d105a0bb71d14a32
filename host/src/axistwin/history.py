"""The history that a node's registers show, read again and again: put together, kept, read back.

While it is being logged it is kept as lines of JSON: what the node is, then what each answer
brought. However such a file ends, the lines that are whole make the record up to there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np

from axistwin.errors import InputError, NotEnoughDataError
from axistwin.record import Record
from axistwin.registers import Value, load_table
from axistwin.sampling import Array, Indices
from axistwin.timebase import Clock, fit_clock

#: How names of kept histories end.
ENDING = ".jsonl"

_SCHEMA = "axistwin.history/1"
_IDENTITY = ("NodeId", "ControlPeriod", "RatedTorque", "MotorResolution", "TableResolution")
_NUMBERS = ("HistoryCount", "HistoryDecimation", "HistoryCounter")
_ARRAYS = _TORQUE, _MOTOR, _TABLE = "HistoryTorque", "HistoryMotorPosition", "HistoryTablePosition"

_WRAP = 1 << 32

# A node that is off by more than this share does not run in real time.
_DRIFT_MAX = 1e-3

# What was read may be older by this [s] than the time at which it was asked for.
_LATE_MAX = 0.25


class HistoryLog:
    """Puts together what is read of a node's history, again and again.

    ``samples`` have come, ``lost`` have not: the node's counter says so. A node that starts afresh,
    or keeps its history at another distance, begins another part. ``keep`` is given lines of text
    from which read() makes the same record, one at the start and one with every answer.
    """

    def __init__(
        self, identity: dict[str, Value], keep: Callable[[str], object] = lambda _: None
    ) -> None:
        self.lost = 0
        self.samples = 0
        self._identity = identity
        self._period = cast(float, identity["ControlPeriod"])
        self._parts: list[_Part] = []
        self._goes_on = False
        self._keep = keep
        keep(_line({"schema": _SCHEMA, "identity": {name: identity[name] for name in _IDENTITY}}))

    @property
    def parts(self) -> int:
        """That have begun so far."""
        return len(self._parts)

    @property
    def next(self) -> int:
        """What to read the history from: the control period of the sample after the last."""
        return self._parts[-1].next if self._goes_on else 0

    def take(self, at: float, history: dict[str, Value]) -> int:
        """What was read of the history from ``next`` on, at the host's time ``at`` [s].

        Returns how many samples that were.
        """
        numbers = cast(dict[str, int], history)
        count, decimation = numbers["HistoryCount"], numbers["HistoryDecimation"]
        if count < 1:
            return 0
        first = numbers["HistoryCounter"]
        if not (self._goes_on and self._parts[-1].follows(first, decimation)):
            self._parts.append(_Part(decimation, first))
            self._goes_on = True
        self.lost += self._parts[-1].take(at, history)
        self.samples += count
        arrays = {name: cast(tuple[int, ...], history[name])[:count] for name in _ARRAYS}
        numbers = {name: numbers[name] for name in _NUMBERS}
        self._keep(_line({"part": self.parts, "at": at, **numbers, **arrays}))
        return count

    def start_afresh(self) -> None:
        """What comes next is of another part."""
        self._goes_on = False

    def watch(self, at: float, newest: dict[str, Value]) -> None:
        """Has the node started afresh? Where nothing came, or after it was away.

        ``newest`` was read of its history from 0 on, at ``at`` [s]. A node that has gone on has
        counted as many control periods as there was time; one that has not is behind.
        """
        numbers = cast(dict[str, int], newest)
        if not self._goes_on or numbers["HistoryCount"] < 1:
            return
        reach = (numbers["HistoryCount"] - 1) * numbers["HistoryDecimation"]
        passed = (at - self._parts[-1].at) / self._period
        behind = round(self._parts[-1].next + passed) - numbers["HistoryCounter"] - reach
        behind = (behind + _WRAP // 2) % _WRAP - _WRAP // 2
        slack = _LATE_MAX / self._period + _DRIFT_MAX * passed + numbers["HistoryDecimation"]
        self._goes_on = behind <= slack

    def record(self, source: str, meta: dict[str, Any]) -> Record:
        """The record of the longest part. Raises NotEnoughDataError."""
        if not self._parts:
            raise NotEnoughDataError(f"{source}: no samples have come")
        part = max(self._parts, key=lambda part: part.samples)
        warnings = []
        if len(self._parts) > 1:
            warnings.append(
                f"the history starts afresh {len(self._parts) - 1} times (node restarted or "
                f"settings changed): the longest part is used, {part.samples} of {self.samples} "
                f"samples"
            )
        return part.record(self._identity, source, warnings, meta)


class _Part:
    """Samples that were counted in one go, ``decimation`` control periods apart."""

    def __init__(self, decimation: int, first: int) -> None:
        self.decimation = decimation
        self.samples = 0
        self.next = first
        self.at = 0.0  # when the last sample was read [s]
        self._place = 0  # of the next sample
        self._times: list[tuple[float, int]] = []
        self._places: list[Indices] = []
        self._columns: dict[str, list[Indices]] = {name: [] for name in _ARRAYS}

    def follows(self, first: int, decimation: int) -> bool:
        """Can this be a sample of the same history, that comes after what was taken?"""
        ahead = (first - self.next) % _WRAP
        return decimation == self.decimation and ahead < _WRAP // 2 and ahead % decimation == 0

    def take(self, at: float, history: dict[str, Value]) -> int:
        """Takes samples that follow; returns how many before them are missing."""
        numbers = cast(dict[str, int], history)
        count, first = numbers["HistoryCount"], numbers["HistoryCounter"]
        missing = (first - self.next) % _WRAP // self.decimation
        place = self._place + missing
        self.at = at
        self._times.append((at, place + count - 1))
        self._places.append(np.arange(place, place + count))
        for name in _ARRAYS:
            values = cast(tuple[int, ...], history[name])
            self._columns[name].append(np.array(values[:count], np.int64))
        self._place = place + count
        self.next = (first + count * self.decimation) % _WRAP
        self.samples += count
        return missing

    def record(
        self,
        identity: dict[str, Value],
        source: str,
        warnings: list[str],
        meta: dict[str, Any],
    ) -> Record:
        """As a record, in SI units."""
        numbers = cast(dict[str, float], identity)
        places = np.concatenate(self._places) if self._places else np.zeros(0, np.int64)
        count = int(places[-1]) + 1 if len(places) else 0
        if len(places) < max(2, count // 2):
            raise NotEnoughDataError(
                f"{source}: only {len(places)} of {count} samples have come; the line is too slow "
                f"for this rate: give a lower one with --rate"
            )
        grid = np.arange(count)
        missing = np.setdiff1d(grid, places)
        if len(missing) > 0:
            warnings.append(f"{len(missing)} of {count} samples are missing")
        step = float(str(np.float32(numbers["ControlPeriod"]))) * self.decimation
        clock = self._clock(step)
        if clock is not None:
            meta = {**meta, "drift_ppm": 1e6 * clock.drift, "drift_error_ppm": 1e6 * clock.error}
            if clock.significant and abs(clock.drift) <= _DRIFT_MAX:
                warnings.append(
                    f"the node's clock is {1e6 * clock.drift:+.3g} ppm off the logger's: put right"
                )
                step = clock.period
        unit = 1e-4 * 1e-3 * numbers["RatedTorque"]  # 0.1 per mille of so many mN m
        motor, table = (int(numbers[f"{name}Resolution"]) for name in ("Motor", "Table"))

        def fill(name: str) -> Array:
            values = np.concatenate(self._columns[name])
            if name != _TORQUE:
                steps = np.diff(values).astype(np.int32).astype(np.int64)  # wraps at 32 bits
                values = np.cumsum(np.concatenate([values[:1], steps]))
            return np.asarray(np.interp(grid, places, values), np.float64)

        turn = 2.0 * np.pi
        return Record(
            time=np.asarray(step * grid, np.float64),
            torque=fill(_TORQUE) * unit,
            theta1=fill(_MOTOR) * (turn / motor),
            theta2=fill(_TABLE) * (turn / table) if table else None,
            time_step=step,
            counts_per_turn=(motor, table or None),
            missing=missing,
            source=source,
            warnings=tuple(warnings),
            meta={"node": int(numbers["NodeId"]), "part": "history", **meta},
        )

    def _clock(self, step: float) -> Clock | None:
        times = np.array(self._times, np.float64)
        return fit_clock(times[:, 0], times[:, 1].astype(np.int64), step)


def journal_of(path: Path) -> Path:
    """Where a history is kept while the record ``path`` is being made."""
    return path.with_name(path.name + ENDING)


def read(path: Path) -> Record:
    """The record of a history that was kept. Raises InputError naming file and line."""
    try:
        *lines, _ = path.read_text(encoding="utf-8").split("\n")  # the last one is not whole
    except UnicodeDecodeError:
        raise InputError(f"{path} is not a text file") from None
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror}") from error
    log: HistoryLog | None = None
    for number, line in enumerate(lines, 1):
        try:
            values = json.loads(line)
            if log is None:
                log = HistoryLog(_identity(values))
            else:
                _take(log, values)
        except (ValueError, KeyError, TypeError, RecursionError) as error:
            raise InputError(f"{path}, line {number}: this is not of a kept history") from error
    if log is None:
        raise InputError(f"{path} is cut off before its first sample")
    try:
        return log.record(str(path), {})
    except NotEnoughDataError as error:
        raise InputError(str(error)) from error


def _line(values: dict[str, Any]) -> str:
    return json.dumps(values) + "\n"


def _identity(head: dict[str, Any]) -> dict[str, Value]:
    """What the first line says of the node. Raises ValueError, KeyError or TypeError."""
    if head["schema"] != _SCHEMA:
        raise ValueError
    found: dict[str, Value] = {name: _checked(name, head["identity"][name]) for name in _IDENTITY}
    needed = ("ControlPeriod", "RatedTorque", "MotorResolution")
    if not all(cast(float, found[name]) > 0 for name in needed):
        raise ValueError
    return found


def _take(log: HistoryLog, values: dict[str, Any]) -> None:
    """Has the log take what a line says of an answer. Raises as _identity()."""
    history: dict[str, Value] = {name: _checked(name, values[name]) for name in _NUMBERS}
    for name in _ARRAYS:
        history[name] = tuple(_checked(name, value) for value in values[name])
    lengths = {len(values[name]) for name in _ARRAYS}
    if lengths != {history["HistoryCount"]} or 0 in lengths or history["HistoryDecimation"] == 0:
        raise ValueError
    if type(values["at"]) is not float or not math.isfinite(values["at"]):
        raise ValueError
    if values["part"] != log.parts:
        log.start_afresh()
    log.take(values["at"], history)


def _checked(name: str, value: Any) -> int | float:
    """A number that a register can hold. Raises ValueError."""
    kind = load_table().registers[name].kind
    if kind == "float32":
        if type(value) is float and math.isfinite(value):
            return value
    elif type(value) is int:
        bits = int(kind.removeprefix("u").removeprefix("int"))
        low, high = (0, 1 << bits) if kind[0] == "u" else (-1 << bits - 1, 1 << bits - 1)
        if low <= value < high:
            return value
    raise ValueError
