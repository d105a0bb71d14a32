"""The rigid axis with friction, by the inverse-dynamic least-squares method of robotics.

::

    T = I q'' + viscous q' + coulomb sign(q') + offset

The published recipe (M. Gautier, ICRA 1997; A. Janot, M. Gautier, M. Brunot, EMPS benchmark, 2019):
the position passes a low-pass forward and backward, so without delay; speed and acceleration are
central differences of it; regressors and torque then all pass the same decimation filter, which
takes ripple above the band of interest out of both sides alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.signal

from axistwin.core import Array
from axistwin.errors import InputError, NotEnoughDataError
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

#: The fastest motion to be explained, in samples a period, when nothing else is said: 20 Hz for a
#: position loop sampled at 1 kHz.
_SAMPLES_A_PERIOD = 50

#: Corner of the low-pass and of the decimation filter against that bandwidth, as published.
_LOW_PASS = 5.0
_DECIMATION = 0.2

#: Samples at either end that the filters' start may have spoiled.
_BORDER = 50

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
    rate = 1.0 / samples.time_step
    if bandwidth is None:
        bandwidth = rate / _SAMPLES_A_PERIOD
    if not 0.0 < bandwidth <= 0.5 * _DECIMATION * rate:
        raise InputError(
            f"a bandwidth of {bandwidth:g} Hz does not fit a record at {rate:g} Hz: "
            f"give one from 0 to {0.5 * _DECIMATION * rate:g} Hz"
        )
    factor = max(1, round(_DECIMATION * rate / bandwidth))
    if samples.count < 2 * _BORDER + 10 * factor:
        raise NotEnoughDataError(
            f"{samples.count} samples are too few for a bandwidth of {bandwidth:g} Hz"
        )
    low_pass = scipy.signal.butter(4, _LOW_PASS * bandwidth, fs=rate, output="sos")
    speed, acceleration = _differentiate(samples.theta1, low_pass, samples.time_step)
    _check_motion(samples, acceleration, low_pass)
    regressors = np.column_stack([acceleration, speed, np.sign(speed), np.ones_like(speed)])
    inner = slice(_BORDER, -_BORDER)
    forward = float(np.mean(speed[inner] > 0.0))
    time = samples.time_step * np.arange(samples.count, dtype=np.float64)
    return _Equations(
        time[inner][::factor],
        _decimate(regressors[inner], factor),
        _decimate(samples.torque[inner], factor),
        min(forward, 1.0 - forward) >= _SHARE_OF_DIRECTION,
    )


def _differentiate(position: Array, low_pass: Array, time_step: float) -> tuple[Array, Array]:
    """Speed and acceleration of a position filtered without delay."""
    speed = np.gradient(scipy.signal.sosfiltfilt(low_pass, position), time_step)
    return speed, np.gradient(speed, time_step)


def _check_motion(samples: Samples, acceleration: Array, low_pass: Array) -> None:
    """Raises NotEnoughDataError when the acceleration is mostly the encoder's rounding."""
    impulse = np.zeros(samples.count)
    impulse[samples.count // 2] = (samples.resolution[0] or 0.0) / np.sqrt(12.0)
    noise = _differentiate(impulse, low_pass, samples.time_step)[1]
    if not float(np.mean(acceleration**2)) > float(np.sum(noise**2)) / _NOISE_SHARE_MAX:
        raise NotEnoughDataError(
            "the motor hardly moves in this record: excite the axis with more torque"
        )


def _decimate(signal: Array, factor: int) -> Array:
    if factor == 1:
        return signal
    result: Array = scipy.signal.decimate(signal, factor, axis=0)
    return result


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
