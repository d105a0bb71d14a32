"""SLCAN read in chunks: whatever the pieces in which it comes, the frames are the same."""

from __future__ import annotations

import os
import pty
import tty
from collections.abc import Iterator

import can
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from axistwin import slcan


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(st.data())
def test_frames_do_not_depend_on_the_pieces_that_they_come_in(data: st.DataObject) -> None:
    frames = data.draw(
        st.lists(st.tuples(st.integers(0, 0x7FF), st.binary(max_size=8)), min_size=1, max_size=20)
    )
    line = b"".join(
        f"t{identifier:03X}{len(payload)}{payload.hex().upper()}\r".encode()
        + data.draw(st.sampled_from([b"", b"\r", b"\a", b"z\r"]))
        for identifier, payload in frames
    )
    slcan.register()
    master, slave = pty.openpty()
    tty.setraw(slave)
    try:
        with can.Bus(os.ttyname(slave), "slcan", sleep_after_open=0.0) as bus:
            assert isinstance(bus, slcan.SlcanBus)
            found = []
            begin = 0
            while begin < len(line):
                end = begin + data.draw(st.integers(1, 40))
                os.write(master, line[begin:end])
                begin = end
                while (message := bus.recv(0.002)) is not None:
                    found.append((message.arbitration_id, bytes(message.data)))
            while (message := bus.recv(0.05)) is not None:
                found.append((message.arbitration_id, bytes(message.data)))
            assert found == frames
    finally:
        os.close(master)
        os.close(slave)


@pytest.fixture(scope="module")
def bus() -> Iterator[slcan.SlcanBus]:
    """A bus at the other end of which nobody says anything."""
    slcan.register()
    master, slave = pty.openpty()
    tty.setraw(slave)
    with can.Bus(os.ttyname(slave), "slcan", sleep_after_open=0.0) as opened:
        assert isinstance(opened, slcan.SlcanBus)
        yield opened
    os.close(master)
    os.close(slave)


def lines_of_anything() -> st.SearchStrategy[bytes]:
    """Bytes, and what begins as a frame does."""
    like = st.builds(
        lambda kind, rest: kind + rest.encode(),
        st.sampled_from([b"t", b"T", b"r", b"R", b"d", b"D", b"b", b"B", b"x", b"V", b"N", b"F"]),
        st.text("0123456789ABCDEFabcdef", max_size=200),
    )
    return st.one_of(st.binary(max_size=300), like).map(lambda line: line.replace(b"\r", b"?"))


@given(st.lists(lines_of_anything(), max_size=6))
@settings(deadline=None)
def test_garbled_lines_are_refused_and_the_next_frame_is_read(
    bus: slcan.SlcanBus, garbage: list[bytes]
) -> None:
    bus._buffer.clear()
    for line in garbage:
        bus._buffer.extend(line + b"\r")
    bus._buffer.extend(b"t1232BEEF\r")
    message = None
    for _ in range(1000):
        try:
            message = bus.recv(0.0) or message
        except (ValueError, IndexError):  # what a node and a monitor count as an error
            continue
        if not bus._buffer:
            break
    assert message is not None
    assert (message.arbitration_id, bytes(message.data)) == (0x123, b"\xbe\xef")


def test_a_line_that_does_not_end_takes_no_room(bus: slcan.SlcanBus) -> None:
    bus._buffer.clear()
    for _ in range(1000):
        bus._buffer.extend(b"t" * 1000)
        with pytest.raises(ValueError, match="a line without an end"):
            bus.recv(0.0)
        assert len(bus._buffer) == 0
