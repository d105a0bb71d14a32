"""What is seen of a live stream while it comes in, and the bus load."""

from __future__ import annotations

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from axistwin.contract import load_contract
from axistwin.monitor import StreamMonitor, frame_bits

from .test_frames import Axis, stream

CONTRACT = load_contract()


@pytest.mark.parametrize(
    ("length", "extended", "least", "most"),
    [(0, False, 47, 55), (8, False, 111, 135), (8, True, 131, 160)],
)
def test_a_frame_has_the_bits_that_the_standard_says(
    length: int, extended: bool, least: int, most: int
) -> None:
    """ISO 11898-1: the frame without stuff bits and the space after it, and with all of them."""
    stuffable = least - 13
    assert frame_bits(length, extended) == most
    assert most - least == (stuffable - 1) // 4


@given(st.integers(0, 65535), st.sets(st.integers(2, 397), max_size=40))
def test_samples_of_which_a_frame_is_missing_are_counted(counter: int, lost: set[int]) -> None:
    monitor = StreamMonitor(CONTRACT, 1)
    for i, message in enumerate(stream(Axis(200), counter)):
        if i not in lost:
            monitor(message)
    assert monitor.lost == len({i // 2 for i in lost})
    assert monitor.samples == 200 - len([i for i in lost if i % 2 == 0])


def test_late_and_doubled_frames_are_not_lost_and_not_counted_twice() -> None:
    monitor = StreamMonitor(CONTRACT, 1)
    sent = stream(Axis(100))
    sent[20], sent[26] = sent[26], sent[20]
    sent.insert(50, sent[48])
    for message in sent:
        monitor(message)
    assert monitor.lost == 0
    assert monitor.samples == 100


def test_a_node_that_has_been_away_has_not_lost_what_it_did_not_send() -> None:
    monitor = StreamMonitor(CONTRACT, 1)
    for message in [*stream(Axis(10))[:12], *stream(Axis(10))[14:]]:
        monitor(message)
    monitor.start_afresh()
    for message in stream(Axis(10), counter=500):
        monitor(message)
    assert monitor.lost == 1
    assert monitor.samples == 19


def test_frames_of_others_do_not_count() -> None:
    monitor = StreamMonitor(CONTRACT, 1)
    for message in stream(Axis(10), node=2):
        monitor(message)
    monitor(can.Message(is_error_frame=True, arbitration_id=0x181))
    monitor(can.Message(arbitration_id=0x181, data=b"123", is_extended_id=False))
    assert (monitor.samples, monitor.lost) == (0, 0)
