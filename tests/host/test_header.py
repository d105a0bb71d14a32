"""A model as a C header: compiled with the core, it is the axis that the host simulates."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from axistwin import core, header, model
from axistwin.cli import main
from axistwin.core import Array, Axis, Effect, Precision
from axistwin.errors import FileError
from axistwin.model import Model

REPOSITORY = Path(__file__).resolve().parent.parent.parent
STEP, SUBSTEPS = 2e-4, 4
AXIS = Axis(2.7e-5, 8.3e-6, 2.1e-3, 110.0)
WAVE = {"amplitude": 0.01, "periods": 72.0, "phase": -0.3}

# Torque comes in, angles go out, as numbers of the core's own type.
FIRMWARE = """
#include "axt_machine.h"
#include "drive_7.h"
#include <stdio.h>

int main(void) {
    static axt_machine machine;
    const axt_motion rest = {0};
    axt_real torque, before = 0;
    axt_status status = axt_machine_init(&machine, &drive_7, (axt_real)STEP / (axt_real)SUBSTEPS,
                                         AXT_TORQUE_HELD, &drive_7_effects);
    for (long n = 0; status == AXT_OK && fread(&torque, sizeof torque, 1, stdin) == 1; n++) {
        axt_motion motion;
        status = (n == 0) ? axt_machine_set(&machine, &rest, torque) : AXT_OK;
        for (int i = 0; n > 0 && status == AXT_OK && i < SUBSTEPS; i++) {
            status = axt_machine_step(&machine, (i < SUBSTEPS - 1) ? before : torque);
        }
        axt_machine_measure(&machine, &motion);
        (void)fwrite(&motion, sizeof motion, 1, stdout);
        before = torque;
    }
    return status != AXT_OK;
}
"""


def everything() -> tuple[Effect, ...]:
    """Each effect there is once, and a second ripple."""
    sizes = {
        "torque": 0.01,
        "coefficient": 1e-4,
        "speed": 2.0,
        "rate": 0.05,
        "amplitude": 1e-3,
        "frequency": 5e3,
        "phase": 0.7,
        "periods": 3.0,
        "gap": 1e-3,
        "ratio": 0.5,
        "damping_ratio": 0.02,
        "mass_ratio": 0.2,
        "limit": 0.3,
        "counts": 65536.0,
        "time": 1.3e-4,
    }
    params: dict[tuple[str, str], dict[str, float]] = {}
    for entry in core.effect_parameters():
        place = params.setdefault((entry.effect, entry.location), {})
        place[entry.parameter] = sizes[entry.parameter]
    effects = [Effect(*place, values) for place, values in params.items()]
    return (*effects, Effect("torque_ripple", "motor", WAVE))


def firmware(folder: Path, precision: Precision) -> Path:
    """A program with the header in `folder`, compiled as strictly as the core itself."""
    (folder / "main.c").write_text(FIRMWARE)
    program = folder / "firmware"
    real = "float" if precision == "float32" else "double"
    strict = ["-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Wshadow", "-Werror"]
    settings = [f"-DSTEP={STEP}", f"-DSUBSTEPS={SUBSTEPS}", f"-DAXT_REAL={real}"]
    sources = [folder / "main.c", *sorted((REPOSITORY / "lib").glob("*.c"))]
    command = ["gcc", "-std=c11", "-O1", "-ffp-contract=off", *strict, *settings]
    command += [f"-I{REPOSITORY / 'lib'}", *map(str, sources), "-lm", "-o", str(program)]
    subprocess.run(command, check=True)
    return program


@pytest.mark.parametrize("precision", ["float32", "float64"])
def test_a_firmware_with_the_header_has_the_axis_of_the_model(
    tmp_path: Path, precision: Precision
) -> None:
    """To the last bit: every effect there is, under torque that has it all."""
    worn = Model(AXIS, everything(), meta={"record": "a */ comment /* that\nends early"})
    header.write(worn, tmp_path / "drive_7.h", "worn.toml")
    torque = np.tile(core.schroeder(1000, 300, 0.3), 3)
    done = subprocess.run(
        [firmware(tmp_path, precision)],
        input=torque.astype(precision).tobytes(),
        capture_output=True,
        check=True,
    )
    expected = core.simulate_effects(
        AXIS, worn.effects, STEP, torque, held=True, substeps=SUBSTEPS, precision=precision
    )
    found = np.frombuffer(done.stdout, expected.samples.dtype)
    assert len(found) == len(torque)
    for name in expected.samples.dtype.names or ():
        assert np.array_equal(found[name], expected.samples[name]), name
    if precision == "float64":
        theta1, theta2 = worn.simulate(torque, STEP, substeps=SUBSTEPS)
        assert np.array_equal(expected.theta1, theta1)
        assert np.array_equal(expected.theta2, theta2)


def test_a_linear_axis_is_one_that_turns_in_the_firmware(tmp_path: Path) -> None:
    slide = Model(
        Axis(100.0, 40.0, 300.0, 1e7),
        (Effect("friction_coulomb", "table", {"torque": 20.0}),),
        linear=True,
    )
    model.write(slide, tmp_path / "slide.toml")
    source = str(tmp_path / "slide.toml")
    assert main(["model", "header", source, "-f", str(tmp_path / "slide-1.h")]) == 0
    text = (tmp_path / "slide-1.h").read_text()
    assert "a metre of it a turn" in text
    assert "static const axt_axis slide_1 = {" in text
    numbers = constants(text)
    turn = 2.0 * np.pi  # rad, for a metre: energy is the same in both
    assert numbers == pytest.approx(
        [100.0 / turn**2, 40.0 / turn**2, 300.0 / turn**2, 1e7 / turn**2, 20.0 / turn], rel=1e-15
    )


def constants(text: str) -> Array:
    parts = text.split("(axt_real)")[1:]
    return np.array([float(part.split(",")[0]) for part in parts])


def test_an_ideal_axis_has_no_effects(tmp_path: Path) -> None:
    header.write(Model(AXIS), tmp_path / "drive_7.h")
    program = firmware(tmp_path, "float32")
    torque = np.full(100, 0.1, np.float32)
    done = subprocess.run([program], input=torque.tobytes(), capture_output=True, check=True)
    expected = core.simulate_effects(
        AXIS, (), STEP, torque, held=True, substeps=SUBSTEPS, precision="float32"
    )
    assert done.stdout == expected.samples.tobytes()


def test_a_header_that_cannot_be_written_is_said(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot write"):
        header.write(Model(AXIS), tmp_path / "nowhere" / "drive_7.h")
