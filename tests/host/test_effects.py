"""The axis with effects against scipy: events, matrix exponentials, closed forms."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import scipy.interpolate
import scipy.linalg
import scipy.signal

from axistwin import core
from axistwin.core import Array, Axis, Effect, State
from axistwin.errors import InputError

from .effects_reference import Friction, Reference

#: 39 Hz; a torque below that leads through sliding, sticking and both flanks.
NUMBERS = (1e-3, 5e-4, 5e-3, 20.0)
AXIS = Axis(*NUMBERS)
STEP = 2e-4
TIMES: Array = STEP * np.arange(10000, dtype=np.float64)


def torque(t: Any) -> Any:
    """A smooth torque [N m] at one or many times [s]."""
    return 0.12 * np.sin(2 * np.pi * 1.3 * t) + 0.08 * np.sin(2 * np.pi * 7.1 * t + 1.0)


def dry(coulomb: float, location: str) -> Effect:
    return Effect("friction_coulomb", location, {"torque": coulomb})


def stribeck(extra: float, speed: float, location: str) -> Effect:
    return Effect("friction_stribeck", location, {"torque": extra, "speed": speed})


def run(effects: Sequence[Effect], *, substeps: int = 1) -> Array:
    """Angles and speeds (n, 4) by the core."""
    motion = core.simulate_effects(AXIS, effects, STEP, torque(TIMES), substeps=substeps)
    return np.column_stack([motion.theta1, motion.theta2, motion.omega1, motion.omega2])


def reference(**what: Any) -> Array:
    """Angles and speeds (n, 4) by scipy."""
    return Reference(NUMBERS, torque, **what).run(np.array(TIMES), np.zeros(4))


def assert_close(found: Array, expected: Array, tolerance: float, twist: float) -> None:
    """Angles and speeds within a share of their range, and the twist within a share of its own."""
    span = np.ptp(expected, axis=0)
    assert np.all(np.max(np.abs(found - expected), axis=0) <= tolerance * span)
    twists = [values[:, 0] - values[:, 1] for values in (found, expected)]
    assert np.max(np.abs(twists[0] - twists[1])) <= twist * np.ptp(twists[1])


# Effects, what the reference calls them, and how far angles and speeds, and the twist, may be off.
# Bounces between flanks repeat any difference enlarged: what is 1e-5 now is 1e-3 after a second.
CASES: dict[str, tuple[list[Effect], dict[str, Any], float, float]] = {
    "coulomb at the motor": (
        [dry(0.05, "motor")],
        {"friction": (Friction(0.05), Friction())},
        5e-4,
        2e-3,
    ),
    "coulomb at the table": (
        [dry(0.05, "table")],
        {"friction": (Friction(), Friction(0.05))},
        5e-4,
        2e-3,
    ),
    "coulomb at both": (
        [dry(0.06, "motor"), dry(0.05, "table")],
        {"friction": (Friction(0.06), Friction(0.05))},
        5e-4,
        2e-3,
    ),
    "reversals at the motor": (
        [dry(0.01, "motor")],
        {"friction": (Friction(0.01), Friction())},
        5e-5,
        1e-3,
    ),
    "reversals at the table": (
        [dry(0.01, "table")],
        {"friction": (Friction(), Friction(0.01))},
        5e-5,
        1e-3,
    ),
    "all of friction": (
        [
            dry(0.03, "table"),
            stribeck(0.04, 2.0, "table"),
            Effect("friction_viscous", "table", {"coefficient": 2e-3}),
            Effect("friction_viscous", "motor", {"coefficient": 1e-3}),
            dry(0.01, "motor"),
            stribeck(0.01, 1.0, "motor"),
        ],
        {"friction": (Friction(0.01, 1e-3, 0.01, 1.0), Friction(0.03, 2e-3, 0.04, 2.0))},
        5e-4,
        4e-3,
    ),
    "friction of a direction": (
        [
            dry(0.02, "table"),
            Effect("friction_viscous", "table", {"coefficient": 3e-3}),
            Effect("friction_asymmetry", "table", {"coefficient": -2e-3}),
            Effect("friction_viscous", "motor", {"coefficient": 2e-3}),
            Effect("friction_asymmetry", "motor", {"coefficient": 1.5e-3}),
        ],
        {
            "friction": (
                Friction(0.0, 2e-3, asymmetry=1.5e-3),
                Friction(0.02, 3e-3, asymmetry=-2e-3),
            )
        },
        5e-4,
        2e-3,
    ),
    "friction of a direction that grows": (
        [
            Effect("friction_viscous", "table", {"coefficient": 3e-3}),
            Effect("friction_asymmetry", "table", {"coefficient": 2e-3}),
            Effect("friction_drift", "table", {"rate": 0.4}),
        ],
        {"friction": (Friction(), Friction(0.0, 3e-3, drift=0.4, asymmetry=2e-3))},
        5e-4,
        2e-3,
    ),
    "friction that grows": (
        [dry(0.05, "motor"), Effect("friction_drift", "motor", {"rate": 0.4})],
        {"friction": (Friction(0.05, drift=0.4), Friction())},
        5e-4,
        2e-3,
    ),
    "backlash": ([Effect("backlash", "shaft", {"gap": 0.02})], {"gap": 0.02}, 4e-3, 2e-2),
    "hardening": (
        [Effect("stiffness_hardening", "shaft", {"coefficient": 1e6})],
        {"hardening": 1e6},
        2e-4,
        2e-3,
    ),
    "a shaft that gets soft": (
        [Effect("stiffness_drift", "shaft", {"rate": -0.3})],
        {"stiffness_drift": -0.3},
        2e-4,
        2e-3,
    ),
    "a load that comes": (
        [Effect("load_change", "table", {"ratio": 1.5, "time": 0.70003})],
        {"load": (1.5, 0.70003)},
        2e-4,
        2e-3,
    ),
    "a load that goes": (
        [Effect("load_change", "table", {"ratio": -0.6, "time": 0.7})],
        {"load": (-0.6, 0.7)},
        2e-4,
        2e-3,
    ),
    "a further mode": (
        [
            Effect(
                "extra_mode",
                "table",
                {"frequency": 300.0, "damping_ratio": 0.03, "mass_ratio": 0.4},
            )
        ],
        {"mode": (300.0, 0.03, 0.4)},
        2e-4,
        2e-3,
    ),
    "ripple": (
        [
            Effect("torque_ripple", "motor", {"amplitude": 0.02, "periods": 6.0, "phase": 0.5}),
            Effect("torque_ripple", "motor", {"amplitude": 0.01, "periods": 2.37, "phase": -1.0}),
        ],
        {"motor": lambda _t, q: 0.02 * np.sin(6 * q + 0.5) + 0.01 * np.sin(2.37 * q - 1.0)},
        2e-4,
        2e-3,
    ),
    "disturbances and offsets": (
        [
            Effect("disturbance", "motor", {"amplitude": 0.02, "frequency": 40.0, "phase": 0.5}),
            Effect("disturbance", "table", {"amplitude": 0.03, "frequency": 55.0, "phase": -1.0}),
            Effect("torque_offset", "motor", {"torque": 0.004}),
            Effect("torque_offset", "table", {"torque": -0.003}),
        ],
        {
            "motor": lambda t, _q: 0.02 * np.sin(40 * t + 0.5) + 0.004,
            "table": lambda t: 0.03 * np.sin(55 * t - 1.0) - 0.003,
        },
        2e-4,
        2e-3,
    ),
}


@functools.cache
def truth(case: str) -> Array:
    return reference(**CASES[case][1])


@pytest.mark.parametrize("case", CASES)
def test_an_effect_moves_the_axis_as_scipy_says(case: str) -> None:
    effects, _, tolerance, twist = CASES[case]
    assert_close(run(effects), truth(case), tolerance, twist)
    # and the effect is no small one: the ideal axis is far away
    ideal = run([])
    assert np.max(np.abs(ideal[:, 3] - truth(case)[:, 3])) > 10 * tolerance * np.ptp(ideal[:, 3])


@pytest.mark.parametrize(
    "case",
    [
        "coulomb at the motor",
        "coulomb at the table",
        "coulomb at both",
        "reversals at the motor",
        "reversals at the table",
        "all of friction",
        "friction of a direction",
        "hardening",
        "a further mode",
        "ripple",
    ],
)
def test_the_error_falls_with_the_square_of_the_step(case: str) -> None:
    """Of second order, through sticking too; 4 steps from sample to sample leave a tenth."""
    effects = CASES[case][0]
    fine = run(effects, substeps=16)  # the same torque, linear between the samples
    errors = [np.max(np.abs(run(effects, substeps=n) - fine)[:, :2]) for n in (1, 4)]
    assert errors[1] < errors[0] / 8.0


def test_friction_and_play_together_follow_until_the_bounces_part() -> None:
    effects = [Effect("backlash", "shaft", {"gap": 0.02}), dry(0.03, "table")]
    expected = reference(gap=0.02, friction=(Friction(), Friction(0.03)))
    found = run(effects, substeps=8)
    span = np.ptp(expected, axis=0)
    early = slice(0, 2500)
    assert np.all(np.abs(found - expected)[early] <= 2e-2 * span)


def held_solution(A: Array, B: Array, u: Array) -> Array:
    """States (n, k) of x' = A x + B u with u held from each sample to the next."""
    step = scipy.signal.cont2discrete((A, B, np.eye(len(A)), np.zeros_like(B)), STEP, "zoh")
    states = scipy.signal.dlsim(step, u)[2]
    return np.asarray(states, np.float64)


def two_inertias(viscous: tuple[float, float]) -> tuple[Array, Array]:
    """A and B of Eq. 3 with viscous friction for the state angles, speeds."""
    I1, I2, B, K = NUMBERS
    stiff = np.array([[K, -K], [-K, K]])
    drag = np.array([[B + viscous[0], -B], [-B, B + viscous[1]]])
    per = np.diag([1.0 / I1, 1.0 / I2])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-per @ stiff, -per @ drag]])
    return A, np.array([[0.0], [0.0], [1.0 / I1], [0.0]])


def test_a_held_torque_with_viscous_friction_is_the_matrix_exponential() -> None:
    u = np.random.default_rng(1).uniform(-0.2, 0.2, len(TIMES))
    expected = held_solution(*two_inertias((2e-3, 3e-3)), u)
    effects = [
        Effect("friction_viscous", "motor", {"coefficient": 2e-3}),
        Effect("friction_viscous", "table", {"coefficient": 3e-3}),
    ]
    motion = core.simulate_effects(AXIS, effects, STEP, u, held=True, substeps=20)
    assert np.max(np.abs(motion.theta1 - expected[:, 0])) < 1e-6 * np.ptp(expected[:, 0])
    assert np.max(np.abs(motion.omega2 - expected[:, 3])) < 1e-4 * np.ptp(expected[:, 3])


def test_the_further_mode_is_where_its_closed_form_says() -> None:
    """The three frequencies are the eigenvalues of three inertias and two springs."""
    I1, I2, _, K = NUMBERS
    p, ratio = 300.0, 0.4
    I3, K3 = ratio * I2, ratio * I2 * p**2
    stiff = np.array([[K, -K, 0.0], [-K, K + K3, -K3], [0.0, -K3, K3]])
    squares = scipy.linalg.eigh(stiff, np.diag([I1, I2, I3]), eigvals_only=True)
    impulse = np.zeros(2**16)
    impulse[1] = 1.0
    mode = Effect("extra_mode", "table", {"frequency": p, "mass_ratio": ratio})
    motion = core.simulate_effects(Axis(I1, I2, 0.0, K), [mode], STEP, impulse, substeps=10)
    spectrum = np.abs(np.fft.rfft(motion.twist * np.hanning(len(impulse))))
    peaks = scipy.signal.find_peaks(spectrum, height=0.02 * spectrum.max())[0]
    frequencies = 2 * np.pi * peaks / (len(impulse) * STEP)
    assert frequencies == pytest.approx(np.sqrt(squares[1:]), rel=3e-3)


def late(signal: Callable[[Array], Array], delay: float) -> Array:
    return signal(np.maximum(TIMES - delay, 0.0))


def test_a_late_torque_is_that_torque_later() -> None:
    delay = 7.3 * STEP
    found = core.simulate_effects(
        AXIS, [Effect("delay", "torque", {"time": delay})], STEP, torque(TIMES) - torque(0.0)
    )
    expected = core.simulate(AXIS, STEP, late(torque, delay) - torque(0.0))
    assert np.max(np.abs(found.theta1 - expected.theta1)) < 1e-4 * np.ptp(expected.theta1)
    prompt = core.simulate(AXIS, STEP, torque(TIMES) - torque(0.0))
    assert np.max(np.abs(prompt.twist - expected.twist)) > 1e-2 * np.ptp(expected.twist)


@pytest.mark.parametrize(("encoder", "channel"), [("encoder1", "theta1"), ("encoder2", "theta2")])
def test_a_late_encoder_shows_that_angle_later(encoder: str, channel: str) -> None:
    delay = 3.37 * STEP
    found = core.simulate_effects(
        AXIS, [Effect("delay", encoder, {"time": delay})], STEP, torque(TIMES), State(speed=2.0)
    )
    fine = core.simulate_effects(AXIS, [], STEP, torque(TIMES), State(speed=2.0), substeps=1)
    spline = scipy.interpolate.CubicSpline(TIMES, getattr(fine, channel))
    shown = getattr(found, channel)
    assert np.max(np.abs(shown - spline(TIMES - delay))[10:]) < 1e-6
    other = "theta2" if channel == "theta1" else "theta1"
    assert getattr(found, other) == pytest.approx(getattr(fine, other), abs=1e-9)


def test_a_delay_between_two_steps_of_a_sample_is_kept() -> None:
    """The delay is in seconds, however many steps there are from sample to sample."""
    effects = [Effect("delay", "torque", {"time": 2.4 * STEP})]
    runs = [
        core.simulate_effects(AXIS, effects, STEP, torque(TIMES), substeps=n) for n in (1, 5, 10)
    ]
    for found in runs[1:]:
        assert np.max(np.abs(found.theta1 - runs[0].theta1)) < 1e-4 * np.ptp(runs[0].theta1)


def test_a_saturated_torque_is_a_clipped_one() -> None:
    found = core.simulate_effects(
        AXIS, [Effect("torque_saturation", "motor", {"limit": 0.1})], STEP, torque(TIMES)
    )
    expected = core.simulate(AXIS, STEP, np.clip(torque(TIMES), -0.1, 0.1))
    assert np.array_equal(found.theta1, expected.theta1)


def test_no_effects_are_the_plant_to_the_last_bit() -> None:
    for precision in ("float32", "float64"):
        found = core.simulate_effects(AXIS, [], STEP, torque(TIMES), precision=precision)
        expected = core.simulate(AXIS, STEP, torque(TIMES), precision=precision)
        assert found.samples.tobytes() == expected.samples.tobytes()


@pytest.mark.parametrize("case", ["all of friction", "hardening", "a further mode", "ripple"])
def test_single_precision_says_the_same(case: str) -> None:
    effects = CASES[case][0]
    single = core.simulate_effects(AXIS, effects, STEP, torque(TIMES), precision="float32")
    double = core.simulate_effects(AXIS, effects, STEP, torque(TIMES))
    assert np.max(np.abs(single.theta1 - double.theta1)) < 2e-4 * np.ptp(double.theta1)
    assert np.max(np.abs(single.twist - double.twist)) < 2e-4 * np.ptp(double.twist)


def test_the_catalogue_has_the_published_names() -> None:
    places: dict[str, set[str]] = {}
    for entry in core.effect_parameters():
        places.setdefault(entry.effect, set()).add(entry.location)
    assert places == {
        "friction_coulomb": {"motor", "table"},
        "friction_viscous": {"motor", "table"},
        "friction_asymmetry": {"motor", "table"},
        "friction_stribeck": {"motor", "table"},
        "torque_offset": {"motor", "table"},
        "backlash": {"shaft"},
        "stiffness_hardening": {"shaft"},
        "torque_ripple": {"motor"},
        "lead_error": {"table"},
        "encoder_eccentricity": {"encoder1", "encoder2"},
        "delay": {"torque", "encoder1", "encoder2"},
        "torque_saturation": {"motor"},
        "stiffness_drift": {"shaft"},
        "friction_drift": {"motor", "table"},
        "load_change": {"table"},
        "extra_mode": {"table"},
        "disturbance": {"motor", "table"},
        "quantisation": {"encoder1", "encoder2"},
    }


@pytest.mark.parametrize(
    ("effects", "message"),
    [
        ([Effect("backlsh", "shaft", {"gap": 1e-3})], "no effect 'backlsh'; there are friction_"),
        ([Effect("backlash", "table", {"gap": 1e-3})], "backlash is not at 'table' but at shaft"),
        (
            [Effect("backlash", "shaft", {"width": 1})],
            "backlash has no parameter 'width'; it has g",
        ),
        ([dry(0.1, "table"), dry(0.1, "table")], "can have friction_coulomb at table 1 times"),
        ([dry(-0.1, "table")], "out of range"),
        ([dry(np.nan, "table")], "not finite"),
        ([stribeck(0.1, 0.0, "motor")], "out of range"),
        ([Effect("friction_asymmetry", "motor", {"coefficient": 1e-3})], "out of range"),
        ([Effect("delay", "torque", {"time": 1.0})], "out of range"),
    ],
)
def test_what_cannot_be_is_refused(effects: list[Effect], message: str) -> None:
    with pytest.raises(InputError, match=message):
        core.simulate_effects(AXIS, effects, STEP, torque(TIMES))


def test_no_steps_between_samples_are_refused() -> None:
    with pytest.raises(InputError, match="has to be 1 or more"):
        core.simulate_effects(AXIS, [], STEP, torque(TIMES), substeps=0)
