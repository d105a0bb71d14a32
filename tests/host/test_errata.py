"""The errata of the paper, one by one, in the order and with the numbers of docs/paper.md."""

from __future__ import annotations

import re
from dataclasses import replace
from decimal import ROUND_DOWN, ROUND_HALF_UP, Decimal

import numpy as np
import pytest

from axistwin import core
from axistwin.core import Array
from axistwin.paper import eq9, native, printed
from axistwin.paper.errata import (
    eq8,
    eq8_as_printed,
    euler_growth,
    euler_motion,
    misfit,
    newmark_slowness,
    newmark_slowness_measured,
)
from axistwin.paper.settings import AXIS, MODAL, SETTINGS, A, B, Setting, errors

from .paper_run import DOCS

both = pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)


def simulated(setting: Setting) -> tuple[core.Motion, Array]:
    torque = setting.torque()
    return core.simulate(AXIS, setting.time_step, torque), torque


def listed() -> list[str]:
    """Numbers of the errata on the page."""
    page = (DOCS / "paper.md").read_text(encoding="utf-8")
    section = page.partition("\n## Errata\n")[2].partition("\n## ")[0]
    return re.findall(r"^\| ([ivx]+) \|", section, re.MULTILINE)


def test_each_erratum_has_a_test_here() -> None:
    tested = [name.split("_")[1] for name in globals() if re.match(r"test_[ivx]+_", name)]
    assert sorted(set(tested)) == sorted(listed())
    assert len(listed()) == 17


@both
def test_i_positive_torque_accelerates_the_motor(setting: Setting) -> None:
    motion, torque = simulated(setting)
    assert misfit(eq8(AXIS), motion, torque, setting.time_step) < 1e-11
    assert misfit(eq8_as_printed(AXIS), motion, torque, setting.time_step) > 0.5
    pushed = core.simulate(AXIS, setting.time_step, [0.1] * 10)
    assert np.all(np.diff(pushed.omega1) > 0.0)


@both
def test_ii_the_inertia_is_missing_beside_the_torque(setting: Setting) -> None:
    motion, torque = simulated(setting)
    phi = eq9.least_squares(eq9.rows(motion, torque, mean_torque=True))
    right, as_printed = setting.time_step / AXIS.I1, setting.time_step
    assert phi[4, 1] == pytest.approx(right, rel=0.1)
    assert phi[4, 1] > 1e4 * as_printed


def test_ii_without_it_only_ratios_are_identified() -> None:
    """All parameters and the torque ten times as large: the same motion, so the same phi."""
    torque = A.torque()
    larger = core.Axis(10.0 * AXIS.I1, 10.0 * AXIS.I2, 10.0 * AXIS.B, 10.0 * AXIS.K)
    one = eq9.rows(core.simulate(AXIS, A.time_step, torque), torque)
    ten = eq9.rows(core.simulate(larger, A.time_step, 10.0 * torque), 10.0 * torque)
    np.testing.assert_allclose(ten.b, one.b, atol=1e-9 * np.max(np.abs(one.b)))


@both
def test_iii_newmarks_samples_obey_the_means_and_not_euler(setting: Setting) -> None:
    motion, torque = simulated(setting)
    h, model, X = setting.time_step, eq8(AXIS), eq9.states(motion)
    rate = np.diff(X, axis=0) / h
    euler = rate - X[:-1] @ model.A.T - np.outer(torque[:-1], model.C)
    assert np.linalg.norm(euler) / np.linalg.norm(rate) > 0.05
    assert misfit(model, motion, torque, h) < 1e-11


@both
def test_iv_eq_9_is_unstable_as_a_simulator(setting: Setting) -> None:
    growth = {"a": 1.00265, "b": 1.07937}[setting.key]
    assert euler_growth(setting) == pytest.approx(growth, abs=5e-6)
    # |1 + h lambda|^2 = 1 - 2 zeta x + x^2 for the vibration
    closed = np.sqrt(1.0 - 2.0 * MODAL.zeta * setting.x + setting.x**2)
    assert euler_growth(setting) == pytest.approx(closed, rel=1e-12)
    pushed = np.zeros(300)
    pushed[0] = 0.1
    X = euler_motion(setting, pushed)
    assert grown(X[:, 0] - X[:, 2]) == pytest.approx(growth, abs=5e-6)
    assert grown(core.simulate(AXIS, setting.time_step, pushed).twist) < 1.0


def grown(twist: Array) -> float:
    """By how much a free vibration grows in a step: q[n+1] = 2 Re(r) q[n] - |r|^2 q[n-1]."""
    regressors = np.column_stack([twist[2:-1], twist[1:-2]])
    found = np.linalg.lstsq(regressors, twist[3:], rcond=None)[0]
    return float(np.sqrt(-found[1]))


def test_v_the_torque_of_eq_17_is_that_of_the_step_before() -> None:
    torque = A.torque()
    for late, unbiased in ((True, True), (False, False)):
        X = euler_motion(A, torque, late=late)
        rows = eq9.Rows(np.column_stack([X[:-1], torque[:-1]]), X[1:])
        found = errors(eq9.read(eq9.least_squares(rows), A.time_step))
        assert (np.max(np.abs(found)) < 1e-6) == unbiased


def test_vi_the_entries_disagree() -> None:
    motion, torque = simulated(A)
    phi = eq9.least_squares(eq9.rows(motion, torque))
    assert phi.size == 20
    stiffness = np.array([-phi[0, 1] * AXIS.I1, phi[0, 3] * AXIS.I2]) / A.time_step / AXIS.K
    damping = np.array([(1.0 - phi[1, 1]) * AXIS.I1, phi[1, 3] * AXIS.I2]) / A.time_step / AXIS.B
    assert np.ptp(stiffness) > 0.01
    assert np.ptp(damping) > 0.5
    # without bias all of them agree
    free = eq9.least_squares(eq9.Rows(*midpoint(motion, torque, A.time_step)))
    np.testing.assert_allclose(-free[0, 1] * AXIS.I1, free[0, 3] * AXIS.I2, rtol=1e-9)
    np.testing.assert_allclose(-free[1, 1] * AXIS.I1, free[1, 3] * AXIS.I2, rtol=1e-9)


def midpoint(motion: core.Motion, torque: Array, h: float) -> tuple[Array, Array]:
    X = np.column_stack([eq9.states(motion), torque])
    return (X[1:] + X[:-1]) / 2.0, np.diff(X[:, :4], axis=0) / h


@both
def test_vii_n_samples_make_n_less_one_rows(setting: Setting) -> None:
    rows = eq9.rows(*simulated(setting))
    assert rows.A.shape == (setting.N - 1, 5)
    assert rows.b.shape == (setting.N - 1, 4)


def test_viii_what_is_inverted_is_a_scalar() -> None:
    """Eqs. 14-16 with the scalar 1, against the inverse of the information matrix (Eq. 12)."""
    rng = np.random.default_rng(8)
    phi, y = rng.standard_normal((30, 3)), rng.standard_normal((30, 1))
    P, theta = 1e6 * np.eye(3), np.zeros((3, 1))
    for row, output in zip(phi, y, strict=True):
        inverted = 1.0 + row @ P @ row
        assert np.ndim(inverted) == 0
        gain = P @ row / inverted
        theta = theta + np.outer(gain, output - row @ theta)
        P = P - np.outer(gain, row @ P)
    information = phi.T @ phi + np.eye(3) / 1e6
    np.testing.assert_allclose(P, np.linalg.inv(information), rtol=1e-6)
    core_theta = native.recursive_least_squares(phi, y, prior=1e6).theta[-1]
    np.testing.assert_allclose(core_theta, theta.T, rtol=1e-6)


def test_ix_what_is_not_stated_matters() -> None:
    motion, torque = simulated(A)
    rows = eq9.rows(motion, torque)
    by_prior = [errors(eq9.read(eq9.recursive(rows, p)[-1], A.time_step)) for p in (1e2, 1e12)]
    assert np.max(np.abs(by_prior[0] - by_prior[1])) > 0.1
    by_lines = [errors(eq9.identify(A, core.schroeder(A.N, n, 0.2)))[2] for n in (10, 20)]
    assert abs(by_lines[0] - by_lines[1]) > 10.0
    by_phase = [errors(eq9.identify(A, A.torque(seed=seed)))[2] for seed in (1, 2)]
    assert abs(by_phase[0] - by_phase[1]) > 1.0
    louder = errors(eq9.identify(A, 5.0 * torque))
    np.testing.assert_allclose(louder, errors(eq9.identify(A, torque)), rtol=1e-5)


@both
def test_x_rls_is_ls(setting: Setting) -> None:
    rows = eq9.rows(*simulated(setting))
    batch = errors(eq9.read(eq9.least_squares(rows), setting.time_step))
    recursive = errors(eq9.read(eq9.recursive(rows, 1e14)[-1], setting.time_step))
    np.testing.assert_allclose(recursive, batch, atol=1e-7)


def test_xi_more_samples_a_period_are_better() -> None:
    def stiffness_error(N: int, k: int) -> float:
        setting = Setting("", N, k)
        return float(abs(errors(eq9.identify(setting, setting.torque()))[3]))

    assert stiffness_error(2048, 10) < 0.2 * stiffness_error(512, 10)
    assert stiffness_error(2048, 40) == pytest.approx(
        stiffness_error(512, 10), rel=0.01
    )  # the same x


def test_xii_there_is_one_mode_and_a_rigid_body() -> None:
    eigenvalues = np.linalg.eigvals(eq8(AXIS).A)
    rigid, vibration = np.sort_complex(eigenvalues[np.argsort(np.abs(eigenvalues))]), MODAL
    oscillating = rigid[np.abs(rigid.imag) > 1.0]
    assert len(oscillating) == 2
    assert oscillating[0] == pytest.approx(np.conj(oscillating[1]))
    expected = -vibration.zeta * vibration.wn + 1j * vibration.wd
    assert oscillating[1] == pytest.approx(expected, rel=1e-9)
    assert np.max(np.abs(rigid[np.abs(rigid.imag) <= 1.0])) < 1e-4 * vibration.wn
    for row in (dict(printed.TABLE_4), dict(printed.TABLE_6), printed.MODAL):
        assert [row[f"{name}1"] for name in ("wn", "wd", "zeta")] == [
            row[f"{name}2"] for name in ("wn", "wd", "zeta")
        ]


def test_xiii_some_numbers_are_cut_off_and_others_rounded() -> None:
    unit = Decimal("1e-2")
    closed = Decimal(AXIS.K / A.closed_form_divisor)
    K = Decimal(dict(printed.TABLE_3)["K"][0])
    assert closed.quantize(unit, ROUND_DOWN) == K
    assert closed.quantize(unit, ROUND_HALF_UP) != K
    unit = Decimal("1e-8")
    Dt = Decimal(printed.TIME_STEPS[1]["Dt"])
    assert Decimal(B.time_step).quantize(unit, ROUND_HALF_UP) == Dt
    assert Decimal(B.time_step).quantize(unit, ROUND_DOWN) != Dt


@both
def test_xiv_newmarks_method_is_slow(setting: Setting) -> None:
    slowness = {"a": 0.125, "b": 1.62}[setting.key]
    assert newmark_slowness(setting) == pytest.approx(slowness, rel=3e-3)
    undamped = core.modal(replace(AXIS, B=0.0)).wn * setting.time_step
    closed = 100.0 * (1.0 - 2.0 / undamped * np.arctan(undamped / 2.0))
    assert newmark_slowness_measured(setting) == pytest.approx(closed, rel=1e-6)
    assert newmark_slowness(setting) == pytest.approx(100.0 * setting.x**2 / 12.0, rel=0.05)


def notation() -> list[tuple[str, str]]:
    """Symbols of the page's notation and what the paper writes them for besides."""
    page = (DOCS / "paper.md").read_text(encoding="utf-8")
    section = page.partition("\n## Notation\n")[2]
    rows = re.findall(r"^\| (`.+?) \| .+? \| (.*?)\|$", section, re.MULTILINE)
    return [(symbol, also) for cell, also in rows for symbol in re.findall(r"`([^`]+)`", cell)]


def test_xv_each_symbol_of_the_page_has_one_meaning() -> None:
    symbols = [symbol for symbol, _ in notation()]
    assert len(symbols) == len(set(symbols))
    twice = {symbol for symbol, also in notation() if also.strip()}
    assert {"K", "A", "δ", "I1", "θ1"} <= twice


def test_xvi_the_rotary_symbols_are_those_of_the_page() -> None:
    translational = {"M", "M1", "M2", "F", "x1", "x2"}
    assert not translational & {symbol for symbol, _ in notation()}


def test_xvii_there_is_no_figure_6() -> None:
    shown = re.findall(r"Figures? (\d+)", (DOCS / "paper.md").read_text(encoding="utf-8"))
    assert "6" in shown  # said to be missing
    assert not list((DOCS / "figures").glob("figure-06*"))
    numbers = {int(path.name[7:9]) for path in (DOCS / "figures").glob("figure-*.png")}
    assert numbers == {4, 7, 8, 9, 10, 11, 12}
