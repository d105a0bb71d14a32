"""How a record is cut into windows, what noise they have, and what is periodic in them."""

from __future__ import annotations

from collections.abc import Collection

import numpy as np
import pytest
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin.core import Array
from axistwin.diagnose import spectrum, windows
from axistwin.errors import NotEnoughDataError
from axistwin.record import Record

STEP = 1e-3


def record(length: int, missing: Collection[int] = ()) -> Record:
    """Channels that number their samples."""
    numbers = np.arange(float(length))
    lost = np.array(sorted(missing), np.int64)
    return Record(STEP * numbers, numbers + 0.25, numbers, STEP, -numbers, missing=lost)


@given(st.integers(2000, 9000), st.sets(st.integers(0, 8999), max_size=12), st.floats(0.03, 0.6))
@settings(max_examples=60, deadline=None)
def test_windows_are_whole_and_apart(length: int, missing: set[int], window: float) -> None:
    missing = {at for at in missing if at < length}
    given_record = record(length, missing)
    cut = windows.cut(given_record, window)
    assert cut.count >= windows.WINDOWS_MIN
    assert np.all(np.diff(cut.index, axis=1) == 1)
    assert not np.isin(cut.index, sorted(missing)).any()
    assert np.all(np.diff(cut.index[:, 0]) >= cut.length)
    assert cut.index.min() >= 0
    assert cut.index.max() < length
    np.testing.assert_array_equal(cut.angles, [cut.index, -cut.index])
    np.testing.assert_array_equal(cut.cut(given_record.torque), cut.index + 0.25)
    np.testing.assert_allclose(cut.time, STEP * cut.index)
    # Each third window is held out, so that neither kind comes from a part of the record alone.
    assert cut.held_out.tolist() == [i % windows.FOLD == windows.FOLD - 1 for i in range(cut.count)]


def test_a_window_lasts_as_long_as_is_asked_where_it_can() -> None:
    assert windows.cut(record(9000), 0.25).length == 250
    assert windows.cut(record(2700), 0.5).length == 2700 // windows.WINDOWS_MIN


def test_a_long_record_is_looked_at_all_over() -> None:
    length = 3 * windows.SAMPLES_MAX
    cut = windows.cut(record(length), 0.5)
    assert cut.index.size <= windows.SAMPLES_MAX
    assert cut.index[0, 0] == 0
    assert cut.index[-1, -1] == length - 1


def test_windows_are_split_and_joined_again() -> None:
    cut = windows.cut(record(9000, {4321}), 0.24)
    short = cut.recut(30)
    assert (short.count, short.length) == (8 * cut.count, 30)
    np.testing.assert_array_equal(short.angles, [short.index, -short.index])
    assert np.count_nonzero(short.held_out) == short.count // windows.FOLD
    again = short.recut(240)
    np.testing.assert_array_equal(again.index, cut.index)
    np.testing.assert_array_equal(again.angles, cut.angles)
    np.testing.assert_array_equal(again.held_out, cut.held_out)


@given(st.integers(216, 40_000), st.integers(24, 300), st.integers(1, 40_000))
@settings(max_examples=100, deadline=None)
def test_a_part_of_the_windows_is_from_all_over_the_record(
    length: int, window: int, samples: int
) -> None:
    whole = windows.cut(record(length), STEP * window)
    part = whole.part(samples)
    assert part.count == whole.count or part.count <= whole.count / 2
    kept = np.searchsorted(whole.index[:, 0], part.index[:, 0])
    np.testing.assert_array_equal(part.index, whole.index[kept])
    np.testing.assert_array_equal(part.angles, whole.angles[:, kept])
    np.testing.assert_array_equal(part.held_out, whole.held_out[kept])
    if part is not whole:
        stretches = kept.reshape(-1, windows.FOLD)
        assert np.all(np.diff(stretches, axis=1) == 1)
        assert part.index.size <= max(samples, 6 * windows.FOLD * part.length)
        # One in each of as many equal parts of the record.
        places = stretches[:, 0] / (whole.count // windows.FOLD * windows.FOLD) * len(stretches)
        assert np.all(np.abs(places - np.arange(len(stretches))) < 1.0)


@pytest.mark.parametrize(
    ("length", "missing"),
    [
        (windows.WINDOWS_MIN * windows.LENGTH_MIN - 1, ()),
        (5000, range(0, 5000, windows.LENGTH_MIN)),
    ],
)
def test_too_few_samples_in_a_row_are_refused(length: int, missing: Collection[int]) -> None:
    with pytest.raises(NotEnoughDataError, match="too few"):
        windows.cut(record(length, missing), 0.5)


@pytest.mark.parametrize(("length", "line"), [(24, 0.0), (100, 0.0), (500, 0.0), (500, 1e-3)])
def test_the_noise_is_told_from_motion_and_from_a_line(length: int, line: float) -> None:
    random = np.random.default_rng(length)
    sizes = np.array([2e-5, 7e-4])
    noise = sizes[:, None, None] * random.standard_normal((2, 60_000 // length, length))
    at = np.arange(length)
    slow = 0.01 * np.sin(2.0 * np.pi * at / length) + 0.003 * (at / length) ** 2
    errors = noise + slow + line * np.sin(2.7 * at)
    np.testing.assert_allclose(windows.noise_floor(errors), sizes, rtol=0.1 if line else 0.05)


def test_how_well_a_floor_is_known() -> None:
    errors = np.random.default_rng(8).standard_normal((300, 25, 400))  # so many times 25 windows
    spread = np.std(windows.noise_floor(errors) ** 2)
    assert windows.floor_spread(errors[0]) == pytest.approx(spread, rel=0.25)


@pytest.mark.parametrize("length", [120, 250, 900])
def test_a_little_in_a_narrow_part_of_the_spectrum_is_told_from_noise(length: int) -> None:
    """A resonance that adds five per cent to the power of the noise, and none."""
    for seed in range(20):
        random = np.random.default_rng(seed)
        noise, drive = random.standard_normal((2, 60_000))
        swinging = scipy.signal.lfilter([1.0], [1.0, -1.8, 0.99], drive)
        more = np.sqrt(0.05) * swinging / np.std(swinging)
        errors, more = (
            one[: 60_000 // length * length].reshape(-1, length) for one in (noise, more)
        )
        assert not windows.coloured(3e-6 * errors, 3e-6)
        assert windows.coloured(3e-6 * (errors + more), 3e-6)


def no_plant(periods: Array) -> Array:
    """Every wave moves as much."""
    return np.ones_like(periods)


@pytest.mark.parametrize(("periods", "whole"), [(7.0, True), (41.0, True), (23.46, False)])
def test_periods_in_an_angle_that_goes_back_and_forth_are_found(
    periods: float, whole: bool
) -> None:
    random = np.random.default_rng(5)
    time = np.arange(12_000).reshape(40, 300)
    angle = 9.0 * np.sin(0.0011 * time) + 2.0 * np.sin(0.0137 * time)
    scores = np.sin(periods * angle + 0.8) + 2.0 * random.standard_normal(angle.shape)
    found = spectrum.peaks(angle, scores, 1.0, 100.0, no_plant, 3, whole)
    assert found[0] == (periods if whole else pytest.approx(periods, abs=0.03))
    assert len(found) == 3


def test_what_moves_the_axis_little_has_to_show_little() -> None:
    angle = np.linspace(0.0, 60.0, 9000).reshape(30, 300)
    scores = np.sin(5.0 * angle) + 0.3 * np.sin(50.0 * angle)

    def low_pass(periods: Array) -> Array:
        return 1.0 / periods**2

    assert spectrum.peaks(angle, scores, 1.0, 100.0, no_plant, 1, True) == [5.0]
    assert spectrum.peaks(angle, scores, 1.0, 100.0, low_pass, 1, True) == [50.0]


def test_an_axis_at_rest_shows_no_periods() -> None:
    still = np.zeros((5, 30))
    assert spectrum.peaks(still, np.ones_like(still), 1.0, 100.0, no_plant, 3, True) == []


def test_lines_are_found_across_windows_that_are_apart() -> None:
    random = np.random.default_rng(6)
    index = (np.arange(30)[:, None] * 400 + np.arange(250)).astype(np.int64)
    time = STEP * index
    errors = np.stack([np.sin(310.0 * time), 0.5 * np.sin(620.5 * time)])
    errors = errors + random.standard_normal((2, *index.shape)) + np.sin(2.0 * time)
    found = spectrum.lines(errors, STEP, index, 2)
    resolution = 2.0 * np.pi / (STEP * float(index[-1, -1]))
    assert found == pytest.approx([310.0, 620.5], abs=resolution)
