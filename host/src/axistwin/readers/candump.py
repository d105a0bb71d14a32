"""Reading candump logs (`candump -L`): all lines of one layout at once, a million in a second.

    (1700000000.000000) vcan0 181#3412C01DFEFF350C R

What cannot be read is counted and left out, and what comes after it is read: this is the format
that a log is written in while it is being made, so a file may end, or go on, anywhere.
"""

from __future__ import annotations

import gzip
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np
import numpy.typing as npt

from axistwin.contract import PAYLOAD, PAYLOAD_FD
from axistwin.frames import Frames

# Files are read and text is dealt with in pieces of these sizes.
_READ, _CHUNK = 1 << 16, 1 << 24

# No line is longer: time, 15 characters of the interface's name, an FD frame, a 29-bit identifier.
_LINE_MAX = 256

# A time of arrival has up to so many digits of seconds, and always six of microseconds.
_SECONDS_MAX = 12
_MICROSECONDS = 6

_STANDARD, _EXTENDED = 3, 8  # digits of an identifier
_ERROR_FLAG = 0x20000000  # in an extended one: an error frame

_NEWLINE, _RETURN, _SPACE, _HASH, _OPEN, _CLOSE, _DOT, _REMOTE = b"\n\r #().R"

_Bytes = npt.NDArray[np.uint8]
_Indices = npt.NDArray[np.int64]
_Flags = npt.NDArray[np.bool_]

# Value of a hexadecimal digit, 255 for anything else.
_HEX = np.full(256, 255, np.uint8)
for _value, _digit in enumerate("0123456789abcdef"):
    _HEX[[ord(_digit), ord(_digit.upper())]] = _value


def read(path: Path) -> tuple[Frames, tuple[str, ...]]:
    """The frames of a candump log, gzip or not, and what is wrong with it.

    Raises OSError when it cannot be read at all. Cost: O(size).
    """
    pieces: list[Frames] = []
    warnings: list[str] = []
    damaged, rest = 0, b""
    with gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb") as file:
        for chunk in _chunks(file, warnings):
            whole, end, rest = (rest + chunk).rpartition(b"\n")
            frames, wrong = _parse(np.frombuffer(whole + end, np.uint8))
            pieces.append(frames)
            damaged += wrong
            if len(rest) > _LINE_MAX:  # no candump log: do not gather it all
                damaged, rest = damaged + 1, b""
    if damaged > 0:
        warnings.append(f"{damaged} lines of the log are damaged: left out")
    if rest:
        warnings.append("the log ends in the middle of a line: left out")
    return Frames.joined(pieces), tuple(warnings)


def _chunks(file: BinaryIO | gzip.GzipFile, warnings: list[str]) -> Iterator[bytes]:
    """What a file holds in pieces, up to where it ends or cannot be unpacked any more."""
    parts: list[bytes] = []
    try:
        while part := file.read(_READ):
            parts.append(part)
            if len(parts) * _READ >= _CHUNK:
                yield b"".join(parts)
                parts.clear()
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        warnings.append(f"the packed log is damaged ({error}): what follows is left out")
    yield b"".join(parts)


def _parse(text: _Bytes) -> tuple[Frames, int]:
    """The frames of whole lines, and how many lines are none."""
    ends = np.flatnonzero(text == _NEWLINE)
    starts = np.concatenate([[0], ends[:-1] + 1])[: len(ends)]
    ends = ends - ((ends > starts) & (text[ends - 1] == _RETURN))
    filled = ends > starts
    starts, ends = starts[filled], ends[filled]
    close, mark = _first(text, _CLOSE, starts), _first(text, _HASH, starts)
    fine = (text[starts] == _OPEN) & (close < mark) & (mark < ends) & (ends - starts <= _LINE_MAX)
    fine &= mark - starts > _MICROSECONDS + 2 + _EXTENDED  # nothing below looks before its line
    lines = len(starts)
    starts, ends, close, mark = (a[fine] for a in (starts, ends, close, mark))

    time, fine = _time(text, starts, close)
    standard = text[mark - _STANDARD - 1] == _SPACE
    extended = text[mark - _EXTENDED - 1] == _SPACE
    flexible = text[mark + 1] == _HASH
    begin = mark + np.where(flexible, 3, 1)
    ends = ends - 2 * ((ends - begin >= 2) & (text[ends - 2] == _SPACE))  # " R" or " T"
    remote = text[np.minimum(begin, len(text) - 1)] & 0xDF == _REMOTE
    digits = np.where(remote, 0, ends - begin)
    most = 2 * np.where(flexible, PAYLOAD_FD, PAYLOAD)
    fine &= (standard | extended) & (digits >= 0) & (digits <= most) & (digits % 2 == 0)
    identifier, number = _number(text, mark, np.where(standard, _STANDARD, _EXTENDED))
    fine &= number
    wanted = fine & standard & ~remote
    payload, number = _payload(text, begin, np.where(wanted, digits, 0))
    fine &= number
    errors = fine & ~standard & (identifier & _ERROR_FLAG != 0)
    chosen = fine & wanted
    frames = Frames(
        time[chosen],
        identifier[chosen],
        digits[chosen] // 2,
        payload[chosen],
        int(np.count_nonzero(errors)),
    )
    return frames, lines - int(np.count_nonzero(fine))


def _first(text: _Bytes, character: int, starts: _Indices) -> _Indices:
    """Where a character comes first from these places on; the end of the text if it does not."""
    places = np.append(np.flatnonzero(text == character), len(text))
    found: _Indices = places[np.searchsorted(places, starts)]
    return found


def _time(
    text: _Bytes, starts: _Indices, close: _Indices
) -> tuple[npt.NDArray[np.float64], _Flags]:
    """The numbers between parentheses, and whether they are any."""
    dot = close - _MICROSECONDS - 1
    before = dot - starts - 1
    fine = (before >= 1) & (before <= _SECONDS_MAX)
    dot = np.where(fine, dot, starts)
    fine &= text[dot] == _DOT
    total = np.zeros(len(starts), np.int64)
    for place in range(_MICROSECONDS + _SECONDS_MAX):
        column = close - 1 - place - (place >= _MICROSECONDS)
        there = fine & (column > starts)
        digit = text[np.where(there, column, starts)].astype(np.int64) - ord("0")
        fine &= ~there | ((digit >= 0) & (digit <= 9))
        total += np.where(there, digit, 0) * 10**place
    return total / 10**_MICROSECONDS, fine


def _number(text: _Bytes, ends: _Indices, digits: _Indices) -> tuple[_Indices, _Flags]:
    """Hexadecimal numbers before these places, and whether they are any."""
    total, fine = np.zeros(len(ends), np.int64), np.ones(len(ends), bool)
    for place in range(int(digits.max(initial=0))):
        there = place < digits
        digit = _HEX[text[ends - 1 - place]]
        fine &= ~there | (digit < 16)
        total += np.where(there, digit, 0).astype(np.int64) << 4 * place
    return total, fine


def _payload(text: _Bytes, begins: _Indices, digits: _Indices) -> tuple[_Bytes, _Flags]:
    """Bytes from pairs of digits, (n, 8) or (n, 64), and whether they are any."""
    width = PAYLOAD if digits.max(initial=0) <= 2 * PAYLOAD else PAYLOAD_FD
    payload, fine = np.zeros((len(begins), width), np.uint8), np.ones(len(begins), bool)
    for many in np.unique(digits[digits > 0]).tolist():
        rows = np.flatnonzero(digits == many)
        value = _HEX[text[begins[rows, None] + np.arange(many)]]
        fine[rows] = np.all(value < 16, axis=1)
        payload[rows, : many // 2] = (value[:, ::2] << 4) | (value[:, 1::2] & 15)
    return payload, fine
