"""The noise in a simulation error: correlated in time and between channels.

What a model misses (friction, say) drifts slowly and moves both encoders alike, while the rounding
to counts is new at every sample. Plain least squares would give the drift all the weight. A vector
autoregressive model of the errors,

    e[k] = A1 e[k-1] + A2 e[k-2] + w[k],    w white with covariance S,

turns them into innovations w that are independent and of equal size; the parameters that make their
sum of squares smallest are the most likely ones (H. Luetkepohl, New Introduction to Multiple Time
Series Analysis, chapter 3).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from axistwin.core import Array

#: Past errors that an autoregressive model looks back on: enough for a drift and its slope.
MEMORY = 2

#: Added to correlations so that channels that say the very same still make a definite matrix.
_RIDGE = 1e-13


@dataclass(frozen=True)
class Noise:
    """A model of the errors in c channels.

    ``coefficients`` (memory, c, c): what the errors 1, 2, ... samples ago contribute, as row vector
    times matrix; none for noise that is white in time. ``weights`` (c, c) makes innovations
    independent and of size 1, likewise. ``log_size`` is the logarithm of the determinant of their
    covariance: the lower, the more likely is the model that leaves such errors.
    """

    coefficients: Array
    weights: Array
    log_size: float

    def whiten(self, values: Array) -> Array:
        """Innovations (n - memory, c, ...) of errors (n, c, ...), or derivatives of them."""
        return _across(_innovations(values, self.coefficients), self.weights)


def estimate(errors: Array, rounding: Array, memory: int) -> Noise:
    """The model of errors (n, c) that looks back on ``memory`` of them.

    ``rounding`` (c,) is the size below which errors mean nothing.
    """
    count, channels = errors.shape
    coefficients = np.zeros((memory, channels, channels))
    if memory > 0:
        past = np.hstack([errors[memory - k : count - k] for k in range(1, memory + 1)])
        reach = np.sqrt(np.mean(past**2, axis=0)) + np.tile(rounding, memory)
        solution = np.linalg.lstsq(past / reach, errors[memory:], rcond=None)[0]
        coefficients = (solution / reach[:, None]).reshape(coefficients.shape)
    innovations = _innovations(errors, coefficients)
    size = np.sqrt(np.mean(innovations**2, axis=0) + rounding**2)
    scaled = innovations / size
    spread = scaled.T @ scaled / len(scaled) + _RIDGE * np.eye(channels)
    factor = np.linalg.cholesky(spread)
    weights = scipy.linalg.solve_triangular(factor, np.diag(1.0 / size), lower=True).T
    log_size = 2.0 * float(np.sum(np.log(np.diag(factor) * size)))
    return Noise(coefficients, weights, log_size)


def _innovations(values: Array, coefficients: Array) -> Array:
    memory, count = len(coefficients), len(values)
    result: Array = values[memory:].copy()
    for k, matrix in enumerate(coefficients, start=1):
        result -= _across(values[memory - k : count - k], matrix)
    return result


def _across(values: Array, matrix: Array) -> Array:
    """Channels (n, c, ...) times a matrix (c, d): (n, d, ...)."""
    result: Array = np.einsum("nc...,cd->nd...", values, matrix)
    return result
