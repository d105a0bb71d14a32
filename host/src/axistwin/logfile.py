"""A bus log while it is being made: whatever happens, what came up to a second before is kept.

Of the formats for bus logs only lines of text can be read however they end. MF4 has its index at
the end and is nothing without it, SQLite gives wrong numbers where pages are missing, BLF is
written in containers. So every log is first written as candump does, and the other formats are made
of that when it is complete.
"""

from __future__ import annotations

from pathlib import Path
from typing import TextIO, cast

import can
import numpy as np

from axistwin.errors import AxisTwinError, FileError, InputError
from axistwin.journal import Journal
from axistwin.output import atomic_write
from axistwin.readers import buslog
from axistwin.terminal import Terminal

# The format that a log is written in while it is being made.
_ENDING = ".log"

# Converting says how far it is once in so many frames.
_PROGRESS = 20_000


class LogFile:
    """A log being written. Give it every message, check() it now and then, and close it.

    Until it is complete a log in another format than candump's is a candump log beside it. Raises
    InputError for an unknown ending, or where such a log has been left; FileError when the log
    cannot be written.
    """

    def __init__(self, path: Path, terminal: Terminal) -> None:
        buslog.check_writable(path)
        self.path = path
        self.journal = journal_of(path)
        self._terminal = terminal
        if self.journal != path and self.journal.exists():
            raise InputError(
                f"{self.journal} is there: a log that was not completed. Read it as it is or make "
                f"a {path.suffix} of it (can_logconvert {self.journal} {path}), then move it away"
            )
        self._file = Journal(self.journal)
        self._format = can.CanutilsLogWriter(cast(TextIO, self._file))

    def __enter__(self) -> LogFile:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __call__(self, message: can.Message) -> None:
        """Takes a message."""
        self._format(message)

    def check(self) -> None:
        """Raises FileError when the log can no longer be written."""
        self._file.check()

    def close(self) -> None:
        """Writes what is left, and the other format. Raises FileError when anything failed."""
        self._file.close()
        if self.journal != self.path:
            _convert(self.journal, self.path, self._terminal)


def journal_of(path: Path) -> Path:
    """Where a log is while it is being made."""
    return path if path.suffix.lower() == _ENDING else path.with_name(path.name + _ENDING)


def _convert(journal: Path, path: Path, terminal: Terminal) -> None:
    """Makes a log in another format of a candump log, and removes that once it reads the same."""
    try:
        with atomic_write(path) as partial:
            with buslog.writing(partial) as write, can.LogReader(journal) as messages:
                for count, message in enumerate(messages):
                    write(message)
                    if count % _PROGRESS == 0 and terminal.due():
                        terminal.live(f"making {path}: {count} frames")
            _check_same(journal, partial)
    except AxisTwinError as error:
        raise FileError(f"{error}; what was logged is in {journal}") from error
    terminal.clear()
    journal.unlink()


def _check_same(journal: Path, written: Path) -> None:
    """Raises FileError when what was written does not read as what was logged."""
    logged, copy = (buslog.read_frames(file)[0] for file in (journal, written))
    same = len(logged) == len(copy) and all(
        np.array_equal(getattr(logged, name), getattr(copy, name))
        for name in ("identifier", "length", "payload")
    )
    if not same:
        raise FileError(f"{written.suffix} logs do not hold all of these frames")
