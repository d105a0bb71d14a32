"""Everything that can happen to a stream on its way: nothing of it goes unnoticed.

Frames are packed here by NumPy's structured types, from docs/wire.md and not by what is tested.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin import frames
from axistwin.contract import load_contract
from axistwin.errors import InputError
from axistwin.frames import Frames, Settings
from axistwin.record import Record

from .test_frames import RATED, RESOLUTION, identity

CONTRACT = load_contract()
MOTOR, TABLE, SAMPLES = 0x181, 0x281, 0x401
MANY = 6  # samples in an FD frame
STEP = 1e-3
BEGIN = 1_700_000_000.0
KNOWN = Settings(None, STEP, RATED, (RESOLUTION, RESOLUTION))

HALF = np.dtype([("counter", "<u2"), ("position", "<i4"), ("last", "<i2")])
SAMPLE = np.dtype([("motor", "<i4"), ("table", "<i4"), ("torque", "<i2")])
WHOLE = np.dtype([("counter", "<u2"), ("status", "<u2"), ("samples", SAMPLE, MANY)])

Times = npt.NDArray[np.float64]
Kind = Callable[..., "Stream"]


@dataclass
class Stream:
    """Frames on their way, and what the axis did: (n,) raw torque, (n, 2) counts."""

    torque: npt.NDArray[np.int64]
    counts: npt.NDArray[np.int64]
    sent: Frames
    samples_a_frame: int

    def frames_of(self, sample: int) -> list[int]:
        """Which frames carry a sample."""
        if self.samples_a_frame == 1:
            return [2 * sample, 2 * sample + 1]
        return [sample // self.samples_a_frame]

    def samples_of(self, frame: int) -> range:
        """Which samples a frame carries."""
        if self.samples_a_frame == 1:
            return range(frame // 2, frame // 2 + 1)
        return range(frame * self.samples_a_frame, (frame + 1) * self.samples_a_frame)

    def check(self, record: Record, first: int = 0) -> None:
        """Every sample of the record that is not missing is what the axis did, to the bit."""
        there = np.setdiff1d(np.arange(len(record)), record.missing)
        torque = np.rint(record.torque[there] / (RATED * 1e-4)).astype(np.int64)
        np.testing.assert_array_equal(torque, self.torque[first + there])
        assert record.theta2 is not None
        for angle, counts in zip((record.theta1, record.theta2), self.counts.T, strict=True):
            found = np.rint(angle[there] * RESOLUTION / (2.0 * np.pi)).astype(np.int64)
            np.testing.assert_array_equal(np.diff(found), np.diff(counts[first + there]))


def motion(n: int, seed: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    random = np.random.default_rng(seed)
    torque = random.integers(-3000, 3000, n)
    return torque, 2**31 - 1000 + np.cumsum(random.integers(-50, 300, (n, 2)), axis=0)


def classical(n: int, counter: int = 0, seed: int = 0, step: float = STEP) -> Stream:
    """Motor and Table frames, one sample each."""
    torque, counts = motion(n, seed)
    packed = np.zeros((n, 2), HALF)
    packed["counter"] = ((counter + np.arange(n)) % 65536)[:, None]
    packed["position"] = counts.astype(np.int32)
    packed["last"][:, 0], packed["last"][:, 1] = torque, 0x0237
    times = BEGIN + step * np.arange(n)[:, None] + [0.0, 1e-4 * step / STEP]
    payload = packed.view(np.uint8).reshape(-1, 8)
    identifier = np.tile([MOTOR, TABLE], n)
    sent = Frames(times.ravel(), identifier, np.full(2 * n, 8), payload, 0)
    return Stream(torque, counts, sent, 1)


def flexible(n: int, counter: int = 0, seed: int = 0, step: float = STEP) -> Stream:
    """Samples frames of CAN FD; n is rounded to whole frames."""
    many = n // MANY
    n = many * MANY
    torque, counts = motion(n, seed)
    packed = np.zeros(many, WHOLE)
    packed["counter"] = (counter + MANY * np.arange(many)) % 65536
    packed["samples"]["motor"] = counts[:, 0].astype(np.int32).reshape(-1, MANY)
    packed["samples"]["table"] = counts[:, 1].astype(np.int32).reshape(-1, MANY)
    packed["samples"]["torque"] = torque.reshape(-1, MANY)
    times = np.asarray(BEGIN + step * MANY * np.arange(many), np.float64)
    payload = packed.view(np.uint8).reshape(-1, 64)
    sent = Frames(times, np.full(many, SAMPLES), np.full(many, 64), payload, 0)
    return Stream(torque, counts, sent, MANY)


kinds = pytest.mark.parametrize("kind", [classical, flexible])


def taken(sent: Frames, rows: npt.ArrayLike) -> Frames:
    """These frames, in this order; they arrive when as many frames would have."""
    index = np.asarray(rows, np.int64)
    return Frames(
        np.sort(sent.time[index]),
        sent.identifier[index],
        sent.length[index],
        sent.payload[index],
        sent.errors,
    )


def at(sent: Frames, times: Times) -> Frames:
    """The same frames at other times of arrival."""
    return Frames(times, sent.identifier, sent.length, sent.payload, sent.errors)


def together(*several: Frames) -> Frames:
    """All frames in the order of their arrival."""
    joined = Frames.joined(several)
    return taken(joined, np.argsort(joined.time, kind="stable"))


def decode(sent: Frames, known: Settings = KNOWN) -> Record:
    return frames.decode(sent, CONTRACT, "made here", known, "stream")


def attempt(sent: Frames) -> tuple[Record | None, str]:
    """The record, or why there is none."""
    try:
        return decode(sent), ""
    except InputError as error:
        return None, str(error)


def late(times: Times, seed: int, busy: float = 1.0) -> Times:
    """Times of arrival at a host that is ``busy`` for so long, several times: frames pile up."""
    random = np.random.default_rng(seed)
    found = times + random.exponential(2e-4, len(times))
    for begin in random.uniform(times[0], times[-1], 4):
        found = np.where((found > begin) & (found < begin + busy), begin + busy, found)
    return np.maximum.accumulate(found)


@kinds
@given(st.integers(0, 65535), st.floats(0.0, 0.25), st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_exactly_the_samples_that_were_lost_are_missing(
    kind: Kind, counter: int, share: float, seed: int
) -> None:
    stream = kind(3000, counter, seed)
    random = np.random.default_rng(seed)
    lost = np.flatnonzero(random.random(len(stream.sent)) < share)
    kept = np.setdiff1d(np.arange(len(stream.sent)), lost)
    record = decode(taken(stream.sent, kept))
    gone = sorted({sample for frame in lost.tolist() for sample in stream.samples_of(frame)})
    whole = np.setdiff1d(np.arange(len(stream.torque)), gone)
    first, last = int(whole[0]), int(whole[-1])
    assert len(record) == last - first + 1
    assert record.missing.tolist() == [i - first for i in gone if first < i < last]
    assert record.meta["frames"]["missing"] == len(record.missing)
    assert any("are missing" in text for text in record.warnings) == (len(record.missing) > 0)
    stream.check(record, first)


@kinds
@pytest.mark.parametrize("gap", [65532, 65538, 100_002, 196_608])
@pytest.mark.parametrize("ppm", [0.0, 300.0])
def test_a_gap_longer_than_a_turn_of_the_counter_is_counted_by_time(
    kind: Kind, gap: int, ppm: float
) -> None:
    """The node's clock is off, and the host was busy when the frames came back."""
    stream = kind(520_002, counter=60_000)
    clock: Times = BEGIN + (stream.sent.time - BEGIN) * (1.0 + 1e-6 * ppm)
    begin = 120_000
    rows = [stream.frames_of(begin)[0], stream.frames_of(begin + gap)[0]]
    kept = np.r_[0 : rows[0], rows[1] : len(stream.sent)]
    back = clock[rows[1]] + 0.4
    arrived = np.where((clock >= clock[rows[1]]) & (clock < back), back, clock)
    record = decode(taken(at(stream.sent, arrived), kept))
    np.testing.assert_array_equal(record.missing, np.arange(begin, begin + gap))
    assert any(f"{gap} in a row from {begin * STEP:g} s on" in text for text in record.warnings)
    stream.check(record)


@kinds
@given(st.integers(0, 2**32 - 1))
@settings(max_examples=25, deadline=None)
def test_doubled_and_overtaken_frames_are_put_right_and_counted(kind: Kind, seed: int) -> None:
    stream = kind(1200, 65_000, seed)
    random = np.random.default_rng(seed)
    n = len(stream.sent)
    order = np.argsort(np.arange(n) + random.uniform(0.0, 8.0, n), kind="stable")
    again = random.choice(n, n // 20, replace=False)
    rows = np.insert(order, again, order[again])
    record = decode(taken(stream.sent, rows))
    found = record.meta["frames"]
    assert (len(record), found["missing"], found["twice"]) == (len(stream.torque), 0, len(again))
    assert found["out_of_order"] > 0
    assert found["different"] == found["contradictory"] == 0
    stream.check(record)


@kinds
@given(st.integers(0, 2**32 - 1), st.sampled_from([-200.0, -35.0, 0.0, 35.0, 200.0]))
@settings(max_examples=20, deadline=None)
def test_the_clock_of_the_node_is_found_whatever_was_late(
    kind: Kind, seed: int, ppm: float
) -> None:
    stream = kind(30_000, seed=seed)
    clock: Times = BEGIN + (stream.sent.time - BEGIN) * (1.0 + 1e-6 * ppm)
    sent = together(Frames.of(identity(BEGIN - 0.1)), at(stream.sent, late(clock, seed)))
    record = decode(sent, Settings())
    assert len(record.missing) == 0
    found = record.meta["frames"]["clock"]
    assert found["drift_ppm"] == pytest.approx(ppm, abs=max(2.0, 5.0 * found["error_ppm"]))
    assert found["error_ppm"] < 10.0
    assert found["start"] == pytest.approx(BEGIN, abs=2e-3)
    assert record.time_step == pytest.approx(STEP * (1.0 + 1e-6 * ppm), rel=5e-6)
    said = [text for text in record.warnings if "clock" in text]
    assert len(said) == (ppm != 0.0)
    if ppm != 0.0:
        assert ("slower" if ppm > 0.0 else "faster") in said[0]
    stream.check(record)


@kinds
@pytest.mark.parametrize("share", [0.002, 0.05])
@pytest.mark.parametrize("seed", range(4))
def test_frames_with_a_damaged_counter_are_left_out_and_said(
    kind: Kind, share: float, seed: int
) -> None:
    stream = kind(20_000, 65_000, seed)
    random = np.random.default_rng(seed)
    n = len(stream.sent)
    hit = np.sort(random.choice(np.arange(50, n - 50), int(share * n), replace=False))
    payload = stream.sent.payload.copy()
    payload[hit, 0] ^= random.integers(1, 256, len(hit), np.uint8)
    payload[hit, 1] ^= random.integers(0, 256, len(hit), np.uint8)
    sent = stream.sent
    record = decode(Frames(sent.time, sent.identifier, sent.length, payload, 0))
    gone = np.unique([sample for frame in hit.tolist() for sample in stream.samples_of(frame)])
    there = np.setdiff1d(np.arange(len(record)), record.missing)
    # A damaged frame can only do harm where it takes the place of another one that was damaged.
    assert np.count_nonzero(np.isin(there, gone)) <= 1 + len(gone) // 20
    good = np.setdiff1d(there, gone)
    np.testing.assert_array_equal(
        np.rint(record.torque[good] / (RATED * 1e-4)).astype(np.int64), stream.torque[good]
    )
    assert np.count_nonzero(np.isin(record.missing, gone)) >= 0.9 * len(record.missing)
    found = record.meta["frames"]
    assert found["contradictory"] + found["different"] > 0
    assert any("left out" in text for text in record.warnings)


@kinds
def test_other_devices_on_a_full_bus_change_nothing(kind: Kind) -> None:
    stream = kind(3000)
    random = np.random.default_rng(1)
    n = 8 * len(stream.sent)
    others = np.setdiff1d(np.arange(0x800), np.array([MOTOR, TABLE, SAMPLES]))
    length = random.integers(0, 9, n)
    payload = random.integers(0, 256, (n, 8), np.uint8)
    times = np.sort(random.uniform(BEGIN, BEGIN + 3.0, n))
    foreign = Frames(times, random.choice(others, n), length, payload, 0)
    sent = together(stream.sent, foreign)
    record = decode(sent, Settings(1, STEP, RATED, (RESOLUTION, RESOLUTION)))
    assert (len(record), len(record.missing)) == (len(stream.torque), 0)
    stream.check(record)


@kinds
@pytest.mark.parametrize("pause", [0.02, 0.9, 30.0, 200.0])
def test_a_node_that_restarts_unseen_parts_the_record(kind: Kind, pause: float) -> None:
    before, after = kind(3000, 40_000, 1), kind(5004, 3, 2)
    later = at(after.sent, after.sent.time + 3.0 + pause)
    record = decode(together(before.sent, later))
    assert any("starts afresh 1 times" in text for text in record.warnings)
    assert record.meta["frames"]["restarts"] == 1
    assert (len(record), len(record.missing)) == (len(after.torque), 0)
    after.check(record)


@kinds
@pytest.mark.parametrize("apart", [0, 1, 70, 1000, 30_000])
def test_two_nodes_with_one_id_make_no_record(kind: Kind, apart: int) -> None:
    one, two = kind(3000, 100, 1), kind(3000, 100 + apart, 2)
    other = at(two.sent, two.sent.time + 0.4e-3)
    with pytest.raises(InputError, match="two nodes with id 1 send at the same time"):
        decode(together(one.sent, other))


@kinds
@pytest.mark.parametrize("slower", [10, 50])
def test_a_second_node_that_sends_now_and_then_is_noticed(kind: Kind, slower: int) -> None:
    one, two = kind(12_000, 100, 1), kind(12_000 // slower, 20_000, 2, slower * STEP)
    record, refusal = attempt(together(one.sent, at(two.sent, two.sent.time + 0.4e-3)))
    if record is None:
        assert "two nodes with id 1" in refusal
    else:
        assert any("second node 1" in text for text in record.warnings)
        assert len(record.missing) == 0
        one.check(record)


@kinds
@pytest.mark.parametrize("speed", [0.02, 0.5, 3.0])
def test_a_node_in_its_own_time_is_counted_by_its_own_time(kind: Kind, speed: float) -> None:
    """An emulator that runs as fast as it can, or as slowly: the host's clock is no use then."""
    stream = kind(30_000, 5)
    n = len(stream.sent)
    kept = np.r_[0 : n // 3, n // 2 : n]
    sent = at(stream.sent, BEGIN + (stream.sent.time - BEGIN) * speed)
    record = decode(taken(sent, kept))
    assert record.time_step == STEP
    assert len(record) == len(stream.torque)
    assert len(record.missing) == pytest.approx(len(record) / 6, rel=1e-3)
    stream.check(record)


def test_where_most_is_missing_the_longest_part_is_used() -> None:
    one, two = classical(3000, 0, 1), classical(5000, 30_000, 2)
    record = decode(together(one.sent, at(two.sent, two.sent.time + 30.0)))
    assert len(record) == 5000
    assert any("most of the samples are missing in between" in text for text in record.warnings)
    two.check(record)


@pytest.mark.parametrize("kind", [classical, flexible])
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0))
@settings(max_examples=50, deadline=None)
def test_whatever_comes_makes_a_record_or_one_clear_line(
    kind: Kind, seed: int, share: float
) -> None:
    """Times, identifiers, lengths and payloads of a share of the frames are anything at all."""
    stream = kind(600, 65_300, seed)
    random = np.random.default_rng(seed)
    sent, n = stream.sent, len(stream.sent)
    wild = random.random((4, n)) < share
    times = np.where(wild[0], random.choice([0.0, -1e9, 1e12, BEGIN, np.pi], n), sent.time)
    identifier = np.where(wild[1], random.integers(0x180, 0x482, n), sent.identifier)
    length = np.where(wild[2], random.integers(0, sent.payload.shape[1] + 1, n), sent.length)
    noise = random.integers(0, 256, sent.payload.shape, np.uint8)
    payload = np.where(wild[3][:, None], noise, sent.payload)
    record, refusal = attempt(Frames(times, identifier, length, payload, 0))
    assert "\n" not in refusal
    assert record is None or len(record) >= 2


def test_two_minutes_at_ten_kilohertz_are_whole() -> None:
    stream = flexible(1_200_000, 123, step=1e-4)
    record = decode(stream.sent, Settings(None, 1e-4, RATED, (RESOLUTION, RESOLUTION)))
    assert (len(record), len(record.missing)) == (len(stream.torque), 0)
    stream.check(record)
