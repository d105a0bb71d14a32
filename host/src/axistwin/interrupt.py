"""Ctrl-C that waits until what is in hand has been put down."""

from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Iterator
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class Interrupts:
    """SIGINT and SIGTERM: they raise KeyboardInterrupt, but inside held() only at its end.

    Without that, one that comes between the reading of a message and its place in a log would lose
    the message.
    """

    def __init__(self) -> None:
        self._held = False
        self._pending = False

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """What runs inside is not interrupted half way."""
        self._held = True
        try:
            yield
        finally:
            self._held = False
        if self._pending:
            self._pending = False
            raise KeyboardInterrupt

    def _take(self, _signal: int, _frame: FrameType | None) -> None:
        if not self._held:
            raise KeyboardInterrupt
        self._pending = True

    @contextlib.contextmanager
    def taken(self) -> Iterator[Interrupts]:
        """They are dealt with here inside; one that is ignored, as in the background, stays so."""
        before = {number: signal.getsignal(number) for number in _SIGNALS}
        heeded = [number for number in _SIGNALS if before[number] is not signal.SIG_IGN]
        if threading.current_thread() is not threading.main_thread():
            heeded = []  # only the main thread gets signals
        for number in heeded:
            signal.signal(number, self._take)
        try:
            yield self
        finally:
            for number in heeded:
                signal.signal(number, before[number])
