"""A further mode of the table: answered exactly, found near the resonance, named beside others."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin.core import Array, Effect
from axistwin.diagnose import diagnose, resonance, windows
from axistwin.diagnose.effects import TABLE, ExtraMode, Found
from axistwin.diagnose.linear import ThreeInertias, Torque, TwoInertias
from axistwin.errors import InputError

from .diagnosis_records import AXIS, STEP, record, shake

TORQUE = shake(8000)


def by_exponential(axis: ThreeInertias, torque: Torque, states: Array) -> tuple[Array, Array]:
    """Angles and speeds (2, w, l) of motor and table, from Newton's law for three inertias."""
    a, third = axis.axis, axis.axis.I2 * axis.mass_ratio
    spring = third * axis.frequency**2
    damper = 2.0 * axis.damping_ratio * axis.frequency * third
    chain = np.array([[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    end = chain[::-1, ::-1]
    inertia = np.array([a.I1, a.I2, third])
    system = np.zeros((10, 10))  # angles, speeds, torque at two places, slopes of that
    system[:3, 3:6] = np.eye(3)
    system[3:6, :3] = -(a.K * chain + spring * end) / inertia[:, None]
    system[3:6, 3:6] = -(a.B * chain + damper * end) / inertia[:, None]
    system[3, 6], system[4, 7] = 1.0 / a.I1, 1.0 / a.I2
    system[6:8, 8:] = np.eye(2)
    step = scipy.linalg.expm(STEP * system)

    def angles_of(body: float, twist: float, further: float) -> Array:
        relative = np.array([twist, 0.0, further])
        angles: Array = relative + body - inertia @ relative / np.sum(inertia)
        return angles

    found = np.empty((2, *torque.first.shape))
    for w, (body, body_speed, twist, twist_speed, further, further_speed) in enumerate(states):
        at = np.append(
            angles_of(body, twist, further), angles_of(body_speed, twist_speed, further_speed)
        )
        for i in range(torque.first.shape[2]):
            found[:, :, w, i] = at[:2], at[3:5]
            first, last = torque.first[:, w, i], torque.last[:, w, i]
            at = (step @ [*at, *first, *(last - first) / STEP])[:6]
    return found[0], found[1]


@given(
    st.sampled_from([20.0, 120.0, 244.0, 900.0]),
    st.sampled_from([0.0, 0.02, 0.3]),
    st.sampled_from([1e-4, 0.2, 3.0]),
    st.integers(0, 2**32 - 1),
)
@settings(max_examples=30, deadline=None)
def test_three_inertias_answer_as_newtons_law_has_it(
    frequency: float, damping_ratio: float, mass_ratio: float, seed: int
) -> None:
    random = np.random.default_rng(seed)
    axis = ThreeInertias(AXIS, frequency, damping_ratio, mass_ratio)
    torque = Torque(*random.standard_normal((2, 2, 3, 60)))
    states = random.standard_normal((3, 6)) * [1.0, 9.0, 1.0, 200.0, 1.0, 200.0]
    found = axis.respond(STEP, torque, states)
    for one, expected in zip(found, by_exponential(axis, torque, states), strict=True):
        np.testing.assert_allclose(one, expected, rtol=0.0, atol=1e-9 * np.max(np.abs(expected)))


def test_a_mode_without_inertia_leaves_two() -> None:
    random = np.random.default_rng(1)
    torque = Torque(*random.standard_normal((2, 2, 3, 60)))
    states = random.standard_normal((3, 6))
    states[:, 4:] = 0.0
    found = ThreeInertias(AXIS, 300.0, 0.02, 0.0).respond(STEP, torque, states)
    expected = TwoInertias(AXIS).respond(STEP, torque, states[:, :4])
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-10 * np.max(np.abs(other)))


def test_next_to_no_inertia_is_no_further_mode() -> None:
    shape = (500.0, 0.02)
    assert Found(ExtraMode(TABLE), np.array([1e-3]), shape).plausible
    assert not Found(ExtraMode(TABLE), np.array([1e-6]), shape).plausible  # all is in its states


def test_what_is_no_further_mode_is_refused() -> None:
    with pytest.raises(InputError):
        ThreeInertias(AXIS, 300.0, 0.02, -0.1)
    with pytest.raises(InputError, match="swings"):
        ThreeInertias(AXIS, 300.0, 2.0, 0.1).free(STEP, 10)


def mode(frequency: float, mass_ratio: float) -> Effect:
    params = {"frequency": frequency, "damping_ratio": 0.02, "mass_ratio": mass_ratio}
    return Effect("extra_mode", "table", params)


@pytest.mark.parametrize("frequency", [160.0, 245.0, 400.0])
def test_the_twist_tells_of_a_mode(frequency: float) -> None:
    cut = windows.cut(record(mode(frequency, 0.1), torque=TORQUE), 0.2)
    plant, found = resonance.find(cut, cut.cut(cut.torque))[0]
    assert found.params["frequency"] == pytest.approx(frequency, rel=0.05)
    assert found.params["mass_ratio"] == pytest.approx(0.1, rel=0.2)
    np.testing.assert_allclose(plant.values, TwoInertias(AXIS).values, rtol=0.1)


@pytest.mark.parametrize(
    "effects",
    [
        (mode(245.0, 0.01),),
        (mode(300.0, 0.4),),
        (
            mode(245.0, 0.2),
            Effect("torque_ripple", "motor", {"amplitude": 0.01, "periods": 12.0, "phase": 0.7}),
        ),
    ],
    ids=["light", "strong", "beside a ripple"],
)
def test_a_mode_near_the_resonance_is_named(effects: tuple[Effect, ...]) -> None:
    found = diagnose(record(*effects, torque=TORQUE), window=0.25)
    named = {(one.effect, one.location): one for one in found.findings}
    assert set(named) == {(one.effect, one.location) for one in effects}
    for effect in effects:
        params = named[effect.effect, effect.location].params
        assert dict(params) == pytest.approx(dict(effect.params), rel=0.03)
    for quantity, truth in zip(found.axis.values(), TwoInertias(AXIS).values, strict=True):
        assert quantity.value == pytest.approx(truth, rel=0.01)
