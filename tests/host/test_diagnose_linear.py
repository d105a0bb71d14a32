"""The linear axis of the diagnosis against matrix exponentials, closed forms, the integrators."""

from __future__ import annotations

from dataclasses import astuple

import numpy as np
import pytest
import scipy.linalg
import scipy.signal
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin import core
from axistwin.core import Array, Axis
from axistwin.diagnose.linear import Plant, Rigid, Torque, TwoInertias
from axistwin.errors import InputError

AXIS = Axis(1e-3, 5e-4, 5e-3, 20.0)
STEP = 1e-3


def by_exponential(
    damping: float, stiffness: float, first: Array, last: Array, start: Array
) -> tuple[Array, Array]:
    """Position and speed (w, n): force and slope are states, so that one exponential is a step."""
    system = np.array(
        [[0.0, 1, 0, 0], [-stiffness, -damping, 1, 0], [0, 0, 0, 1], [0, 0, 0, 0]], np.float64
    )
    step = scipy.linalg.expm(system * STEP)
    found = np.empty((2, *first.shape))
    for w, state in enumerate(start):
        at = state
        for i, (begin, end) in enumerate(zip(first[w], last[w], strict=True)):
            found[:, w, i] = at
            at = (step @ [*at, begin, (end - begin) / STEP])[:2]
    return found[0], found[1]


@given(
    st.sampled_from([0.0, 0.3, 40.0, 3000.0]),
    st.sampled_from([0.0, 50.0, 4e4, 2e6]),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=40, deadline=None)
def test_an_oscillator_answers_a_force_that_may_jump_exactly(
    damping: float, stiffness: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    first, last = random.standard_normal((2, 3, 30))
    start = random.standard_normal((3, 2)) * [1e-3, 1.0]
    found = core.respond(damping, stiffness, STEP, first, last, start)
    for one, expected in zip(
        found, by_exponential(damping, stiffness, first, last, start), strict=True
    ):
        np.testing.assert_allclose(one, expected, rtol=0.0, atol=1e-11 * np.max(np.abs(expected)))


@pytest.mark.parametrize("held", [True, False])
def test_held_and_linear_forces_are_answered_as_by_scipy(held: bool) -> None:
    force = np.random.default_rng(1).standard_normal(200)
    last = force if held else np.append(force[1:], 0.0)
    found = core.respond(3.0, 900.0, STEP, force[None], last[None])
    system = ([[0.0, 1.0], [-900.0, -3.0]], [[0.0], [1.0]], np.eye(2), np.zeros((2, 1)))
    _, expected, _ = scipy.signal.lsim(system, force, STEP * np.arange(200), interp=not held)
    for one, other in zip(found, expected.T, strict=True):
        np.testing.assert_allclose(one[0], other, rtol=0.0, atol=1e-10 * np.max(np.abs(other)))


@pytest.mark.parametrize("law", [(-1.0, 900.0), (1.0, -900.0), (1.0, np.nan), (np.inf, 1.0)])
def test_what_no_oscillator_can_have_is_refused(law: tuple[float, float]) -> None:
    with pytest.raises(InputError):
        core.respond(*law, STEP, np.zeros((1, 5)), np.zeros((1, 5)))


def test_a_rigid_axis_runs_up_to_its_final_speed() -> None:
    inertia, viscous, torque = 2e-3, 0.04, 0.3
    held = np.full((1, 1, 400), torque)
    angles, speeds = Rigid(inertia, viscous).respond(STEP, Torque(held, held))
    time, settling = STEP * np.arange(400), inertia / viscous
    rising = 1.0 - np.exp(-time / settling)
    np.testing.assert_allclose(speeds[0, 0], torque / viscous * rising, rtol=1e-10)
    expected = torque / viscous * (time - settling * rising)
    np.testing.assert_allclose(angles[0, 0], expected, rtol=1e-9, atol=1e-14)


def test_two_inertias_go_on_from_any_state_as_the_exact_integrator_does() -> None:
    windows, length = 5, 80
    torque = np.random.default_rng(2).standard_normal(windows * length)
    motion = core.integrate("exact_held", AXIS, STEP, torque, core.State(2e-3, -1.0, 30.0, 0.4))
    share = AXIS.I2 / (AXIS.I1 + AXIS.I2)
    states = np.column_stack(
        [
            motion.theta1 - share * motion.twist,
            motion.omega1 - share * motion.twist_speed,
            motion.twist,
            motion.twist_speed,
        ]
    )[::length]
    held = np.stack([torque, np.zeros_like(torque)]).reshape(2, windows, length)
    angles, speeds = TwoInertias(AXIS).respond(STEP, Torque(held, held), states)
    found = (*angles.reshape(2, -1), *speeds.reshape(2, -1))
    expected = (motion.theta1, motion.theta2, motion.omega1, motion.omega2)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-10 * np.ptp(other))


def test_seen_from_the_table_the_axis_is_the_other_way_round() -> None:
    random = np.random.default_rng(3)
    first, last = random.standard_normal((2, 2, 3, 50))
    turned = Axis(AXIS.I2, AXIS.I1, AXIS.B, AXIS.K)
    found = TwoInertias(AXIS).respond(STEP, Torque(first, last))
    mirrored = TwoInertias(turned).respond(STEP, Torque(first[::-1], last[::-1]))
    for one, other in zip(found, mirrored, strict=True):
        np.testing.assert_allclose(one, other[::-1], rtol=0.0, atol=1e-11 * np.ptp(one))


@pytest.mark.parametrize("plant", [TwoInertias(AXIS), Rigid(2e-3, 0.04)])
def test_free_motion_and_answer_add_up(plant: Plant) -> None:
    random = np.random.default_rng(4)
    free = plant.free(STEP, 60)
    count, channels, length = free.shape
    first, last = random.standard_normal((2, channels, 3, length))
    states = random.standard_normal((3, count))
    together, _ = plant.respond(STEP, Torque(first, last), states)
    driven, _ = plant.respond(STEP, Torque(first, last))
    expected = driven + np.einsum("ws,scl->cwl", states, free)
    np.testing.assert_allclose(together, expected, rtol=0.0, atol=1e-11 * np.ptp(together))


@pytest.mark.parametrize("plant", [TwoInertias(AXIS), Rigid(2e-3, 0.04)])
def test_a_plant_is_its_values(plant: Plant) -> None:
    assert len(plant.values) == len(plant.names)
    assert plant.with_values(plant.values) == plant


def test_plants_that_look_alike_from_afar_keep_inertia_and_frequency() -> None:
    wn = core.modal(AXIS).wn
    others = TwoInertias(AXIS).others()
    assert len(others) > 1
    for plant in others:
        assert isinstance(plant, TwoInertias)
        first, second, _, _ = astuple(plant.axis)
        assert first + second == pytest.approx(AXIS.I1 + AXIS.I2)
        assert plant.frequency == pytest.approx(wn)


@pytest.mark.parametrize("x", [0.05, 0.2, 0.5, 1.0])
def test_a_smooth_torque_keeps_the_size_of_an_oscillation(x: float) -> None:
    """``x`` radians a sample; what the straight lines have of it by numerical integration."""
    periods = 8
    count = round(2.0 * np.pi * periods / x)
    turns = 2.0 * np.pi * periods / count
    torque = Torque.smooth(np.sin(turns * np.arange(-2.0, count + 2.0))[None, None])
    first, last = torque.first[0, 0, 2:-2], torque.last[0, 0, 2:-2]
    at = (np.arange(200) + 0.5) / 200
    lines = first[:, None] + (last - first)[:, None] * at
    wave = np.sin(turns * (np.arange(count)[:, None] + at))
    gain = 2.0 * np.mean(lines * wave)
    assert abs(gain - 1.0) < turns**4 / 80.0 + 1e-5
