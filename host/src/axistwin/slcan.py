"""python-can's SLCAN interface, reading whatever has come at once.

The original reads byte by byte, two system calls each: a small computer cannot keep up with a
drive's live stream that way.
"""

from __future__ import annotations

import re

import can.interfaces
import serial
from can.exceptions import error_check
from can.interfaces.slcan import slcanBus

_END = re.compile(rb"[\r\a]")

# No line is longer: an FD frame with a 29-bit identifier and a time stamp.
_LINE_MAX = 160

# As much as a port may hand over at once: half a second of a full bus.
_CHUNK = 1 << 16


class SlcanBus(slcanBus):
    """The interface "slcan" once register() has been called."""

    def _read(self, timeout: float | None) -> str | None:
        """The next line, its end included; None when none is complete within ``timeout`` [s].

        Raises ValueError for what is too long to be a line: it is left out up to where it ends.
        """
        limit = serial.Timeout(timeout)
        while True:
            end = _END.search(self._buffer)
            if end is not None:
                line = self._buffer[: end.end()].decode("ascii", "replace")
                del self._buffer[: end.end()]
                return line
            if len(self._buffer) > _LINE_MAX:
                self._buffer.clear()
                raise ValueError("a line without an end")
            # The port's own time limit, a millisecond, ends this read; then what has come is there.
            with error_check("Could not read from serial device"):
                chunk = self.serialPortOrig.read(_CHUNK)
            self._buffer.extend(chunk)
            if not chunk and limit.expired():
                return None


def register() -> None:
    """Makes python-can use this class for the interface "slcan", in this process."""
    can.interfaces.BACKENDS["slcan"] = (__name__, SlcanBus.__name__)
