"""A text file that keeps what came up to a second before, whatever ends its writing.

A thread of its own does all writing: a disk that is busy holds up no receiving.
"""

from __future__ import annotations

import errno
import os
import threading
from collections import deque
from pathlib import Path

from axistwin.errors import FileError

# What has come is given to the operating system, and by it to the disk, this often [s].
_INTERVAL = 0.25


class Journal:
    """Lines being written to a new file. check() it now and then, and close() it, or use it as a
    context manager.

    Raises FileError when the file cannot be written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_CLOEXEC
        try:
            self._file = os.open(path, flags, 0o666)
        except OSError as error:
            raise FileError(f"cannot write {path}: {error.strerror}") from error
        self._lines: deque[str] = deque()
        self._failure: str | None = None
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, name="journal", daemon=True)
        self._thread.start()

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, line: str) -> None:
        """Takes a line, its end included. What comes after a failure is dropped."""
        if self._failure is None:
            self._lines.append(line)

    def check(self) -> None:
        """Raises FileError when the file can no longer be written."""
        if self._failure is not None:
            raise FileError(self._failure)

    def close(self) -> None:
        """Writes what is left. Raises FileError when anything failed."""
        self._ended.set()
        self._thread.join()
        os.close(self._file)
        self.check()

    def _run(self) -> None:
        try:
            ended = False
            while not ended:
                ended = self._ended.wait(_INTERVAL)
                self._save()
        except OSError as error:
            reason = error.strerror or str(error)
            self._failure = f"cannot write {self.path}: {reason}; what came before is in it"

    def _save(self) -> None:
        """Brings what has come to the disk, and sees to it that the file is still there."""
        text = "".join(self._lines.popleft() for _ in range(len(self._lines))).encode()
        while text:
            text = text[os.write(self._file, text) :]
        try:
            os.fdatasync(self._file)
        except OSError as error:
            if error.errno not in (errno.EINVAL, errno.ENOTSUP):  # a pipe, or a device
                raise
        if not self._is_there():
            raise FileNotFoundError(errno.ENOENT, "it was removed, or its file system has gone")

    def _is_there(self) -> bool:
        try:
            return os.path.samestat(os.fstat(self._file), self.path.stat())
        except FileNotFoundError:
            return False
