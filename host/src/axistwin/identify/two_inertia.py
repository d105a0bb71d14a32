"""The axis of Eq. 3, two inertias and a shaft, from records with both encoders."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from axistwin import core
from axistwin.core import Array
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify import output_error, regression
from axistwin.identify.output_error import Progress
from axistwin.identify.result import (
    AXIS,
    MODAL,
    TWO_INERTIA,
    Comparison,
    Convergence,
    Estimate,
    Identification,
    axis_estimate,
    quantity,
    unit,
)
from axistwin.identify.samples import Hold, Samples
from axistwin.identify.statistics import confidence_factor, whiteness
from axistwin.record import Record

#: A model whose twist is further off than this share of it has not found the resonance.
_TWIST_ERROR_MAX = 0.5

#: Beyond this wn Dt, seven tenths of the Nyquist frequency, the torque between samples matters.
_RADIANS_A_SAMPLE_MAX = 2.2

#: Without resolution in the record, angles go to the C estimator in the finest counts it takes.
_FINEST_COUNTS = 2**24

#: Points of a convergence curve.
_CURVE = 500

#: A residual this much larger than the encoder's rounding comes from something else.
_ABOVE_ROUNDING = 3.0

_TURN = 2.0 * math.pi

_AT_FULL_RATE = "take a trace at the full control rate: axistwin trace --excite"


def identify(
    record: Record, samples: Samples, holds: tuple[Hold, ...], progress: Progress
) -> Identification:
    """Identify I1, I2, B, K from an unbroken stretch of a record with both encoders.

    Raises NotEnoughDataError, with the reason and what to do, when they cannot be had from it.
    """
    _check_twist(samples)
    try:
        start = output_error.find_start(samples, progress)
        fit = output_error.fit(samples, start, holds, progress)
    except NotEnoughDataError as error:
        raise NotEnoughDataError(f"{error}; {_AT_FULL_RATE}") from error
    comparisons = _compare(samples, fit.simulated)
    estimate = axis_estimate(
        "output error", fit.unknowns[:4], fit.covariance[:4, :4], fit.freedom, samples.linear
    )
    _check_answer(estimate, comparisons, samples)
    progress("recursive least squares")
    recursive = _recursive(samples, fit.axis)
    return Identification(
        model=TWO_INERTIA,
        record=record,
        used=samples.count,
        hold=fit.hold,
        estimate=estimate,
        others=(*_batch(samples, fit.axis), *(item[0] for item in recursive)),
        comparisons=comparisons,
        whiteness=whiteness(fit.residual),
        notes=_notes(comparisons, fit.hold),
        convergence=tuple(item[1] for item in recursive),
    )


def predict(samples: Samples, estimate: Estimate, hold: Hold) -> tuple[Comparison, ...]:
    """Twist and angles as this axis has them under the torque of other samples.

    State, zero and load at their start are adjusted to the samples, the axis is not.
    """
    axis = core.Axis(*(estimate.params[name].value for name in AXIS))
    return _compare(samples, output_error.adjust_start(samples, axis, hold))


def _check_twist(samples: Samples) -> None:
    twist = float(np.std(samples.twist))
    steps = [step for step in samples.resolution if step is not None]
    if twist == 0.0 or (steps and twist < 0.3 * max(steps)):
        raise NotEnoughDataError(
            "the twist between motor and table is below what the encoders resolve: "
            "excite the axis with more torque, or nearer to its resonance"
        )


def _check_answer(
    estimate: Estimate, comparisons: tuple[Comparison, ...], samples: Samples
) -> None:
    twist = comparisons[0]
    rate = 1.0 / samples.time_step
    radians = estimate.modal["wn"].value * samples.time_step
    if twist.relative_error > _TWIST_ERROR_MAX or radians > _RADIANS_A_SAMPLE_MAX:
        raise NotEnoughDataError(
            f"no resonance of motor against table shows below the {0.5 * rate:.4g} Hz that "
            f"{rate:.4g} samples a second can show; {_AT_FULL_RATE}"
        )
    for name in ("I1", "I2", "K"):
        item = estimate.params[name]
        if not item.determined:
            error = 100.0 * item.stderr / item.value
            raise NotEnoughDataError(
                f"the record does not tell {name} (standard error {error:.2g} %): excite the axis "
                f"up to its resonance, for longer or with more torque; {_AT_FULL_RATE}"
            )


def _compare(samples: Samples, simulated: Array) -> tuple[Comparison, ...]:
    time = samples.time_step * np.arange(samples.count, dtype=np.float64)
    motor, table = simulated[:, 0], simulated[:, 1]
    steps = samples.resolution
    twist_step = None if steps[0] is None or steps[1] is None else max(steps[0], steps[1])
    angle = unit("angle", samples.linear)
    return (
        Comparison("twist", angle, time, samples.twist, motor - table, twist_step),
        Comparison("motor angle", angle, time, samples.theta1, motor, steps[0]),
        Comparison("table angle", angle, time, samples.table, table, steps[1]),
    )


def _batch(samples: Samples, axis: core.Axis) -> tuple[Estimate, ...]:
    """Least squares over all samples at once: with speeds if measured, else filtered positions.

    Nothing where noise makes that no axis; damping that comes out negative is taken as none.
    """
    if samples.has_speeds:
        method, equations = "least squares, midpoint", regression.midpoint(samples)
    else:
        corner = output_error.filter_corner(axis, samples)
        method, equations = "least squares, filtered", regression.filtered(samples, corner)
    freedom = equations.outputs.size - 6
    try:
        values, spread = regression.solve_with_covariance(equations)
        values[2] = max(values[2], 0.0)
        return (axis_estimate(method, values, spread, freedom, samples.linear),)
    except (NotEnoughDataError, InputError):
        return ()


def _recursive(samples: Samples, axis: core.Axis) -> list[tuple[Estimate, Convergence]]:
    """The C estimator on the same samples, in double and in single precision, where it answers."""
    if samples.linear and not samples.has_speeds:
        return []  # it takes counts a turn
    precisions: tuple[core.Precision, ...] = ("float64", "float32")
    answers = []
    for precision in precisions:
        found = _run_estimator(samples, axis, precision)
        if found.last.axis.I1 > 0.0:
            method = f"RLS, {precision}"
            answers.append(
                (
                    _estimate_of(found.last, method, samples.linear),
                    _curve(found, method, samples.time_step),
                )
            )
    return answers


def _run_estimator(samples: Samples, axis: core.Axis, precision: core.Precision) -> core.Estimates:
    torque = samples.torque
    settings = core.IdentSettings(samples.time_step, axis, float(np.sqrt(np.mean(torque**2))))
    every = max(1, samples.count // _CURVE)
    if samples.has_speeds:
        return core.identify_motion(settings, _motion(samples, precision), torque, every=every)
    counts, per_turn = _counts(samples)
    return core.identify_counts(
        settings, counts, per_turn, torque, every=every, precision=precision
    )


def _motion(samples: Samples, precision: core.Precision) -> core.Motion:
    omega1, omega2 = samples.speeds()
    columns = np.column_stack([samples.twist, omega1 - omega2, omega1, samples.theta1])
    return core.motion((core.State(*row) for row in columns.tolist()), precision)


def _counts(samples: Samples) -> tuple[npt.NDArray[np.int64], tuple[int, int]]:
    """The angles in encoder counts (n, 2), each from its first sample, and the counts a turn."""
    counts, per_turn = [], []
    for angle, step in zip((samples.theta1, samples.table), samples.resolution, strict=True):
        turn = _FINEST_COUNTS if step is None else min(round(_TURN / step), _FINEST_COUNTS)
        counts.append(np.rint((angle - angle[0]) * (turn / _TURN)).astype(np.int64))
        per_turn.append(turn)
    return np.column_stack(counts), (per_turn[0], per_turn[1])


def _estimate_of(found: core.Estimate, method: str, linear: bool) -> Estimate:
    factor = confidence_factor(2 * (found.samples or 0))
    values, errors = found.axis, found.axis_error
    return Estimate(
        method,
        {
            name: quantity(name, getattr(values, name), getattr(errors, name), factor, linear)
            for name in AXIS
        },
        {
            name: quantity(
                name, getattr(found.modal, name), getattr(found.modal_error, name), factor, linear
            )
            for name in MODAL
        },
    )


def _curve(found: core.Estimates, method: str, time_step: float) -> Convergence:
    answered = found.axis[:, :1] > 0.0

    def known(values: Array) -> Array:
        result: Array = np.where(answered, values, np.nan)
        return result

    return Convergence(
        method,
        time_step * found.sample.astype(np.float64),
        known(found.axis),
        known(found.axis_error),
    )


def _notes(comparisons: tuple[Comparison, ...], hold: Hold) -> tuple[str, ...]:
    notes = []
    if hold != "newmark":
        how = "was held from each sample to the next" if hold == "zoh" else "varied linearly"
        notes.append(
            f"the torque {how} ({hold}); the other methods take the trapezoidal rule and are "
            "biased by that"
        )
    motor = comparisons[1]
    if motor.resolution and motor.rms > _ABOVE_ROUNDING * motor.resolution:
        notes.append(
            f"the motor angle is off by {motor.rms / motor.resolution:.3g} counts rms, more than "
            "rounding: friction, a delay or the like is not in this model"
        )
    return tuple(notes)
