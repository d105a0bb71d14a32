"""The rigid axis with friction, by the inverse-dynamic least-squares method of robotics.

::

    T = I q'' + viscous q' + coulomb sign(q') + offset

Regressors and torque are compared in the band of band.py, whose recipe this is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from axistwin.core import Array
from axistwin.errors import NotEnoughDataError
from axistwin.identify.band import Band
from axistwin.identify.result import (
    RIGID,
    Comparison,
    Estimate,
    Identification,
    quantities,
    unit,
)
from axistwin.identify.samples import Samples
from axistwin.identify.statistics import (
    confidence_factor,
    covariance,
    least_squares,
    whiteness,
)
from axistwin.record import Record

PARAMETERS = ("I", "viscous", "coulomb", "offset")

#: Travel in one direction for less than this share of the time says nothing about its friction.
_SHARE_OF_DIRECTION = 0.02

#: Share of the acceleration's power that may be noise; the inertia comes out that much too small.
_NOISE_SHARE_MAX = 0.01

_ONE_WAY = (
    "the axis moves in one direction only: Coulomb friction cannot be told from the offset "
    "and is part of it"
)


def identify(record: Record, samples: Samples, bandwidth: float | None = None) -> Identification:
    """Identify inertia, viscous and Coulomb friction and offset from a stretch of a record.

    ``bandwidth`` [Hz] is that of the fastest motion to be explained. Raises NotEnoughDataError
    when the record does not tell the inertia, InputError for a bandwidth beyond the record's rate.
    """
    equations = _build(samples, bandwidth)
    names = [name for name in PARAMETERS if name != "coulomb" or equations.both_ways]
    regressors = equations.regressors[:, [PARAMETERS.index(name) for name in names]]
    fit = least_squares(regressors, equations.torque[:, None])
    spread = covariance(regressors[:, None, :], fit.residual)
    factor = confidence_factor(len(equations.torque) - len(names))
    params = quantities(names, fit.solution[:, 0], spread, factor, samples.linear)
    if not (params["I"].value > 0.0 and params["I"].determined):
        raise NotEnoughDataError(
            "the torque does not explain how the axis moves: excite it with more acceleration"
        )
    estimate = Estimate("inverse-dynamic least squares", params, {})
    return Identification(
        model=RIGID,
        record=record,
        used=samples.count,
        estimate=estimate,
        comparisons=(_compare(equations, estimate, samples.linear),),
        whiteness=whiteness(fit.residual),
        notes=() if equations.both_ways else (_ONE_WAY,),
    )


def predict(samples: Samples, estimate: Estimate, bandwidth: float | None = None) -> Comparison:
    """The torque of other samples as an identified axis has it; raises as identify()."""
    return _compare(_build(samples, bandwidth), estimate, samples.linear)


@dataclass(frozen=True)
class _Equations:
    """Decimated: ``time`` (n,), ``regressors`` (n, 4) in the order of PARAMETERS, ``torque`` (n,).

    ``both_ways``: the axis travels in both directions.
    """

    time: Array
    regressors: Array
    torque: Array
    both_ways: bool


def _build(samples: Samples, bandwidth: float | None) -> _Equations:
    band = Band.of(samples, bandwidth)
    speed, acceleration = band.differentiate(samples.theta1)
    _check_motion(samples, acceleration, band)
    regressors = np.column_stack([acceleration, speed, np.sign(speed), np.ones_like(speed)])
    forward = float(np.mean(band.inner(speed) > 0.0))
    return _Equations(
        band.time(samples.count),
        band.thin(regressors),
        band.thin(samples.torque),
        min(forward, 1.0 - forward) >= _SHARE_OF_DIRECTION,
    )


def _check_motion(samples: Samples, acceleration: Array, band: Band) -> None:
    """Raises NotEnoughDataError when the acceleration is mostly the encoder's rounding."""
    rounding = (samples.resolution[0] or 0.0) / np.sqrt(12.0)
    noise = (rounding * band.noise(samples.count)[1]) ** 2
    if not float(np.mean(acceleration**2)) > noise / _NOISE_SHARE_MAX:
        raise NotEnoughDataError(
            "the motor hardly moves in this record: excite the axis with more torque"
        )


def _compare(equations: _Equations, estimate: Estimate, linear: bool) -> Comparison:
    values = [
        estimate.params[name].value if name in estimate.params else 0.0 for name in PARAMETERS
    ]
    return Comparison(
        "force" if linear else "torque",
        unit("torque", linear),
        equations.time,
        equations.torque,
        equations.regressors @ np.array(values),
    )
