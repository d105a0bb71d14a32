"""The rigid axis with friction: a published benchmark, known axes, invariance, refusals."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify import identify, validate
from axistwin.readers import read_record
from axistwin.readers.columns import ColumnOptions
from axistwin.record import Record

Measured = Callable[[str], Path]

#: EMPS: A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019, section 3.4.
PUBLISHED = {"I": 95.1089, "viscous": 203.5034, "coulomb": 20.3935, "offset": -3.1648}

KNOWN = {"I": 3e-4, "viscous": 2e-3, "coulomb": 0.04, "offset": -0.01}


def emps(path: Path) -> Record:
    """One of the two EMPS records: drive voltage times drive gain, motor position in m."""
    options = ColumnOptions(
        columns={"torque": "vir", "theta1": "qm"}, scales={"torque": "gtau"}, linear=True
    )
    return read_record(path, options)


def back_and_forth(*, noise: float = 0.0, drift: float = 0.0, rate: float = 1000.0) -> Record:
    """10 s of a known axis whose speed is a sum of sines, known in closed form."""
    time = np.arange(round(10.0 * rate)) / rate
    angle, speed, acceleration = drift * time, drift + 0.0 * time, 0.0 * time
    for frequency, amplitude in ((0.5, 20.0), (1.7, 8.0), (4.3, 5.0)):
        w = 2.0 * np.pi * frequency
        phase = w * time + 0.3 * frequency
        angle -= amplitude / w * np.cos(phase)
        speed += amplitude * np.sin(phase)
        acceleration += amplitude * w * np.cos(phase)
    torque = (
        KNOWN["I"] * acceleration
        + KNOWN["viscous"] * speed
        + KNOWN["coulomb"] * np.sign(speed)
        + KNOWN["offset"]
    )
    torque += noise * np.random.default_rng(1).standard_normal(len(time))
    return Record(time=time, torque=torque, theta1=angle, time_step=1.0 / rate)


def test_published_benchmark(measured: Measured) -> None:
    result = identify(emps(measured("EMPS/DATA_EMPS.mat")))
    assert result.model == "rigid"
    for name, value in PUBLISHED.items():
        item = result.estimate.params[name]
        assert item.value == pytest.approx(value, rel=0.01)
        assert item.ci95[0] < value < item.ci95[1]
    assert result.estimate.params["I"].unit == "kg"
    pulses = validate(result, emps(measured("EMPS/DATA_EMPS_PULSES.mat")))
    assert pulses.validation is not None
    assert pulses.validation.relative_error["force"] <= 0.06


def test_known_axis() -> None:
    params = identify(back_and_forth()).estimate.params
    for name, value in KNOWN.items():
        assert params[name].value == pytest.approx(value, rel=5e-3)


def test_intervals_hold_for_noisy_torque() -> None:
    inside = 0
    clean = back_and_forth()
    reference = identify(clean).estimate.params
    rng = np.random.default_rng(2)
    for _ in range(50):
        noisy = replace(clean, torque=clean.torque + 0.05 * rng.standard_normal(len(clean)))
        params = identify(noisy).estimate.params
        for name in KNOWN:
            low, high = params[name].ci95
            inside += low <= reference[name].value <= high
    assert 0.90 <= inside / 200 <= 0.99


def test_one_way_travel_leaves_coulomb_friction_in_the_offset() -> None:
    result = identify(back_and_forth(drift=50.0))
    params = result.estimate.params
    assert "coulomb" not in params
    assert params["offset"].value == pytest.approx(KNOWN["coulomb"] + KNOWN["offset"], rel=0.02)
    assert params["I"].value == pytest.approx(KNOWN["I"], rel=5e-3)
    assert any("one direction" in note for note in result.notes)


def test_sign() -> None:
    record = back_and_forth(noise=0.01)
    turned = replace(record, torque=-record.torque, theta1=-record.theta1)
    forth, back = (identify(r).estimate.params for r in (record, turned))
    for name in ("I", "viscous", "coulomb"):
        assert back[name].value == pytest.approx(forth[name].value, rel=1e-9)
    assert back["offset"].value == pytest.approx(-forth["offset"].value, rel=1e-9)


@settings(max_examples=15, deadline=None)
@given(torque=st.floats(1e-3, 1e3), angle=st.floats(1e-3, 1e3), zero=st.floats(-1e3, 1e3))
def test_units_and_zero(torque: float, angle: float, zero: float) -> None:
    record = back_and_forth(noise=0.01)
    scaled = replace(record, torque=torque * record.torque, theta1=angle * (record.theta1 + zero))
    before, after = (identify(r).estimate.params for r in (record, scaled))
    powers = {"I": torque / angle, "viscous": torque / angle, "coulomb": torque, "offset": torque}
    for name, factor in powers.items():
        assert after[name].value == pytest.approx(factor * before[name].value, rel=1e-5)
        assert after[name].stderr == pytest.approx(factor * before[name].stderr, rel=1e-3)


def test_bandwidth() -> None:
    record = back_and_forth()
    wide = identify(record, bandwidth=50.0).estimate.params["I"].value
    assert wide == pytest.approx(KNOWN["I"], rel=5e-3)
    for impossible in (0.0, -1.0, 101.0, float("nan")):
        with pytest.raises(InputError, match="bandwidth"):
            identify(record, bandwidth=impossible)


def test_record_that_tells_nothing() -> None:
    record = back_and_forth()
    short = Record(
        time=record.time[:150],
        torque=record.torque[:150],
        theta1=record.theta1[:150],
        time_step=record.time_step,
    )
    with pytest.raises(NotEnoughDataError, match="too few"):
        identify(short)
    rng = np.random.default_rng(3)
    with pytest.raises(NotEnoughDataError, match="does not explain"):
        identify(replace(record, torque=rng.standard_normal(len(record))))
    # an encoder that flickers between two counts
    step = 2.0 * np.pi / 4096
    flicker = step * rng.integers(0, 2, len(record)).astype(np.float64)
    with pytest.raises(NotEnoughDataError, match="hardly moves"):
        identify(replace(record, theta1=flicker, counts_per_turn=(4096, None)))
