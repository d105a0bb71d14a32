"""The engine of the diagnosis against the machine in C, which simulates every effect by itself.

The engine knows each effect as what it adds along a measured motion; the machine moves by it. Where
the engine finds the parameters that the machine was given, both have the same physics.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin.core import Effect
from axistwin.diagnose import diagnose, windows
from axistwin.diagnose.answer import stiff
from axistwin.diagnose.effects import Found, Kind, TorqueDelay, catalogue, of
from axistwin.diagnose.fit import Fit
from axistwin.diagnose.linear import Plant, Rigid, Torque, TwoInertias
from axistwin.diagnose.state import State
from axistwin.diagnose.trials import Trials
from axistwin.identify.samples import Hold

from .diagnosis_records import AXIS, NOISE, STEP, record, shake

TORQUE = shake(6000)


def coulomb(location: str) -> Effect:
    return Effect("friction_coulomb", location, {"torque": 0.02})


#: One of each kind, by itself or on top of the friction that it needs.
CASES = [
    *(
        effect
        for place in ("motor", "table")
        for effect in (
            coulomb(place),
            Effect("friction_viscous", place, {"coefficient": 1e-3}),
            Effect("friction_asymmetry", place, {"coefficient": -8e-4}),
            Effect("friction_stribeck", place, {"torque": 0.03, "speed": 2.0}),
            Effect("friction_drift", place, {"rate": 0.05}),
            Effect("disturbance", place, {"amplitude": 0.01, "frequency": 61.0, "phase": 0.7}),
        )
    ),
    Effect("encoder_eccentricity", "encoder1", {"amplitude": 1e-3, "phase": 0.7}),
    Effect("encoder_eccentricity", "encoder2", {"amplitude": 1e-3, "phase": -2.0}),
    Effect("lead_error", "table", {"amplitude": 1e-3, "periods": 7.0, "phase": 0.7}),
    Effect("delay", "encoder1", {"time": 0.6e-3}),
    Effect("delay", "encoder2", {"time": 2.3e-3}),
    Effect("delay", "torque", {"time": 1.7e-3}),
    Effect("torque_saturation", "motor", {"limit": 0.3}),
    Effect("torque_offset", "motor", {"torque": 0.01}),
    Effect("torque_ripple", "motor", {"amplitude": 0.01, "periods": 12.0, "phase": 0.7}),
    Effect("stiffness_hardening", "shaft", {"coefficient": 1e5}),
    Effect("stiffness_drift", "shaft", {"rate": 0.02}),
    Effect("backlash", "shaft", {"gap": 2e-3}),
    Effect("load_change", "table", {"ratio": 0.4, "time": 2.6}),
    Effect("extra_mode", "table", {"frequency": 120.0, "damping_ratio": 0.02, "mass_ratio": 0.2}),
]


def name(effect: Effect) -> str:
    return f"{effect.effect}:{effect.location}"


def kinds(effect: Effect) -> list[Kind]:
    """The effect at every place that it can have."""
    return [kind for kind in catalogue(2, linear=False) if kind.effect == effect.effect]


def beside(effect: Effect) -> tuple[Effect, ...]:
    """What has to be there for an effect to act on."""
    if effect.effect == "friction_asymmetry":
        return (Effect("friction_viscous", effect.location, {"coefficient": 2e-3}),)
    return (coulomb(effect.location),) if effect.effect == "friction_drift" else ()


def known(*effects: Effect) -> tuple[Found, ...]:
    """Effects as if they had been found."""
    return tuple(one for one in map(of, effects) if one is not None)


def test_every_kind_is_compared() -> None:
    assert sorted(name(effect) for effect in CASES) == sorted(
        kind.name for kind in catalogue(2, linear=False)
    )


@pytest.mark.parametrize("effect", CASES, ids=name)
def test_an_effect_is_known_by_its_parameters(effect: Effect) -> None:
    (found,) = known(effect)
    assert (found.kind.effect, found.kind.location) == (effect.effect, effect.location)
    assert dict(found.params) == pytest.approx(effect.params)


def test_what_is_of_the_record_is_no_effect_along_a_motion() -> None:
    assert known(Effect("sample_loss", "record", {"fraction": 0.1})) == ()


@pytest.mark.parametrize("effect", CASES, ids=name)
def test_the_machine_and_the_engine_have_the_same_physics(effect: Effect) -> None:
    """From the true axis, so that only the effect is unknown; then with the axis unknown too."""
    others = beside(effect)
    cut = windows.cut(record(*others, effect, torque=TORQUE), 0.25)
    fit = Fit(cut, "zoh", TwoInertias(AXIS), found=known(*others))
    fit = fit.with_noise(fit.motion(None))
    before = State(fit, fit.motion(fit.motion(None)))
    best = Trials(before).run(kinds(effect), lambda _: None)[0].found
    assert (best.kind.effect, best.kind.location) == (effect.effect, effect.location)

    after = State.of(replace(fit, found=(*fit.found, best)), before.motion)
    assert after.scale < max(1e-2 * before.scale, 1.1)
    for parameter, value in after.fit.found[-1].params.items():
        truth = effect.params[parameter]
        assert value == pytest.approx(truth, rel=0.02), parameter
    np.testing.assert_allclose(after.fit.plant.values, TwoInertias(AXIS).values, rtol=0.01)


def test_a_gap_that_is_crossed_within_a_sample_is_found() -> None:
    """The shaft then pulls to one side, and before the next sample to the other."""
    gap = Effect("backlash", "shaft", {"gap": 1e-4})
    cut = windows.cut(record(gap, torque=TORQUE), 0.25)
    fit = Fit(cut, "zoh", TwoInertias(AXIS))
    fit = fit.with_noise(fit.motion(None))
    before = State(fit, fit.motion(fit.motion(None)))
    within = np.abs(before.motion.twist) < 0.5e-4
    assert np.mean(within[:, 1:] & within[:, :-1]) < 0.01
    best = Trials(before).run(catalogue(2, linear=False), lambda _: None)[0]
    assert best.found.kind.effect == "backlash"
    assert best.found.shape[0] == pytest.approx(1e-4, rel=0.1)
    assert before.scale > 10.0
    assert np.mean(best.after) == pytest.approx(before.samples, rel=0.05)


HOLDS: list[Hold] = ["zoh", "foh"]


@pytest.mark.parametrize("hold", HOLDS)
def test_the_torque_goes_on_between_samples_as_is_said(hold: Hold) -> None:
    """Taken otherwise, it would be half a sample early or late."""
    cut = windows.cut(record(torque=TORQUE, hold=hold), 0.25)
    for assumed in HOLDS:
        fit = Fit(cut, assumed, TwoInertias(AXIS), noise=np.full(2, NOISE))
        state = State(fit, fit.motion(None))
        assert (state.scale < 1.1) == (assumed == hold)


@pytest.mark.parametrize("hold", HOLDS)
def test_a_delay_of_any_part_of_a_sample_is_found(hold: Hold) -> None:
    late = Effect("delay", "torque", {"time": 1.7e-3})
    fit = Fit(windows.cut(record(late, torque=TORQUE, hold=hold), 0.25), hold, TwoInertias(AXIS))
    fit = fit.with_noise(fit.motion(None))
    found = Trials(State(fit, fit.motion(None))).run([TorqueDelay()], lambda _: None)[0].found
    assert found.params["time"] == pytest.approx(1.7e-3, rel=0.01)


def cut_of(plant: Plant) -> Fit:
    """A plant against a short part of a record, two channels weighted differently."""
    part = record(torque=TORQUE[:1000])
    if isinstance(plant, Rigid):
        part = replace(part, theta2=None)
    cut = windows.cut(part, 0.1)
    return Fit(cut, "zoh", plant, noise=np.array([1e-5, 3e-5])[: cut.channels])


PLANTS = [cut_of(TwoInertias(AXIS)), cut_of(Rigid(1.5e-3, 0.01))]


@given(st.sampled_from(PLANTS), st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_no_initial_state_is_left_in_an_error(fit: Fit, seed: int) -> None:
    random = np.random.default_rng(seed)
    free = fit.plant.free(STEP, fit.windows.length)
    states = random.standard_normal((fit.windows.count, len(free)))
    nothing = np.zeros_like(fit.windows.angles)
    angles, _ = fit.plant.respond(STEP, Torque(nothing, nothing), states)
    size = np.max(np.abs(angles * fit.weights))
    assert np.max(np.abs(fit.project(angles))) < 1e-10 * size
    np.testing.assert_allclose(fit.states(angles), states, rtol=0.0, atol=1e-6)

    errors = random.standard_normal(angles.shape)
    np.testing.assert_allclose(
        fit.project(errors + angles), fit.project(errors), rtol=0.0, atol=1e-10 * size
    )


def test_sensitivities_are_derivatives() -> None:
    """Where the error is none, as the derivative of the projection is left out (Kaufman 1975)."""
    rough = cut_of(TwoInertias(AXIS))
    found = tuple(
        Found(
            next(kind for kind in catalogue(2, linear=False) if kind.name == which),
            np.array(sizes),
            shape,
        )
        for which, sizes, shape in (
            ("friction_viscous:table", [1e-3], ()),
            ("friction_stribeck:motor", [0.02], (9.0,)),
            ("disturbance:motor", [0.01, 0.02], (61.0,)),
            ("delay:encoder2", [], (0.7e-3,)),
            ("backlash:shaft", [], (2e-3,)),
        )
    )
    rough = replace(rough, found=found, zero=0.01)
    motion = rough.motion(rough.motion(None))
    angles, _ = rough.simulate(motion, rough.states(rough.measured))
    fit = replace(rough, windows=replace(rough.windows, angles=angles))
    columns = fit.sensitivity(motion)
    assert np.max(np.abs(fit.residual(motion))) < 1e-6 * np.max(np.abs(columns[:, 0]))
    assert columns.shape[1] == len(fit.values) == len(fit.names)
    for i, direction in enumerate(fit.directions.T):
        share = 1e-5 * float(np.max(np.abs(fit.values[direction != 0.0])))
        share /= float(np.max(np.abs(direction)))
        step = share * direction
        up, down = (fit.with_values(fit.values + s).residual(motion) for s in (step, -step))
        slope = (down - up) / (2.0 * share)
        size = np.max(np.abs(slope))
        np.testing.assert_allclose(columns[:, i], slope, rtol=0.0, atol=5e-3 * size)


def test_a_window_that_has_run_away_counts_although_it_is_held_out() -> None:
    """No step is taken there: what is simulated next would begin from nowhere."""
    cut = windows.cut(record(torque=TORQUE), 0.25)
    fit = Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE))
    residual = fit.residual(fit.motion(None))
    assert np.isfinite(fit.misfit(residual))
    residual[np.flatnonzero(cut.held_out)[0], 3] = np.inf
    assert fit.misfit(residual) == np.inf


def test_nothing_is_named_in_a_record_of_an_ideal_axis() -> None:
    found = diagnose(record(torque=TORQUE), window=0.25)
    assert found.findings == ()
    assert not found.unexplained
    assert found.base_valid
    assert found.error.base == pytest.approx(NOISE, rel=0.1)
    assert found.error.noise_floor == pytest.approx(NOISE, rel=0.1)
    for quantity, truth in zip(found.axis.values(), TwoInertias(AXIS).values, strict=True):
        assert quantity.value == pytest.approx(truth, rel=0.01)
        assert abs(quantity.value - truth) < 5.0 * quantity.stderr


def test_what_is_named_is_what_the_machine_had() -> None:
    effects = (
        coulomb("table"),
        Effect("torque_ripple", "motor", {"amplitude": 0.01, "periods": 12.0, "phase": 0.7}),
    )
    found = diagnose(record(*effects, torque=TORQUE), window=0.25)
    assert [(one.effect, one.location) for one in found.findings] == [
        (one.effect, one.location) for one in effects
    ]
    for finding, effect in zip(found.findings, effects, strict=True):
        assert dict(finding.params) == pytest.approx(effect.params, rel=0.02)
        for parameter, (low, high) in finding.ci95.items():
            assert low <= finding.params[parameter] <= high
    assert found.model.effects == tuple(
        Effect(one.effect, one.location, dict(one.params)) for one in found.findings
    )


def test_what_short_windows_show_is_taken_to_long_ones() -> None:
    """Friction has the simulation soon do something else; a drift is small and slow."""
    effects = (
        Effect("friction_coulomb", "table", {"torque": 0.05}),
        Effect("stiffness_drift", "shaft", {"rate": 3e-4}),
    )
    found = diagnose(record(*effects, torque=shake(8000)))
    assert [(one.effect, one.location) for one in found.findings] == [
        (one.effect, one.location) for one in effects
    ]
    assert found.findings[0].params["torque"] == pytest.approx(0.05, rel=1e-5)
    assert found.findings[1].params["rate"] == pytest.approx(3e-4, rel=0.1)
    assert found.window == pytest.approx(0.5, rel=0.02)
    assert not found.unexplained


def test_one_encoder_is_enough_for_what_acts_at_the_motor() -> None:
    inertia = 1.5e-3
    rigid = record(coulomb("motor"), torque=TORQUE, axis=stiff(inertia, STEP))
    found = diagnose(replace(rigid, theta2=None), window=0.25)
    assert [(one.effect, one.location) for one in found.findings] == [("friction_coulomb", "motor")]
    assert found.findings[0].params["torque"] == pytest.approx(0.02, rel=0.02)
    assert found.axis["I"].value == pytest.approx(inertia, rel=0.01)
