"""Records: what they accept, how uneven samples become one, and that nothing is lost in CSV."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

from axistwin.errors import FileError, InputError
from axistwin.readers import read_record
from axistwin.record import Record, from_samples, write_csv
from axistwin.sampling import Array

finite = st.floats(allow_nan=False, allow_infinity=False, width=64)


@st.composite
def records(draw: st.DrawFn) -> Record:
    """Any record that is possible."""
    n = draw(st.integers(2, 40))
    step = draw(st.floats(1e-6, 1.0))
    begin = draw(st.floats(-10.0, 10.0))
    channel = npst.arrays(np.float64, n, elements=finite)
    maybe = st.none() | channel
    counts = st.none() | st.integers(1, 2**24)
    return Record(
        time=begin + step * np.arange(n, dtype=np.float64),
        torque=draw(channel),
        theta1=draw(channel),
        theta2=draw(maybe),
        omega1=draw(maybe),
        omega2=draw(maybe),
        time_step=step,
        counts_per_turn=(draw(counts), draw(counts)),
        missing=np.array(sorted(draw(st.sets(st.integers(0, n - 1)))), np.int64),
        linear=draw(st.booleans()),
        warnings=tuple(draw(st.lists(st.text(max_size=20), max_size=2))),
    )


@given(records())
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_record_survives_csv_to_the_last_bit(tmp_path: Path, record: Record) -> None:
    file = tmp_path / "record.csv"
    write_csv(record, file)
    found = read_record(file)
    assert found.time.tobytes() == record.time.tobytes()
    assert found.channels.keys() == record.channels.keys()
    for name, values in record.channels.items():
        assert found.channels[name].tobytes() == values.tobytes()
    assert found.time_step == record.time_step
    assert found.counts_per_turn == record.counts_per_turn
    assert found.missing.tolist() == record.missing.tolist()
    assert found.linear == record.linear
    assert found.warnings == record.warnings
    assert found.source == str(file)
    assert found.meta == {"source": record.source}


@given(st.data())
def test_samples_on_a_grid_stay_and_those_between_are_listed(data: st.DataObject) -> None:
    n = data.draw(st.integers(20, 200))
    step = data.draw(st.floats(1e-5, 1.0))
    lost = data.draw(st.sets(st.integers(1, n - 2), max_size=n // 5))
    places = np.array([i for i in range(n) if i not in lost])
    # as a logger with six digits would print it
    time = 3.0 + step * places
    torque = np.random.default_rng(n).normal(size=n)
    record = from_samples(
        time, {"torque": torque[places], "theta1": 1.0 * places}, source="made here"
    )
    assert record.missing.tolist() == sorted(lost)
    assert record.time_step == pytest.approx(step, rel=1e-9)
    assert (record.torque[places] == torque[places]).all()
    # a straight line shows that what is missing is interpolated
    assert record.theta1 == pytest.approx(np.arange(n), abs=1e-9 * n)
    assert any("missing" in warning for warning in record.warnings) == bool(lost)


def test_rounded_time_stamps_are_an_even_grid() -> None:
    time = np.round(np.arange(5000) * 1.0761e-4, 6)
    record = from_samples(time, {"torque": time, "theta1": time}, source="made here")
    assert len(record) == 5000
    assert record.time_step == pytest.approx(1.0761e-4, rel=1e-6)
    assert record.warnings == ()


def test_an_uneven_time_base_is_resampled_with_a_warning() -> None:
    time = np.cumsum(np.tile([0.010, 0.012], 300))
    record = from_samples(time, {"torque": np.sin(time), "theta1": time}, source="made here")
    (warning,) = record.warnings
    met = sum(np.min(np.abs(time - at)) < 1e-9 for at in record.time)
    assert "uneven (steps of 0.01 to 0.012 s): resampled every" in warning
    assert f"{len(record) - met} of {len(record)} samples are interpolated" in warning
    assert record.theta1 == pytest.approx(record.time, abs=1e-12)
    assert record.torque == pytest.approx(np.sin(record.time), abs=2e-5)


@pytest.mark.parametrize("samples_jitter", [False, True])
def test_the_motion_says_whether_samples_or_only_their_stamps_jitter(samples_jitter: bool) -> None:
    even = 1e-3 * np.arange(3000.0)
    stamps = even + np.random.default_rng(1).uniform(0.0, 4e-4, 3000)
    if not samples_jitter:  # late ones, in one burst
        stamps[700:705] = stamps[704] - 1e-5 * np.arange(4.0, -1.0, -1.0)
    angle = np.sin(20.0 * (stamps if samples_jitter else even))
    record = from_samples(stamps, {"torque": angle, "theta1": angle}, source="made here")
    (warning,) = record.warnings
    assert "the time base is uneven" in warning
    assert ("but the motion is even" in warning) != samples_jitter
    assert ("resampled" in warning) == samples_jitter
    if not samples_jitter:
        assert record.theta1.tolist() == angle.tolist()
        assert record.time_step == pytest.approx(1e-3, rel=1e-3)
    assert record.missing.tolist() == []


def test_a_long_gap_in_an_uneven_time_base_is_missing() -> None:
    time = np.cumsum(np.tile([0.010, 0.012], 300))
    time[300:] += 0.5
    record = from_samples(time, {"torque": time, "theta1": time}, source="made here")
    gap = record.time[record.missing]
    assert gap.min() > time[299] - 0.02
    assert gap.max() < time[300] + 0.02
    assert len(gap) == pytest.approx(0.5 / record.time_step, abs=2)


def stumbling(advances: list[int]) -> Record:
    """Samples of a motion, each so many time steps after the last, that a log numbers."""
    places = np.concatenate([[0], np.cumsum(advances)])
    angle, speed = (0.1 * np.sin(1e-3 * places), 0.1 * np.cos(1e-3 * places))  # for 1 ms
    return from_samples(
        1e-3 * np.arange(len(places)),
        {"torque": np.sin(0.01 * places), "theta1": angle, "omega1": speed},
        source="made here",
    )


def test_samples_that_are_only_numbered_are_put_where_the_motion_has_them() -> None:
    advances = np.ones(1000, np.int64)
    advances[[100, 300, 700]], advances[[101, 301]], advances[500] = 0, 2, 3
    record = stumbling(advances.tolist())
    (warning,) = record.warnings
    assert "3 samples are repeats and 4 are lost" in warning
    assert record.missing.tolist() == []
    assert len(record) == 1001 - 3 + 4
    assert record.theta1 == pytest.approx(0.1 * np.sin(record.time), abs=1e-7)
    assert record.torque == pytest.approx(np.sin(10.0 * record.time), abs=1e-4)


def test_nothing_is_known_where_samples_stumble_again_and_again_or_many_are_lost() -> None:
    advances = np.ones(1000, np.int64)
    advances[400:440:8], advances[404:440:8], advances[600] = 0, 2, 9
    record = stumbling(advances.tolist())
    assert any("5 samples are repeats and 13 are lost" in line for line in record.warnings)
    times = record.time[record.missing]
    assert np.all(((times > 0.399) & (times < 0.441)) | ((times > 0.599) & (times < 0.609)))
    assert len(times) > 40
    known = np.setdiff1d(np.arange(len(record)), record.missing)
    assert record.theta1[known] == pytest.approx(0.1 * np.sin(record.time[known]), abs=1e-7)


@pytest.mark.parametrize(
    "speed",
    [
        np.ones(1000),  # one that goes on evenly
        np.random.default_rng(3).uniform(0.5, 1.5, 1000),  # one that tells nothing
        np.zeros(1000),
    ],
)
def test_time_stamps_are_believed_unless_the_speed_says_otherwise(speed: Array) -> None:
    time = 1e-3 * np.arange(1000)
    angle = np.cumsum(np.full(1000, 1e-3))
    record = from_samples(
        time, {"torque": angle, "theta1": angle, "omega1": speed}, source="made here"
    )
    assert record.warnings == ()
    assert record.theta1.tolist() == angle.tolist()


def test_a_coarse_encoder_stands_still_and_jumps_at_an_even_speed() -> None:
    """By a count a sample at 1 rad/s, and at times by none or two."""
    jumps = np.ones(1000)
    jumps[100::100], jumps[101::100] = 0.0, 2.0
    angle = 1e-3 * np.cumsum(jumps)
    record = from_samples(
        1e-3 * np.arange(1000),
        {"torque": angle, "theta1": angle, "omega1": np.ones(1000)},
        source="made here",
    )
    assert record.warnings == ()
    assert record.theta1.tolist() == angle.tolist()


@pytest.mark.parametrize(
    ("time", "torque", "complaint"),
    [
        ([0.0, 1.0, 2.0], [0.0, float("nan"), 0.0], "torque is nan at sample 1"),
        ([0.0, 1.0, float("inf")], [0.0, 0.0, 0.0], "t is inf at sample 2"),
        ([0.0, 1.0, 1.0], [0.0, 0.0, 0.0], "time does not increase at sample 2"),
        ([0.0, 1.0, 0.5], [0.0, 0.0, 0.0], "time does not increase at sample 2"),
        ([0.0, 1.0, 1e9], [0.0, 0.0, 0.0], "more samples are missing than there are"),
        ([0.0, 1.0, 2.0], [0.0, 0.0], "torque has shape"),
        ([0.0], [0.0], "1 samples are no record"),
        ([], [], "0 samples are no record"),
    ],
)
def test_samples_that_make_no_record_are_refused(
    time: list[float], torque: list[float], complaint: str
) -> None:
    with pytest.raises(InputError, match=complaint) as caught:
        from_samples(time, {"torque": torque, "theta1": np.zeros(len(time))}, source="made here")
    assert "\n" not in str(caught.value)


def test_a_record_is_checked_and_read_only() -> None:
    time = np.arange(10.0)
    with pytest.raises(InputError, match="off an even time base"):
        Record(time=time**2, torque=time, theta1=time, time_step=1.0)
    with pytest.raises(InputError, match="time step of 0"):
        Record(time=time, torque=time, theta1=time, time_step=0.0)
    with pytest.raises(InputError, match="0 counts a turn"):
        Record(time=time, torque=time, theta1=time, time_step=1.0, counts_per_turn=(0, None))
    with pytest.raises(InputError, match="missing samples"):
        Record(time=time, torque=time, theta1=time, time_step=1.0, missing=np.array([11]))
    record = Record(time=time, torque=time, theta1=time, time_step=1.0)
    assert not record.torque.flags.writeable
    time[0] = 5.0
    assert record.torque[0] == 0.0


def test_one_count_is_a_turn_or_a_metre_divided() -> None:
    time = np.arange(10.0)
    rotary = Record(time=time, torque=time, theta1=time, time_step=1.0, counts_per_turn=(360, None))
    assert rotary.resolution[0] == pytest.approx(np.deg2rad(1.0))
    assert rotary.resolution[1] is None
    linear = Record(
        time=time, torque=time, theta1=time, time_step=1.0, counts_per_turn=(1000, 10), linear=True
    )
    assert linear.resolution == (1e-3, 0.1)


def test_a_file_that_cannot_be_written_leaves_what_was_there(tmp_path: Path) -> None:
    time = np.arange(10.0)
    record = Record(time=time, torque=time, theta1=time, time_step=1.0, meta={"bad": object()})
    file = tmp_path / "record.csv"
    file.write_text("precious")
    with pytest.raises(TypeError):
        write_csv(record, file)
    assert file.read_text() == "precious"
    assert list(tmp_path.iterdir()) == [file]
    with pytest.raises(FileError, match="No such file or directory"):
        write_csv(record, tmp_path / "no" / "folder.csv")
