"""CAN frames as columns, and what they say: the record that they carry, the node that sent them."""

from __future__ import annotations

import zlib
from collections import defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from typing import Any

import can
import numpy as np
import numpy.typing as npt

from axistwin.contract import NODES, PAYLOAD, Contract, Payloads
from axistwin.core import Axis, Estimate, Modal
from axistwin.errors import InputError
from axistwin.record import Array, Indices, Record

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

# A counter that goes back by more than this many samples has started afresh: frames of one node do
# not overtake each other by that much.
_OVERTAKEN_MAX = 64
_COUNTER_WRAP = 1 << 16

# Time stamps may lag behind the bus by this much when a host was busy [s].
_CLOCK_LAG_MAX = 5.0


@dataclass(frozen=True)
class Frames:
    """Classical data frames with 11-bit identifiers, in order of arrival.

    ``time`` [s] of arrival, ``identifier``, ``length`` are (n,), ``payload`` is (n, 8), filled up
    with zeros. ``errors`` is the number of error frames among them.
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
        """The frames of messages; FD, remote and extended frames are left out."""
        times, identifiers, lengths, payloads, errors = [], [], [], [], 0
        for message in messages:
            if message.is_error_frame:
                errors += 1
            elif not (message.is_extended_id or message.is_remote_frame or message.is_fd):
                times.append(message.timestamp)
                identifiers.append(message.arbitration_id)
                lengths.append(len(message.data))
                payloads.append(bytes(message.data).ljust(PAYLOAD, b"\0"))
        return Frames(
            np.array(times, np.float64),
            np.array(identifiers, np.int64),
            np.array(lengths, np.int64),
            np.frombuffer(b"".join(payloads), np.uint8).reshape(-1, PAYLOAD),
            errors,
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
    for message in ("Motor", "Trace"):
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

    def rows(self, message: str) -> Indices:
        """Indices of a message's frames, those with the wrong length left out."""
        frames, contract = self.frames, self.contract
        named = frames.identifier == contract.identifier(message, self.id)
        return np.flatnonzero(named & (frames.length == contract.length(message)))

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

    def longest(self, rows: Indices, part_of: Indices) -> npt.NDArray[np.bool_]:
        """Which rows are in the longest of several parts."""
        sizes = np.bincount(part_of)
        longest = int(np.argmax(sizes))
        if len(sizes) > 1:
            self.warnings.append(
                f"the {self.part} starts afresh {len(sizes) - 1} times (node restarted or settings "
                f"changed): the longest part is used, {sizes[longest]} of {len(rows)} frames"
            )
        chosen: npt.NDArray[np.bool_] = part_of == longest
        return chosen

    def assemble(
        self,
        places: tuple[Indices, Indices],
        rows: tuple[Indices, Indices],
        names: tuple[str, str],
        count: int,
        time_step: float,
    ) -> Record:
        """A record of ``count`` samples from motor and table frames at ``places`` of the grid."""
        at = max(int(r[-1]) for r in rows if len(r) > 0)
        motor_counts, table_counts = self.counts(at)
        if len(rows[1]) == 0:
            table_counts = None
        whole = np.zeros(count, bool)
        whole[places[0]] = True
        if table_counts is not None:
            whole[np.setdiff1d(np.arange(count), places[1])] = False
        if np.count_nonzero(whole) < max(2, count // 2):
            raise InputError(
                f"{self.source}: only {np.count_nonzero(whole)} of {count} samples are complete"
            )
        first, last = np.flatnonzero(whole)[[0, -1]]
        grid = np.arange(first, last + 1)
        missing = np.flatnonzero(~whole[first : last + 1])

        def fill(values: npt.NDArray[Any], i: int) -> Array:
            return np.asarray(np.interp(grid, places[i], values), np.float64)

        turn = 1.0 if self.settings.linear else 2.0 * np.pi
        motor = _unwrap(self.node.raw(self.messages[0], names[0], rows[0]))
        torque = self.node.raw(self.messages[0], "Torque", rows[0])
        theta2 = None
        if table_counts is not None:
            table = _unwrap(self.node.raw(self.messages[1], names[1], rows[1]))
            theta2 = fill(table * (turn / table_counts), 1)
        self.warn(len(missing), len(grid))
        return Record(
            time=time_step * np.arange(len(grid), dtype=np.float64),
            torque=fill(torque * self.torque_unit(self.messages[0], at), 0),
            theta1=fill(motor * (turn / motor_counts), 0),
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
        """Which node this is, and what it has found out about its axis."""
        estimate = self.node.estimate()
        found = {"node_estimate": asdict(estimate)} if estimate is not None else {}
        return {"node": self.node.id, "part": self.part, **found}

    def warn(self, missing: int, count: int) -> None:
        """Notes everything about these frames that is not as it should be."""
        if missing > 0:
            self.warnings.append(f"{missing} of {count} samples are missing")
        for message in dict.fromkeys(self.messages):
            wrong = self.node.wrong_lengths(message)
            if wrong > 0:
                self.warnings.append(
                    f"{wrong} {message} frames do not have "
                    f"{self.node.contract.length(message)} bytes: left out"
                )
        if self.node.frames.errors > 0:
            self.warnings.append(f"{self.node.frames.errors} bus error frames")
        late = self.node.page_rows("Overruns")
        if len(late) > 0:
            overruns = self.node.raw("Report", "Overruns", late[[0, -1]])
            if overruns[1] > overruns[0]:
                self.warnings.append(
                    f"the node's control loop was late {overruns[1] - overruns[0]} times"
                )

    def record(self) -> Record:
        """The record; InputError when the frames do not make one."""
        raise NotImplementedError


class _Stream(_Reader):
    """The live stream: motor and table frames with a 16-bit sample counter."""

    part = "stream"
    messages = ("Motor", "Table")

    def record(self) -> Record:
        node = self.node
        is_motor = np.zeros(len(node.frames), bool)
        is_motor[node.rows("Motor")] = True
        rows = np.union1d(node.rows("Motor"), node.rows("Table"))
        if len(rows) == 0:
            raise InputError(f"{self.source}: holds no live stream of node {node.id}")
        counter = np.where(
            is_motor[rows],
            node.raw("Motor", "Counter", rows),
            node.raw("Table", "Counter", rows),
        )
        step = (np.diff(counter) + _COUNTER_WRAP // 2) % _COUNTER_WRAP - _COUNTER_WRAP // 2
        afresh = self.afresh(rows, step)
        used = self.longest(rows, np.concatenate([[0], np.cumsum(afresh)]))
        count = np.concatenate([[0], np.cumsum(np.where(afresh, 0, step))])[used]
        rows, count = rows[used], count - count.min()
        behind = int(np.count_nonzero(np.diff(count) < 0))
        if behind > 0:
            self.warnings.append(f"{behind} frames came out of order")
        motor, table = (self.kind(rows, count, is_motor[rows] == flag) for flag in (True, False))
        if len(motor[0]) == 0:
            raise InputError(f"{self.source}: holds no Motor frames of node {node.id}")
        return self.assemble(
            (motor[0], table[0]),
            (motor[1], table[1]),
            ("Position", "Position"),
            int(count.max()) + 1,
            self.time_step(int(rows[-1])),
        )

    def afresh(self, rows: Indices, step: Indices) -> npt.NDArray[np.bool_]:
        """Where the counting starts afresh: (n - 1,) for n rows and the steps of their counter."""
        node = self.node
        decimation = node.page_rows("StreamDecimation")
        changed = np.diff(node.raw("Report", "StreamDecimation", decimation)) != 0
        restarts = np.union1d(node.starts(), decimation[1:][changed])
        # A host that lost its node and found it again has asked it who it is. If samples are
        # missing there, too, then the node may have been another one in between.
        met = np.union1d(node.accepted("Identify"), node.accepted("StreamStart"))
        # Counter and clock have to agree roughly; else the counter has gone round unseen, or it
        # was not that far ahead but reset.
        period = self.time_step(int(rows[-1]))
        disagree = np.diff(node.frames.time[rows]) - period * step
        result: npt.NDArray[np.bool_] = (
            _between(restarts, rows)
            | (_between(met, rows) & (step > 1))
            | (step < -_OVERTAKEN_MAX)
            | (disagree > period * _COUNTER_WRAP / 2)
            | (disagree < -_CLOCK_LAG_MAX)
        )
        return result

    def kind(
        self, rows: Indices, count: Indices, chosen: npt.NDArray[np.bool_]
    ) -> tuple[Indices, Indices]:
        """Places on the grid and rows of one kind of frame, in order, each place once."""
        places, first = np.unique(count[chosen], return_index=True)
        twice = np.count_nonzero(chosen) - len(places)
        if twice > 0:
            self.warnings.append(f"{twice} frames came twice")
        return places, rows[chosen][first]

    def time_step(self, at: int) -> float:
        """Time between two samples [s]."""
        if self.settings.time_step is not None:
            return self.settings.time_step
        period = self.need("ControlPeriod", "--time-step", at)
        return period * self.need("StreamDecimation", "--time-step", at)


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
        motor, table = (self.channel(rows, index, channel == i) for i in (0, 1))
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
        return self.assemble(
            (motor[0], table[0]),
            (motor[1], table[1]),
            ("MotorPosition", "TablePosition"),
            count,
            period,
        )

    @staticmethod
    def channel(
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


def _between(marks: Indices, rows: Indices) -> npt.NDArray[np.bool_]:
    """Is there a mark between each row and the next? (n - 1,) for n rows."""
    result: npt.NDArray[np.bool_] = np.diff(np.searchsorted(marks, rows)) > 0
    return result


def _unwrap(counts: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """Counts of a register that wraps around at 32 bits as plain numbers."""
    steps = np.diff(counts).astype(np.int32).astype(np.int64)
    return np.cumsum(np.concatenate([counts[:1], steps]))
