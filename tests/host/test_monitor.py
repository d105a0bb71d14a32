"""What is seen of a live stream while it comes in, and the bus load."""

from __future__ import annotations

import can
import pytest
from hypothesis import given
from hypothesis import strategies as st

from axistwin.contract import load_contract
from axistwin.monitor import BusLoad, StreamMonitor, fd_frame_bits, frame_bits

from .test_frames import Axis, stream
from .test_log_durability import messages_of
from .test_stream_faults import classical, flexible, taken

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


@pytest.mark.parametrize(
    ("length", "extended", "nominal", "data"),
    [(0, False, 33, 34), (8, False, 33, 114), (64, False, 33, 679), (64, True, 56, 680)],
)
def test_an_fd_frame_has_the_bits_that_the_standard_says(
    length: int, extended: bool, nominal: int, data: int
) -> None:
    """Counted by hand from the frame's figure in ISO 11898-1:2015, all stuff bits included."""
    assert fd_frame_bits(length, extended) == (nominal, data)


def test_the_load_is_the_share_of_time_that_frames_take(monkeypatch: pytest.MonkeyPatch) -> None:
    now = 100.0
    monkeypatch.setattr("axistwin.monitor.time.monotonic", lambda: now)
    load = BusLoad(1_000_000, 5_000_000)
    frames = list(messages_of(flexible(600).sent))  # 100 of 64 bytes
    for message in frames:
        load(message)
    now += 0.5
    assert load.recent() == pytest.approx(100 * (33 + 679) * 1e-6 / 0.5)
    for message in frames:
        message.bitrate_switch = True
        load(message)
    now += 0.5
    assert load.recent() == pytest.approx(100 * (33e-6 + 679 * 0.2e-6) / 0.5)
    assert load.mean() == pytest.approx(100 * (2 * 33e-6 + 679 * 1.2e-6) / 1.0)
    now += 1.0
    assert load.recent() == 0.0


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


@given(st.integers(0, 65535), st.sets(st.integers(1, 98), max_size=20))
def test_samples_of_an_fd_stream_are_counted(counter: int, lost: set[int]) -> None:
    monitor = StreamMonitor(CONTRACT, 1)
    sent = flexible(600, counter).sent
    for message in messages_of(taken(sent, [i for i in range(100) if i not in lost])):
        monitor(message)
    assert (monitor.samples, monitor.lost) == (600 - 6 * len(lost), 6 * len(lost))


def test_a_damaged_counter_is_one_lost_sample_and_a_new_beginning_none() -> None:
    monitor = StreamMonitor(CONTRACT, 1)
    sent = list(messages_of(classical(200, 500).sent))
    sent[100].data[1] ^= 0x80
    for message in [*sent, *messages_of(classical(200, 40_000).sent)]:
        monitor(message)
    assert monitor.lost == 1
    assert monitor.samples == 200 - 1 + 200
