"""The noise model of the output-error fit: what went into an error comes out as white."""

from __future__ import annotations

import numpy as np
import pytest

from axistwin.core import Array
from axistwin.identify import noise
from axistwin.identify.statistics import whiteness

A1 = np.array([[1.2, 0.1], [-0.3, 0.6]])
A2 = np.array([[-0.4, 0.0], [0.2, -0.1]])
S = np.array([[4.0, 1.5], [1.5, 1.0]])
NO_ROUNDING = np.zeros(2)


def autoregressive(samples: int, seed: int = 1) -> Array:
    """Errors (n, 2) by the definition of the model."""
    w = np.random.default_rng(seed).standard_normal((samples, 2)) @ np.linalg.cholesky(S).T
    errors = np.zeros((samples, 2))
    for k in range(2, samples):
        errors[k] = errors[k - 1] @ A1 + errors[k - 2] @ A2 + w[k]
    return errors


def test_the_model_that_made_the_errors_is_found() -> None:
    found = noise.estimate(autoregressive(100_000), NO_ROUNDING, 2)
    np.testing.assert_allclose(found.coefficients, [A1, A2], atol=0.02)
    assert found.log_size == pytest.approx(np.log(np.linalg.det(S)), abs=0.02)
    np.testing.assert_allclose(found.weights.T @ S @ found.weights, np.eye(2), atol=0.02)


def test_innovations_are_white_and_of_size_one() -> None:
    errors = autoregressive(5000)
    assert not whiteness(errors).white
    innovations = noise.estimate(errors, NO_ROUNDING, 2).whiten(errors)
    assert innovations.shape == (4998, 2)
    assert whiteness(innovations).white
    np.testing.assert_allclose(innovations.T @ innovations / 4998, np.eye(2), atol=1e-9)


def test_white_noise_only_gets_weights() -> None:
    errors = np.random.default_rng(2).standard_normal((1000, 3)) * [1e-6, 1.0, 1e6]
    found = noise.estimate(errors, np.zeros(3), 0)
    assert found.coefficients.shape == (0, 3, 3)
    np.testing.assert_allclose(found.whiten(errors), errors @ found.weights)
    sizes = np.log(np.linalg.det(errors.T @ errors / 1000))
    assert found.log_size == pytest.approx(sizes)


def test_derivatives_are_whitened_as_errors_are() -> None:
    found = noise.estimate(autoregressive(500), NO_ROUNDING, 2)
    directions = np.random.default_rng(3).standard_normal((500, 2, 4))
    whitened = found.whiten(directions)
    for column in range(4):
        np.testing.assert_allclose(whitened[:, :, column], found.whiten(directions[:, :, column]))


def test_a_drift_common_to_both_channels_loses_its_weight() -> None:
    rng = np.random.default_rng(4)
    drift = np.cumsum(np.cumsum(rng.standard_normal(2000)))
    rounding = 0.3 * rng.standard_normal((2000, 2))
    found = noise.estimate(drift[:, None] + rounding, NO_ROUNDING, 2)
    difference = np.tile([0.5, -0.5], (2000, 1))
    common = np.ones((2000, 2))
    weight_of = {
        name: float(np.mean(found.whiten(signal) ** 2))
        for name, signal in (("difference", difference), ("common", common))
    }
    assert weight_of["difference"] > 100.0 * weight_of["common"]


def test_errors_without_noise_have_the_size_of_rounding() -> None:
    found = noise.estimate(np.zeros((100, 2)), np.array([1e-12, 1e-15]), 2)
    assert np.all(np.isfinite(found.weights))
    assert np.isfinite(found.log_size)
