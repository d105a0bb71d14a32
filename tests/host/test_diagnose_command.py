"""`axistwin diagnose` from a file to its answer, with the engine that users get."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from axistwin import core, model
from axistwin.cli import main
from axistwin.core import Axis, Effect
from axistwin.model import Model
from axistwin.record import Record, write_csv

AXIS = Axis(1e-3, 5e-4, 5e-3, 20.0)
LATE = 3e-4
NOISE = 2e-5


def record_of(made_by: Model, samples: int = 10_000) -> Record:
    """Ten seconds at 1 kHz of a multisine beyond the resonance and slow reversals."""
    step = 1e-3
    time = step * np.arange(samples, dtype=np.float64)
    table = core.schroeder(2048, 200, 0.08, seed=5)
    torque = np.resize(table, samples) + 0.06 * np.sin(2.1 * time)
    theta1, theta2 = made_by.simulate(torque, step, substeps=20)
    random = np.random.default_rng(1)
    return Record(
        time,
        torque,
        theta1 + NOISE * random.standard_normal(samples),
        step,
        theta2 + NOISE * random.standard_normal(samples),
    )


@dataclass(frozen=True)
class Run:
    """What a run of the command leaves in a folder, and its exit status."""

    folder: Path
    status: int

    def text(self, name: str) -> str:
        """A file that it wrote."""
        return (self.folder / name).read_text(encoding="utf-8")


def run(folder: Path, made_by: Model) -> Run:
    write_csv(record_of(made_by), folder / "axis.csv")
    outputs = {
        "json": "answer.json",
        "report": "report.html",
        "model": "model.toml",
        "header": "axis_model.h",
    }
    options = [f"--{name}={folder / file}" for name, file in outputs.items()]
    status = main(["diagnose", str(folder / "axis.csv"), *options])
    return Run(folder, status)


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Of an axis whose table encoder is late."""
    worn = Model(AXIS, (Effect("delay", "encoder2", {"time": LATE}),))
    return run(tmp_path_factory.mktemp("late"), worn)


@pytest.fixture(scope="module")
def clean(tmp_path_factory: pytest.TempPathFactory) -> Run:
    """Of an axis that is what Eq. 3 says."""
    return run(tmp_path_factory.mktemp("clean"), Model(AXIS))


def test_a_hidden_effect_is_named_and_the_status_says_so(late: Run) -> None:
    assert late.status == 1
    answer = json.loads(late.text("answer.json"))
    (finding,) = answer["findings"]
    assert (finding["effect"], finding["location"]) == ("delay", "encoder2")
    low, high = finding["ci95"]["time"]
    assert high - low < 0.01 * LATE
    assert abs(finding["params"]["time"] - LATE) < high - low
    assert answer["unexplained"] is False
    assert answer["error"]["extended"] < 1.1 * NOISE < answer["error"]["base"]


def test_nothing_wrong_is_status_0(clean: Run) -> None:
    assert clean.status == 0
    answer = json.loads(clean.text("answer.json"))
    assert answer["findings"] == []
    assert answer["unexplained"] is False
    assert answer["considered"]
    params = answer["base_model"]["params"]
    for name in ("I1", "I2", "B", "K"):
        assert params[name] == pytest.approx(getattr(AXIS, name), rel=0.02)


def test_the_extended_model_is_the_axis_that_made_the_record(late: Run) -> None:
    extended = model.read(late.folder / "model.toml")
    assert vars(extended.axis) == pytest.approx(vars(AXIS), rel=0.02)
    assert [(one.effect, one.location) for one in extended.effects] == [("delay", "encoder2")]
    assert extended.meta["made_by"] == "axistwin diagnose"
    assert extended.meta["record"] == str(late.folder / "axis.csv")
    assert json.loads(late.text("answer.json"))["extended_model"] == str(late.folder / "model.toml")
    header = late.text("axis_model.h")
    assert "static const axt_effects axis_model_effects" in header


def test_the_report_shows_it(late: Run) -> None:
    page = late.text("report.html")
    assert "One cause named" in page
    assert "delay of the table encoder" in page
    assert page.count("<svg") > 10


def test_the_answer_goes_to_the_terminal_or_makes_way_for_json(
    late: Run, capsys: pytest.CaptureFixture[str]
) -> None:
    """A shorter record does: it is about what goes where."""
    write_csv(record_of(Model(AXIS), 6000), late.folder / "short.csv")
    assert main(["diagnose", str(late.folder / "short.csv"), "--json", "-"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out)["schema"] == "axistwin.diagnosis/1"
    assert "Nothing is wrong" in captured.err


def test_too_little_data_is_status_4(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_csv(record_of(Model(AXIS), 100), tmp_path / "short.csv")
    assert main(["diagnose", str(tmp_path / "short.csv")]) == 4
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.startswith("axistwin: ")
    assert captured.err.count("\n") == 1


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["nothing.csv"], "cannot read nothing.csv"),
        (["nothing.csv", "--window", "0"], "--window 0: has to be a positive time"),
        (["nothing.csv", "--window", "nan"], "--window nan: has to be a positive time"),
    ],
)
def test_usage_is_status_2(
    arguments: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["diagnose", *arguments]) == 2
    assert complaint in capsys.readouterr().err
