"""The torque that a model needs for a measured motion: closed forms, and the machine in C."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from axistwin import compare, inverse
from axistwin.compare import ChannelError
from axistwin.core import Axis, Effect
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify.band import Band
from axistwin.identify.samples import Hold, longest_stretch
from axistwin.model import Model
from axistwin.record import Record

from .diagnosis_records import AXIS, STEP, record, shake
from .test_diagnose_engine import CASES, beside, name

TORQUE = shake(6000)

#: Within the shaft, or an error of an encoder too slow to accelerate anything.
UNSEEN = (
    "stiffness_hardening:shaft",
    "stiffness_drift:shaft",
    "backlash:shaft",
    "encoder_eccentricity:encoder1",
    "encoder_eccentricity:encoder2",
)


def error(model: Model, measured: Record, hold: Hold = "zoh") -> ChannelError:
    samples = longest_stretch(measured)
    return compare.torque_error(model, samples, Band.of(samples), hold)


@pytest.mark.parametrize("effect", CASES, ids=name)
def test_what_moves_the_machine_is_what_is_needed(effect: Effect) -> None:
    others = beside(effect)
    measured = record(*others, effect, torque=TORQUE)
    known = error(Model(AXIS, (*others, effect)), measured)
    unknown = error(Model(AXIS, others), measured)
    assert known.relative < 0.008  # the noise of the encoders makes 0.0023, a reversal more
    assert name(effect) in UNSEEN or unknown.rms > 4.0 * known.rms


@pytest.mark.parametrize("share", [-0.2, 0.1])
def test_an_inertia_wrong_by_a_share_is_a_torque_wrong_by_that_share(share: float) -> None:
    wrong = Axis((1.0 + share) * AXIS.I1, (1.0 + share) * AXIS.I2, AXIS.B, AXIS.K)
    found = error(Model(wrong), record(torque=TORQUE))
    assert found.relative == pytest.approx(abs(share), rel=0.01)
    assert found.below == pytest.approx(40.0)


def test_an_offset_is_an_error_of_its_size() -> None:
    measured = record(torque=TORQUE)
    found = error(Model(AXIS, (Effect("torque_offset", "table", {"torque": 0.02}),)), measured)
    assert found.rms == pytest.approx(0.02, rel=0.02)


def test_noise_of_the_torque_is_the_error_that_is_left() -> None:
    """As much of it as lies within the band."""
    measured = record(torque=TORQUE)
    noise = 0.05 * np.random.default_rng(3).standard_normal(len(TORQUE))
    found = error(Model(AXIS), replace(measured, torque=TORQUE + noise), "foh")
    band = Band.of(longest_stretch(measured))
    assert found.rms == pytest.approx(0.05 * np.sqrt(2.0 * band.highest * STEP), rel=0.1)


def test_one_encoder_shows_both_inertias_where_the_shaft_is_stiff() -> None:
    stiff = Axis(AXIS.I1, AXIS.I2, 0.1, 2e4)
    worn = (
        Effect("friction_coulomb", "table", {"torque": 0.03}),
        Effect("friction_viscous", "motor", {"coefficient": 1e-3}),
    )
    measured = replace(record(*worn, torque=TORQUE, axis=stiff), theta2=None)
    assert error(Model(stiff, worn), measured).relative < 0.01
    assert error(Model(stiff), measured).relative > 0.1


def test_an_axis_that_is_held_needs_what_acts() -> None:
    """Any torque up to the limit of dry friction leaves it at rest; beyond that it would move."""
    worn = (Effect("friction_coulomb", "motor", {"torque": 0.05}),)
    time = STEP * np.arange(3000, dtype=np.float64)
    torque = 0.04 * np.sin(20.0 * time)
    measured = replace(record(*worn, torque=torque), theta2=None)
    held = error(Model(AXIS, worn), measured)
    half = Model(AXIS, (Effect("friction_coulomb", "motor", {"torque": 0.02}),))
    # the noise of the encoder as a torque is left, 1e-3 N m
    assert held.rms < 1e-3
    beyond = np.maximum(np.abs(torque) - 0.02, 0.0)
    assert error(half, measured).rms == pytest.approx(np.sqrt(np.mean(beyond**2)), rel=0.2)


def test_where_a_record_begins_changes_nothing() -> None:
    """Drifts go on, and a ripple is where it is on the turn."""
    worn = (
        Effect("friction_coulomb", "motor", {"torque": 0.03}),
        Effect("friction_drift", "motor", {"rate": 0.2}),
        Effect("torque_ripple", "motor", {"amplitude": 0.02, "periods": 3.0, "phase": 0.7}),
    )
    measured = record(*worn, torque=TORQUE)
    broken = replace(measured, missing=np.array([2000]))
    assert error(Model(AXIS, worn), broken).relative < 0.02


def test_a_band_is_that_of_the_record() -> None:
    samples = longest_stretch(record(torque=TORQUE))
    band = Band.of(samples, 50.0)
    assert band.factor == 4
    assert band.highest == pytest.approx(100.0)
    found = inverse.torque(Model(AXIS), samples, band)
    assert len(found.time) == len(found.measured) == len(found.simulated)
    with pytest.raises(InputError, match="a bandwidth of 100 Hz does not fit"):
        Band.of(samples, 100.0)  # whose low-pass would be at half the rate
    with pytest.raises(NotEnoughDataError, match="150 samples are too few"):
        Band.of(longest_stretch(record(torque=TORQUE[:150])))


def test_a_short_record_is_compared_without_its_torque() -> None:
    errors = compare.compare(Model(AXIS), record(torque=TORQUE[:150]), window=0.1)
    assert [one.name for one in errors] == ["theta1", "theta2", "twist"]
