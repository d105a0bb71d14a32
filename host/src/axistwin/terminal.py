"""What a command says to the person in front of it: notes and a live line, on standard error."""

from __future__ import annotations

import sys
import time


class Terminal:
    """Notes, each on a line of its own, and one line that is written over and over.

    Where standard error is no terminal the live line appears once every ``quiet_interval`` seconds.
    """

    def __init__(self, live_interval: float = 0.25, quiet_interval: float = 10.0) -> None:
        self._overwrites = sys.stderr.isatty()
        self._interval = live_interval if self._overwrites else quiet_interval
        self._last = time.monotonic() if not self._overwrites else 0.0
        self._width = 0

    def note(self, text: str) -> None:
        """A line that stays."""
        self.clear()
        print(text, file=sys.stderr, flush=True)

    def due(self) -> bool:
        """Is it time for the live line?"""
        return time.monotonic() - self._last >= self._interval

    def live(self, text: str) -> None:
        """Replaces the live line."""
        self._last = time.monotonic()
        if self._overwrites:
            print("\r" + text.ljust(self._width), end="", file=sys.stderr, flush=True)
            self._width = len(text)
        else:
            print(text, file=sys.stderr, flush=True)

    def clear(self) -> None:
        """Makes room for something else."""
        if self._width > 0:
            print("\r" + " " * self._width + "\r", end="", file=sys.stderr, flush=True)
            self._width = 0
