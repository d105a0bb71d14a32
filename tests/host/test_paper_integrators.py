"""Integrators: closed forms against the C core, and what the methods do to parameters."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from axistwin.paper.integrators import (
    EXACT,
    EXACT_HELD,
    HOUBOLT,
    INTEGRATORS,
    NEWMARK,
    RUNGE_KUTTA,
    WILSON,
    Integrator,
    damping_error,
    period_error,
)
from axistwin.paper.settings import NAMES, SETTINGS, Setting

from .paper_run import value

integrators = st.sampled_from(INTEGRATORS)
steps = st.floats(0.05, 2.0)
dampings = st.floats(0.0, 0.3)


@given(integrators, steps, dampings)
@settings(max_examples=150, deadline=None)
def test_the_core_vibrates_as_the_closed_form_says(
    integrator: Integrator, x: float, zeta: float
) -> None:
    assert abs(integrator.measured_root(x, zeta) - integrator.root(x, zeta)) < 1e-9


@given(steps, dampings)
def test_newmark_and_the_exact_map_have_the_poles_of_the_bilinear_transform_and_of_the_axis(
    x: float, zeta: float
) -> None:
    pole = x * complex(-zeta, math.sqrt(1.0 - zeta**2))
    assert NEWMARK.root(x, zeta) == pytest.approx((2.0 + pole) / (2.0 - pole))
    for integrator in (EXACT, EXACT_HELD):
        assert integrator.root(x, zeta) == pytest.approx(np.exp(pole))


@pytest.mark.parametrize(
    ("integrator", "period", "damping"),
    [
        (NEWMARK, (1 / 12, 2), None),
        (HOUBOLT, (11 / 24, 2), (1 / 2, 3)),
        (RUNGE_KUTTA, (1 / 120, 4), (1 / 144, 5)),
    ],
    ids=lambda p: p.title if isinstance(p, Integrator) else "",
)
def test_small_steps_err_as_the_power_series_of_the_root_says(
    integrator: Integrator, period: tuple[float, int], damping: tuple[float, int] | None
) -> None:
    x = 0.02
    root = integrator.root(x)
    coefficient, order = period
    assert period_error(root, x) / 100.0 == pytest.approx(coefficient * x**order, rel=0.01)
    if damping is None:
        assert abs(damping_error(root)) < 1e-12
    else:
        coefficient, order = damping
        assert damping_error(root) == pytest.approx(coefficient * x**order, rel=0.01)


def test_the_damping_that_an_axis_has_is_not_counted_as_the_methods() -> None:
    for zeta in (0.0, 0.04, 0.3):
        root = EXACT.root(0.5, zeta)
        assert abs(period_error(root, 0.5, zeta)) < 1e-10
        assert abs(damping_error(root, zeta)) < 1e-12


def test_all_methods_are_stable_where_the_study_goes() -> None:
    for integrator in INTEGRATORS:
        for x in np.geomspace(0.03, 2.0, 30):
            assert abs(integrator.root(float(x))) <= 1.0 + 1e-12


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.key)
class TestTable:
    """The table of `make paper`."""

    @staticmethod
    def of(setting: Setting, integrator: Integrator, column: str) -> float:
        return value(f"Integrators, {setting.title}", integrator.title, column)

    def test_measured_and_closed_form_agree(self, setting: Setting) -> None:
        for integrator in INTEGRATORS:
            for quantity, rounding in (("period", 1e-8), ("damping", 1e-10)):
                closed = self.of(setting, integrator, f"{quantity}, closed form")
                measured = self.of(setting, integrator, f"{quantity}, measured")
                assert measured == pytest.approx(closed, rel=1e-6, abs=rounding)

    def test_newmarks_period_error_is_that_of_the_arctangent(self, setting: Setting) -> None:
        x = setting.x
        expected = 100.0 * (x / (2.0 * math.atan(x / 2.0)) - 1.0)
        assert self.of(setting, NEWMARK, "period, closed form") == pytest.approx(expected)

    def test_newmarks_samples_are_identified_exactly(self, setting: Setting) -> None:
        for name in NAMES:
            assert abs(self.of(setting, NEWMARK, f"{name} identified")) < 1e-10

    def test_exact_samples_are_identified_but_for_the_torque_between_them(
        self, setting: Setting
    ) -> None:
        """Torque that is linear in between lowers the inertias by x^2 / 12, and leaves K."""
        expected = -100.0 * setting.x**2 / 12.0
        for name in ("I1", "I2"):
            found = self.of(setting, EXACT, f"{name} identified")
            assert found == pytest.approx(expected, rel=0.01)
        assert abs(self.of(setting, EXACT, "K identified")) < 1e-4

    def test_numerical_damping_shows_as_damping(self, setting: Setting) -> None:
        """Houbolt's in the first setting is 2 % of the axis' own, in the second 70 %."""
        added = self.of(setting, HOUBOLT, "damping, closed form")
        assert self.of(setting, HOUBOLT, "B identified") > 100.0 * added
        assert self.of(setting, WILSON, "damping, closed form") < 0.25 * added
