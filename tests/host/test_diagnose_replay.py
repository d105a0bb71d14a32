"""Windows simulated with their effects, against long simulations and what made a record."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from axistwin import core
from axistwin.core import Array, Axis, Effect, Motion
from axistwin.diagnose import windows
from axistwin.diagnose.answer import stiff
from axistwin.diagnose.effects import (
    Backlash,
    Coulomb,
    EncoderDelay,
    ExtraMode,
    Found,
    FrictionDrift,
    Hardening,
)
from axistwin.diagnose.fit import Fit
from axistwin.diagnose.linear import Plant, Rigid, ThreeInertias, Torque, TwoInertias
from axistwin.diagnose.replay import Replay, find_replay
from axistwin.diagnose.state import State
from axistwin.diagnose.trials import Trials
from axistwin.errors import InputError
from axistwin.model import Model
from axistwin.record import Record

from .effects_reference import Friction, Reference

AXIS = Axis(1e-3, 5e-4, 8e-3, 20.0)  # 245 rad/s, damping ratio 0.05
STEP = 1e-3
NOISE = 5e-6


def torque(samples: int) -> Array:
    """Held for some samples each, so that everything is moved, there and back."""
    levels = np.random.default_rng(3).choice([-1.0, 0.3, 1.0], samples // 40 + 1)
    return np.repeat(0.05 * levels, 40)[:samples]


def states(motion: Motion, at: npt.NDArray[np.int64]) -> Array:
    """Of a motion at some samples (w,), in the order of State."""
    columns = motion.twist, motion.twist_speed, motion.omega1, motion.theta1
    return np.stack([column[at] for column in columns], axis=1)


@pytest.mark.parametrize(
    "effects",
    [
        [Effect("friction_viscous", "table", {"coefficient": 1e-3})],
        [
            Effect("friction_viscous", "motor", {"coefficient": 1e-3}),
            Effect("friction_asymmetry", "motor", {"coefficient": -6e-4}),
            Effect("friction_drift", "motor", {"rate": 0.7}),
        ],
        [
            Effect("friction_coulomb", "motor", {"torque": 0.01}),
            Effect("friction_drift", "motor", {"rate": 0.7}),
        ],
        [Effect("stiffness_drift", "shaft", {"rate": -0.3})],
        [Effect("load_change", "table", {"ratio": 0.6, "time": 0.9137})],
        [Effect("disturbance", "table", {"amplitude": 0.02, "frequency": 31.0, "phase": 0.4})],
        [Effect("torque_ripple", "motor", {"amplitude": 0.02, "periods": 7.0, "phase": 1.0})],
        [Effect("backlash", "shaft", {"gap": 4e-4})],
        [Effect("stiffness_hardening", "shaft", {"coefficient": 3e5})],
    ],
    ids=lambda effects: effects[-1].effect,
)
def test_a_window_goes_on_where_a_simulation_was(effects: list[Effect]) -> None:
    command, length = torque(2000), 100
    whole = core.simulate_effects(AXIS, effects, STEP, command, held=True, substeps=200)
    at = np.arange(0, 2000 - length, 190, dtype=np.int64)
    times: Array = STEP * at.astype(np.float64)
    cut = at[:, None] + np.arange(length)
    angles, speeds = core.simulate_windows(
        AXIS, effects, STEP, command[cut], times, states(whole, at), 50
    )
    start = whole.theta1[at][:, None]
    for found, expected in (
        (angles[0], whole.theta1[cut] - start),
        (angles[1], whole.theta2[cut] - start),
        (speeds[0], whole.omega1[cut]),
        (speeds[1], whole.omega2[cut]),
    ):
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-4 * np.max(np.abs(expected)))


#: Of some starts scipy's events miss a rest that is short.
STARTS: Array = np.random.default_rng(7).standard_normal((8, 4)) * (3e-3, 0.5, 0.5, 0.0)
PUSH, LENGTH = 0.015, 60


def error_of_steps(effect: Effect, truth: Reference) -> Callable[[int], float]:
    """By the steps from sample to sample: against scipy's integration with events, in units of how
    far the axis is twisted."""
    times = STEP * np.arange(LENGTH, dtype=np.float64)
    of_angles = np.array([[0.0, 0.0, 0.0, 1.0], [-1.0, 0.0, 0.0, 1.0]])
    of_speeds = np.array([[0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 1.0, 0.0]])
    both = np.concatenate([of_angles, of_speeds])
    expected = np.stack([truth.run(times, both @ start)[:, :2] for start in STARTS])
    twisted = float(np.std(expected[:, :, 0] - expected[:, :, 1]))
    pushed = np.full((len(STARTS), LENGTH), PUSH)
    axis, at_once = replace(AXIS, B=0.0), np.zeros(len(STARTS))

    def error(substeps: int) -> float:
        angles, _ = core.simulate_windows(axis, [effect], STEP, pushed, at_once, STARTS, substeps)
        away = angles.transpose(1, 2, 0) - expected
        return float(np.sqrt(np.mean(away**2))) / twisted

    return error


@pytest.mark.parametrize("place", [0, 1])
def test_friction_leaves_errors_of_third_order(place: int) -> None:
    """Slides, turns round, sticks and breaks away."""
    limit = 0.02
    dry = tuple(Friction(coulomb=limit if place == i else 0.0) for i in (0, 1))
    truth = Reference((AXIS.I1, AXIS.I2, 0.0, AXIS.K), lambda _: PUSH, (dry[0], dry[1]))
    effect = Effect("friction_coulomb", ("motor", "table")[place], {"torque": limit})
    error = error_of_steps(effect, truth)
    assert error(2) < 3e-5
    assert error(8) < error(2) / 40.0


def test_a_shaft_that_is_no_straight_line_leaves_errors_of_third_order() -> None:
    """It flies free, meets a flank and leaves it; it gets stiffer the more it is twisted."""
    axis, push = (AXIS.I1, AXIS.I2, 0.0, AXIS.K), lambda _: PUSH
    for effect, truth in (
        (Effect("backlash", "shaft", {"gap": 4e-3}), Reference(axis, push, gap=4e-3)),
        (Effect("backlash", "shaft", {"gap": 4e-4}), Reference(axis, push, gap=4e-4)),
        (
            Effect("stiffness_hardening", "shaft", {"coefficient": 4e5}),
            Reference(axis, push, hardening=4e5),
        ),
    ):
        error = error_of_steps(effect, truth)
        assert error(2) < 3e-5
        assert error(8) < error(2) / 40.0


def test_the_vibration_is_exact_in_spite_of_the_steps() -> None:
    starts = np.array([[1e-3, 0.0, 0.0, 0.0], [0.0, 0.2, 1.0, 0.0]])
    still = np.zeros((2, 400))
    angles, _ = core.simulate_windows(AXIS, [], STEP, still, np.zeros(2), starts, 1)
    plant = TwoInertias(AXIS)
    nothing = np.zeros((2, 2, 400))
    exact, _ = plant.respond(STEP, Torque(nothing, nothing), plant.states(starts))
    found, expected = angles[0] - angles[1], exact[0] - exact[1]
    modal = core.modal(AXIS)
    envelope = np.exp(-modal.zeta * modal.wn * STEP * np.arange(400))
    size = np.array([[1e-3], [0.2 / modal.wn]])
    assert np.max(np.abs(found - expected) / (size * envelope)) < 1e-3


def test_a_further_mode_swings_on_in_a_window() -> None:
    mode = {"frequency": 400.0, "damping_ratio": 0.02, "mass_ratio": 0.2}
    system = ThreeInertias(AXIS, *mode.values())
    given = np.random.default_rng(3).standard_normal((5, 6)) * (1e-3, 0.1, 1e-3, 0.1, 1e-3, 0.1)
    starts = system.starts(given)
    np.testing.assert_allclose(system.states(starts), given, rtol=0.0, atol=1e-15)
    held = 0.01 * np.random.default_rng(4).standard_normal((5, 100))
    nothing = np.zeros_like(held)
    both = np.stack([held, nothing])
    exact_angles, exact_speeds = system.respond(STEP, Torque(both, both), given)
    angles, speeds = core.simulate_windows(
        AXIS, [Effect("extra_mode", "table", mode)], STEP, held, np.zeros(5), starts, 200
    )
    for found, exact in ((angles + starts[:, 3:4], exact_angles), (speeds, exact_speeds)):
        np.testing.assert_allclose(found, exact, rtol=0.0, atol=1e-4 * np.max(np.abs(exact)))
    resting, _ = core.simulate_windows(
        AXIS, [Effect("extra_mode", "table", mode)], STEP, held, np.zeros(5), starts[:, :4], 200
    )
    assert np.max(np.abs(resting - angles)) > 0.1 * np.max(np.abs(angles[0] - angles[1]))


def test_windows_of_what_no_axis_can_be_are_refused() -> None:
    at = np.zeros(1), np.zeros((1, 4))
    with pytest.raises(InputError):
        core.simulate_windows(
            AXIS, [Effect("backlash", "shaft", {"gap": -1.0})], STEP, np.zeros((1, 9)), *at
        )
    with pytest.raises(InputError):
        core.simulate_windows(
            AXIS, [], STEP, np.zeros((1, 9)), np.zeros(1), np.full((1, 4), np.nan)
        )
    drifting = [Effect("stiffness_drift", "shaft", {"rate": -0.5})]
    with pytest.raises(InputError):
        core.simulate_windows(AXIS, drifting, STEP, np.zeros((1, 9)), np.full(1, 3.0), at[1])


@pytest.mark.parametrize("plant", [TwoInertias(AXIS), Rigid(2e-3, 0.01)])
def test_the_states_of_core_and_plant_are_the_same(plant: Plant) -> None:
    count = plant.free(STEP, 2).shape[0]
    given = np.random.default_rng(1).standard_normal((5, count))
    starts = plant.starts(given)
    np.testing.assert_allclose(plant.states(starts), given, rtol=0.0, atol=1e-14)
    nothing = np.zeros((plant.free(STEP, 2).shape[1], 5, 3))
    angles, speeds = plant.respond(STEP, Torque(nothing, nothing), given)
    np.testing.assert_allclose(starts[:, 3], angles[0, :, 0], rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(starts[:, 2], speeds[0, :, 0], rtol=0.0, atol=1e-14)
    if len(angles) == 2:
        np.testing.assert_allclose(starts[:, 0], angles[0, :, 0] - angles[1, :, 0], atol=1e-14)
        np.testing.assert_allclose(starts[:, 1], speeds[0, :, 0] - speeds[1, :, 0], atol=1e-14)


# ---- Fits


def record(effects: tuple[Effect, ...], *, one: bool = False, noise: float = NOISE) -> Record:
    """Of an axis with effects, its encoders with noise."""
    command = torque(16_000)
    axis = stiff(1.5e-3, STEP) if one else AXIS
    theta = Model(axis, effects).simulate(command, STEP, substeps=60)
    random = np.random.default_rng(5)
    first, second = (angle + noise * random.standard_normal(len(angle)) for angle in theta)
    time: Array = STEP * np.arange(len(command), dtype=np.float64)
    return Record(
        time=time,
        torque=command,
        theta1=first,
        theta2=None if one else second,
        time_step=STEP,
    )


def nearly(plant: Plant) -> Plant:
    """A plant that is a few per cent off."""
    return plant.with_values(plant.values * np.resize([1.03, 0.95, 1.2, 0.97], len(plant.values)))


def fitted(record: Record, plant: Plant, found: tuple[Found, ...], noise: float = NOISE) -> Replay:
    """The replay of a fit that starts off a few per cent from what is true."""
    cut = windows.cut(record)
    fit = Fit(cut, "zoh", nearly(plant), found=found, noise=np.full(cut.channels, noise))
    fit, motion = fit.adjust()
    played = find_replay(fit, motion)
    assert played is not None
    return played


def deviations(played: Replay, expected: Array) -> Array:
    """Of all unknowns but the zero of the encoders, in standard errors."""
    columns = played.columns[~played.fit.windows.held_out]
    gram = np.einsum("wan,wbn->ab", columns, columns)
    spread = played.fit.directions @ np.linalg.inv(gram) @ played.fit.directions.T
    found, error = played.fit.values, np.sqrt(np.diag(spread))
    known = [i for i, name in enumerate(played.fit.names) if name != "zero"]
    deviations: Array = (found[known] - expected) / error[known]
    return deviations


def mean_square(played: Replay) -> float:
    """Of what is left, in units of the noise."""
    cut = played.fit.windows
    free = 4 if cut.channels == 2 else 2
    return float(np.sum(played.residual**2)) / (cut.count * (cut.channels * cut.length - free))


def test_a_gap_is_found_as_wide_as_it_is() -> None:
    gap = 1.5e-3
    played = fitted(
        record((Effect("backlash", "shaft", {"gap": gap}),)),
        TwoInertias(AXIS),
        (Found(Backlash(), np.zeros(0), (1.05 * gap,)),),
    )
    assert mean_square(played) == pytest.approx(1.0, abs=0.03)
    assert np.max(np.abs(deviations(played, np.array([*TwoInertias(AXIS).values, gap])))) < 4.0


def test_a_stiffness_that_goes_with_the_twist_is_found_in_much_noise() -> None:
    """The linear axis that comes nearest vibrates so much faster: whole windows lead nowhere."""
    coefficient, noise, axis = 2e5, 3e-3, replace(AXIS, B=2e-3)
    random = np.random.default_rng(3)
    command = 0.15 * random.standard_normal(12_000)
    effects = (Effect("stiffness_hardening", "shaft", {"coefficient": coefficient}),)
    theta = Model(axis, effects).simulate(command, STEP, substeps=30)
    first, second = (angle + noise * random.standard_normal(len(angle)) for angle in theta)
    time: Array = STEP * np.arange(len(command), dtype=np.float64)
    cut = windows.cut(Record(time, command, first, STEP, second), 0.5)
    fit, motion = Fit(cut, "zoh", TwoInertias(axis), noise=np.full(2, noise)).adjust()
    assert fit.scale(fit.residual(motion)) < 2.0
    assert fit.plant.values[3] > 1.2 * axis.K
    found = Found(Hardening(), np.array([0.01 * coefficient]), ())
    played = find_replay(replace(fit, found=(found,)), motion)
    assert played is not None
    assert played.fit.found[0].sizes == pytest.approx([coefficient], rel=0.05)
    assert played.fit.plant.values[3] == pytest.approx(axis.K, rel=0.05)
    assert mean_square(played) < 1.1


def test_friction_that_holds_an_axis_is_found_and_a_delay_beside_it() -> None:
    friction, delay = 0.02, 3e-4
    effects = (
        Effect("friction_coulomb", "motor", {"torque": friction}),
        Effect("delay", "encoder2", {"time": delay}),
    )
    found = (
        Found(Coulomb(0), np.array([0.96 * friction]), ()),
        Found(EncoderDelay(1), np.zeros(0), (1.05 * delay,)),
    )
    played = fitted(
        record(effects),
        TwoInertias(AXIS),
        found,
    )
    assert mean_square(played) == pytest.approx(1.0, abs=0.05)
    truth = np.array([*TwoInertias(AXIS).values, friction, delay])
    known = [i for i, name in enumerate(played.fit.names) if name != "zero"]
    assert np.max(np.abs(played.fit.values[known] / truth - 1.0)) < 5e-3


def test_friction_of_a_rigid_axis_that_stops_is_found() -> None:
    friction, viscous = 0.02, 2e-3
    effects = (
        Effect("friction_coulomb", "motor", {"torque": friction}),
        Effect("friction_viscous", "motor", {"coefficient": viscous}),
    )
    found = (Found(Coulomb(0), np.array([0.96 * friction]), ()),)
    played = fitted(
        record(effects, one=True),
        Rigid(1.5e-3, viscous),
        found,
    )
    assert mean_square(played) == pytest.approx(1.0, abs=0.05)
    truth = np.array([1.5e-3, viscous, friction])
    assert np.max(np.abs(played.fit.values / truth - 1.0)) < 0.01


@pytest.mark.parametrize(("place", "friction"), [(0, 0.035), (1, 0.02)])
def test_a_replay_beside_another_one_begins_as_that(
    place: int, friction: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    effect = Effect("friction_coulomb", ("motor", "table")[place], {"torque": friction})
    found = (Found(Coulomb(place), np.array([0.96 * friction]), ()),)
    first = fitted(record((effect,)), TwoInertias(AXIS), found)
    # In windows that are all fitted, and a little off, as one with a further effect begins.
    all_fitted = replace(first.fit.windows, held_out=np.zeros(first.fit.windows.count, np.bool_))
    off = replace(first.fit.with_values(first.fit.values * (1.0 + 1e-5)), windows=all_fitted)

    simulations = 0
    simulate = core.simulate_windows

    def counted(*given: Any) -> tuple[Array, Array]:
        nonlocal simulations
        simulations += 1
        return simulate(*given)

    monkeypatch.setattr(core, "simulate_windows", counted)
    alone = find_replay(off, first.motion)
    of_alone, simulations = simulations, 0
    beside = find_replay(off, first.motion, first)
    assert alone is not None
    assert beside is not None
    assert simulations < 0.8 * of_alone
    for one in (alone, beside):
        assert mean_square(one) == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(beside.fit.values, alone.fit.values, rtol=2e-3, atol=2e-6)


@pytest.mark.parametrize("noise", [0.005 * NOISE, 0.1 * NOISE])
def test_what_is_missed_by_steps_is_no_more_than_an_effect_could_be_taken_for(noise: float) -> None:
    effects = (Effect("friction_coulomb", "table", {"torque": 0.02}),)
    found = (Found(Coulomb(1), np.array([0.02]), ()),)
    played = fitted(record(effects, noise=noise), TwoInertias(AXIS), found, noise)
    cut, plant = played.fit.windows, played.fit.plant
    assert isinstance(plant, TwoInertias)
    torques, times, starts = cut.cut(cut.torque), cut.time[:, 0], played.starts

    def of_effects(substeps: int) -> Array:
        given = (STEP, torques, times, starts, substeps)
        with_them, without = (
            core.simulate_windows(plant.axis, acting, *given)[0] for acting in (effects, ())
        )
        return with_them - without

    def missed(substeps: int) -> float:
        return float(np.sum(played.fit.project(of_effects(substeps) - of_effects(300)) ** 2))

    assert missed(played.substeps) < 40.0
    # nor are they finer than that takes
    assert missed(played.substeps // 2) > 40.0


def test_a_window_begins_where_the_one_before_it_ends() -> None:
    effects = (Effect("backlash", "shaft", {"gap": 0.02}),)
    first = fitted(record(effects), TwoInertias(AXIS), (Found(Backlash(), np.zeros(0), (0.02,)),))
    starts = first.starts.copy()
    starts[[7, 20]] += [0.3, -90.0, 40.0, -0.6]  # from there no small steps lead back
    lost = replace(first, _point=replace(first._point, starts=starts))
    found = find_replay(first.fit, first.motion, lost)
    assert found is not None
    assert mean_square(found) == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(found.starts[[7, 20]], first.starts[[7, 20]], rtol=0.0, atol=1e-4)


def test_friction_beside_a_further_mode_is_replayed() -> None:
    friction, shape, ratio = 0.01, (500.0, 0.02), 0.15
    params = {"frequency": shape[0], "damping_ratio": shape[1], "mass_ratio": ratio}
    given = record(
        (
            Effect("friction_coulomb", "motor", {"torque": friction}),
            Effect("extra_mode", "table", params),
        )
    )
    found = (
        Found(Coulomb(0), np.array([0.97 * friction]), ()),
        Found(ExtraMode(1), np.array([1.02 * ratio]), (1.005 * shape[0], shape[1])),
    )
    played = fitted(given, TwoInertias(AXIS), found)
    assert mean_square(played) == pytest.approx(1.0, abs=0.1)
    found_values = np.delete(played.fit.values, played.fit.names.index("zero"))
    truth = [AXIS.I1, AXIS.I2, AXIS.B, AXIS.K, friction, ratio, *shape]
    # The steps of the core leave two frequencies off by a thousandth, and their damping by more.
    tolerance = [2e-3, 2e-3, 3e-2, 2e-3, 2e-3, 1e-2, 2e-3, 5e-2]
    assert np.all(np.abs(found_values / truth - 1.0) < tolerance)


def test_what_moves_nothing_is_tried_beside_a_replay_and_gains_nothing() -> None:
    """A friction that is nothing has no drift."""
    played = fitted(
        record((Effect("friction_coulomb", "motor", {"torque": 0.01}),)),
        TwoInertias(AXIS),
        (Found(Coulomb(0), np.array([0.01]), ()),),
        noise=0.5 * NOISE,
    )
    still = replace(played.motion, friction=np.zeros_like(played.motion.friction))
    trials = Trials(State(played.fit, still, played)).run([FrictionDrift(0)], lambda _: None)
    assert [trial.gain for trial in trials] == [0.0]


def test_a_linear_axis_is_not_replayed() -> None:
    cut = windows.cut(record(()))
    fit = Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE))
    motion = fit.motion(None)
    assert find_replay(fit, motion) is None
    mode = Found(ExtraMode(1), np.array([0.1]), (500.0, 0.02))
    assert find_replay(replace(fit, found=(mode,)), motion) is None
