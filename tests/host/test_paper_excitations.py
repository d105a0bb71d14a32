"""Excitations: equal size, steady motion, persistence of excitation, and what they are worth."""

from __future__ import annotations

import numpy as np
import pytest

from axistwin.core import IdentSettings
from axistwin.errors import InputError
from axistwin.paper import equations
from axistwin.paper.excitations import EXCITATIONS, Excitation, filled, steady
from axistwin.paper.settings import AXIS, NAMES, RMS, SETTINGS, A, Setting

from .paper_run import value

BY_TITLE = {excitation.title: excitation for excitation in EXCITATIONS}
HARMONIC = BY_TITLE["harmonic at wn"]
PERSISTENT = [excitation for excitation in EXCITATIONS if excitation is not HARMONIC]
NARROW = ("Schroeder, 2k lines", "binary, to about 2 wn", "chirp, 0 to 2 wn")
WIDE = ("impulse", "white noise", "binary, to the Nyquist frequency")


def regressors(excitation: Excitation, setting: Setting) -> equations.Equations:
    record = steady(excitation, setting)
    settings = IdentSettings(setting.time_step, AXIS, RMS)
    return equations.from_motion(settings, record.motion, record.torque)


@pytest.mark.parametrize("excitation", EXCITATIONS, ids=lambda e: e.title)
@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_all_have_the_same_rms_torque(excitation: Excitation, setting: Setting) -> None:
    period = len(excitation.period(setting))
    torque = excitation.torque(setting, 3 * period)
    assert np.sqrt(np.mean(torque**2)) == pytest.approx(RMS, rel=1e-12)
    np.testing.assert_array_equal(torque[:period], torque[period : 2 * period])


@pytest.mark.parametrize("excitation", EXCITATIONS, ids=lambda e: e.title)
def test_the_record_begins_when_the_transient_is_over(excitation: Excitation) -> None:
    period = len(excitation.period(A))
    record = steady(excitation, A, 2 * period + 1)
    twist = record.motion.twist
    np.testing.assert_allclose(twist[period:-1], twist[:period], atol=1e-8 * np.max(np.abs(twist)))
    assert record.start.twist == twist[0]
    assert record.start.speed == record.motion.omega1[0]


def test_a_band_is_what_it_says() -> None:
    """Of the power of the narrow binary signal most lies below 2 wn, of the wide one little."""
    shares = {}
    for title in ("binary, to about 2 wn", "binary, to the Nyquist frequency"):
        table = BY_TITLE[title].period(A)
        power = np.abs(np.fft.rfft(table - table.mean())) ** 2
        wn = len(table) * A.k / A.N
        shares[title] = float(np.sum(power[: int(2 * wn) + 1]) / np.sum(power))
    assert shares["binary, to about 2 wn"] > 0.7
    assert shares["binary, to the Nyquist frequency"] < 0.1


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_the_condition_number_is_that_of_the_information_matrix(setting: Setting) -> None:
    for excitation in PERSISTENT:
        phi = regressors(excitation, setting).phi
        singular = np.linalg.svd(phi / np.linalg.norm(phi, axis=0), compute_uv=False)
        expected = (singular[0] / singular[-1]) ** 2
        study = f"Excitations, {setting.title}"
        assert value(study, excitation.title, "condition number") == pytest.approx(expected)


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_one_harmonic_does_not_excite_persistently(setting: Setting) -> None:
    phi = regressors(HARMONIC, setting).phi
    singular = np.linalg.svd(phi / np.linalg.norm(phi, axis=0), compute_uv=False)
    assert singular[1] > 0.1
    assert singular[2] < 1e-5 * singular[0]
    assert value(f"Excitations, {setting.title}", HARMONIC.title, "condition number") >= 1e10
    errors = [
        value(f"Excitations, {setting.title}", HARMONIC.title, f"{name} rms") for name in NAMES
    ]
    assert max(errors) > 50.0


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_power_below_twice_the_natural_frequency_is_what_counts(setting: Setting) -> None:
    study = f"Excitations, {setting.title}"
    for name in NAMES:
        narrow = [value(study, title, f"{name} rms") for title in NARROW]
        wide = [value(study, title, f"{name} rms") for title in WIDE]
        assert max(narrow) < min(wide)
        least = [value(study, title, f"{name} bound") for title in (*NARROW, *WIDE)]
        assert max(least[:3]) < min(least[3:])


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
def test_nothing_is_better_than_the_bound(setting: Setting) -> None:
    study = f"Excitations, {setting.title}"
    for excitation in EXCITATIONS:
        for name in NAMES:
            rms = value(study, excitation.title, f"{name} rms")
            assert rms > value(study, excitation.title, f"{name} bound")
        failed = value(study, excitation.title, "records without an axis")
        assert failed == 0 or excitation is HARMONIC


def test_a_period_that_cannot_be_filled_is_an_error() -> None:
    with pytest.raises(InputError, match="harmonic of 8 samples"):
        filled("harmonic", 8, 4)
