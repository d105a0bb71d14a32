"""What is said of a record before it is diagnosed: of good ones nothing, of bad ones what and why.

Good records are those of emulated axes and of real ones; the bad ones are good ones spoilt.
"""

from __future__ import annotations

import argparse
import re
import shlex
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from axistwin import core, readers
from axistwin.cli import make_parser
from axistwin.core import Array, Effect
from axistwin.diagnose import channels
from axistwin.diagnose.intake import examine
from axistwin.errors import AxisTwinError, InputError, NotEnoughDataError
from axistwin.model import Model
from axistwin.record import Record

from .identify_records import evenly, trace

Measured = Callable[[str], Path]

TURN = 2.0 * np.pi

#: Two seconds of a trace, with the resonance well excited and many turns of travel.
GOOD = trace(samples=20_000)

#: An axis that moves like a machine: resonance at 37 Hz, 12 s at 1 kHz.
SLOW = core.Axis(2e-3, 1e-3, 5e-3, 36.0)

WORN = {
    "ideal": (),
    "friction": (
        Effect("friction_coulomb", "motor", {"torque": 0.05}),
        Effect("friction_coulomb", "table", {"torque": 0.05}),
    ),
    "backlash": (Effect("backlash", "shaft", {"gap": 2e-3}),),
    "hardening": (Effect("stiffness_hardening", "shaft", {"coefficient": 1e5}),),
    "ripple": (
        Effect("torque_ripple", "motor", {"amplitude": 0.1, "periods": 12.0, "phase": 1.0}),
    ),
    "eccentricity": (
        Effect("encoder_eccentricity", "encoder2", {"amplitude": 5e-3, "phase": 0.0}),
    ),
    "delay": (Effect("delay", "torque", {"time": 2e-3}),),
    "load": (Effect("load_change", "table", {"ratio": 1.5, "time": 6.0}),),
    "disturbance": (
        Effect("disturbance", "table", {"amplitude": 0.1, "frequency": 60.0, "phase": 0.0}),
    ),
}


def machine(
    effects: tuple[Effect, ...] = (), *, seed: int = 1, one: bool = False, highest: float = 80.0
) -> Record:
    """A record of the slow axis: a swing over several turns, and noise up to ``highest`` [Hz]."""
    n, step, counts = 12_000, 1e-3, 2**16
    rng = np.random.default_rng(seed)
    time = evenly(n, step)
    spectrum = np.fft.rfft(rng.normal(size=n)) * (np.fft.rfftfreq(n, step) < highest)
    noise = np.fft.irfft(spectrum, n)
    torque = 0.6 * np.cos(0.25 * TURN * time) + 0.3 * noise / np.std(noise)
    angles = []
    for angle in Model(SLOW, effects).simulate(torque, step):
        noisy = angle + rng.normal(size=n) * 1e-5
        angles.append(np.rint(noisy * counts / TURN) * (TURN / counts))
    return Record(
        time=time,
        torque=torque,
        theta1=angles[0],
        theta2=None if one else angles[1],
        time_step=step,
        source="machine.csv",
    )


def sampled_slowly(record: Record, times: int) -> Record:
    """One in so many samples of it."""
    return replace(
        record,
        time=record.time[::times],
        torque=record.torque[::times],
        theta1=record.theta1[::times],
        theta2=table(record)[::times],
        time_step=times * record.time_step,
    )


def table(record: Record) -> Array:
    """theta2 of a record that has it."""
    assert record.theta2 is not None
    return record.theta2


# ---- Good records


@pytest.mark.parametrize("name", WORN)
@pytest.mark.parametrize("one", [False, True])
def test_a_worn_axis_is_no_bad_record(name: str, one: bool) -> None:
    intake = examine(machine(WORN[name], one=one))
    assert intake.warnings == ()
    assert all(line.startswith("one encoder") == one for line in intake.advice)


def test_a_trace_is_no_bad_record() -> None:
    intake = examine(GOOD)
    assert intake.warnings == ()
    assert [line.split(" s ")[0] for line in intake.advice] == ["2.15"]


def test_warnings_of_the_record_stay() -> None:
    assert examine(replace(GOOD, warnings=("the log was cut off",))).warnings == (
        "the log was cut off",
    )


# ---- Channels that are not what their name says

REVERSED_TORQUE = "torque, or every angle, is reversed.*--scale torque=-1"

SPOILT: Mapping[str, tuple[Callable[[Record], Record], str]] = {
    "exchanged": (
        lambda r: replace(r, theta1=table(r), theta2=r.theta1),
        r"theta1 and theta2 are exchanged: .*misfit 0\.0\d* that way.*--map",
    ),
    "torque reversed": (lambda r: replace(r, torque=-r.torque), REVERSED_TORQUE),
    "angles reversed": (
        lambda r: replace(r, theta1=-r.theta1, theta2=-table(r)),
        REVERSED_TORQUE,
    ),
    "theta1 reversed": (
        lambda r: replace(r, theta1=-r.theta1),
        "theta1 is reversed: .*--scale theta1=-1",
    ),
    "theta2 reversed": (
        lambda r: replace(r, theta2=-table(r)),
        "theta2 is reversed: .*--scale theta2=-1",
    ),
    "exchanged and reversed": (
        lambda r: replace(r, theta1=table(r), theta2=r.theta1, torque=-r.torque),
        "theta1 and theta2 are exchanged: .*torque.*is reversed",
    ),
    "thousandfold": (
        lambda r: replace(r, theta2=1e3 * table(r)),
        r"theta2 moves 1000 times as far as theta1 \(thousandfold.*--scale theta2=0\.001,",
    ),
    "a thousandth": (
        lambda r: replace(r, theta2=1e-3 * table(r)),
        r"theta2 moves 0\.001 times .*\(thousandfold.*--scale theta2=1000,",
    ),
    "degrees": (
        lambda r: replace(r, theta2=np.rad2deg(table(r))),
        r"theta2 moves 57\.3 times .*\(degrees.*--scale theta2=0\.0174532925,",
    ),
    "turns": (
        lambda r: replace(r, theta2=table(r) / TURN),
        r"theta2 moves 0\.1592 times .*\(turns.*--scale theta2=6\.28318531,",
    ),
    "gear": (
        lambda r: replace(r, theta2=table(r) / 50.0),
        r"theta2 moves 0\.02 times .*\(a gear of 50 to 1\)",
    ),
    "gear, reversed": (
        lambda r: replace(r, theta2=table(r) / -50.0),
        r"\(a gear of 50 to 1\).*theta2 is reversed",
    ),
}


@pytest.mark.parametrize("name", SPOILT)
@pytest.mark.parametrize(
    "record", [GOOD, machine(), machine(WORN["friction"])], ids=lambda r: r.source
)
def test_what_is_not_what_its_name_says_is_refused(name: str, record: Record) -> None:
    spoil, complaint = SPOILT[name]
    with pytest.raises(InputError, match=complaint) as caught:
        examine(spoil(record))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["torque reversed", "theta1 reversed"])
def test_one_encoder_tells_a_reversed_sign_too(name: str) -> None:
    with pytest.raises(InputError, match="is reversed: the inertia would be negative"):
        examine(replace(SPOILT[name][0](machine()), theta2=None))


@pytest.mark.parametrize(
    ("factor", "unit", "scale"),
    [
        (180.0 / np.pi, "degrees", "0.0174532925"),
        (1.0 / TURN, "turns", "6.28318531"),
        (1e3, "milliradians", "0.001"),
        (1e-3, "thousands of radians", "1000"),
    ],
)
def test_the_encoder_gives_the_unit_away(factor: float, unit: str, scale: str) -> None:
    record = replace(GOOD, theta1=factor * GOOD.theta1, theta2=factor * table(GOOD))
    expected = f"theta1 looks like {unit}: .* 1048576 counts a turn.*--scale theta1={scale}$"
    assert any(re.match(expected, warning) for warning in examine(record).warnings)
    # without the counts only powers of two give it away
    unknown = replace(record, counts_per_turn=(None, None))
    assert any(re.match(expected, warning) for warning in examine(unknown).warnings)


def test_counts_and_milliseconds_are_told() -> None:
    counts = replace(
        GOOD,
        theta1=np.rint(GOOD.theta1 * 2**20 / TURN),
        theta2=np.rint(table(GOOD) * 2**20 / TURN),
        counts_per_turn=(None, None),
    )
    warnings = examine(counts).warnings
    assert any("theta1 is in whole numbers: in encoder counts?" in line for line in warnings)
    assert any("faster than any motor" in line for line in warnings)
    milliseconds = replace(GOOD, time=1e3 * GOOD.time, time_step=1e3 * GOOD.time_step)
    assert any("is the time in milliseconds" in line for line in examine(milliseconds).warnings)


@pytest.mark.parametrize(
    ("factor", "why"),
    [(30.0 / np.pi, "revolutions a minute"), (1e3, "thousandfold"), (-1.0, "reversed")],
)
def test_speeds_are_held_against_their_angle(factor: float, why: str) -> None:
    record = machine()
    speed = np.gradient(record.theta1, record.time_step)
    assert examine(replace(record, omega1=speed)).warnings == ()
    (warning,) = examine(replace(record, omega1=factor * speed)).warnings
    assert f"times the rate of theta1 ({why}" in warning


# ---- Samples that are not what was measured


def test_a_torque_that_is_cut_off_is_told() -> None:
    record = machine()
    limit = 1.2 * float(np.std(record.torque))
    (warning,) = examine(replace(record, torque=np.clip(record.torque, -9.0, limit))).warnings
    assert warning.startswith(f"the torque is cut off at {limit:.4g}")


@pytest.mark.parametrize("record", [GOOD, machine()], ids=lambda r: r.source)
def test_an_angle_that_is_cut_off_is_told(record: Record) -> None:
    limit = float(np.quantile(record.theta1, 0.8))
    warnings = examine(replace(record, theta1=np.minimum(record.theta1, limit))).warnings
    assert any(line.startswith(f"theta1 is cut off at {limit:.4g}") for line in warnings)


@pytest.mark.parametrize(
    "torque",
    [
        np.sign(np.sin(np.arange(12_000.0))),
        np.repeat(np.random.default_rng(1).integers(-3, 4, 2400), 5).astype(np.float64),
        np.rint(50.0 * np.sin(0.01 * np.arange(12_000.0))) / 50.0,
        np.random.default_rng(1).normal(size=12_000),
    ],
    ids=["square", "levels", "coarse sine", "noise"],
)
def test_what_only_looks_cut_off_is_not_called_so(torque: Array) -> None:
    assert channels.clipped(torque, channels.resolution(torque), smooth=False) is None
    assert channels.outliers(torque, channels.resolution(torque)) is None


def test_samples_that_were_read_twice_are_counted() -> None:
    record = machine()
    speed = np.abs(np.gradient(record.theta1))
    fast = np.flatnonzero(speed > 40.0 * TURN / 2**16)[50::400]
    angle = record.theta1.copy()
    angle[fast] = angle[fast - 1]
    (warning,) = examine(replace(record, theta1=angle)).warnings
    assert warning.startswith(f"theta1 has {len(fast)} spikes of the sampling")


def test_an_encoder_that_is_read_too_often_is_told() -> None:
    record = machine()
    held = np.repeat(record.theta1[::4], 4)
    (warning,) = examine(replace(record, theta1=held)).warnings
    share = re.search(r"\(([0-9.]+) % of the samples are repeats\)", warning)
    assert share is not None
    assert 60.0 < float(share[1]) <= 75.0


def test_spikes_of_the_torque_and_jumps_of_an_angle_are_told() -> None:
    record = machine()
    at = np.arange(500, 12_000, 1000)
    torque = record.torque.copy()
    torque[at] += 10.0
    (warning,) = examine(replace(record, torque=torque)).warnings
    assert warning.startswith(f"the torque has {len(at)} spikes of a sample, up to ")
    assert "first at sample 500" in warning
    angle = record.theta1 + np.cumsum(np.isin(np.arange(12_000), at)) * 0.3
    warnings = examine(replace(record, theta1=angle, theta2=None)).warnings
    assert any(f"theta1 jumps between two samples {len(at)} times" in line for line in warnings)


@given(
    counts=st.integers(200, 2**18),
    speed=st.floats(0.5, 200.0),
    noise=st.floats(0.0, 3.0),
    digits=st.sampled_from([None, 9]),
)
def test_the_step_of_an_encoder_is_found(
    counts: int, speed: float, noise: float, digits: int | None
) -> None:
    step = TURN / counts
    rng = np.random.default_rng(counts)
    time = np.arange(5000.0) * 1e-3
    # from some counts to some hundred a sample, forwards and backwards
    motion = speed * step * 250.0 * np.sin(3.0 * time) + noise * step * rng.normal(size=5000)
    angle = step * np.rint(motion / step)
    if digits is not None:
        angle = np.array([float(f"{value:.{digits}g}") for value in angle])
    assert channels.resolution(angle) == pytest.approx(step, rel=1e-4)


def test_without_an_encoder_there_is_no_step() -> None:
    rng = np.random.default_rng(1)
    assert channels.resolution(rng.normal(size=5000)) is None
    assert channels.resolution(np.cumsum(rng.normal(size=5000))) is None
    assert channels.resolution(np.zeros(5000)) is None


# ---- Records that cannot be diagnosed


@pytest.mark.parametrize(
    ("spoil", "error", "complaint"),
    [
        (
            lambda r: replace(r, torque=np.zeros(len(r))),
            NotEnoughDataError,
            "torque does not change.*switch the excitation on",
        ),
        (
            lambda r: replace(r, torque=np.full(len(r), 0.3)),
            NotEnoughDataError,
            "torque does not change",
        ),
        (
            lambda r: replace(r, theta1=np.zeros(len(r))),
            NotEnoughDataError,
            "motor does not move.*release the brake",
        ),
        (
            lambda r: replace(r, theta1=r.theta1[0] + (np.arange(len(r)) % 7 == 0) * TURN / 2**16),
            NotEnoughDataError,
            "theta1 moves by less than 5 steps of its encoder: release the brake",
        ),
        (
            lambda r: replace(r, torque=np.random.default_rng(99).normal(size=len(r))),
            InputError,
            "torque and motion have nothing to do with each other.*--map torque=COLUMN",
        ),
        (
            lambda r: replace(
                r,
                time=r.time[:10],
                torque=r.torque[:10],
                theta1=r.theta1[:10],
                theta2=table(r)[:10],
            ),
            NotEnoughDataError,
            "only 10 samples in a row, 50 are needed",
        ),
    ],
    ids=["no torque", "constant torque", "no motion", "noise for motion", "unrelated", "short"],
)
@pytest.mark.parametrize("record", [GOOD, machine()], ids=lambda r: r.source)
def test_what_cannot_be_diagnosed_is_refused(
    record: Record,
    spoil: Callable[[Record], Record],
    error: type[AxisTwinError],
    complaint: str,
) -> None:
    with pytest.raises(error, match=complaint) as caught:
        examine(spoil(replace(record, warnings=())))
    assert "\n" not in str(caught.value)


def test_ten_million_samples_are_looked_at() -> None:
    repeats = 500

    def on_and_on(angle: Array) -> Array:
        travel = angle[-1] - angle[0] + angle[1] - angle[0]
        moved: Array = np.tile(angle, repeats) + np.repeat(travel * np.arange(repeats), len(angle))
        return moved

    record = Record(
        time=evenly(repeats * len(GOOD), GOOD.time_step),
        torque=np.tile(GOOD.torque, repeats),
        theta1=on_and_on(GOOD.theta1),
        theta2=on_and_on(table(GOOD)),
        time_step=GOOD.time_step,
    )
    assert len(record) == 10_000_000
    assert examine(record).warnings == ()


# ---- What a record cannot tell


def commands(advice: tuple[str, ...]) -> list[argparse.Namespace]:
    """The commands that are named, parsed by the parser that the user would meet."""
    found = []
    for line in advice:
        for words in re.findall(
            r"axistwin ((?:excite|trace)(?: on)?(?: -{2}\S+(?: [\d.e+-]+)?)*)", line
        ):
            arguments = shlex.split(words)
            found.append(make_parser(arguments[0]).parse_args(arguments))
    return found


@pytest.mark.parametrize(
    ("record", "topic", "complaint"),
    [
        (
            replace(machine(), theta1=machine().theta1 + 300.0 * machine().time, theta2=None),
            "direction",
            "Coulomb friction cannot be told from an offset",
        ),
        (machine(one=True), "one encoder", "backlash and friction of the table cannot be told"),
        (machine(highest=15.0), "no resonance up to 16", "uncertain; excite up to 49.8 Hz"),
        (
            sampled_slowly(machine(highest=25.0), 16),
            "half the sampling rate",
            "uncertain.*axistwin trace --excite",
        ),
        (trace(), "0.5 turns", "once a turn .* cannot be told; let it turn"),
        (trace(), "0.22 s are too short", "changes slowly"),
    ],
    ids=["one direction", "one encoder", "below resonance", "undersampled", "travel", "duration"],
)
def test_what_cannot_be_told_comes_with_the_experiment(
    record: Record, topic: str, complaint: str
) -> None:
    (line,) = (line for line in examine(record).advice if topic in line)
    assert re.search(complaint, line)
    assert len(commands((line,))) == 1


# ---- Real axes, read with the options that docs and users give

LATE = "the time base is uneven .* but the motion is even: taken as every 0.00100003 s"
UNEVEN = (
    r"the time base is uneven \(steps of 0.01 to 0.012 s\): resampled every 0.01 s, 5135 of 6291"
)
TWICE = "theta1 has {} spikes of the sampling"
TORQUE = "the torque has {} spikes of a sample"
NUMBERED = "theta1 has spikes of the sampling, .*: {} samples are repeats and {} are lost"
EMPS = "--map theta1=qm torque=vir --scale torque=gtau --linear --counts 20000000"
KINOVA = (
    "--map t=Time theta1=Position{0} torque=TorqueCur{0} omega1=Velocity{0} --scale t=1e-3"
).format
UR5 = "--map t=t_s theta1=pos_rad torque=current_A omega1=vel_radps"


@pytest.mark.parametrize(
    ("name", "options", "expected"),
    [
        ("EMPS/DATA_EMPS.mat", EMPS, []),
        ("EMPS/DATA_EMPS_PULSES.mat", EMPS, []),
        (
            "LAAS_cogging/speed_test1.csv",
            "--map t=Time theta1=Position torque=Iq omega1=Velocity",
            [LATE, TWICE.format(47)],
        ),
        (
            "Kinova_Gen3_joints/joint_1_trapez.csv",
            KINOVA(1),
            [NUMBERED.format(94, 112), "109 of 6513 samples are missing", TORQUE.format(21)],
        ),
        (
            "Kinova_Gen3_joints/joint_4_trapez.csv",
            KINOVA(4),
            [NUMBERED.format(48, 30), "15 of 6109 samples are missing", TORQUE.format(17)],
        ),
        (
            "Kinova_Gen3_joints/joint_6_trapez.csv",
            KINOVA(6),
            [NUMBERED.format(92, 71), "130 of 5811 samples are missing"],
        ),
        ("UR5_joints/joint_1.csv", UR5, [UNEVEN]),
    ],
)
def test_real_records_get_the_warnings_that_are_true(
    measured: Measured, name: str, options: str, expected: list[str]
) -> None:
    parser = argparse.ArgumentParser()
    readers.add_arguments(parser)
    record = readers.read(parser.parse_args([str(measured(name)), *options.split()]))
    intake = examine(record)
    assert len(intake.warnings) == len(expected)
    for line, pattern in zip(intake.warnings, expected, strict=True):
        assert re.match(pattern, line), line
    assert any("one encoder" in line for line in intake.advice)
    assert any("one direction" in line for line in intake.advice) == ("Kinova" in name)
