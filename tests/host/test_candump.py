"""Candump logs, read a million lines a second: as python-can reads them, and past any damage."""

from __future__ import annotations

import gzip
from pathlib import Path

import can
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from axistwin.errors import InputError
from axistwin.frames import Frames
from axistwin.readers import buslog, candump

LENGTHS_FD = (*range(9), 12, 16, 20, 24, 32, 48, 64)


@st.composite
def messages(draw: st.DrawFn) -> can.Message:
    """Any frame that a bus carries."""
    flexible, extended = draw(st.booleans()), draw(st.booleans())
    length = draw(st.sampled_from(LENGTHS_FD if flexible else LENGTHS_FD[:9]))
    return can.Message(
        timestamp=draw(st.integers(0, 10**16)) / 1e6,
        arbitration_id=draw(st.integers(0, 0x1FFFFFFF if extended else 0x7FF)),
        is_extended_id=extended,
        is_fd=flexible,
        is_remote_frame=not flexible and draw(st.booleans()),
        is_error_frame=draw(st.integers(0, 9)) == 0,
        bitrate_switch=flexible and draw(st.booleans()),
        is_rx=draw(st.booleans()),
        channel=draw(st.sampled_from(["vcan0", "can1", "a-name-of-15-ch"])),
        data=draw(st.binary(min_size=length, max_size=length)),
    )


def in_order(sent: list[can.Message]) -> list[can.Message]:
    return sorted(sent, key=lambda message: message.timestamp)


def written(sent: list[can.Message], folder: Path) -> Path:
    """A log of these messages by python-can."""
    file = folder / "bus.log"
    with can.Logger(file) as writer:
        for message in sent:
            writer(message)
    return file


def same(found: Frames, expected: Frames) -> None:
    for name in ("time", "identifier", "length", "payload"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    assert found.errors == expected.errors


@given(st.lists(messages(), max_size=30).map(in_order))
def test_it_is_read_as_python_can_reads_it(
    tmp_path_factory: pytest.TempPathFactory, sent: list[can.Message]
) -> None:
    file = written(sent, tmp_path_factory.mktemp("candump"))
    found, warnings = candump.read(file)
    assert warnings == ()
    with can.LogReader(file) as reader:
        same(found, Frames.of(reader))


@given(st.lists(messages(), min_size=1, max_size=8).map(in_order), st.data())
def test_a_log_cut_anywhere_is_read_up_to_its_last_whole_line(
    tmp_path_factory: pytest.TempPathFactory, sent: list[can.Message], data: st.DataObject
) -> None:
    file = written(sent, tmp_path_factory.mktemp("candump"))
    whole = file.read_bytes()
    cut = data.draw(st.integers(0, len(whole)))
    file.write_bytes(whole[:cut])
    found, warnings = candump.read(file)
    lines = whole[:cut].count(b"\n")
    same(found, Frames.of(can.CanutilsLogReader(written(sent[:lines], file.parent))))
    assert ("the log ends in the middle of a line: left out" in warnings) == (
        not whole[:cut].endswith(b"\n") and cut > 0
    )


@given(
    st.lists(messages(), min_size=1, max_size=20).map(in_order),
    st.dictionaries(
        st.integers(0, 19),
        st.binary(min_size=1, max_size=300).map(lambda b: b.replace(b"\n", b"?")),
        min_size=1,
    ),
)
def test_damaged_lines_are_counted_and_what_follows_is_read(
    tmp_path_factory: pytest.TempPathFactory, sent: list[can.Message], garbage: dict[int, bytes]
) -> None:
    file = written(sent, tmp_path_factory.mktemp("candump"))
    clean = Frames.of(can.CanutilsLogReader(file))
    lines = file.read_bytes().splitlines(keepends=True)
    for place, text in sorted(garbage.items(), reverse=True):
        lines.insert(min(place, len(lines)), b"~" + text + b"\n")
    file.write_bytes(b"".join(lines))
    found, warnings = candump.read(file)
    same(found, clean)
    assert warnings == (f"{len(garbage)} lines of the log are damaged: left out",)


@given(st.lists(st.binary(max_size=60), max_size=20))
def test_lines_that_look_like_frames_do_no_harm(
    tmp_path_factory: pytest.TempPathFactory, pieces: list[bytes]
) -> None:
    """Anything between the marks that the reader looks for."""
    file = tmp_path_factory.mktemp("candump") / "bus.log"
    text = b""
    for piece in pieces:
        text += b"(1.000000) c 181#" + piece + b"\n(" + piece + b") c 181#00\n" + piece + b"##\r\n"
    file.write_bytes(text)
    found, _ = candump.read(file)
    assert len(found) <= text.count(b"\n")
    assert np.all(np.isfinite(found.time))
    assert np.all((found.identifier >= 0) & (found.identifier <= 0x7FF))
    assert np.all(found.length <= found.payload.shape[1])


def test_a_log_longer_than_a_piece_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sent = [
        can.Message(timestamp=1e9 + i, arbitration_id=i % 2048, data=bytes([i % 256] * (i % 9)))
        for i in range(3000)
    ]
    for message in sent:
        message.is_extended_id = False
    file = written(sent, tmp_path)
    monkeypatch.setattr(candump, "_READ", 100)
    monkeypatch.setattr(candump, "_CHUNK", 1000)
    found, warnings = candump.read(file)
    same(found, Frames.of(sent))
    assert warnings == ()


def test_a_packed_log_that_was_cut_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    line = b"(1700000000.%06d) vcan0 181#3412C01DFEFF350C R\n"
    file = tmp_path / "bus.log.gz"
    packed = gzip.compress(b"".join(line % i for i in range(200_000)))
    file.write_bytes(packed[: len(packed) // 2])
    found, damage = buslog.read_frames(file)
    assert 50_000 < len(found) < 150_000
    assert np.all(np.diff(found.time) > 0.0)
    assert any("the packed log is damaged" in text for text in damage)
    file.write_bytes(packed[:5])
    with pytest.raises(InputError, match="the packed log is damaged"):
        buslog.read_frames(file)
