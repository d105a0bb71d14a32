"""Two inertias and a shaft: accuracy, stated uncertainty, invariance, and honest refusals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from axistwin import core
from axistwin.errors import NotEnoughDataError
from axistwin.identify import identify, output_error, regression, validate
from axistwin.identify.samples import Hold, longest_stretch
from axistwin.record import Record

from .identify_records import (
    LINE,
    PARAMETERS,
    PERIOD,
    evenly,
    excitation,
    ideal,
    relative_errors,
    trace,
)

PAPER = core.paper_axis()

#: 1e-9 % and 1e-4 %, as fractions.
NOISE_FREE = {"float64": 1e-11, "float32": 1e-6}


def values(record: Record) -> core.Array:
    """I1, I2, B, K as identified, (4,)."""
    params = identify(record, "two-inertia").estimate.params
    return np.array([params[name].value for name in PARAMETERS])


def test_trace_of_a_drive_in_100_runs() -> None:
    runs = [identify(trace(seed)).estimate.params for seed in range(1, 101)]
    errors = np.array([relative_errors(params, PAPER) for params in runs])
    assert np.max(np.abs(errors[:, [0, 1, 3]])) < 0.002
    assert np.max(np.abs(errors[:, 2])) < 0.02
    for name in PARAMETERS:
        ends = np.array([params[name].ci95 for params in runs])
        true = getattr(PAPER, name)
        inside = np.count_nonzero((ends[:, 0] <= true) & (true <= ends[:, 1]))
        assert inside >= 90, f"{name} in its interval in {inside} of 100 runs"


def test_modal_intervals_hold() -> None:
    true = core.modal(PAPER)
    inside = 0
    for seed in range(1, 41):
        modal = identify(trace(seed, samples=1024)).estimate.modal
        for name in ("wn", "wd", "zeta"):
            low, high = modal[name].ci95
            inside += low <= getattr(true, name) <= high
    assert inside / 120 >= 0.88


@pytest.mark.parametrize(("period", "line"), [(512, 10), (PERIOD, LINE)])
@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_noise_free_samples_with_speeds(precision: core.Precision, period: int, line: int) -> None:
    time_step = core.time_step(period, line, core.modal(PAPER).wn)
    torque = np.resize(core.schroeder(period, 2 * line, 0.2, precision=precision), 4 * period)
    result = identify(ideal(PAPER, time_step, torque, precision=precision, speeds=True))
    by_method = {
        estimate.method: np.max(np.abs(relative_errors(estimate.params, PAPER)))
        for estimate in (result.estimate, *result.others)
    }
    assert by_method["output error"] <= NOISE_FREE[precision]
    assert by_method["least squares, midpoint"] <= NOISE_FREE[precision]
    assert by_method["RLS, float64"] <= NOISE_FREE[precision]
    assert by_method["RLS, float32"] <= NOISE_FREE["float32"]


def test_filtered_regression_is_exact_for_noise_free_positions() -> None:
    torque, time_step = excitation()
    samples = longest_stretch(ideal(PAPER, time_step, np.resize(torque, 4096)))
    for corner in (500.0, 4000.0, 12000.0):
        found = regression.solve(regression.filtered(samples, corner))
        np.testing.assert_allclose(found, [PAPER.I1, PAPER.I2, PAPER.B, PAPER.K], rtol=1e-6)


def test_recursive_and_batch_least_squares_are_the_same_estimator() -> None:
    result = identify(trace())
    batch, recursive = (
        next(other for other in result.others if other.method == method)
        for method in ("least squares, filtered", "RLS, float64")
    )
    for name in PARAMETERS:
        assert recursive.params[name].value == pytest.approx(batch.params[name].value, rel=2e-5)


@pytest.mark.parametrize("counts", [(10_000, 10_000), (2**20, 10_000)])
def test_coarse_encoders(counts: tuple[int, int]) -> None:
    for seed in range(1, 6):
        params = identify(trace(seed, counts=counts, samples=4096)).estimate.params
        assert np.max(np.abs(relative_errors(params, PAPER))) < 0.03


@pytest.mark.parametrize("decibels", [60, 40, 20])
def test_noise_on_the_angles(decibels: int) -> None:
    torque, time_step = excitation()
    clean = ideal(PAPER, time_step, np.resize(torque, 10240))
    assert clean.theta2 is not None
    rng = np.random.default_rng(decibels)
    sigma = 10.0 ** (-decibels / 20.0) * np.std(clean.theta1 - clean.theta2)
    noisy = replace(
        clean,
        theta1=clean.theta1 + sigma * rng.standard_normal(len(clean)),
        theta2=clean.theta2 + sigma * rng.standard_normal(len(clean)),
    )
    result = identify(noisy)
    # the bound grows with the noise: 0.015 % at 60 dB, 1.5 % at 20 dB
    assert np.max(np.abs(relative_errors(result.estimate.params, PAPER))) < 0.15 * 10.0 ** (
        -decibels / 20.0
    )
    assert result.whiteness.white


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    inertia=st.floats(1e-6, 1e-1),
    ratio=st.floats(0.1, 10.0),
    radians=st.floats(0.05, 1.0),
    zeta=st.floats(0.005, 0.3),
    rate=st.floats(1e3, 4e4),
)
def test_any_axis_is_found_without_a_hint(
    inertia: float, ratio: float, radians: float, zeta: float, rate: float
) -> None:
    wn = radians * rate
    axis = core.axis_from_modal(inertia, inertia * ratio, wn, zeta)
    torque = np.resize(core.schroeder(2048, 1000, inertia * wn**2 * 1e-2, seed=1), 3072)
    params = identify(ideal(axis, 1.0 / rate, torque), "two-inertia").estimate.params
    assert np.max(np.abs(relative_errors(params, axis))) < 1e-6


@settings(max_examples=10, deadline=None)
@given(power=st.integers(-6, 6))
def test_scale_of_the_torque(power: int) -> None:
    # torque and axis times the same power of two: the same motion, to the bit
    factor = 2.0**power
    record = trace()
    np.testing.assert_allclose(
        values(replace(record, torque=factor * record.torque)), factor * values(record), rtol=1e-9
    )


@settings(max_examples=10, deadline=None)
@given(power=st.integers(-3, 3))
def test_scale_of_time(power: int) -> None:
    # time times c under the same torque and angles: I times c^2, B times c
    factor = 2.0**power
    record = trace()
    slower = replace(record, time=factor * record.time, time_step=factor * record.time_step)
    expected = values(record) * [factor**2, factor**2, factor, 1.0]
    np.testing.assert_allclose(values(slower), expected, rtol=1e-9)


def test_sign() -> None:
    record = trace()
    assert record.theta2 is not None
    turned = replace(record, torque=-record.torque, theta1=-record.theta1, theta2=-record.theta2)
    np.testing.assert_allclose(values(turned), values(record), rtol=1e-9)


@settings(max_examples=10, deadline=None)
@given(motor=st.integers(-(10**7), 10**7), table=st.integers(-(10**7), 10**7))
def test_encoder_zeros_do_not_matter(motor: int, table: int) -> None:
    record = trace()
    step = record.resolution[0]
    assert record.theta2 is not None
    assert step is not None
    moved = replace(
        record, theta1=record.theta1 + motor * step, theta2=record.theta2 + table * step
    )
    np.testing.assert_allclose(values(moved), values(record), rtol=1e-7)


@settings(max_examples=10, deadline=None)
@given(load=st.floats(-0.5, 0.5))
def test_a_constant_load_does_not_matter(load: float) -> None:
    torque, time_step = excitation()
    commanded = np.resize(torque, 4096)
    acting = ideal(PAPER, time_step, commanded + load)
    found = values(replace(acting, torque=commanded))
    np.testing.assert_allclose(found, [PAPER.I1, PAPER.I2, PAPER.B, PAPER.K], rtol=1e-7)


@pytest.mark.parametrize("start", [1, 100, 777])
def test_any_part_of_a_record_gives_the_same_axis(start: int) -> None:
    record = trace(samples=3000)
    assert record.theta2 is not None
    part = Record(
        time=record.time[start:],
        torque=record.torque[start:],
        theta1=record.theta1[start:],
        theta2=record.theta2[start:],
        time_step=record.time_step,
        counts_per_turn=record.counts_per_turn,
    )
    whole, found = (identify(r).estimate.params for r in (record, part))
    for name in PARAMETERS:
        change = abs(found[name].value - whole[name].value)
        assert change < 2.0 * found[name].stderr


@pytest.mark.parametrize("hold", ["zoh", "foh"])
def test_real_axes_do_not_follow_the_trapezoidal_rule(hold: Hold) -> None:
    """Exact motion under a torque that is held, or linear, between samples."""
    torque, time_step = excitation()
    torque = np.resize(torque, 5000)
    method: core.Method = "exact_held" if hold == "zoh" else "exact"
    motion = core.integrate(method, PAPER, time_step, torque)
    angles = core.read_encoders(motion, (2**20, 2**20)) * np.float64(2.0 * np.pi / 2**20)
    record = Record(
        time=evenly(2048, time_step),
        torque=torque[-2048:],
        theta1=angles[-2048:, 0],
        theta2=angles[-2048:, 1],
        time_step=time_step,
        counts_per_turn=(2**20, 2**20),
    )
    result = identify(record)
    assert result.hold == hold
    assert result.whiteness.white
    assert np.max(np.abs(relative_errors(result.estimate.params, PAPER))) < 0.002
    assert any(hold in note for note in result.notes)
    told = identify(record, hold=hold)
    assert told.estimate == result.estimate
    # the wrong rule is wrong by per cents at this rate, and the record shows that it is
    wrong = identify(record, "two-inertia", hold="newmark")
    assert not wrong.whiteness.white
    assert np.max(np.abs(relative_errors(wrong.estimate.params, PAPER))) > 0.01


def test_drag_on_the_motor_hardly_moves_the_estimate() -> None:
    """Viscous friction, which the model does not have, takes a torque that follows the speed."""
    torque, time_step = excitation()
    torque = np.resize(torque, 4096)
    drag = 2e-4
    seen = np.zeros_like(torque)
    for _ in range(12):  # torque and speed in turn, until they agree
        motion = core.simulate(PAPER, time_step, torque - drag * seen)
        seen = motion.omega1
    free = core.simulate(PAPER, time_step, torque)
    assert np.max(np.abs(motion.theta1 - free.theta1)) > 0.1
    record = Record(
        time=evenly(4096, time_step),
        torque=torque,
        theta1=motion.theta1,
        theta2=motion.theta2,
        time_step=time_step,
    )
    result = identify(record)
    assert result.model == "two-inertia"
    assert not result.whiteness.white
    errors = np.abs(relative_errors(result.estimate.params, PAPER))
    assert np.max(errors[[0, 1, 3]]) < 0.005
    assert errors[2] < 0.02


def test_state_at_the_first_sample_is_found() -> None:
    torque, time_step = excitation()
    state = core.State(twist=2e-3, twist_speed=-3.0, speed=40.0, angle=5.0)
    record = ideal(PAPER, time_step, np.resize(torque, 2048), state=state)
    samples = longest_stretch(record)
    fit = output_error.fit(samples, output_error.find_start(samples))
    found = dict(zip(output_error.UNKNOWNS, fit.unknowns, strict=True))
    assert found["twist"] == pytest.approx(state.twist, rel=1e-6)
    assert found["twist_speed"] == pytest.approx(state.twist_speed, rel=1e-6)
    assert found["speed"] == pytest.approx(state.speed, rel=1e-6)
    assert found["zero"] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("late", [0, 2, 4])
def test_a_start_is_found_where_the_torque_acts_radians_late(late: int) -> None:
    time_step = 1.0 / core.modal(PAPER).wn
    torque = np.repeat(np.random.default_rng(0).choice([-1.0, 1.0], 500), 5)
    still = np.zeros(late)
    record = ideal(PAPER, time_step, np.concatenate([still, torque]))
    samples = longest_stretch(replace(record, torque=np.concatenate([torque, still])))
    start = output_error.find_start(samples)
    for name in ("I1", "K"):
        assert getattr(start, name) == pytest.approx(getattr(PAPER, name), rel=0.3)


def test_no_damping_is_said_to_be_undetermined() -> None:
    undamped = core.Axis(PAPER.I1, PAPER.I2, 0.0, PAPER.K)
    result = identify(trace(axis=undamped))
    damping = result.estimate.params["B"]
    assert damping.ci95[0] <= 0.0 <= damping.ci95[1]
    assert damping.ci95[1] < 1e-3 * PAPER.B
    assert result.undetermined == ("B",)
    assert not result.valid
    assert result.estimate.params["K"].value == pytest.approx(PAPER.K, rel=2e-3)


def test_lost_samples_leave_the_longest_stretch() -> None:
    record = replace(trace(samples=4096), missing=np.array([1000, 1001, 3500]))
    result = identify(record)
    assert result.used == 3500 - 1002
    assert any("2498 samples" in note for note in result.notes)
    assert np.max(np.abs(relative_errors(result.estimate.params, PAPER))) < 0.002


def test_validation_on_another_record() -> None:
    result = validate(identify(trace(1)), trace(2))
    assert result.validation is not None
    # two encoders round the twist by sqrt(2 / 12) counts of some 220 counts rms
    assert result.validation.relative_error["twist"] < 0.0025
    stiffer = core.Axis(PAPER.I1, PAPER.I2, PAPER.B, 1.05 * PAPER.K)
    other = validate(identify(trace(1)), trace(2, axis=stiffer))
    assert other.validation is not None
    assert other.validation.relative_error["twist"] > 0.05


def test_live_stream_is_too_slow_for_the_resonance() -> None:
    stream = trace(samples=5000, decimation=9)
    with pytest.raises(NotEnoughDataError, match="axistwin trace"):
        identify(stream, "two-inertia")


def test_live_stream_of_slow_excitation_tells_the_rigid_axis() -> None:
    table = core.schroeder(PERIOD, 20, 0.2)
    time_step = core.time_step(PERIOD, LINE, core.modal(PAPER).wn)
    full = ideal(PAPER, time_step, np.resize(table, 9 * 5000))
    assert full.theta2 is not None
    stream = Record(
        time=evenly(5000, 9 * time_step),
        torque=full.torque[::9],
        theta1=full.theta1[::9],
        theta2=full.theta2[::9],
        time_step=9 * time_step,
    )
    result = identify(stream)
    assert result.model == "rigid"
    assert result.estimate.params["I"].value == pytest.approx(PAPER.I1 + PAPER.I2, rel=0.02)
    assert any("rigid axis only" in note and "axistwin trace" in note for note in result.notes)


def test_record_that_tells_nothing() -> None:
    record = trace()
    assert record.theta2 is not None
    with pytest.raises(NotEnoughDataError, match="excitation"):
        identify(replace(record, torque=np.zeros(len(record))))
    with pytest.raises(NotEnoughDataError, match="does not move"):
        identify(replace(record, theta1=np.zeros(len(record))))
    with pytest.raises(NotEnoughDataError, match="twist"):
        identify(replace(record, theta2=record.theta1 - 0.1), "two-inertia")
    with pytest.raises(NotEnoughDataError, match="both encoders"):
        identify(replace(record, theta2=None), "two-inertia")
    with pytest.raises(NotEnoughDataError, match="in a row"):
        identify(trace(samples=40))


def test_torque_that_has_nothing_to_do_with_the_motion() -> None:
    record = trace()
    other = np.random.default_rng(1).permutation(record.torque)
    with pytest.raises(NotEnoughDataError):
        identify(replace(record, torque=other))


def test_progress_is_told() -> None:
    told: list[str] = []
    identify(trace(), progress=told.append)
    assert len(told) >= 5
