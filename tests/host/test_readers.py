"""Reading records from CSV and MAT files, good ones and bad ones."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import scipy.io

from axistwin.cli import main
from axistwin.errors import InputError
from axistwin.readers import read_record
from axistwin.readers.columns import ColumnOptions

Measured = Callable[[str], Path]

CSV = "t,torque,theta1,theta2\n0.0,0.1,1,2\n0.001,0.2,2,3\n0.002,0.3,3,5\n"


def written(folder: Path, text: str | bytes, name: str = "record.csv") -> Path:
    file = folder / name
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return file


@pytest.mark.parametrize(
    "text",
    [
        CSV,
        CSV.replace("\n", "\r\n"),
        "\ufeff" + CSV,
        "# made by hand\n\n% with comments\n" + CSV,
        CSV.replace(",", "\t"),
        CSV.replace(",", " ").replace("\n", "  \n"),
        CSV.replace(",", ";").replace(".", ","),
        CSV.replace(",", ", "),
        '"t","torque","theta1","theta2"\n' + CSV.split("\n", 1)[1],
        "temperature,theta2,theta1,t,torque\n20,2,1,0,0.1\n20,3,2,0.001,0.2\n21,5,3,0.002,0.3\n",
        "t,torque,theta1,theta2,note\n0,0.1,1,2,a\n0.001,0.2,2,3,b c\n0.002,0.3,3,5,\n",
    ],
)
def test_csv_is_read_as_people_write_it(tmp_path: Path, text: str) -> None:
    record = read_record(written(tmp_path, text))
    assert record.time_step == pytest.approx(1e-3)
    assert record.torque.tolist() == [0.1, 0.2, 0.3]
    assert record.theta1.tolist() == [1.0, 2.0, 3.0]
    assert record.theta2 is not None
    assert record.theta2.tolist() == [2.0, 3.0, 5.0]
    assert record.omega1 is None
    assert record.warnings == ()


def test_columns_are_mapped_and_scaled(tmp_path: Path) -> None:
    file = written(tmp_path, "ms,i,q1\n0,1,0\n1,2,0.25\n2,3,0.5\n")
    options = ColumnOptions(
        columns={"t": "ms", "torque": "i", "theta1": "q1"},
        scales={"t": "1e-3", "torque": "35.15"},
        counts_per_turn=(1000, None),
        linear=True,
    )
    record = read_record(file, options)
    assert record.time_step == pytest.approx(1e-3)
    assert record.torque == pytest.approx([35.15, 70.3, 105.45])
    assert record.linear
    assert record.resolution == (1e-3, None)


def test_a_time_step_takes_the_place_of_a_time_column(tmp_path: Path) -> None:
    file = written(tmp_path, "torque,theta1\n1,2\n3,4\n5,6\n")
    record = read_record(file, ColumnOptions(time_step=0.25))
    assert record.time.tolist() == [0.0, 0.25, 0.5]


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "is empty"),
        ("\n\n# nothing\n", "has no header"),
        ("0,0.1,1\n1,0.2,2\n", "line 1: a header that names the columns is missing"),
        ("t,torque\n0,1\n1,2\n", "no column 'theta1' for theta1.*--map theta1=COLUMN"),
        ("t,torque,theta1\n", "0 samples"),
        ("t,torque,theta1\n0,1,2\n", "1 samples"),
        (CSV.replace("0.2", "nan"), "torque is nan at sample 1"),
        (CSV.replace("0.2", "inf"), "torque is inf at sample 1"),
        (CSV.replace("0.2", ""), "line 3: torque is '', no number"),
        (CSV.replace("0.2", "much"), "line 3: torque is 'much', no number"),
        (CSV[:-6], "line 4: 2 columns, too few for theta1 .is the file cut off"),
        (CSV.replace("0.002", "0.001"), "time does not increase at sample 2"),
        (CSV.encode("utf-16"), "is not a text file"),
        (b"\x7fELF\x02\x01\x01\x00\xff\xfe", "is not a text file"),
        ('# axistwin record {"time_step": 1}\n' + CSV, "line 1: the comment .* is damaged"),
    ],
)
def test_bad_csv_gets_one_clear_line(
    tmp_path: Path, text: str | bytes, complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, text)
    with pytest.raises(InputError, match=complaint) as caught:
        read_record(file)
    assert str(file) in str(caught.value)
    assert main(["identify", str(file)]) == 2
    said = capsys.readouterr().err
    assert said == f"axistwin: {caught.value}\n"


def test_files_that_are_none_get_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="there is no such file"):
        read_record(tmp_path / "nothing.csv")
    with pytest.raises(InputError, match="it is a folder"):
        read_record(tmp_path)
    with pytest.raises(InputError, match=r"its ending is none of \.asc \.blf \.csv"):
        read_record(written(tmp_path, "x", "record.odt"))


@pytest.mark.parametrize(
    ("options", "complaint"),
    [
        (["--map", "theta3=q1"], "'theta3' is no channel"),
        (["--map", "theta1"], "--map wants CHANNEL=VALUE"),
        (["--map", "theta1=q1"], "no column 'q1' for theta1"),
        (["--scale", "torque=big"], "--scale torque=big: 'big' is no number"),
        (["--scale", "omega1=2"], "--scale omega1: .* has no such channel"),
        (["--time-step", "-1"], "--time-step has to be a positive number"),
        (["--time-step", "nan"], "--time-step has to be a positive number"),
    ],
)
def test_options_that_make_no_sense_are_said(
    tmp_path: Path, options: list[str], complaint: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, CSV)
    assert main(["identify", str(file), *options]) == 2
    said = capsys.readouterr().err
    assert len(said.splitlines()) == 1
    assert said.startswith("axistwin: ")
    assert re.search(complaint, said)


@pytest.mark.parametrize("counts", ["0", "1,2,3", "x", "-4,5", ""])
def test_counts_that_make_no_sense_are_said(
    tmp_path: Path, counts: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = written(tmp_path, CSV)
    with pytest.raises(SystemExit) as caught:
        main(["identify", str(file), f"--counts={counts}"])
    assert caught.value.code == 2
    assert "argument --counts: invalid" in capsys.readouterr().err


def test_mat_files_are_read_with_structures_and_scales(tmp_path: Path) -> None:
    file = tmp_path / "record.mat"
    time = np.arange(50) * 1e-3
    contents = {
        "t": time[:, None],
        "gain": 3.0,
        "drive": {"voltage": np.sin(time), "q": {"motor": time**2}},
        "note": "text is no column",
    }
    scipy.io.savemat(file, contents)
    options = ColumnOptions(
        columns={"torque": "drive.voltage", "theta1": "drive.q.motor"}, scales={"torque": "gain"}
    )
    record = read_record(file, options)
    assert record.torque == pytest.approx(3.0 * np.sin(time))
    assert record.theta1.tolist() == (time**2).tolist()


def test_bad_mat_files_get_one_clear_line(tmp_path: Path) -> None:
    good = tmp_path / "good.mat"
    scipy.io.savemat(good, {"t": np.arange(50.0), "torque": np.ones(50), "theta1": np.ones(40)})
    with pytest.raises(InputError, match="theta1 has shape"):
        read_record(good)
    for length in (10, 100, 200, 300):
        cut = written(tmp_path, good.read_bytes()[:length], f"cut{length}.mat")
        with pytest.raises(InputError, match=f"cut{length}.mat") as caught:
            read_record(cut)
        assert "\n" not in str(caught.value)
    matlab73 = b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM" + b"\0" * 400
    with pytest.raises(InputError, match=r"save.* '-v7'"):
        read_record(written(tmp_path, matlab73, "new.mat"))


def test_emps_is_read(measured: Measured) -> None:
    options = ColumnOptions(
        columns={"theta1": "qm", "torque": "vir"}, scales={"torque": "gtau"}, linear=True
    )
    record = read_record(measured("EMPS/DATA_EMPS.mat"), options)
    assert len(record) == 24841
    assert record.time_step == pytest.approx(1e-3)
    assert record.warnings == ()
    contents = scipy.io.loadmat(measured("EMPS/DATA_EMPS.mat"))
    assert record.torque == pytest.approx((contents["vir"] * contents["gtau"]).ravel())


@pytest.mark.parametrize(
    ("name", "columns", "scales", "uneven"),
    [
        (
            "LAAS_cogging/speed_test1.csv",
            {"t": "Time", "theta1": "Position", "torque": "Iq"},
            {},
            True,
        ),
        (
            "UR5_joints/joint_1.csv",
            {"t": "t_s", "theta1": "pos_rad", "torque": "current_A"},
            {},
            True,
        ),
        (
            "Kinova_Gen3_joints/joint_1_trapez.csv",
            {"t": "Time", "theta1": "Position1", "torque": "TorqueCur1"},
            {"t": "1e-3"},
            False,
        ),
    ],
)
def test_measured_records_are_read(
    measured: Measured, name: str, columns: dict[str, str], scales: dict[str, str], uneven: bool
) -> None:
    record = read_record(measured(name), ColumnOptions(columns, scales))
    assert len(record) > 5000
    assert any("uneven" in warning for warning in record.warnings) == uneven


def test_a_file_without_a_header_is_said_to_have_none(measured: Measured) -> None:
    with pytest.raises(InputError, match="line 13: a header that names the columns is missing"):
        read_record(measured("ODrive_voltage_tests/step1.csv"))
