"""CAN frames as columns, and what they say: the record that they carry, the node that sent them."""

from __future__ import annotations

import zlib
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

import can
import numpy as np
import numpy.typing as npt

from axistwin.contract import NODES, PAYLOAD, PAYLOAD_FD, Contract, Payloads
from axistwin.core import Axis, Estimate, Modal
from axistwin.errors import InputError
from axistwin.record import Record
from axistwin.sampling import Array, Indices
from axistwin.timebase import Clock, Counting, fit_clock, follow

#: Report pages that describe a node, in the order of the contract.
IDENTITY = (
    "Contract",
    "Firmware",
    "ControlPeriod",
    "RatedTorque",
    "MotorResolution",
    "TableResolution",
    "StreamDecimation",
    "TraceCapacity",
)

_AXIS = ("I1", "I2", "B", "K")
_MODAL = ("Wn", "Wd", "Zeta")

# Fewer frames than this that fit to no others are damaged; so many amid others are a second node's.
_PART_MIN = 8
_SECOND_NODE_MIN = 20
_DENSE = 16  # one sample in so many came

# Of frames with the same counter so many may differ: one in ten. More are a second node's.
_DIFFERENT_MAX = 10

# A node whose clock is off by more than this does not run in real time: an overloaded emulator.
_DRIFT_MAX = 1e-3

# A record has to be half complete: it is cut at its longest gaps so often to become that.
_CUTS_MAX = 50


@dataclass(frozen=True)
class Frames:
    """Data frames with 11-bit identifiers, classical and FD, in order of arrival.

    ``time`` [s] of arrival, ``identifier``, ``length`` are (n,), ``payload`` is (n, 8), or (n, 64)
    where an FD frame needs it, filled up with zeros. ``errors`` is the number of error frames among
    them.
    """

    time: Array
    identifier: npt.NDArray[np.int64]
    length: npt.NDArray[np.int64]
    payload: Payloads
    errors: int

    def __len__(self) -> int:
        return len(self.time)

    @staticmethod
    def of(messages: Iterable[can.Message]) -> Frames:
        """The frames of messages; remote and extended frames are left out."""
        times, identifiers, payloads, errors = [], [], [], 0
        for message in messages:
            if message.is_error_frame:
                errors += 1
            elif not (message.is_extended_id or message.is_remote_frame):
                times.append(message.timestamp)
                identifiers.append(message.arbitration_id)
                payloads.append(bytes(message.data[:PAYLOAD_FD]))
        lengths = np.array([len(payload) for payload in payloads], np.int64)
        width = PAYLOAD if lengths.max(initial=0) <= PAYLOAD else PAYLOAD_FD
        filled = b"".join(payload.ljust(width, b"\0") for payload in payloads)
        return Frames(
            np.array(times, np.float64),
            np.array(identifiers, np.int64),
            lengths,
            np.frombuffer(filled, np.uint8).reshape(-1, width),
            errors,
        )

    @staticmethod
    def joined(pieces: Sequence[Frames]) -> Frames:
        """One after the other."""
        width = max((piece.payload.shape[1] for piece in pieces), default=PAYLOAD)
        return Frames(
            np.concatenate([np.zeros(0), *(piece.time for piece in pieces)]),
            np.concatenate([np.zeros(0, np.int64), *(piece.identifier for piece in pieces)]),
            np.concatenate([np.zeros(0, np.int64), *(piece.length for piece in pieces)]),
            np.concatenate(
                [
                    np.zeros((0, width), np.uint8),
                    *(np.pad(p.payload, ((0, 0), (0, width - p.payload.shape[1]))) for p in pieces),
                ]
            ),
            sum(piece.errors for piece in pieces),
        )


@dataclass(frozen=True)
class Settings:
    """What a reader of frames may be told, in place of what the frames say.

    ``node`` id, ``time_step`` between samples [s], ``rated_torque`` [N m], ``counts_per_turn`` of
    the encoders; ``linear``: counts a metre and N.
    """

    node: int | None = None
    time_step: float | None = None
    rated_torque: float | None = None
    counts_per_turn: tuple[int | None, int | None] = (None, None)
    linear: bool = False


def find_node(frames: Frames, contract: Contract, source: str, wanted: int | None) -> int:
    """The node whose samples these frames carry.

    Raises InputError when there is none, more than one, or not the one that is wanted.
    """
    found: set[int] = set()
    for message in ("Motor", "Samples", "Trace"):
        node = frames.identifier - contract.identifier(message, 0)
        is_node = (node >= NODES.start) & (node < NODES.stop)
        found |= set(node[is_node & (frames.length == contract.length(message))].tolist())
    named = [n for n in found if _Node(frames, contract, n).page("Contract") is not None]
    nodes = sorted(named or found)
    if wanted is None and len(nodes) == 1:
        return nodes[0]
    if wanted in found and wanted is not None:
        return wanted
    numbers = ", ".join(map(str, nodes))
    if not nodes:
        raise InputError(f"{source}: none of its {len(frames)} CAN frames is a node's sample")
    if wanted is None:
        raise InputError(f"{source}: holds nodes {numbers}; say which one with --node")
    raise InputError(f"{source}: holds no samples of node {wanted}, but of {numbers}")


def decode(
    frames: Frames,
    contract: Contract,
    source: str,
    settings: Settings,
    part: str | None = None,
    warnings: tuple[str, ...] = (),
) -> Record:
    """The record that frames carry: the ``"trace"`` where there is one, else the live ``"stream"``.

    Its time base is the node's own sample counter, never the time of arrival. ``part`` chooses
    between the two; ``warnings`` are put before those of the record. Raises InputError when there
    is no such part, or the frames do not say what is needed to read it.
    """
    node_id = find_node(frames, contract, source, settings.node)
    node = _Node(frames, contract, node_id)
    version = node.page("Contract")
    if version is not None and version != contract.version:
        raise InputError(
            f"{source}: node {node_id} speaks contract version {version:.0f}, {contract.source} is "
            f"version {contract.version}; give the matching file with --dbc"
        )
    chosen = part or ("trace" if len(node.rows("Trace")) > 0 else "stream")
    reader = _Trace if chosen == "trace" else _Stream
    return reader(node, source, settings, warnings).record()


def latest(
    frames: Frames, contract: Contract, node_id: int, pages: Iterable[str]
) -> dict[str, int]:
    """What a node's report pages with whole numbers said last, those that were sent."""
    node = _Node(frames, contract, node_id)
    values = {page: node.page(page) for page in pages}
    return {page: int(value) for page, value in values.items() if value is not None}


def short(value: np.float32 | float) -> float:
    """The shortest decimal number that is this one in single precision: what was meant."""
    return float(str(np.float32(value)))


def trace_checksum(payload: Payloads) -> int:
    """CRC-32 of a trace's frames (2 n, 8) in the order sent."""
    return zlib.crc32(payload.tobytes())


class _Node:
    """The frames of one node."""

    def __init__(self, frames: Frames, contract: Contract, node_id: int) -> None:
        self.frames = frames
        self.contract = contract
        self.id = node_id
        self._rows: dict[str, Indices] = {}

    def rows(self, message: str) -> Indices:
        """Indices of a message's frames, those with the wrong length left out."""
        if message not in self._rows:
            frames, contract = self.frames, self.contract
            named = frames.identifier == contract.identifier(message, self.id)
            right = frames.length == contract.length(message)
            self._rows[message] = np.flatnonzero(named & right)
        return self._rows[message]

    def wrong_lengths(self, message: str) -> int:
        """How many frames of a message have the wrong length."""
        named = self.frames.identifier == self.contract.identifier(message, self.id)
        return int(np.count_nonzero(named)) - len(self.rows(message))

    def raw(self, message: str, name: str, rows: Indices) -> npt.NDArray[Any]:
        """A signal in these rows as it is on the wire."""
        return self.contract.raw(message, name, self.frames.payload[rows])

    def page_rows(self, name: str) -> Indices:
        """Rows of a report page."""
        rows = self.rows("Report")
        chosen = self.raw("Report", "Page", rows) == self.contract.choice("Report", name)
        return np.compress(chosen, rows)

    def page(self, name: str, at: int | None = None) -> float | None:
        """What a report page said last, None when it was not sent.

        With a row ``at``: what it said last up to there, or first after it.
        """
        rows = self.page_rows(name)
        if len(rows) == 0:
            return None
        last = len(rows) if at is None else max(1, int(np.searchsorted(rows, at, side="right")))
        value = self.raw("Report", name, rows[last - 1 : last])[0]
        return short(value) if isinstance(value, np.float32) else float(value)

    def accepted(self, command: str) -> Indices:
        """Rows in which the node says that it has carried out this command."""
        rows = self.page_rows("Answer")
        code = self.contract.choice("Command", command)
        done = self.raw("Report", "Sequence", rows) == 0
        return np.compress(done & (self.raw("Report", "Flags", rows) == code), rows)

    def starts(self) -> Indices:
        """Rows in which the node says that it has started."""
        rows = self.rows("Heartbeat")
        started = self.raw("Heartbeat", "State", rows) == self.contract.state("BootUp")
        return np.compress(started, rows)

    def estimate(self) -> Estimate | None:
        """The latest estimate of which all pages with one sequence number have come."""
        names = [f"{kind}{name}" for kind in ("Estimate", "Error") for name in (*_AXIS, *_MODAL)]
        page_names = {self.contract.choice("Report", name): name for name in names}
        rows = self.rows("Report")
        rows = rows[np.isin(self.raw("Report", "Page", rows), list(page_names))]
        rows = rows[-3 * len(names) :]  # the last one that is complete is among them
        found: dict[int, dict[str, tuple[float, bool]]] = defaultdict(dict)
        for i, page in enumerate(self.raw("Report", "Page", rows).tolist()):
            row, name = rows[i : i + 1], page_names[page]
            sequence = int(self.raw("Report", "Sequence", row)[0])
            valid = bool(self.raw("Report", "Flags", row)[0] & 1)
            found[sequence][name] = (float(self.raw("Report", name, row)[0]), valid)
        complete = [pages for pages in found.values() if len(pages) == len(names)]
        return _estimate_of(complete[-1]) if complete else None


def _estimate_of(values: Mapping[str, tuple[float, bool]]) -> Estimate:
    def column(kind: str, names: Iterable[str]) -> list[float]:
        return [values[f"{kind}{name}"][0] for name in names]

    I1, I2, B, K = (values[f"Estimate{name}"][1] for name in _AXIS)
    return Estimate(
        Axis(*column("Estimate", _AXIS)),
        Modal(*column("Estimate", _MODAL)),
        Axis(*column("Error", _AXIS)),
        Modal(*column("Error", _MODAL)),
        (I1, I2, B, K),
    )


@dataclass(frozen=True)
class _Channel:
    """One encoder: raw positions at places of the grid, and the torque beside them, if any.

    Places are in order once there is one_each(); ``off`` says how far each is off the line.
    """

    places: Indices
    position: npt.NDArray[np.int64]
    torque: npt.NDArray[np.int64]
    off: Indices

    def __len__(self) -> int:
        return len(self.places)

    @staticmethod
    def of(
        places: Indices,
        position: npt.NDArray[np.int64],
        torque: npt.NDArray[np.int64] | None = None,
    ) -> _Channel:
        """What is known to be at these places."""
        nothing = np.zeros(len(places), np.int64)
        return _Channel(places, position, nothing if torque is None else torque, nothing)

    @staticmethod
    def one_each(channels: Sequence[_Channel]) -> tuple[_Channel, int]:
        """All in order, at each place the one least off the line; and how many others differ."""
        empty = _Channel.of(np.zeros(0, np.int64), np.zeros(0, np.int64))
        names = [field.name for field in fields(_Channel)]
        whole = _Channel(
            *(np.concatenate([getattr(c, name) for c in (empty, *channels)]) for name in names)
        )
        if np.all(np.diff(whole.places) > 0):
            return whole, 0
        order = np.lexsort((whole.off, whole.places))
        _, first, place = np.unique(whole.places[order], return_index=True, return_inverse=True)
        best = order[first]
        differ = np.count_nonzero(whole.position[order] != whole.position[best][place])
        return _Channel(*(getattr(whole, name)[best] for name in names)), int(differ)


class _Reader:
    """What stream and trace have in common: units, gaps, warnings."""

    part = ""
    messages: tuple[str, ...] = ()

    def __init__(
        self, node: _Node, source: str, settings: Settings, warnings: tuple[str, ...]
    ) -> None:
        self.node = node
        self.source = source
        self.settings = settings
        self.warnings = list(warnings)
        self.found: dict[str, Any] = {}

    def need(self, page: str, option: str, at: int) -> float:
        """What a report page says; InputError naming the option when it was not sent."""
        value = self.node.page(page, at)
        if value is None or not value > 0:
            raise InputError(
                f"{self.source}: no report says {page} of node {self.node.id}; give {option}"
            )
        return value

    def torque_unit(self, message: str, at: int) -> float:
        """1 of a raw torque in N m."""
        rated = self.settings.rated_torque
        if rated is None:
            rated = self.need("RatedTorque", "--rated-torque", at) * 1e-3
        return self.node.contract.scale(message, "Torque") * 1e-3 * rated

    def counts(self, at: int) -> tuple[int, int | None]:
        """Counts a turn of both encoders; None for a table encoder that is not there."""
        motor, table = self.settings.counts_per_turn
        if motor is None:
            motor = int(self.need("MotorResolution", "--counts", at))
            reported = self.node.page("TableResolution", at)
            table = int(reported) if reported else None
        return motor, table

    def note(self, name: str, count: int, text: str) -> None:
        """Counts something that is not as it should be; it is said where there is any of it."""
        self.found[name] = count
        if count > 0:
            self.warnings.append(f"{count} {text}")

    def longest(self, rows: Indices, part_of: Indices) -> npt.NDArray[np.bool_]:
        """Which rows are in the longest of several parts."""
        sizes = np.bincount(part_of)
        longest = int(np.argmax(sizes))
        self.found["restarts"] = len(sizes) - 1
        if len(sizes) > 1:
            self.warnings.append(
                f"the {self.part} starts afresh {len(sizes) - 1} times (node restarted or settings "
                f"changed): the longest part is used, {sizes[longest]} of {len(rows)} frames"
            )
        chosen: npt.NDArray[np.bool_] = part_of == longest
        return chosen

    def assemble(
        self, motor: _Channel, table: _Channel, message: str, at: int, count: int, time_step: float
    ) -> Record:
        """A record of ``count`` samples of both encoders; what was reported by row ``at`` holds."""
        motor_counts, table_counts = self.counts(at)
        if len(table) == 0:
            table_counts = None
        whole = np.zeros(count, bool)
        whole[motor.places] = True
        if table_counts is not None:
            there = np.zeros(count, bool)
            there[table.places] = True
            whole &= there
        if np.count_nonzero(whole) < max(2, count // 2):
            raise InputError(
                f"{self.source}: only {np.count_nonzero(whole)} of {count} samples are complete"
            )
        first, last = np.flatnonzero(whole)[[0, -1]]
        grid = np.arange(first, last + 1)
        missing = np.flatnonzero(~whole[first : last + 1])

        def fill(values: npt.NDArray[Any], places: Indices) -> Array:
            return np.asarray(np.interp(grid, places, values), np.float64)

        turn = 1.0 if self.settings.linear else 2.0 * np.pi
        torque = motor.torque * self.torque_unit(message, at)
        theta2 = None
        if table_counts is not None:
            theta2 = fill(_unwrap(table.position) * (turn / table_counts), table.places)
        self.warn(missing, len(grid), time_step)
        return Record(
            time=time_step * np.arange(len(grid), dtype=np.float64),
            torque=fill(torque, motor.places),
            theta1=fill(_unwrap(motor.position) * (turn / motor_counts), motor.places),
            theta2=theta2,
            time_step=time_step,
            counts_per_turn=(motor_counts, table_counts),
            missing=missing,
            source=self.source,
            warnings=tuple(self.warnings),
            meta=self.meta(),
            linear=self.settings.linear,
        )

    def meta(self) -> dict[str, Any]:
        """Which node this is, what was found wrong, and what the node has identified."""
        estimate = self.node.estimate()
        found = {"node_estimate": asdict(estimate)} if estimate is not None else {}
        return {"node": self.node.id, "part": self.part, "frames": self.found, **found}

    def warn(self, missing: Indices, count: int, time_step: float) -> None:
        """Notes everything about these frames that is not as it should be."""
        self.found["samples"] = count
        gaps = np.concatenate([[0], np.flatnonzero(np.diff(missing) > 1) + 1, [len(missing)]])
        longest = int(np.argmax(np.diff(gaps)))
        in_a_row = int(gaps[longest + 1] - gaps[longest])
        where = ""
        if in_a_row > 1:
            where = f", {in_a_row} in a row from {missing[gaps[longest]] * time_step:.6g} s on"
        self.note("missing", len(missing), f"of {count} samples are missing{where}")
        wrong = {name: self.node.wrong_lengths(name) for name in dict.fromkeys(self.messages)}
        self.found["wrong_length"] = sum(wrong.values())
        for message, many in wrong.items():
            if many > 0:
                self.warnings.append(
                    f"{many} {message} frames do not have "
                    f"{self.node.contract.length(message)} bytes: left out"
                )
        self.note("error_frames", self.node.frames.errors, "bus error frames")
        for page, text in (
            ("Overruns", "the node's control loop was late {} times"),
            ("LostSamples", "the node found no room on the way to the bus for {} samples"),
        ):
            pages = self.node.page_rows(page)
            values = self.node.raw("Report", page, pages[[0, -1]]) if len(pages) > 0 else [0, 0]
            grown = max(0, int(values[1]) - int(values[0]))
            self.found["node_" + page.lower()] = grown
            if grown > 0:
                self.warnings.append(text.format(grown))

    def record(self) -> Record:
        """The record; InputError when the frames do not make one."""
        raise NotImplementedError


_STREAMED = ("Motor", "Table", "Samples")
_TABLE = 1


class _Stream(_Reader):
    """The live stream, samples counted by 16 bits: Motor and Table frames, or Samples on CAN FD."""

    part = "stream"
    messages = _STREAMED

    def record(self) -> Record:
        node = self.node
        kind = np.full(len(node.frames), -1)
        counter = np.zeros(len(node.frames), np.int64)
        for i, message in enumerate(self.messages):
            rows = node.rows(message)
            if len(rows) > 0:
                kind[rows], counter[rows] = i, node.raw(message, "Counter", rows)
        rows = np.flatnonzero(kind >= 0)
        if len(rows) == 0:
            raise InputError(f"{self.source}: holds no live stream of node {node.id}")
        used, counting = self.main_part(rows, counter[rows])
        rows, count = rows[used], counting.count[used]
        time_step = self.time_step(int(rows[-1]))
        timed = kind[rows] != _TABLE
        if not np.any(timed):
            raise InputError(f"{self.source}: holds no Motor frames of node {node.id}")
        clock = fit_clock(node.frames.time[rows[timed]], count[timed], time_step)
        held = np.array([node.contract.samples(message) for message in self.messages])
        dense = self.densest(count, held[kind[rows]])
        rows, count = rows[dense], count[dense] - count[dense].min()
        self.note(
            "out_of_order",
            int(np.count_nonzero(np.diff(count) < 0)),
            "frames came out of order: put right",
        )
        motor, table = self.channels(rows, count, kind[rows])
        samples = 1 + int(max(channel.places[-1] for channel in (motor, table) if len(channel)))
        time_step = self.by_clock(time_step, clock)
        return self.assemble(motor, table, "Motor", int(rows[-1]), samples, time_step)

    def main_part(self, rows: Indices, counter: Indices) -> tuple[npt.NDArray[np.bool_], Counting]:
        """Which rows are of the longest part that was counted in one go, and how they count.

        Raises InputError when more than one node has counted at a time.
        """
        node, cuts = self.node, self.cuts(rows)
        counting = follow(node.frames.time[rows], counter, self.time_step(int(rows[-1])), cuts)
        second = (
            f"{self.source}: two nodes with id {node.id} send at the same time, or the log is "
            f"damaged (their counters contradict each other); give each node an id of its own"
        )
        if counting.contradictory:
            raise InputError(second)
        sizes = np.bincount(counting.part)
        main = int(np.argmax(sizes))
        span = np.flatnonzero(counting.part == main)[[0, -1]]
        amid = np.bincount(counting.part[span[0] : span[1] + 1], minlength=len(sizes))
        damaged = sizes < _PART_MIN
        for part in np.flatnonzero(~damaged).tolist():
            damaged[part] = not _dense(counting.count[counting.part == part])
            if part != main and amid[part] >= _SECOND_NODE_MIN and not damaged[part]:
                raise InputError(second)
        damaged[main] = False
        self.note(
            "contradictory",
            int(sizes[damaged].sum()),
            f"frames contradict the others (damaged, or of a second node {node.id}): left out",
        )
        kept = ~damaged[counting.part]
        used = np.zeros(len(rows), bool)
        parts = np.unique(counting.part[kept], return_inverse=True)[1]
        used[kept] = self.longest(rows[kept], parts)
        return used, counting

    def cuts(self, rows: Indices) -> npt.NDArray[np.bool_]:
        """Where the node says that its counter starts afresh: (n - 1,) for n rows."""
        node = self.node
        pages = node.page_rows("StreamDecimation")
        changed = np.flatnonzero(np.diff(node.raw("Report", "StreamDecimation", pages)) != 0)
        before, after = pages[changed], pages[changed + 1]
        # Another rate holds from the command on that is answered before it is reported.
        answered = np.union1d(node.accepted("StreamStart"), node.accepted("StreamStartFd"))
        last = np.append(-1, answered)[np.searchsorted(answered, after)]
        return _between(np.union1d(node.starts(), np.where(last > before, last, after)), rows)

    def densest(self, count: Indices, samples: Indices) -> npt.NDArray[np.bool_]:
        """Which frames make a record that is at least half complete: cut at the longest gaps.

        ``count`` (n,) of the frames and how many ``samples`` each has.
        """
        chosen = np.ones(len(count), bool)
        for _ in range(_CUTS_MAX):
            places, first = np.unique(count[chosen], return_index=True)
            held = np.cumsum(samples[chosen][first])
            if 2 * held[-1] >= places[-1] - places[0]:
                break
            gap = int(np.argmax(np.diff(places)))
            later = 2 * held[gap] < held[-1]
            chosen &= (count > places[gap]) if later else (count <= places[gap])
        if not np.all(chosen):
            self.warnings.append(
                f"most of the samples are missing in between: the longest part that holds together "
                f"is used, {np.count_nonzero(chosen)} of {len(count)} frames"
            )
        return chosen

    def channels(
        self, rows: Indices, count: Indices, kind: npt.NDArray[np.int64]
    ) -> tuple[_Channel, _Channel]:
        """Both encoders, each place once. Raises InputError when frames of many places differ."""
        off = _off_the_line(count)
        twice, different = 0, 0
        motors, tables = [], []
        for i, message in enumerate(self.messages):
            chosen = np.flatnonzero(kind == i)
            if len(chosen) == 0:
                continue
            once, same, others = self.once(rows[chosen], count[chosen], off[chosen])
            chosen = chosen[once]
            twice, different = twice + same, different + others
            many = self.node.contract.samples(message)
            places = (count[chosen, None] + np.arange(many)).ravel()
            distance = np.repeat(off[chosen], many)
            torque, motor, table = self.columns(message, rows[chosen], many)
            if motor is not None and torque is not None:
                motors.append(_Channel(places, motor, torque, distance))
            if table is not None:
                tables.append(_Channel(places, table, np.zeros_like(table), distance))
        motor_channel, motor_differs = _Channel.one_each(motors)
        table_channel, table_differs = _Channel.one_each(tables)
        different += (motor_differs + table_differs) // (2 * self.node.contract.samples("Samples"))
        if _DIFFERENT_MAX * different > len(rows):
            raise InputError(
                f"{self.source}: two nodes with id {self.node.id} send at the same time (frames "
                f"with the same counter differ); give each node an id of its own"
            )
        self.note("twice", twice, "frames came twice: left out")
        self.note("different", different, "frames have the counter of another one: left out")
        return motor_channel, table_channel

    def columns(
        self, message: str, rows: Indices, many: int
    ) -> tuple[npt.NDArray[np.int64] | None, ...]:
        """Torque, motor and table position of each sample in these rows; None: not in there."""
        if message == "Samples":
            return tuple(
                np.stack([self.node.raw(message, f"{n}{i}", rows) for i in range(many)], 1).ravel()
                for n in ("Torque", "MotorPosition", "TablePosition")
            )
        position = self.node.raw(message, "Position", rows)
        if message == "Motor":
            return self.node.raw(message, "Torque", rows), position, None
        return None, None, position

    def once(self, rows: Indices, count: Indices, off: Indices) -> tuple[Indices, int, int]:
        """Indices of the frames of one kind, each count once and in order; how many were left out.

        First those that came twice, then those that differ from the one with the same count that
        is less ``off`` the line of those around it.
        """
        if np.all(np.diff(count) > 0):
            return np.arange(len(rows)), 0, 0
        order = np.lexsort((off, count))
        _, first, place = np.unique(count[order], return_index=True, return_inverse=True)
        payload = self.node.frames.payload[rows[order]]
        differ = int(np.count_nonzero(np.any(payload != payload[first][place], axis=1)))
        return order[first], len(rows) - len(first) - differ, differ

    def time_step(self, at: int) -> float:
        """Time between two samples by the node's clock [s]."""
        if self.settings.time_step is not None:
            return self.settings.time_step
        period = self.need("ControlPeriod", "--time-step", at)
        return period * self.need("StreamDecimation", "--time-step", at)

    def by_clock(self, time_step: float, clock: Clock | None) -> float:
        """Time between two samples [s] by the clock of the host that has logged them."""
        if clock is None:
            return time_step
        self.found["clock"] = {
            "start": clock.start,
            "drift_ppm": 1e6 * clock.drift,
            "error_ppm": 1e6 * clock.error,
        }
        if not clock.significant:
            return time_step
        off = f"the node's clock is {1e6 * abs(clock.drift):.3g} ppm (± {1e6 * clock.error:.1g}) "
        off += "slower" if clock.drift > 0 else "faster"
        if abs(clock.drift) > _DRIFT_MAX:
            self.warnings.append(f"{off} than the logger's: it does not run in real time")
            return time_step
        if self.settings.time_step is not None:
            return time_step
        self.warnings.append(f"{off} than the logger's: put right")
        return clock.period


class _Trace(_Reader):
    """An uploaded trace: two frames a sample, numbered."""

    part = "trace"
    messages = ("Trace", "Trace")

    def record(self) -> Record:
        node = self.node
        rows = node.rows("Trace")
        if len(rows) == 0:
            raise InputError(f"{self.source}: holds no trace of node {node.id}")
        armed = np.union1d(node.starts(), node.accepted("TraceArm"))
        part_of = np.searchsorted(armed, rows)
        used = self.longest(rows, np.unique(part_of, return_inverse=True)[1])
        start = armed[part_of[used][0] - 1] if part_of[used][0] > 0 else 0
        rows = rows[used]
        index = node.raw("Trace", "Index", rows)
        channel = node.raw("Trace", "Channel", rows)
        motor, table = (self.places(rows, index, channel == i) for i in (0, 1))
        if len(motor[0]) == 0:
            raise InputError(f"{self.source}: holds no motor frames of a trace of node {node.id}")
        captured = node.page_rows("TraceCaptured")
        captured = captured[captured >= start]
        announced = node.raw("Report", "TraceCaptured", captured).max(initial=0)
        count = max(int(index.max()) + 1, int(announced))
        self.check(motor, table, count, int(start))
        period = self.settings.time_step
        if period is None:
            period = self.need("ControlPeriod", "--time-step", int(rows[-1]))
            period *= node.page("TraceDecimation", int(rows[-1])) or 1.0
        triggered = node.page("TraceTriggered", int(rows[-1]))
        if triggered:
            self.found["trigger"] = int(triggered)
        return self.assemble(
            _Channel.of(
                motor[0],
                node.raw("Trace", "MotorPosition", motor[1]),
                node.raw("Trace", "Torque", motor[1]),
            ),
            _Channel.of(table[0], node.raw("Trace", "TablePosition", table[1])),
            "Trace",
            int(rows[-1]),
            count,
            period,
        )

    @staticmethod
    def places(
        rows: Indices, index: Indices, chosen: npt.NDArray[np.bool_]
    ) -> tuple[Indices, Indices]:
        """Indices and rows of one channel, in order, each once: sent again means the same."""
        places, first = np.unique(index[chosen], return_index=True)
        return places, rows[chosen][first]

    def check(
        self,
        motor: tuple[Indices, Indices],
        table: tuple[Indices, Indices],
        count: int,
        start: int,
    ) -> None:
        """Compares a complete trace with the checksum that the node has sent with it."""
        sent = self.node.page_rows("TraceChecksum")
        sent = sent[sent >= start][-1:]
        if len(sent) == 0 or len(motor[0]) < count or len(table[0]) < count:
            return
        order = np.column_stack([motor[1], table[1]]).ravel()
        found = trace_checksum(self.node.frames.payload[order])
        if found != int(self.node.raw("Report", "TraceChecksum", sent)[0]):
            self.warnings.append("the trace does not match its checksum")


def _dense(count: Indices) -> bool:
    """Do these follow each other, as the frames of a node do, or fit together by chance only?"""
    return _DENSE * len(np.unique(count)) >= int(np.ptp(count))


def _off_the_line(count: Indices) -> Indices:
    """How far each count (n,) is off the middle of itself and its neighbours."""
    around = np.stack([np.append(count[:1], count[:-1]), count, np.append(count[1:], count[-1:])])
    result: Indices = np.abs(count - np.sort(around, axis=0)[1])
    return result


def _between(marks: Indices, rows: Indices) -> npt.NDArray[np.bool_]:
    """Is there a mark between each row and the next? (n - 1,) for n rows."""
    result: npt.NDArray[np.bool_] = np.diff(np.searchsorted(marks, rows)) > 0
    return result


def _unwrap(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Counts of a register that wraps around at 32 bits as plain numbers."""
    steps = np.diff(counts).astype(np.int32).astype(np.int64)
    return np.cumsum(np.concatenate([counts[:1], steps]))
