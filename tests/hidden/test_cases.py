"""Cases are what they say, and sizes what threshold.py says."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
from cases import draw
from catalogue import Hidden
from threshold import size_in_thresholds
from truth import STATES, Truth, simulate

STEP = 1e-3
NOISE = (1e-5, 2e-5)
AXIS = Truth(2.7e-5, 8.3e-6, 5e-4, 1.0)


def sizes(hidden: list[Hidden], truth: Truth = AXIS, speed: float = 40.0) -> list[float]:
    """Of effects in a record of 10 s at a speed [rad/s], with a random binary torque on top."""
    start = np.zeros(STATES)
    start[2:4] = speed
    feed = 0.01 * np.random.default_rng(1).choice([-1.0, 1.0], 10_000)
    whole = truth
    for effect in hidden:
        whole = effect.into(whole)
    run = simulate(whole, STEP, feed, start=start)
    return [size_in_thresholds(truth, hidden, i, run, STEP, NOISE) for i in range(len(hidden))]


def lead_error(amplitude: float) -> Hidden:
    return Hidden("lead_error", "table", {"amplitude": amplitude, "periods": 20.0, "phase": 0.5})


def test_a_lead_error_is_as_large_as_its_sine_against_the_noise() -> None:
    """A wave that is no motion: sqrt(sum r^2) is that of a sine, A sqrt(n / 2)."""
    amplitude = 3e-6
    expected = amplitude / NOISE[1] * np.sqrt(10_000 / 2) / 10.0
    assert sizes([lead_error(amplitude)])[0] == pytest.approx(expected, rel=0.05)


def test_twice_the_effect_is_twice_the_size() -> None:
    small, large = (
        sizes([Hidden("torque_offset", "table", {"torque": torque})])[0] for torque in (1e-7, 2e-7)
    )
    assert large == pytest.approx(2.0 * small, rel=1e-3)


def test_what_the_parameters_imitate_has_no_size() -> None:
    """Another inertia from the beginning is another I2; from the middle on it is a load change."""
    always, later = (
        sizes([Hidden("load_change", "table", {"ratio": 1e-4, "time": time})])[0]
        for time in (0.0, 5.0)
    )
    assert later > 1.0
    assert always < 1e-2 * later


def test_an_effect_is_no_larger_than_what_tells_its_place() -> None:
    """The place of friction shows in the twist alone, which a stiff shaft does not have."""
    friction = [Hidden("friction_viscous", "table", {"coefficient": 1e-7})]
    soft = sizes(friction)[0]
    stiff = sizes(friction, AXIS._replace(K=10.0))[0]
    assert stiff < 0.3 * soft


def test_two_effects_that_are_one_have_no_size() -> None:
    """Of a lead error and the same again nobody can say which is how large."""
    again = Hidden("encoder_eccentricity", "encoder2", {"amplitude": 1e-5, "phase": 0.5})
    once = Hidden("lead_error", "table", {"amplitude": 1e-5, "periods": 1.0, "phase": 0.5})
    assert max(sizes([again, once])) < 1e-6
    assert min(sizes([again, lead_error(1e-5)])) > 1.0


def test_a_seed_is_a_case(tmp_path: Path) -> None:
    for name in ("a.csv", "b.csv"):
        draw(12).write(tmp_path / name)
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    draw(13, kind="clean").write(tmp_path / "b.csv")
    assert (tmp_path / "a.csv").read_bytes() != (tmp_path / "b.csv").read_bytes()


@pytest.mark.parametrize("seed", range(4))
def test_a_case_is_within_what_is_promised(seed: int) -> None:
    case = draw(seed, least=3.0)
    truth, step = case.setting.truth, case.setting.time_step
    n = len(case.run.command)
    wn = np.sqrt(truth.K * (1 / truth.I1 + 1 / truth.I2))
    assert 0.1 <= wn * step <= 0.8
    assert 1e-4 <= step <= 1e-3
    assert 9.9 <= n * step <= 60.0
    assert n <= 100_000
    assert np.ptp(case.run.states[:, 0]) > 4 * np.pi
    assert all(size >= 3.0 for size in case.sizes)
    assert len(case.hidden) == {"clean": 0, "single": 1, "pair": 2, "unknown": 1}[case.kind]


def test_the_file_holds_the_readings_and_not_what_was_lost(tmp_path: Path) -> None:
    case = draw(1, kind="single", effect="sample_loss")
    case.write(tmp_path / "record.csv")
    with (tmp_path / "record.csv").open(encoding="ascii") as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["t", "torque", "theta1", "theta2"]
    table = np.array(rows[1:], np.float64)
    kept = np.rint(table[:, 0] / case.setting.time_step).astype(int)
    assert len(case.lost) > 0
    assert sorted({*kept.tolist(), *case.lost.astype(int).tolist()}) == list(
        range(len(case.run.command))
    )
    assert np.array_equal(table[:, 1], case.run.command[kept])
    assert np.array_equal(table[:, 2:], case.run.readings[kept])


def test_readings_are_counts_about_the_angle() -> None:
    case = draw(2, kind="single", effect="quantisation")
    (effect,) = case.hidden
    which = int(effect.location[-1]) - 1
    count = 2 * np.pi / effect.params["counts"]
    readings, shown = case.run.readings[:, which], case.run.shown[:, which]
    assert np.max(np.abs(readings / count - np.rint(readings / count))) < 1e-3
    assert np.std(readings - shown) == pytest.approx(case.setting.noise[which], rel=0.05)
