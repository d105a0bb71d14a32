"""What is to be seen of a live stream while it comes in: lost samples, rate, bus load."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import can

from axistwin.contract import Contract
from axistwin.timebase import WRAP

# Frames of one node do not overtake each other by more than this many samples, and hardly ever are
# more lost in a row: a counter that is further off is damaged, or has started afresh.
_OVERTAKEN_MAX = 64
_LOST_MAX = WRAP // 4


@dataclass
class _Counted:
    """The sample counter of one kind of frame, followed. Each frame has ``samples`` samples."""

    samples: int
    next: int | None = None
    missing: set[int] = field(default_factory=set)
    _odd: int | None = None

    def take(self, counter: int) -> int:
        """The next counter that has come; returns how many of its samples are new ones."""
        if self.next is None:
            self.next = counter
        ahead = (counter - self.next + WRAP // 2) % WRAP - WRAP // 2
        first = self.next + ahead
        if not -_OVERTAKEN_MAX <= ahead <= _LOST_MAX:
            if counter != self._odd:  # one that is odd is damaged, two are a new beginning
                self._odd = (counter + self.samples) % WRAP
                return 0
            self.next = counter + self.samples
            return 2 * self.samples
        if ahead >= 0:
            self.missing.update(range(self.next, self.next + ahead))
            self.next = first + self.samples
            return self.samples
        late = self.missing.intersection(range(first, first + self.samples))
        self.missing -= late
        return len(late)


class StreamMonitor:
    """Follows the sample counters of a node's live stream. Give it every message.

    ``samples`` have come; ``lost`` have not, wholly or in part.
    """

    def __init__(self, contract: Contract, node_id: int) -> None:
        self.node_id = node_id
        self.samples = 0
        self._lost_before = 0
        self._counters = {
            contract.identifier(name, node_id): (
                contract.length(name),
                contract.reader(name, "Counter"),
                _Counted(contract.samples(name)),
                name != "Table",
            )
            for name in ("Motor", "Table", "Samples")
        }

    @property
    def lost(self) -> int:
        """Samples of which a frame has not come."""
        missing = [counted.missing for _, _, counted, _ in self._counters.values()]
        return self._lost_before + len(set().union(*missing))

    def start_afresh(self) -> None:
        """The node has been away: what was not counted meanwhile is not a lost sample."""
        self._lost_before = self.lost
        for _, _, counted, _ in self._counters.values():
            counted.next = None
            counted.missing.clear()

    def __call__(self, message: can.Message) -> None:
        """Takes a message."""
        followed = self._counters.get(message.arbitration_id)
        if followed is None or message.is_error_frame or message.is_extended_id:
            return
        length, counter, counted, counts = followed
        if len(message.data) == length:
            new = counted.take(counter(bytes(message.data)))
            if counts:
                self.samples += new


class BusLoad:
    """The share of the time that the bus is busy, at most: with the worst case of stuff bits.

    ``bit_rate`` [bit/s], and that of the second part of FD frames, which may be the same.
    """

    def __init__(self, bit_rate: int, data_bit_rate: int | None = None) -> None:
        self.bit_rate = bit_rate
        self._data_bit_rate = data_bit_rate or bit_rate
        self._times: dict[tuple[int, bool, bool, bool], float] = {}
        self._busy = 0.0
        self._begin = time.monotonic()
        self._total = 0.0
        self._total_begin = self._begin

    def __call__(self, message: can.Message) -> None:
        """Takes a message."""
        kind = (
            len(message.data),
            message.is_extended_id,
            message.is_fd,
            message.bitrate_switch,
        )
        took = self._times.get(kind)
        if took is None:
            took = self._times[kind] = self._frame_time(*kind)
        self._busy += took
        self._total += took

    def _frame_time(self, length: int, extended: bool, flexible: bool, switched: bool) -> float:
        nominal, data = (fd_frame_bits if flexible else _classical)(length, extended)
        return nominal / self.bit_rate + data / (self._data_bit_rate if switched else self.bit_rate)

    def recent(self) -> float:
        """Load since the last call, 0 to 1."""
        now = time.monotonic()
        load = self._busy / max(now - self._begin, 1e-3)
        self._busy, self._begin = 0.0, now
        return load

    def mean(self) -> float:
        """Load since the start, 0 to 1."""
        return self._total / max(time.monotonic() - self._total_begin, 1e-3)


def frame_bits(length: int, extended: bool = False) -> int:
    """Bits of a classical data frame with this many bytes, the space to the next one included.

    One bit is stuffed after every four at worst, from the start of the frame to its checksum.
    """
    stuffable = (54 if extended else 34) + 8 * length
    return stuffable + 13 + (stuffable - 1) // 4


def fd_frame_bits(length: int, extended: bool = False) -> tuple[int, int]:
    """Bits of an FD frame with this many bytes: those at the nominal and those at the data rate.

    ISO 11898-1:2015: up to the bit rate switch and from the acknowledgement on at the nominal rate;
    stuffing as above, but stuff count and checksum (17 bits, 21 above 16 bytes) have a fixed stuff
    bit before every four.
    """
    before = 36 if extended else 17
    stuffed_before = (before - 1) // 4
    data = 1 + 4 + 8 * length
    checked = 4 + (21 if length > 16 else 17)
    stuffed = (before + data - 1) // 4 - stuffed_before
    return before + stuffed_before + 12, data + stuffed + checked + (checked + 3) // 4 + 1


def _classical(length: int, extended: bool) -> tuple[int, int]:
    return frame_bits(length, extended), 0
