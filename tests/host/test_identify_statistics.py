"""Least squares with uncertainty: against closed forms and by repeated experiments."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.signal

from axistwin.core import Array
from axistwin.errors import NotEnoughDataError
from axistwin.identify import statistics


def autoregressive(rng: np.random.Generator, shape: tuple[int, int], rho: float) -> Array:
    """Noise of standard deviation 1 whose neighbours are correlated by rho."""
    white = rng.standard_normal(shape) * np.sqrt(1.0 - rho**2)
    result: Array = scipy.signal.lfilter([1.0], [1.0, -rho], white, axis=0)
    return result


def test_least_squares_solves_the_normal_equations() -> None:
    rng = np.random.default_rng(1)
    regressors = rng.standard_normal((200, 3)) * [1e-6, 1.0, 1e7]
    outputs = rng.standard_normal((200, 2))
    fit = statistics.least_squares(regressors, outputs)
    # the residual of least squares is orthogonal to every regressor
    size = np.linalg.norm(regressors, axis=0)[:, None] * np.linalg.norm(outputs, axis=0)
    assert np.max(np.abs(regressors.T @ fit.residual) / size) < 1e-13
    np.testing.assert_allclose(regressors @ fit.solution + fit.residual, outputs, rtol=1e-12)


def test_columns_that_depend_on_each_other_are_refused() -> None:
    column = np.random.default_rng(1).standard_normal(100)
    twice = np.column_stack([column, 2.0 * column])
    with pytest.raises(NotEnoughDataError, match="does not tell"):
        statistics.least_squares(twice, column[:, None])
    with pytest.raises(NotEnoughDataError, match="no effect"):
        statistics.least_squares(np.zeros((100, 1)), column[:, None])


@pytest.mark.parametrize("rho", [0.0, 0.5, 0.9])
def test_error_of_a_mean_of_correlated_noise(rho: float) -> None:
    # variance of the mean of n samples of an AR(1) process: (1 + rho) / (1 - rho) / n
    samples = 4000
    noise = autoregressive(np.random.default_rng(2), (samples, 200), rho)
    found = [
        statistics.covariance(np.ones((samples, 1, 1)), run[:, None] - run.mean())[0, 0]
        for run in noise.T
    ]
    expected = (1.0 + rho) / (1.0 - rho) / samples
    assert np.mean(found) == pytest.approx(expected, rel=0.15)


def test_intervals_hold_for_correlated_noise_and_two_channels() -> None:
    rng = np.random.default_rng(3)
    samples, runs, inside = 1500, 300, 0
    jacobian = autoregressive(rng, (samples, 4), 0.8).reshape(samples, 2, 2)
    flat = jacobian.reshape(-1, 2)
    for _ in range(runs):
        noise = autoregressive(rng, (samples, 2), 0.8) * [1.0, 3.0]
        estimate = np.linalg.lstsq(flat, noise.ravel())[0]
        residual = noise - (jacobian @ estimate)
        spread = statistics.covariance(jacobian, residual)
        half = statistics.confidence_factor(2 * samples - 2) * np.sqrt(np.diag(spread))
        inside += np.count_nonzero(np.abs(estimate) < half)
    assert 0.92 <= inside / (2 * runs) <= 0.98


def test_white_residuals_give_the_textbook_covariance() -> None:
    rng = np.random.default_rng(4)
    jacobian = rng.standard_normal((20000, 1, 3))
    residual = 0.5 * rng.standard_normal((20000, 1))
    textbook = 0.25 * np.linalg.inv(jacobian[:, 0].T @ jacobian[:, 0])
    np.testing.assert_allclose(
        np.diag(statistics.covariance(jacobian, residual)), np.diag(textbook), rtol=0.05
    )


def test_whiteness_tells_noise_from_structure() -> None:
    rng = np.random.default_rng(5)
    white = rng.standard_normal((2000, 2))
    assert statistics.whiteness(white).white
    one_is_not = np.column_stack([white[:, 0], autoregressive(rng, (2000, 1), 0.3)[:, 0]])
    verdict = statistics.whiteness(one_is_not)
    assert not verdict.white
    assert verdict.lag1 == pytest.approx(0.3, abs=0.1)


def test_white_noise_is_rarely_called_anything_else() -> None:
    rng = np.random.default_rng(6)
    wrong = sum(not statistics.whiteness(rng.standard_normal((500, 1))).white for _ in range(300))
    assert wrong <= 10  # 1 % are expected


def test_gradient_against_the_derivative() -> None:
    at = np.array([2.0, 1e-6, 3e5])
    found = statistics.gradient(lambda x: np.array([x[0] * x[1] / x[2], x[0] ** 2]), at)
    expected = [[at[1] / at[2], at[0] / at[2], -at[0] * at[1] / at[2] ** 2], [2 * at[0], 0.0, 0.0]]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-20)
