"""The error of a model on a record: none on its own, and what is known on another's."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from axistwin import compare, core, model
from axistwin.cli import main
from axistwin.core import Axis, Effect
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify.samples import Hold
from axistwin.model import Model
from axistwin.record import Record, write_csv

AXIS = Axis(1e-3, 5e-4, 5e-3, 20.0)
WORN = Model(
    AXIS,
    (
        Effect("friction_coulomb", "table", {"torque": 0.03}),
        Effect("friction_drift", "table", {"rate": 0.3}),
        Effect("disturbance", "motor", {"amplitude": 0.02, "frequency": 47.0}),
    ),
)
STEP = 1e-3


def record_of(made_by: Model, hold: Hold = "zoh", noise: float = 0.0) -> Record:
    time = STEP * np.arange(2000, dtype=np.float64)
    torque = 0.12 * np.sin(8.2 * time) + 0.08 * np.sin(45.0 * time + 1.0)
    theta1, theta2 = made_by.simulate(torque, STEP, hold=hold)
    random = np.random.default_rng(1)
    return Record(
        time=time,
        torque=torque,
        theta1=theta1 + noise * random.standard_normal(len(time)),
        theta2=theta2 + 0.3 + noise * random.standard_normal(len(time)),
        time_step=STEP,
        linear=made_by.linear,
    )


@pytest.mark.parametrize("hold", ["newmark", "zoh", "foh"])
def test_a_model_has_no_error_on_its_own_record(hold: Hold) -> None:
    errors = compare.compare(WORN, record_of(WORN, hold), hold=hold)
    assert [error.name for error in errors] == ["theta1", "theta2", "twist", "torque"]
    assert all(error.relative < 1e-4 for error in errors[:3])
    assert errors[3].relative < 0.03  # a smoothed speed hardly shows where friction stops it


def test_angle_and_time_are_those_of_the_record() -> None:
    """A ripple is where it is on the turn, a disturbance when it is, wherever a record begins."""
    place = {"amplitude": 0.02, "periods": 7.0, "phase": 0.4}
    worn = replace(WORN, effects=(*WORN.effects, Effect("torque_ripple", "motor", place)))
    whole = record_of(worn)
    assert whole.theta2 is not None
    first = 900
    later = Record(
        time=whole.time[first:],
        torque=whole.torque[first:],
        theta1=whole.theta1[first:] + 2.0 * np.pi * 5.0,
        theta2=whole.theta2[first:] + 2.0 * np.pi * 5.0,
        time_step=STEP,
    )
    halved = replace(whole, missing=np.array([first - 1]))
    for model_of_part, record in ((worn.later(first * STEP), later), (worn, halved)):
        errors = compare.compare(model_of_part, record)
        assert all(error.relative < 1e-4 for error in errors[:3])
        assert errors[3].relative < 0.03


def test_the_state_is_found_of_an_axis_that_sticks_now_and_then() -> None:
    """Under torque of many frequencies the error of a whole window has many minima."""
    sticky = Model(AXIS, (Effect("friction_coulomb", "table", {"torque": 0.02}),))
    torque = np.tile(core.schroeder(2048, 160, 0.2), 2)
    theta1, theta2 = sticky.simulate(torque, STEP)
    time = STEP * np.arange(len(torque), dtype=np.float64)
    record = Record(time=time, torque=torque, theta1=theta1, theta2=theta2, time_step=STEP)
    errors = compare.compare(sticky, record)
    assert all(error.relative < 1e-3 for error in errors[:3])


def test_noise_is_the_error_that_is_left() -> None:
    errors = compare.compare(WORN, record_of(WORN, noise=1e-4))
    assert [error.rms for error in errors[:3]] == pytest.approx([1e-4, 1e-4, 1.414e-4], rel=0.05)


def test_a_model_without_the_effects_is_further_away() -> None:
    record = record_of(WORN)
    worn, ideal = (compare.compare(which, record) for which in (WORN, Model(AXIS)))
    assert all(a.rms > 100.0 * b.rms for a, b in zip(ideal[:3], worn[:3], strict=True))
    assert ideal[3].rms > 10.0 * worn[3].rms


def test_one_encoder_is_enough_for_its_channel() -> None:
    errors = compare.compare(WORN, replace(record_of(WORN), theta2=None))
    assert [error.name for error in errors] == ["theta1", "torque"]
    assert errors[0].relative < 0.05  # the twist at the start of a window is unknown


def test_what_does_not_fit_is_refused() -> None:
    with pytest.raises(InputError, match="the model is rotary, the record linear"):
        compare.compare(WORN, replace(record_of(WORN), linear=True))
    with pytest.raises(NotEnoughDataError, match="less than 20 samples"):
        compare.compare(WORN, record_of(WORN), window=0.01)


def test_the_command_prints_and_writes_the_errors(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model.write(WORN, tmp_path / "worn.toml")
    write_csv(record_of(WORN), tmp_path / "record.csv")
    arguments = [str(tmp_path / "worn.toml"), str(tmp_path / "record.csv")]
    assert main(["compare", *arguments, "--json", str(tmp_path / "out.json")]) == 0
    result = json.loads((tmp_path / "out.json").read_text())
    assert result["schema"] == "axistwin.compare/1"
    assert set(result["errors"]) == {"theta1", "theta2", "twist", "torque"}
    assert result["errors"]["theta1"]["relative"] < 1e-4
    assert result["errors"]["torque"]["below_hz"] == pytest.approx(40.0)
    shown = capsys.readouterr().out
    assert "theta2" in shown
    assert "against that applied, below 40 Hz" in shown
    assert main(["compare", *arguments, "--bandwidth", "400"]) == 2
    assert "a bandwidth of 400 Hz does not fit" in capsys.readouterr().err
    assert main(["compare", *arguments, "--window", "0"]) == 2
    assert "--window 0: has to be a positive time" in capsys.readouterr().err
