"""`axistwin identify`: what it prints, writes and answers to the shell."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib import image

from axistwin import core, plots
from axistwin.cli import main
from axistwin.identify import identify
from axistwin.record import Record, write_csv

from .identify_records import PARAMETERS, trace

Measured = Callable[[str], Path]
PAPER = core.paper_axis()
TRUE = f"{PAPER.I1},{PAPER.I2},{PAPER.B},{PAPER.K}"


@pytest.fixture
def csv(tmp_path: Path) -> Path:
    path = tmp_path / "trace.csv"
    write_csv(trace(), path)
    return path


def test_table_as_the_paper_prints_it(csv: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(csv), "--true", TRUE]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert "Two-inertia axis" in lines[0]
    assert lines[2].split()[:4] == ["Real", "Estimated", "Error", "(%)"]
    rows = {line.split()[0]: line for line in lines[3:10]}
    assert list(rows) == [*PARAMETERS, "wn", "wd", "zeta"]
    numbers = rows["K"].partition(")")[2].split()
    assert float(numbers[0]) == 110.0
    assert float(numbers[1]) == pytest.approx(110.0, rel=2e-3)
    assert float(numbers[2]) == pytest.approx(100 * (float(numbers[1]) / 110.0 - 1), abs=1e-3)
    methods = [line for line in lines if line.startswith(("output error", "least", "RLS"))]
    assert [method.split("  ")[0] for method in methods] == [
        "output error",
        "least squares, filtered",
        "RLS, float64",
        "RLS, float32",
    ]


def test_json_says_everything(csv: Path, tmp_path: Path) -> None:
    out = tmp_path / "result.json"
    assert main(["identify", str(csv), "--validate", str(csv), "--json", str(out)]) == 0
    result = json.loads(out.read_text())
    assert result["schema"] == "axistwin.identify/1"
    assert result["record"]["samples"] == 2048
    assert result["record"]["channels"] == ["torque", "theta1", "theta2"]
    assert result["model"] == "two-inertia"
    assert result["valid"] is True
    for name in PARAMETERS:
        low, high = result["ci95"][name]
        assert low < result["params"][name] < high
        assert result["stderr"][name] > 0.0
    assert set(result["modal"]) == {"wn", "wd", "zeta"}
    assert result["whiteness"]["white"] is True
    counts = {item["channel"]: item["rms_counts"] for item in result["residual"]}
    # an encoder that rounds to the nearest count is off by 1 / sqrt(12) rms
    assert counts["motor angle"] == pytest.approx(12.0**-0.5, rel=0.1)
    assert result["validation"]["relative_error"]["twist"] < 0.01


def test_json_on_standard_output_is_alone_there(
    csv: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", str(csv), "--json", "-"]) == 0
    streams = capsys.readouterr()
    assert json.loads(streams.out)["model"] == "two-inertia"
    assert "Two-inertia axis" in streams.err


def test_pictures(csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "new" / "pictures"
    assert main(["identify", str(csv), "--true", TRUE, "--plot", str(folder)]) == 0
    told = capsys.readouterr().err
    for name in ("measured_simulated.png", "convergence.png"):
        assert str(folder / name) in told
        picture = image.imread(folder / name)
        height, width = picture.shape[:2]
        assert min(height, width) >= 600
        assert np.std(picture[..., :3]) > 0.02  # not an empty page


def test_pictures_show_what_was_found() -> None:
    result = identify(trace())
    figure = plots.measured_and_simulated(result)
    twist, error = figure.axes[0], figure.axes[2]
    assert "mrad" in twist.get_ylabel()
    measured, simulated = (np.asarray(line.get_ydata(), np.float64) for line in twist.lines)
    assert np.max(np.abs(measured - simulated)) < 0.02  # two counts in mrad
    assert "counts" in error.get_ylabel()
    assert np.size(error.lines[0].get_ydata()) == 2048
    curves = plots.convergence(result, {"K": 110.0})
    stiffness = curves.axes[3]
    assert "110 N m/rad" in stiffness.get_title()
    low, high = stiffness.get_ylim()
    assert low < 0.0 < high
    deviation = np.asarray(stiffness.lines[0].get_ydata(), np.float64)
    assert abs(deviation[-1]) < 0.2  # per cent


def test_benchmark_from_its_file(
    measured: Measured, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    mapping = ["--map", "torque=vir", "theta1=qm", "--scale", "torque=gtau", "--linear"]
    status = main(
        [
            "identify",
            str(measured("EMPS/DATA_EMPS.mat")),
            *mapping,
            "--validate",
            str(measured("EMPS/DATA_EMPS_PULSES.mat")),
            "--plot",
            str(tmp_path),
        ]
    )
    out = capsys.readouterr().out
    assert status == 0
    assert "Rigid axis" in out
    assert "M (kg)" in out
    assert "the model misses something" in " ".join(out.split())
    assert [path.name for path in tmp_path.iterdir()] == ["measured_simulated.png"]


def test_rigid_axis_against_a_known_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "trace.csv"
    write_csv(trace(samples=6000), path)
    assert main(["identify", str(path), "--model", "rigid", "--true", TRUE]) == 0
    row = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("I "))
    assert float(row.partition(")")[2].split()[0]) == pytest.approx(PAPER.I1 + PAPER.I2, rel=1e-5)


def test_too_little_data_says_what_to_do(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "stream.csv"
    write_csv(trace(samples=3000, decimation=9), path)
    assert main(["identify", str(path), "--model", "two-inertia"]) == 4
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert error.startswith("axistwin: ")
    assert "axistwin trace" in error
    idle = trace()
    write_csv(replace(idle, torque=np.zeros(len(idle))), path)
    assert main(["identify", str(path)]) == 4
    assert "excitation" in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [
        ["--true", "1,2,3"],
        ["--true", "1,two,3,4"],
        ["--true", "2.7e-5,-8.3e-6,2.1e-3,110"],
        ["--true", "2.7e-5,8.3e-6,nan,110"],
        ["--model", "three-inertia"],
        ["--bandwidth", "fast"],
    ],
)
def test_wrong_arguments(
    csv: Path, arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["identify", str(csv), *arguments])
    assert stop.value.code == 2
    assert "error: argument" in capsys.readouterr().err


def test_wrong_values_and_files(
    csv: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    nowhere = str(tmp_path / "nowhere.csv")
    assert main(["identify", nowhere]) == 2
    assert main(["identify", str(csv), "--validate", nowhere]) == 2
    assert main(["identify", str(csv), "--model", "rigid", "--bandwidth", "1e6"]) == 2
    assert main(["identify", str(csv), "--plot", str(csv)]) != 0
    assert main(["identify", str(csv), "--json", str(tmp_path / "no" / "out.json")]) != 0
    streams = capsys.readouterr()
    assert "Traceback" not in streams.err
    assert not (tmp_path / "no").exists()


def test_a_damaged_sample_never_reaches_the_fit(tmp_path: Path) -> None:
    path = tmp_path / "damaged.csv"
    write_csv(trace(), path)
    lines = path.read_text().splitlines()
    cells = lines[900].split(",")
    cells[2] = "nan"
    lines[900] = ",".join(cells)
    path.write_text("\n".join(lines))
    assert main(["identify", str(path)]) == 2


def test_loss_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    whole = trace(samples=3000)
    assert whole.theta2 is not None
    keep = np.delete(np.arange(3000), [500, 501, 502])
    path = tmp_path / "lossy.csv"
    rows = np.column_stack(
        [channel[keep] for channel in (whole.time, whole.torque, whole.theta1, whole.theta2)]
    )
    np.savetxt(path, rows, delimiter=",", header="t,torque,theta1,theta2", comments="", fmt="%.17g")
    assert main(["identify", str(path), "--counts", str(2**20)]) == 0
    out = capsys.readouterr().out
    assert "3 of 3000 samples are missing" in out
    assert "2497 samples" in out


def test_record_of_one_encoder_is_a_rigid_axis() -> None:
    whole = trace(samples=6000)
    alone = Record(
        time=whole.time, torque=whole.torque, theta1=whole.theta1, time_step=whole.time_step
    )
    result = identify(alone)
    assert result.model == "rigid"
    assert result.convergence == ()
