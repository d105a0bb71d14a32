"""Recursive estimators against batch solutions of the same equations, and on a drifting axis."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin import core
from axistwin.core import Array, IdentSettings
from axistwin.errors import InputError
from axistwin.paper import equations
from axistwin.paper.equations import Equations
from axistwin.paper.estimators import (
    EVERY,
    HELD,
    MEMORIES,
    METHODS,
    PERIODS,
    SETTING,
    SHOWN,
    drifting_motion,
    record,
    stiffness,
)
from axistwin.paper.measurement import measure, noise_level, read_encoders
from axistwin.paper.settings import AXIS, RMS, A, errors

from .paper_run import value

STUDY = "Tracking a drifting stiffness: error of K"
EXPONENTIAL, DIRECTIONAL = METHODS[0].title, METHODS[1].title


def noisy_equations(seed: int, decibels: float, periods: int = 4) -> Equations:
    torque = A.torque(periods)
    motion = core.simulate(AXIS, A.time_step, torque)
    level = noise_level(motion, torque, decibels)
    measured = measure(motion, torque, level, np.random.default_rng(seed))
    return equations.from_motion(IdentSettings(A.time_step, AXIS, RMS), *measured)


def solved(given: Equations, instruments: Array, forgetting: float, start: int, end: int) -> Array:
    """I1, I2, B, K (4,) from the normal equations with exponential weights, by numpy."""
    weights = forgetting ** np.arange(end - 1, start - 1, -1)
    z = instruments[start:end] * weights[:, None]
    theta = np.linalg.solve(z.T @ given.phi[start:end], z.T @ given.y[start:end])
    result: Array = given.axes(theta.T[None])[0]
    return result


# ---- The estimators ------------------------------------------------------------------------------


@given(st.integers(0, 2**31), st.sampled_from([40.0, 60.0]))
@settings(max_examples=10, deadline=None)
def test_rls_is_least_squares_and_the_answer_of_axt_ident(seed: int, decibels: float) -> None:
    given_ = noisy_equations(seed, decibels)
    found = equations.least_squares(given_)[-1]
    batch = solved(given_, given_.phi, 1.0, 0, len(given_.phi))
    np.testing.assert_allclose(found, batch, rtol=1e-9)
    np.testing.assert_allclose(equations.exponential(given_)[-1], batch, rtol=1e-6)

    torque = A.torque(4)
    motion = core.simulate(AXIS, A.time_step, torque)
    level = noise_level(motion, torque, decibels)
    measured = measure(motion, torque, level, np.random.default_rng(seed))
    answer = core.identify_motion(IdentSettings(A.time_step, AXIS, RMS), *measured).last.axis
    np.testing.assert_allclose(found, [answer.I1, answer.I2, answer.B, answer.K], rtol=1e-12)


@given(st.integers(0, 2**31), st.sampled_from([128, 512]))
@settings(max_examples=10, deadline=None)
def test_forgetting_is_a_weight_that_fades_exponentially(seed: int, memory: int) -> None:
    given_ = noisy_equations(seed, 40.0)
    forgetting = 1.0 - 1.0 / memory
    found = equations.exponential(given_, forgetting=forgetting, every=700)
    for k, end in enumerate([700, 1400, len(given_.phi)]):
        np.testing.assert_allclose(
            found[k], solved(given_, given_.phi, forgetting, 0, end), rtol=1e-6
        )


@given(st.integers(0, 2**31))
@settings(max_examples=10, deadline=None)
def test_instruments_are_the_regressors_a_period_earlier(seed: int) -> None:
    given_ = noisy_equations(seed, 40.0)
    earlier = np.vstack([np.zeros((A.N, 3)), given_.phi[: -A.N]])
    found = equations.instrumental(given_, A.N)[-1]
    batch = solved(given_, earlier, 1.0, A.N, len(given_.phi))
    np.testing.assert_allclose(found, batch, rtol=1e-6)


def test_all_estimators_agree_without_noise() -> None:
    torque = A.torque(4)
    motion = core.simulate(AXIS, A.time_step, torque)
    given_ = equations.from_motion(IdentSettings(A.time_step, AXIS, RMS), motion, torque)
    for found in (
        equations.least_squares(given_),
        equations.exponential(given_),
        equations.extended(given_),
        equations.instrumental(given_, A.N),
    ):
        np.testing.assert_allclose(errors(found[-1]), 0.0, atol=1e-6)


def test_equations_know_their_samples() -> None:
    torque = np.concatenate([np.zeros(500), A.torque(4), np.zeros(20000)])
    motion = core.simulate(AXIS, A.time_step, torque)
    settings_ = IdentSettings(A.time_step, AXIS, RMS)
    with_speeds = equations.from_motion(settings_, motion, torque)
    np.testing.assert_array_equal(with_speeds.sample, np.arange(1, len(torque)))
    counts = read_encoders(motion, 10**4, np.random.default_rng(1))
    from_encoders = equations.from_counts(settings_, counts, (10**4, 10**4), torque)
    assert np.all(np.diff(from_encoders.sample) > 0)
    assert from_encoders.sample[0] > 500
    assert from_encoders.sample[-1] < 500 + 4 * A.N + 10000  # it comes to rest


def test_what_makes_no_sense_is_an_error() -> None:
    given_ = noisy_equations(0, 60.0)
    with pytest.raises(InputError, match="earlier"):
        equations.instrumental(given_, len(given_.phi))
    motion = core.simulate(AXIS, A.time_step, np.zeros(10))
    with pytest.raises(InputError, match="10 samples of motion, 9 of torque"):
        equations.from_motion(IdentSettings(A.time_step, AXIS, RMS), motion, np.zeros(9))


def test_what_is_no_axis_is_not_a_number() -> None:
    given_ = noisy_equations(0, 60.0)
    assert np.all(np.isnan(given_.axes(np.zeros((2, 2, 3)))))


# ---- A stiffness that drifts ---------------------------------------------------------------------


def test_a_stiffness_that_stays_is_the_plant_itself() -> None:
    torque = SETTING.torque(2)[: 9 * HELD + 1]
    found = drifting_motion(torque, np.full(len(torque), AXIS.K))
    expected = core.simulate(AXIS, SETTING.time_step, torque)
    for name in ("twist", "twist_speed", "omega1", "theta1"):
        a, b = getattr(found, name), getattr(expected, name)
        np.testing.assert_allclose(a, b, atol=1e-11 * np.max(np.abs(b)))


def test_the_equations_hold_with_the_stiffness_of_the_moment() -> None:
    """Without noise, over a stretch in which it does not change, it is found exactly."""
    torque = SETTING.torque(PERIODS)
    true = stiffness()
    motion = drifting_motion(torque, true)
    settings_ = IdentSettings(SETTING.time_step, AXIS, RMS)
    for first in (100 * HELD, 333 * HELD):
        part = slice(first, first + HELD)
        piece = core.Motion(motion.precision, motion.samples[part])
        found = equations.least_squares(equations.from_motion(settings_, piece, torque[part]))
        assert found[-1, 3] == pytest.approx(true[first + 1], rel=1e-9)


def test_the_stiffness_falls_by_a_fifth_and_comes_back() -> None:
    true = stiffness()
    assert true[0] == AXIS.K
    assert true.min() == pytest.approx(0.8 * AXIS.K)
    assert true[-1] == pytest.approx(AXIS.K, rel=1e-4)
    assert np.all(np.diff(true).nonzero()[0] % HELD == HELD - 1)


def test_the_shorter_the_memory_the_smaller_the_lag_until_noise_takes_over() -> None:
    tracked = [value(STUDY, EXPONENTIAL, f"memory {memory}") for memory in MEMORIES]
    best = int(np.argmin(tracked))
    assert 0 < best < len(MEMORIES) - 1
    assert np.all(np.diff(tracked[best:]) > 0.0)
    assert tracked[best] < 0.6
    drift = np.sqrt(np.mean((stiffness() / AXIS.K - 1.0) ** 2)) * 100.0
    assert tracked[best] < 0.1 * drift


def test_lag_is_what_a_long_memory_costs() -> None:
    """What an exponential memory of m samples lags behind a slow drift is m times its rate."""
    drifting = record(pause=False)
    memory = 4096
    found = equations.exponential(drifting.speeds, forgetting=1.0 - 1.0 / memory, every=EVERY)
    ends = np.minimum(np.arange(1, len(found) + 1) * EVERY, len(drifting.speeds.sample)) - 1
    samples = drifting.speeds.sample[ends]
    late = samples > 8 * SHOWN
    expected = drifting.stiffness[np.maximum(samples - memory, 0)][late]
    actual = drifting.stiffness[samples][late]
    lag = np.sqrt(np.mean((found[late, 3] - actual) ** 2))
    assert np.sqrt(np.mean((found[late, 3] - expected) ** 2)) < 0.3 * lag


def test_a_pause_is_survived_by_what_forgets_only_what_is_renewed() -> None:
    worst = f"worst with a pause, memory {SHOWN}"
    assert value(STUDY, EXPONENTIAL, worst) > 2.0 * value(STUDY, DIRECTIONAL, worst)
    assert value(STUDY, DIRECTIONAL, worst) < 10.0
