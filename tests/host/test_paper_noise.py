"""Estimators under noise: the goals, the bound, and the estimator that reaches it."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from axistwin import core
from axistwin.core import Array, Axis, State
from axistwin.errors import NotEnoughDataError
from axistwin.paper import spectral
from axistwin.paper.bound import cramer_rao
from axistwin.paper.measurement import (
    NoiseLevel,
    central_differences,
    measure,
    noise_level,
    quantisation,
    read_encoders,
)
from axistwin.paper.noise import CASES, ESTIMATORS, EXPECTED, GOALS, Case
from axistwin.paper.settings import AXIS, MODAL, NAMES, SETTINGS, A, Setting, errors

from .paper_run import studies, value

WORST = "Noise, worst of both settings"
LIKELIEST = "periods, maximum likelihood"
NOISY = [case for case in CASES if case.decibels is not None]

axes = st.builds(
    Axis,
    st.floats(1e-5, 1e-4),
    st.floats(5e-6, 5e-5),
    st.floats(5e-4, 5e-3),
    st.floats(50.0, 200.0),
)
seeds = st.integers(0, 2**31)


def states(motion: core.Motion, channels: int) -> Array:
    columns = [motion.theta1, motion.theta2, motion.omega1, motion.omega2]
    return np.column_stack(columns[:channels])


# ---- The goals -----------------------------------------------------------------------------------


def test_the_goals_are_those_that_were_set() -> None:
    assert GOALS == {
        "60 dB": (0.01, 0.1),
        "40 dB": (0.1, 1.0),
        "20 dB": (1.0, 6.0),
        "2^20 counts": (0.05, 0.3),
        "10^4 counts": (3.0, 3.0),
        "10^4 counts, no drift": (3.0, 3.0),
    }


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.title)
@pytest.mark.parametrize("name", NAMES)
def test_the_best_estimator_meets_the_goals(case: Case, name: str) -> None:
    most = value(WORST, f"{case.title}, goal", name)
    assert value(WORST, f"{case.title}, {LIKELIEST}", name) <= most


@pytest.mark.parametrize("case", ["60 dB", "40 dB", "2^20 counts", "10^4 counts"])
@pytest.mark.parametrize("name", NAMES)
def test_the_filter_on_the_node_meets_them_up_to_40_db(case: str, name: str) -> None:
    most = value(WORST, f"{case}, goal", name)
    assert value(WORST, f"{case}, filter, RLS", name) <= most


@pytest.mark.parametrize("case", CASES, ids=lambda c: c.title)
def test_the_papers_regression_meets_none(case: Case) -> None:
    assert value(WORST, f"{case.title}, Eq. 9, LS", "K") > 5.0
    assert value(WORST, f"{case.title}, Eq. 9, LS", "B") > 100.0


def test_central_differences_are_no_measured_speeds() -> None:
    for name in NAMES:
        filtered = value(WORST, "2^20 counts, filter, RLS", name)
        assert value(WORST, "2^20 counts, midpoint, RLS", name) > 100.0 * filtered


def test_extended_least_squares_fails_on_coarse_encoders() -> None:
    study = f"Noise, {A.title}"
    for case in ("10^4 counts", "10^4 counts, no drift"):
        assert value(study, f"{case}, midpoint, ELS", "records without an axis") > 50


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_instruments_take_the_bias_away(setting: Setting) -> None:
    study = f"Noise, {setting.title}"
    plain = value(study, "20 dB, midpoint, RLS", "I1 bias")
    assert abs(value(study, "20 dB, midpoint, IV", "I1 bias")) < 0.4 * abs(plain)


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_without_drift_averaging_is_of_no_help(setting: Setting) -> None:
    study = f"Noise, {setting.title}"
    for name in NAMES:
        drifting = value(study, f"10^4 counts, {LIKELIEST}", f"{name} rms")
        assert value(study, f"10^4 counts, no drift, {LIKELIEST}", f"{name} rms") > 3.0 * drifting


def test_bias_and_scatter_make_the_rms_error() -> None:
    for setting in SETTINGS:
        rows = studies()[f"Noise, {setting.title}"]
        found = {(v["row"], v["column"]): v["value"] for v in rows}
        for row, column in found:
            if column.endswith(" rms"):
                name = column.removesuffix(" rms")
                parts = (found[row, f"{name} {part}"] for part in ("bias", "scatter"))
                assert found[row, column] == pytest.approx(np.hypot(*parts))


def test_a_guess_is_all_that_estimators_are_told() -> None:
    ratios = np.array(astuple(EXPECTED)) / astuple(AXIS)
    assert np.all((ratios > 1.5) | (ratios < 0.6))


# ---- The bound -----------------------------------------------------------------------------------


@pytest.mark.parametrize("case", NOISY, ids=lambda c: c.title)
@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_maximum_likelihood_reaches_the_bound(case: Case, setting: Setting) -> None:
    """The rms of 100 errors is known to 7 %; what lies between lines is not used."""
    study = f"Noise, {setting.title}"
    for name in NAMES:
        rms = value(study, f"{case.title}, {LIKELIEST}", f"{name} rms")
        least = value(study, f"{case.title}, bound, all measured", name)
        assert 0.8 < rms / least < 1.3


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_no_other_estimator_beats_the_bound(setting: Setting) -> None:
    study = f"Noise, {setting.title}"
    for case in NOISY:
        for estimator in ESTIMATORS:
            # Eq. 9 is given the true I2
            if estimator.encoders_only or estimator.title == "Eq. 9, LS":
                continue
            for name in NAMES:
                rms = value(study, f"{case.title}, {estimator.title}", f"{name} rms")
                assert rms > 0.8 * value(study, f"{case.title}, bound, all measured", name)


@pytest.mark.parametrize("speeds", [True, False])
@pytest.mark.parametrize("torque_noise", [0.05, 0.0])
def test_the_bound_is_that_of_all_unknowns_at_once(speeds: bool, torque_noise: float) -> None:
    """The information about parameters, state at the start and every torque sample, inverted."""
    rng = np.random.default_rng(1)
    n, h = 60, A.time_step
    torque = 0.2 * rng.standard_normal(n)
    level = NoiseLevel(torque_noise, 1e-4, 0.5)
    start = State(3e-4, 1.0, 5.0, 0.2)
    deviation = np.array([1e-4, 1e-4, 0.5, 0.5][: 4 if speeds else 2])

    def outputs(unknowns: Array) -> Array:
        axis = Axis(*(np.array(astuple(AXIS)) * np.exp(unknowns[:4])).tolist())
        applied = torque + unknowns[8:] if torque_noise else torque
        motion = core.simulate(axis, h, applied, State(*unknowns[4:8].tolist()))
        measured = (states(motion, len(deviation)) / deviation).ravel()
        return np.append(measured, applied / torque_noise) if torque_noise else measured

    at = np.concatenate([np.zeros(4), astuple(start), np.zeros(n if torque_noise else 0)])
    size = np.concatenate([np.full(4, 1e-4), [1e-4, 0.1, 0.1, 1e-3], np.full(len(at) - 8, 0.01)])
    columns = [
        (outputs(at + step) - outputs(at - step)) / (2.0 * np.max(step)) for step in np.diag(size)
    ]
    jacobian = np.column_stack(columns)
    scale = np.linalg.norm(jacobian, axis=0)
    covariance = np.linalg.inv((jacobian / scale).T @ (jacobian / scale))
    expected = (np.sqrt(np.diag(covariance)) / scale)[:4]
    found = cramer_rao(AXIS, h, torque, level, start=start, speeds=speeds)
    np.testing.assert_allclose(found, expected, rtol=1e-5)


def test_the_bound_is_proportional_to_the_noise() -> None:
    torque = A.torque()
    level = noise_level(core.simulate(AXIS, A.time_step, torque), torque, 40.0)
    double = NoiseLevel(*(2.0 * size for size in astuple(level)))
    once, twice = (cramer_rao(AXIS, A.time_step, torque, size) for size in (level, double))
    np.testing.assert_allclose(twice, 2.0 * once, rtol=1e-6)
    fewer = cramer_rao(AXIS, A.time_step, torque, level, speeds=False)
    assert np.all(fewer > once)


# ---- Maximum likelihood on the lines of the excitation -------------------------------------------


def averaged(setting: Setting, axis: Axis, start: State, channels: int) -> spectral.Average:
    torque = setting.torque(6)
    motion = core.simulate(axis, setting.time_step, torque, start)
    lines = np.arange(1, 2 * setting.k + 1)
    step, N = setting.time_step, setting.N
    return spectral.average(step, N, lines, torque, states(motion, channels), rounding=1e-9)


@given(axes, st.floats(-1e-3, 1e-3), st.floats(-20.0, 20.0), st.sampled_from([2, 4]))
@settings(max_examples=30, deadline=None)
def test_without_noise_it_is_exact_whatever_transient_and_drift(
    axis: Axis, twist: float, speed: float, channels: int
) -> None:
    assume(0.3 < core.modal(axis).wn / MODAL.wn < 1.8)  # the excitation reaches 2 wn
    data = averaged(A, axis, State(twist=twist, speed=speed), channels)
    np.testing.assert_allclose(astuple(spectral.rough(data)), astuple(axis), rtol=1e-6)
    found = spectral.maximum_likelihood(data, spectral.rough(data)).axis
    np.testing.assert_allclose(astuple(found), astuple(axis), rtol=1e-6)


@given(st.lists(st.floats(0.95, 1.05), min_size=4, max_size=4))
@settings(max_examples=20, deadline=None)
def test_where_it_starts_does_not_matter(factors: list[float]) -> None:
    data = averaged(A, AXIS, State(), 2)
    wrong = Axis(*(np.array(astuple(AXIS)) * factors).tolist())
    found = spectral.maximum_likelihood(data, wrong).axis
    np.testing.assert_allclose(errors(found), 0.0, atol=1e-4)


def test_its_standard_errors_are_its_scatter() -> None:
    torque = A.torque(10)
    motion = core.simulate(AXIS, A.time_step, torque)
    level = noise_level(motion, torque, 40.0)
    rng = np.random.default_rng(2)
    lines = np.arange(1, 2 * A.k + 1)
    found, promised = [], []
    for _ in range(200):
        measured, known = measure(motion, torque, level, rng)
        data = spectral.average(A.time_step, A.N, lines, known, states(measured, 4))
        fit = spectral.maximum_likelihood(data, spectral.rough(data))
        found.append(errors(fit.axis))
        promised.append(100.0 * fit.relative_error)
    scatter = np.std(found, axis=0)
    np.testing.assert_allclose(scatter / np.mean(promised, axis=0), 1.0, atol=0.2)
    assert np.all(np.abs(np.mean(found, axis=0)) < 4.0 * scatter / np.sqrt(len(found)))


def test_the_noise_is_measured_from_how_the_periods_differ() -> None:
    torque = A.torque(20)
    motion = core.simulate(AXIS, A.time_step, torque, State(speed=10.0))
    level = NoiseLevel(0.01, 1e-5, 0.02)
    measured, known = measure(motion, torque, level, np.random.default_rng(3))
    lines = np.arange(1, 2 * A.k + 1)
    data = spectral.average(A.time_step, A.N, lines, known, states(measured, 4))
    power = np.append(data.torque_power, data.motion_power) * 20 / A.N
    np.testing.assert_allclose(power, np.square([0.01, 1e-5, 1e-5, 0.02, 0.02]), rtol=0.1)


def test_rounding_that_repeats_is_not_averaged() -> None:
    lines = np.arange(1, 2 * A.k + 1)
    torque = A.torque(20)
    step = 2.0 * np.pi / 10**4
    for drift in (False, True):
        case = Case("", counts_per_turn=10**4, drift=drift)
        motion = case.motion(A, torque)
        counts = read_encoders(motion, 10**4, np.random.default_rng(4))
        data = spectral.average(
            A.time_step, A.N, lines, torque, (step * counts).astype(np.float64), step
        )
        share = data.motion_power / (A.N * step**2 / 12.0)
        assert np.all(share < 0.3) if drift else np.all(share > 0.9)


def test_too_few_periods_are_an_error() -> None:
    with pytest.raises(NotEnoughDataError, match="five are needed"):
        spectral.average(1e-4, 10, np.arange(1, 3), np.zeros(40), np.zeros((40, 2)))


def test_noise_alone_is_no_axis() -> None:
    rng = np.random.default_rng(5)
    lines = np.arange(1, 2 * A.k + 1)
    data = spectral.average(A.time_step, A.N, lines, A.torque(6), rng.standard_normal((6 * A.N, 2)))
    with pytest.raises(NotEnoughDataError):
        spectral.maximum_likelihood(data, spectral.rough(data))


# ---- Measurements --------------------------------------------------------------------------------


def test_noise_is_white_and_of_the_size_that_was_asked_for() -> None:
    torque = A.torque(20)
    motion = core.simulate(AXIS, A.time_step, torque)
    level = NoiseLevel(0.01, 1e-5, 0.02)
    measured, known = measure(motion, torque, level, np.random.default_rng(6))
    noise = np.column_stack([known - torque, states(measured, 4) - states(motion, 4)])
    np.testing.assert_allclose(np.std(noise, axis=0), [0.01, 1e-5, 1e-5, 0.02, 0.02], rtol=0.03)
    correlation = np.corrcoef(noise.T) - np.eye(5)
    assert np.max(np.abs(correlation)) < 5.0 / np.sqrt(len(noise))
    for channel in noise.T:
        assert abs(np.corrcoef(channel[1:], channel[:-1])[0, 1]) < 5.0 / np.sqrt(len(noise))
    np.testing.assert_allclose(measured.twist, measured.theta1 - measured.theta2, atol=1e-15)


def test_noise_at_a_level_is_that_many_decibels_below() -> None:
    torque = A.torque(20)
    motion = core.simulate(AXIS, A.time_step, torque)
    level = noise_level(motion, torque, 40.0)
    assert level.torque == pytest.approx(0.01 * np.std(torque))
    assert level.angle == pytest.approx(0.01 * np.std(motion.twist))
    assert level.speed == pytest.approx(0.01 * np.std(motion.twist_speed))


def test_encoders_round_and_their_zeros_lie_anywhere() -> None:
    motion = core.motion([State(0.001 * i, 0.0, 0.0, 0.03 * i) for i in range(200)])
    step = 2.0 * np.pi / 1000
    rng = np.random.default_rng(7)
    shifts = []
    for _ in range(20):
        error = step * read_encoders(motion, 1000, rng) - states(motion, 2)
        assert np.all(np.ptp(error, axis=0) < step)
        shifts.append(np.mean(error, axis=0) / step)
    assert np.all(np.std(shifts, axis=0) > 0.2)
    rounding = float(np.std(step * read_encoders(motion, 1000, rng)[:, 0] - motion.theta1))
    assert rounding == pytest.approx(quantisation(1000).angle, rel=0.1)


def test_central_differences_of_a_steady_speed_are_that_speed() -> None:
    counts = np.column_stack([np.arange(0, 400, 4), np.arange(0, 200, 2)]).astype(np.int32)
    found = central_differences(counts, 1000, 1e-3)
    assert len(found) == 98
    np.testing.assert_allclose(found.omega1, 4 * 2.0 * np.pi)
    np.testing.assert_allclose(found.omega2, 2 * 2.0 * np.pi)
    np.testing.assert_allclose(found.theta1, 2.0 * np.pi * counts[1:-1, 0] / 1000)
    np.testing.assert_allclose(found.twist, 2.0 * np.pi * counts[1:-1, 1] / 1000)
