"""python-can's SLCAN interface, reading whatever has come at once.

The original reads byte by byte, two system calls each: a small computer cannot keep up with a
drive's live stream that way.
"""

from __future__ import annotations

import can.interfaces
import serial
from can.exceptions import error_check
from can.interfaces.slcan import slcanBus

# As much as a port may hand over at once: half a second of a full bus.
_CHUNK = 1 << 16


class SlcanBus(slcanBus):
    """The interface "slcan" once register() has been called."""

    def _read(self, timeout: float | None) -> str | None:
        """The next line, its end included; None when none is complete within ``timeout`` [s]."""
        limit = serial.Timeout(timeout)
        while True:
            for end, byte in enumerate(self._buffer):
                if byte in b"\r\a":
                    line = self._buffer[: end + 1].decode("ascii", "replace")
                    del self._buffer[: end + 1]
                    return line
            # The port's own time limit, a millisecond, ends this read; then what has come is there.
            with error_check("Could not read from serial device"):
                chunk = self.serialPortOrig.read(_CHUNK)
            self._buffer.extend(chunk)
            if not chunk and limit.expired():
                return None


def register() -> None:
    """Makes python-can use this class for the interface "slcan", in this process."""
    can.interfaces.BACKENDS["slcan"] = (__name__, SlcanBus.__name__)
