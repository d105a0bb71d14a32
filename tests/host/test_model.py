"""Model files and what is done with them: simulate, emulate."""

from __future__ import annotations

import argparse
import subprocess
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from axistwin import bus, compare, core, model, readers
from axistwin.cli import main
from axistwin.commands.emulate import with_model
from axistwin.contract import load_contract
from axistwin.core import Axis, Effect, State
from axistwin.errors import CommandRefusedError, InputError
from axistwin.model import Model
from axistwin.record import Record, write_csv

from .drive_process import PATIENCE, running_drive

AXIS = Axis(2.7e-5, 8.3e-6, 2.1e-3, 110.0)
WORN = Model(
    AXIS,
    (
        Effect("friction_coulomb", "table", {"torque": 0.012}),
        Effect("torque_ripple", "motor", {"amplitude": 0.01, "periods": 72.0, "phase": 0.3}),
        Effect("torque_ripple", "motor", {"amplitude": 0.004, "periods": 1.0}),
        Effect("backlash", "shaft", {"gap": 1e-3}),
        Effect("delay", "encoder2", {"time": 3e-5}),
    ),
    meta={"made by": 'a "test"', "count": 3, "fine": True},
)
HEAD = 'schema = "axistwin.model/1"\n[axis]\nI1 = 1e-3\nI2 = 5e-4\nB = 5e-3\nK = 20.0\n'
REPOSITORY = Path(__file__).resolve().parent.parent.parent
EMULATOR = REPOSITORY / "build" / "axistwin-emulator"


def torque_record(time_step: float, n: int, *, linear: bool = False) -> Record:
    time = time_step * np.arange(n, dtype=np.float64)
    torque = 0.1 * np.sin(20.0 * time) + 0.05 * np.sin(210.0 * time)
    theta1 = np.zeros(n)
    return Record(time=time, torque=torque, theta1=theta1, time_step=time_step, linear=linear)


@st.composite
def models(draw: st.DrawFn) -> Model:
    positive = st.floats(1e-6, 1e3)
    parameters: dict[tuple[str, str], list[str]] = {}
    for entry in core.effect_parameters():
        parameters.setdefault((entry.effect, entry.location), []).append(entry.parameter)
    chosen = draw(st.lists(st.sampled_from(sorted(parameters)), unique=True, max_size=6))
    numbers = st.floats(allow_nan=False, allow_infinity=False)
    effects = [
        Effect(*place, {name: draw(numbers) for name in parameters[place]}) for place in chosen
    ]
    axis = Axis(*(draw(positive) for _ in range(4)))
    text = st.text(st.characters(exclude_categories=("Cc", "Cs")))
    return Model(axis, tuple(effects), draw(st.booleans()), draw(st.dictionaries(text, text)))


@given(models())
def test_a_model_that_was_written_is_read_back(
    tmp_path_factory: pytest.TempPathFactory, any_model: Model
) -> None:
    path = tmp_path_factory.getbasetemp() / "model.toml"
    model.write(any_model, path)
    assert model.read(path) == any_model


def test_a_model_is_a_vector_for_fits() -> None:
    assert WORN.names[:5] == ("I1", "I2", "B", "K", "friction_coulomb:table:torque")
    assert "torque_ripple#2:motor:amplitude" in WORN.names
    assert WORN.values[:5].tolist() == [2.7e-5, 8.3e-6, 2.1e-3, 110.0, 0.012]
    assert WORN.with_values(WORN.values) == WORN
    doubled = WORN.with_values(2.0 * WORN.values)
    assert doubled.axis.K == 220.0
    assert doubled.effects[2].params == {"amplitude": 0.008, "periods": 2.0}
    with pytest.raises(InputError, match="3 values for"):
        WORN.with_values([1.0, 2.0, 3.0])


def test_a_simulation_is_the_core_s_with_steps_short_enough() -> None:
    given_record = torque_record(1e-3, 2000)
    found = WORN.simulate(given_record.torque, 1e-3)
    steps = WORN.substeps(1e-3)
    assert core.modal(AXIS).wn * 1e-3 / steps < 0.21
    motion = core.simulate_effects(
        AXIS, WORN.effects, 1e-3, given_record.torque, held=True, substeps=steps
    )
    assert np.array_equal(found[0], motion.theta1)
    assert np.array_equal(found[1], motion.theta2)


def test_a_linear_axis_is_the_rotary_one_on_a_screw() -> None:
    """A slide on a screw with lead l [m/rad]: x = l q, F = T / l, so m = I / l^2 and so on."""
    lead = 5e-3 / (2 * np.pi)  # a turn is 5 mm, so 72 periods a turn are 14400 a metre
    slide = Model(
        Axis(AXIS.I1 / lead**2, AXIS.I2 / lead**2, AXIS.B / lead**2, AXIS.K / lead**2),
        (
            Effect("friction_coulomb", "table", {"torque": 0.012 / lead}),
            Effect("friction_stribeck", "table", {"torque": 0.01 / lead, "speed": 2.0 * lead}),
            Effect("friction_viscous", "motor", {"coefficient": 1e-4 / lead**2}),
            Effect("stiffness_hardening", "shaft", {"coefficient": 1e5 / lead**4}),
            Effect(
                "torque_ripple",
                "motor",
                {"amplitude": 0.01 / lead, "periods": 14400.0, "phase": 1.0},
            ),
            Effect("lead_error", "table", {"amplitude": 1e-3 * lead, "periods": 200.0}),
            Effect("delay", "encoder1", {"time": 1e-4}),
            Effect("quantisation", "encoder2", {"counts": 1e6}),
        ),
        linear=True,
    )
    screw = Model(
        AXIS,
        (
            Effect("friction_coulomb", "table", {"torque": 0.012}),
            Effect("friction_stribeck", "table", {"torque": 0.01, "speed": 2.0}),
            Effect("friction_viscous", "motor", {"coefficient": 1e-4}),
            Effect("stiffness_hardening", "shaft", {"coefficient": 1e5}),
            Effect("torque_ripple", "motor", {"amplitude": 0.01, "periods": 72.0, "phase": 1.0}),
            Effect("lead_error", "table", {"amplitude": 1e-3, "periods": 1.0}),
            Effect("delay", "encoder1", {"time": 1e-4}),
            Effect("quantisation", "encoder2", {"counts": 5000.0}),
        ),
    )
    torque = torque_record(1e-3, 1000).torque
    x1, x2 = slide.simulate(torque / lead, 1e-3, State(twist=1e-3 * lead, angle=3.0 * lead))
    q1, q2 = screw.simulate(torque, 1e-3, State(twist=1e-3, angle=3.0))
    assert x1 / lead == pytest.approx(q1, abs=1e-7)
    counts = (x2 * 1e6, q2 * 5000 / (2 * np.pi))
    assert counts[0] == pytest.approx(np.rint(counts[0]), abs=1e-6)
    assert np.mean(np.abs(counts[0] - counts[1]) > 1e-3) < 1e-2  # at the edge of a count


@pytest.mark.parametrize("moment", [0.2, 0.5])
def test_a_model_of_later_goes_on_where_the_first_part_ends(moment: float) -> None:
    worn = Model(
        AXIS,
        (
            Effect("friction_coulomb", "table", {"torque": 0.02}),
            Effect("friction_viscous", "table", {"coefficient": 2e-4}),
            Effect("friction_asymmetry", "table", {"coefficient": 1e-4}),
            Effect("friction_drift", "table", {"rate": 0.8}),
            Effect("stiffness_drift", "shaft", {"rate": -0.5}),
            Effect("load_change", "table", {"ratio": 1.0, "time": 0.3}),
            Effect("disturbance", "motor", {"amplitude": 0.02, "frequency": 55.0, "phase": 1.0}),
        ),
    )
    torque = torque_record(1e-4, 8000).torque
    whole = core.simulate_effects(AXIS, worn.effects, 1e-4, torque)
    n = round(moment / 1e-4)
    state = State(whole.twist[n], whole.twist_speed[n], whole.omega1[n], whole.theta1[n])
    theta1, theta2 = worn.later(moment).simulate(torque[n:], 1e-4, state, hold="newmark")
    assert theta1 == pytest.approx(whole.theta1[n:], abs=1e-7)
    assert theta2 == pytest.approx(whole.theta2[n:], abs=1e-7)
    prompt, _ = worn.simulate(torque[n:], 1e-4, state, hold="newmark")
    assert np.max(np.abs(prompt - whole.theta1[n:])) > 1e-2


def test_a_stiffness_cannot_drift_below_nothing() -> None:
    soft = Model(AXIS, (Effect("stiffness_drift", "shaft", {"rate": -0.5}),))
    with pytest.raises(InputError, match="drifted to nothing"):
        soft.later(2.0)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("I1 = ", "is no TOML"),
        ("[axis]\n", "the schema is None; this version reads 'axistwin.model/1'"),
        (HEAD.replace("/1", "/2"), "the schema is 'axistwin.model/2'"),
        (HEAD.replace("K = 20.0", ""), "axis has no K"),
        (HEAD.replace("K = 20.0", "K = true"), "K is True, not a number"),
        (HEAD.replace("K = 20.0", 'K = "20"'), "K is '20', not a number"),
        (HEAD.replace("K = 20.0", "K = nan"), "K is nan, not a number"),
        (HEAD + "D = 1.0\n", "axis has 'D'; known are B, I1, I2, K"),
        ("linear = 1\n" + HEAD, "linear is neither true nor false"),
        ("effects = 3\n" + HEAD, "effects are not a list"),
        (HEAD + '[[effects]]\neffect = "backlash"\n', "no name (effect) or no location"),
        (
            HEAD + '[[effects]]\neffect = "slack"\nlocation = "shaft"\n',
            "no effect 'slack'; there are friction_coulomb",
        ),
        (
            HEAD + '[[effects]]\neffect = "backlash"\nlocation = "shaft"\nparams = {gap = "1"}\n',
            "backlash: gap is '1', not a number",
        ),
        (
            HEAD + '[[effects]]\neffect = "sample_loss"\nlocation = "record"\n',
            "has the parameter fraction",
        ),
    ],
)
def test_a_file_that_is_no_model_says_why(
    text: str, complaint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "model.toml"
    path.write_text(text)
    assert main(["simulate", str(path), "--torque", "none.csv", "-f", "out.csv"]) == 2
    error = capsys.readouterr().err
    assert complaint in error
    assert error.count("\n") == 1
    assert str(path) in error


def test_a_model_file_that_is_not_there() -> None:
    with pytest.raises(InputError, match=r"cannot read no\.toml: No such file"):
        model.read("no.toml")


def test_simulate_writes_the_record_of_a_model(tmp_path: Path) -> None:
    model.write(WORN, tmp_path / "worn.toml")
    given_record = torque_record(1e-3, 1500)
    write_csv(given_record, tmp_path / "torque.csv")
    arguments = [str(tmp_path / "worn.toml"), "--torque", str(tmp_path / "torque.csv")]
    assert main(["simulate", *arguments, "-f", str(tmp_path / "out.csv")]) == 0
    found = readers.read_record(tmp_path / "out.csv")
    theta1, theta2 = WORN.simulate(given_record.torque, 1e-3)
    assert np.array_equal(found.theta1, theta1)
    assert found.theta2 is not None
    assert np.array_equal(found.theta2, theta2)
    assert np.array_equal(found.torque, given_record.torque)


def test_simulate_loses_the_share_of_samples_that_the_model_says(tmp_path: Path) -> None:
    lossy = Model(AXIS, (Effect("sample_loss", "record", {"fraction": 0.1}),))
    model.write(lossy, tmp_path / "lossy.toml")
    write_csv(torque_record(1e-3, 5000), tmp_path / "torque.csv")
    arguments = [str(tmp_path / "lossy.toml"), "--torque", str(tmp_path / "torque.csv")]
    assert main(["simulate", *arguments, "-f", str(tmp_path / "out.csv")]) == 0
    found = readers.read_record(tmp_path / "out.csv")
    assert len(found.missing) == pytest.approx(500, abs=5 * np.sqrt(450))
    theta1, _ = lossy.simulate(torque_record(1e-3, 5000).torque, 1e-3)
    there = np.setdiff1d(np.arange(len(found)), found.missing)
    assert np.array_equal(found.theta1[there], theta1[there])


def test_a_rotary_model_is_not_run_on_a_linear_record(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model.write(WORN, tmp_path / "worn.toml")
    write_csv(torque_record(1e-3, 100, linear=True), tmp_path / "torque.csv")
    arguments = [str(tmp_path / "worn.toml"), "--torque", str(tmp_path / "torque.csv")]
    assert main(["simulate", *arguments, "-f", str(tmp_path / "out.csv")]) == 2
    assert "the model is rotary, the record linear" in capsys.readouterr().err
    assert not (tmp_path / "out.csv").exists()


def test_emulate_takes_axis_and_effects_from_a_model(tmp_path: Path) -> None:
    path = tmp_path / "worn.toml"
    model.write(WORN, path)
    options = with_model(["--effects", str(path), "--duration", "0.1"])
    assert options[:2] == ["--axis", "2.7e-05,8.3e-06,0.0021,110.0"]
    assert options[2:4] == ["--effect", "friction_coulomb:table:torque=0.012"]
    assert options[-2:] == ["--duration", "0.1"]
    assert with_model([f"--effects={path}", "--duration", "0.1"]) == options
    ended = subprocess.run(
        [EMULATOR, "--simulated", *options], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 0, ended.stderr
    assert "ended after 0.1 s" in ended.stdout


def test_emulate_refuses_what_it_cannot_be() -> None:
    with pytest.raises(InputError, match="--effects wants a model file"):
        with_model(["--effects"])
    with pytest.raises(InputError, match="rotary one, the model is linear"):
        Model(AXIS, linear=True).emulator_options()
    with pytest.raises(InputError, match="rotary one, the model is linear"):
        Model(AXIS, linear=True).commands()
    with pytest.raises(InputError, match="that is of the record"):
        Model(AXIS, (Effect("sample_loss", "record", {"fraction": 0.1}),)).emulator_options()


def test_the_wire_numbers_the_catalogue_as_the_core_does() -> None:
    contract = load_contract()
    names = [f"{e.effect}_{e.location}_{e.parameter}" for e in core.effect_parameters()]
    spelled = ["".join(word.capitalize() for word in name.split("_")) for name in names]
    numbers = range(len(names) + 1)  # the one behind the last has no name
    named = [contract.name_of("Command", "EffectSelect", number) for number in numbers]
    assert named == [*spelled, str(len(names))]


def test_a_model_sent_to_an_emulated_axis_is_what_it_is_from_then_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model.write(WORN, tmp_path / "worn.toml")
    line, file = tmp_path / "line", tmp_path / "trace.csv"
    carrier = ["-i", "slcan", "-c", str(line), *PATIENCE]
    with running_drive(line, "--bit-rate", "4000000", "--watchdog", "5000"):
        assert main(["model", "send", str(tmp_path / "worn.toml"), *carrier]) == 0
        assert "at rest at angle 0" in capsys.readouterr().out
        assert main(["trace", *carrier, "--excite", "-n", "4000", "-f", str(file)]) == 0
    record = readers.read_record(file)
    # In so short a time what it rattles in its play hardly depends on the state it starts from, and
    # all that is left is the rounding to a count.
    rounding = 2 * np.pi / 2**20 / np.sqrt(12)
    for sent, least, most in ((WORN, 0.9, 1.1), (Model(AXIS), 100.0, np.inf)):
        errors = compare.compare(sent, record, window=0.02, hold="newmark")
        assert least < errors[0].rms / rounding < most


def test_an_axis_is_not_changed_under_a_torque(tmp_path: Path) -> None:
    line = tmp_path / "line"
    arguments = argparse.ArgumentParser()
    bus.add_arguments(arguments)
    with (
        running_drive(line, "--watchdog", "5000"),
        bus.node_of(arguments.parse_args(["-i", "slcan", "-c", str(line), *PATIENCE])) as node,
    ):
        node.connect(5.0, print)
        node.enable()
        with pytest.raises(CommandRefusedError, match="AxisRestart: not while operation is enab"):
            node.restart_axis(WORN)
        node.disable()
        node.restart_axis(WORN)
        stiff = Model(AXIS, (Effect("friction_coulomb", "motor", {"torque": -1.0}),))
        with pytest.raises(CommandRefusedError, match="AxisRestart: the argument is out of range"):
            node.restart_axis(stiff)


@pytest.mark.parametrize(
    ("effect", "complaint"),
    [
        ("friction_coulomb:table", "wants EFFECT:LOCATION:PARAMETER=VALUE"),
        ("friction_coulomb:shaft:torque=1", "no such effect at this location"),
        ("friction_coulomb:table:force=1", "this effect has no such parameter"),
        ("friction_coulomb:table:torque", "wants PARAMETER=VALUE"),
        ("friction_coulomb:table:torque=1x", "the value is no number"),
        ("friction_coulomb:table:torque=nan", "the value is no number"),
        ("friction_coulomb:table:torque=-1", "argument out of range"),
        ("delay:torque:time=1", "argument out of range"),
    ],
)
def test_the_emulator_says_what_is_wrong_with_an_effect(effect: str, complaint: str) -> None:
    ended = subprocess.run(
        [EMULATOR, "--simulated", "--duration", "0.1", "--effect", effect],
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 2
    assert complaint in ended.stderr
    assert ended.stderr.count("\n") == 1
