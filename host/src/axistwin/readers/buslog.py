"""Bus logs: whatever python-can reads, decoded to a record by the contract; and writing them."""

from __future__ import annotations

import contextlib
import importlib.util
import io
import sqlite3
from collections.abc import Iterator
from pathlib import Path

import can
from can.io.generic import MessageReader, TextIOMessageReader
from can.io.logger import MESSAGE_WRITERS
from can.io.player import MESSAGE_READERS

from axistwin.contract import Contract
from axistwin.errors import FileError, InputError
from axistwin.frames import Frames, Settings, decode
from axistwin.readers import candump
from axistwin.record import Record

_INSTALL_MF4 = "MF4 takes a further package: pip install 'axistwin[mf4]'"

_CSV_HEADER = "timestamp,arbitration_id"


def endings() -> tuple[str, ...]:
    """Endings of the names of files that python-can reads."""
    return (*MESSAGE_READERS, ".gz")


def writable_endings() -> tuple[str, ...]:
    """Endings of the names of files that python-can writes, and reads back whole.

    Its SQLite writer does not bring everything to the file when it is stopped.
    """
    return tuple(
        ending for ending in MESSAGE_WRITERS if ending in MESSAGE_READERS and ending != ".db"
    )


def is_csv_log(path: Path) -> bool:
    """Is this CSV file one that python-can wrote?"""
    with path.open("rb") as file:
        return file.read(len(_CSV_HEADER)) == _CSV_HEADER.encode()


def read(path: Path, contract: Contract, settings: Settings, part: str | None) -> Record:
    """The record in a bus log; see axistwin.frames.decode(). Raises InputError."""
    frames, damage = read_frames(path)
    return decode(frames, contract, str(path), settings, part, damage)


def read_frames(path: Path) -> tuple[Frames, tuple[str, ...]]:
    """All frames of a bus log, and a warning if it ends in something that cannot be read.

    Raises InputError when there is nothing to be read at all.
    """
    damage: list[str] = []
    if path.name.lower().endswith((".log", ".log.gz")):
        frames = _candump(path, damage)
    else:
        frames = Frames.of(messages(path, damage))
    if len(frames) == 0 and frames.errors == 0:
        reason = damage[0] if damage else "it holds no data frames with 11-bit ids"
        raise InputError(f"cannot read {path}: {reason}")
    return frames, tuple(damage)


def _candump(path: Path, damage: list[str]) -> Frames:
    """The frames of a candump log."""
    try:
        frames, found = candump.read(path)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    damage += found
    return frames


class _WholeLines(io.TextIOWrapper):
    """Lines of text; a last one without its end is left out: a number in it may be cut off."""

    cut = False

    def __next__(self) -> str:  # type: ignore[override]  # as in TextIOWrapper itself
        line: str = super().__next__()
        if not line.endswith("\n"):
            self.cut = bool(line.strip())
            raise StopIteration
        return line


def messages(path: Path, damage: list[str]) -> Iterator[can.Message]:
    """The messages of a bus log up to its end, or to where it is damaged: ``damage`` says why."""
    count = 0
    try:
        with _reader(path) as reader:
            for message in reader:
                yield message
                count += 1
            if isinstance(reader, can.BLFReader) and reader.file_size != path.stat().st_size:
                damage.append("the log was cut off or not closed: it is read as far as it goes")
            if isinstance(reader, TextIOMessageReader) and getattr(reader.file, "cut", False):
                damage.append("the log ends in the middle of a line: left out")
    except NotImplementedError:
        damage.append(_INSTALL_MF4)
    except Exception as error:  # each of python-can's readers stumbles in its own way
        reason = " ".join(str(error).split())[:100] or type(error).__name__
        damage.append(
            f"the log is damaged after {count} frames ({reason}): what follows is left out"
            if count > 0
            else reason
        )


def _reader(path: Path) -> MessageReader:
    ending = path.suffix.lower()
    kind = MESSAGE_READERS.get(ending)
    if ending == ".db":
        _check_database(path)
    if kind is None or not issubclass(kind, TextIOMessageReader):
        return can.LogReader(path)
    return kind(_WholeLines(path.open("rb"), encoding="utf-8", errors="replace"))


def _check_database(path: Path) -> None:
    """SQLite reads on where pages are missing, and gives wrong numbers: ask it first."""
    with contextlib.closing(
        sqlite3.connect(f"{path.resolve().as_uri()}?mode=ro", uri=True)
    ) as file:
        found = file.execute("PRAGMA quick_check(1)").fetchone()[0]
    if found != "ok":
        raise InputError(f"the database is damaged ({found})")


def check_writable(path: Path) -> None:
    """Raises InputError when the ending of this name is not that of a bus log."""
    ending = path.suffix.lower()
    if ending not in writable_endings():
        known = " ".join(sorted(writable_endings()))
        raise InputError(f"cannot write {path}: its ending is none of {known}")
    if ending == ".mf4" and importlib.util.find_spec("asammdf") is None:
        raise InputError(f"cannot write {path}: {_INSTALL_MF4}")


@contextlib.contextmanager
def writing(path: Path) -> Iterator[can.Listener]:
    """A new bus log as a receiver of messages; its ending says in which format.

    Raises InputError for an unknown ending, FileError when the file cannot be written.
    """
    try:
        writer = can.Logger(path)
    except ValueError as error:
        raise InputError(f"cannot write {path}: {error}") from error
    except NotImplementedError:
        raise InputError(f"cannot write {path}: {_INSTALL_MF4}") from None
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror}") from error
    try:
        try:
            yield writer
        finally:
            writer.stop()
    except OSError as error:
        raise FileError(f"cannot write {path}: {error.strerror or error}") from error
