"""What is to be seen of a live stream while it comes in: lost samples, rate, bus load."""

from __future__ import annotations

import time
from dataclasses import dataclass, field

import can

from axistwin.contract import Contract

_COUNTER_WRAP = 1 << 16

# Frames of one node do not overtake each other by more than this many samples: a counter that goes
# back further has started afresh.
_OVERTAKEN_MAX = 64


@dataclass
class _Counted:
    """The sample counter of one kind of frame, followed."""

    last: int | None = None
    missing: set[int] = field(default_factory=set)

    def take(self, counter: int) -> bool:
        """The next counter that has come; True when it is a new sample."""
        if self.last is None:
            self.last = counter
            return True
        ahead = (counter - self.last + _COUNTER_WRAP // 2) % _COUNTER_WRAP - _COUNTER_WRAP // 2
        sample = self.last + ahead
        if ahead > 0:
            self.missing.update(range(self.last + 1, sample))
            self.last = sample
            return True
        if ahead < -_OVERTAKEN_MAX:
            self.last = counter
            return True
        late = sample in self.missing
        self.missing.discard(sample)
        return late


class StreamMonitor:
    """Follows the sample counters of a node's live stream. Give it every message.

    ``samples`` have come; ``lost`` have not, wholly or in part.
    """

    def __init__(self, contract: Contract, node_id: int) -> None:
        self.samples = 0
        self._lost_before = 0
        self._counters = {
            contract.identifier(name, node_id): (contract.reader(name, "Counter"), _Counted())
            for name in ("Motor", "Table")
        }
        self._first = contract.identifier("Motor", node_id)

    @property
    def lost(self) -> int:
        """Samples of which a frame has not come."""
        motor, table = (counted.missing for _, counted in self._counters.values())
        return self._lost_before + len(motor | table)

    def start_afresh(self) -> None:
        """The node has been away: what was not counted meanwhile is not a lost sample."""
        self._lost_before = self.lost
        for _, counted in self._counters.values():
            counted.last = None
            counted.missing.clear()

    def __call__(self, message: can.Message) -> None:
        """Takes a message."""
        reader, counted = self._counters.get(message.arbitration_id, (None, None))
        if reader is None or counted is None or message.is_error_frame or message.dlc != 8:
            return
        if counted.take(reader(bytes(message.data))) and message.arbitration_id == self._first:
            self.samples += 1


class BusLoad:
    """The share of the time that the bus is busy, at most: with the worst case of stuff bits."""

    def __init__(self, bit_rate: int) -> None:
        self.bit_rate = bit_rate
        self._bits = 0
        self._begin = time.monotonic()
        self._total = 0
        self._total_begin = self._begin

    def __call__(self, message: can.Message) -> None:
        """Takes a message."""
        bits = frame_bits(len(message.data), message.is_extended_id)
        self._bits += bits
        self._total += bits

    def recent(self) -> float:
        """Load since the last call, 0 to 1."""
        now = time.monotonic()
        load = self._bits / max(now - self._begin, 1e-3) / self.bit_rate
        self._bits, self._begin = 0, now
        return load

    def mean(self) -> float:
        """Load since the start, 0 to 1."""
        return self._total / max(time.monotonic() - self._total_begin, 1e-3) / self.bit_rate


def frame_bits(length: int, extended: bool = False) -> int:
    """Bits of a classical data frame with this many bytes, the space to the next one included.

    One bit is stuffed after every four at worst, from the start of the frame to its checksum.
    """
    stuffable = (54 if extended else 34) + 8 * length
    return stuffable + 13 + (stuffable - 1) // 4
