"""How far a least-squares estimate can be trusted, when its residuals may be correlated.

A model that is not quite right leaves residuals that are correlated in time, and the textbook
covariance ``s^2 (J'J)^-1`` then promises too much. Everything here uses the covariance that stays
right for correlated residuals and residuals of unequal size (Newey and West, Econometrica 55
(1987) 703-708)::

    cov = (J'J)^-1 [S_0 + sum_k (1 - k / (L + 1)) (S_k + S_k')] (J'J)^-1,   S_k = sum_t s_t s_(t-k)'

with the scores ``s_t = J_t' e_t``. The number of lags L follows from the residuals' own correlation
(Andrews, Econometrica 59 (1991) 817-858, first-order plug-in): none when they are white.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.stats

from axistwin.core import Array
from axistwin.errors import NotEnoughDataError

#: Columns that depend on each other to this relative precision cannot be told apart.
_RANK_TOLERANCE = 1e-12

#: Residuals are called white when a test that errs once in a hundred times says nothing else.
_SIGNIFICANCE = 0.01


@dataclass(frozen=True)
class Fit:
    """A linear least-squares solution: ``solution`` (p, outputs) and ``residual`` (n, outputs)."""

    solution: Array
    residual: Array


@dataclass(frozen=True)
class Whiteness:
    """Does a residual look like noise? Of several channels the least white one is shown."""

    lag1: float  #: correlation between neighbouring samples, -1 .. 1
    p_value: float  #: of the Ljung-Box test: small when the residuals are correlated

    @property
    def white(self) -> bool:
        """True when the residuals can pass for white noise."""
        return self.p_value >= _SIGNIFICANCE


def least_squares(regressors: Array, outputs: Array) -> Fit:
    """Solve ``regressors @ solution = outputs`` by QR with column scaling.

    ``regressors`` is (n, p), ``outputs`` (n, m). Raises NotEnoughDataError when the columns are
    not independent.
    """
    scale = _column_scale(regressors)
    q, r = scipy.linalg.qr(regressors / scale, mode="economic")
    _check_rank(r)
    solution = scipy.linalg.solve_triangular(r, q.T @ outputs) / scale[:, None]
    return Fit(solution, outputs - regressors @ solution)


def covariance(jacobian: Array, residual: Array) -> Array:
    """Covariance (p, p) of the parameters that minimise the sum of squared residuals.

    ``jacobian`` is (n, channels, p), ``residual`` (n, channels), samples in the order of time.
    Raises NotEnoughDataError when the data do not tell the parameters apart.
    """
    samples, channels, parameters = jacobian.shape
    flat = jacobian.reshape(samples * channels, parameters)
    scale = _column_scale(flat)
    r = scipy.linalg.qr(flat / scale, mode="r")[0][:parameters]
    _check_rank(r)
    # scores in the coordinates where J'J is the identity
    orthogonal = scipy.linalg.solve_triangular(r, (flat / scale).T, trans="T").T
    scores = np.einsum("ncp,nc->np", orthogonal.reshape(samples, channels, parameters), residual)
    spread = scores.T @ scores
    lags = correlation_lags(residual)
    for k in range(1, lags + 1):
        lagged = scores[k:].T @ scores[:-k]
        spread += (1.0 - k / (lags + 1.0)) * (lagged + lagged.T)
    spread *= residual.size / max(residual.size - parameters, 1)
    inverse = scipy.linalg.solve_triangular(r, np.eye(parameters)) / scale[:, None]
    result: Array = inverse @ spread @ inverse.T
    return result


def correlation_lags(residual: Array) -> int:
    """Number of lags L of the covariance above, for residuals (n, channels)."""
    samples = len(residual)
    lag1 = max(abs(float(_autocorrelation(channel, 1)[0])) for channel in residual.T)
    if lag1 < 2.0 / np.sqrt(samples):
        return 0
    lag1 = min(lag1, 0.97)
    strength = 4.0 * lag1**2 / ((1.0 - lag1) ** 2 * (1.0 + lag1) ** 2)
    return min(int(1.1447 * (strength * samples) ** (1.0 / 3.0)) + 1, samples // 4)


def whiteness(residual: Array) -> Whiteness:
    """Test each channel of residuals (n, channels) for correlation in time (Ljung-Box)."""
    samples, channels = residual.shape
    lags = max(1, min(20, samples // 5))
    worst = Whiteness(0.0, 1.0)
    for channel in residual.T:
        rho = _autocorrelation(channel, lags)
        statistic = samples * (samples + 2.0) * np.sum(rho**2 / (samples - np.arange(1, lags + 1)))
        p_value = min(1.0, channels * float(scipy.stats.chi2.sf(statistic, lags)))
        if p_value < worst.p_value or (p_value == worst.p_value and abs(rho[0]) > abs(worst.lag1)):
            worst = Whiteness(float(rho[0]), p_value)
    return worst


def confidence_factor(freedom: int) -> float:
    """Half width of a 95 % interval in standard errors, by the t distribution."""
    return float(scipy.stats.t.ppf(0.975, max(freedom, 1)))


def gradient(function: Callable[[Array], Array], at: Array) -> Array:
    """Derivative (outputs, inputs) of a smooth function at a point with no zero in it."""
    columns = []
    for i, value in enumerate(at):
        step = np.zeros_like(at)
        step[i] = 1e-5 * value
        columns.append((function(at + step) - function(at - step)) / (2.0 * step[i]))
    return np.stack(columns, axis=1)


def _column_scale(matrix: Array) -> Array:
    scale = np.sqrt(np.mean(matrix**2, axis=0))
    if not np.all(scale > 0.0):
        raise NotEnoughDataError("a quantity that is to be identified has no effect in this record")
    return np.asarray(scale)


def _check_rank(r: npt.NDArray[np.floating[Any]]) -> None:
    diagonal = np.abs(np.diag(r))
    if diagonal.min() <= _RANK_TOLERANCE * diagonal.max():
        raise NotEnoughDataError("the record does not tell the parameters apart: excite the axis")


def _autocorrelation(channel: Array, lags: int) -> Array:
    """Correlation of a signal with itself, ``lags`` of them from lag 1."""
    centred = channel - channel.mean()
    power = float(centred @ centred)
    if power <= 0.0:
        return np.zeros(lags)
    return np.array([centred[k:] @ centred[:-k] for k in range(1, lags + 1)]) / power
