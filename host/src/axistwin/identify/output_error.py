"""Simulation-error (output-error) fit: the axis whose simulation comes closest to the encoders.

The measured torque drives the C plant, and the parameters, the state at the first sample and the
zeros are adjusted until the simulated angles differ least from the measured ones (L. Ljung, System
Identification, sections 7.4 and 10.2). Torque and time are taken as exact, the noise sits in the
angles: that is how a drive's record is made, and it is why this fit has no bias where a regression
has one. With white noise it reaches the Cramer-Rao bound.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.optimize

from axistwin import core
from axistwin.core import Array
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify import noise, regression
from axistwin.identify.samples import HOLDS, ROUNDING, Hold, Samples
from axistwin.identify.statistics import covariance, least_squares, whiteness

#: Unknowns of the fit. The first four are the axis; the response is linear in all others: the state
#: at the first sample, the table encoder's zero against the motor's, and a constant load.
UNKNOWNS = ("I1", "I2", "B", "K", "twist", "twist_speed", "speed", "angle", "zero", "load")
_AXIS = 4

#: Relative step of the central differences: the cube root of the precision of a double.
_STEP = 6e-6

#: Inertias, damping and stiffness in units of the start: at least this, and that to start with.
#: Damping may come out as good as zero, but central differences need room below it.
_AXIS_MIN = (1e-3, 1e-3, 2.0 * _STEP, 1e-3)
_START_MIN = 1e-2

#: Rounds of fitting with the noise of the last round, and what ends them: its log size settles.
_ROUNDS = 10
_SETTLED = 1e-3

#: Rounds of the linear regression that completes an axis, with the noise of the last round.
_COMPLETIONS = 3

#: Corners of the filter to start with, how often it is moved at most, and the change that ends it.
_CORNERS = 8
_PASSES = 3
_CORNER_SETTLED = 0.02

#: Where fewer of these give an axis the torque may act late, by so many samples at most.
_FEW = _CORNERS // 2
_LATE_MAX = 8

#: Evaluations of one round: a start that is any good needs five.
_EVALUATIONS_MAX = 50

_NOTHING_NEAR = "no two-inertia axis comes near to what was measured"

Progress = Callable[[str], None]


@dataclass(frozen=True)
class OutputErrorFit:
    """``unknowns`` (10,) in the order of UNKNOWNS with their ``covariance``; ``simulated`` and
    ``residual`` (simulated - measured) are (n, channels): theta1, theta2 [rad] and, when they were
    measured, omega1, omega2 [rad/s]. ``log_size`` compares fits: the lower, the more likely."""

    hold: Hold
    unknowns: Array
    covariance: Array
    simulated: Array
    residual: Array
    freedom: int
    log_size: float

    @property
    def axis(self) -> core.Axis:
        """The axis found."""
        return core.Axis(*(float(value) for value in self.unknowns[:_AXIS]))


def fit(
    samples: Samples,
    start: core.Axis,
    holds: tuple[Hold, ...] = HOLDS,
    progress: Progress = lambda _: None,
) -> OutputErrorFit:
    """Adjust axis, initial state, zero and load to the samples, from a start near the answer.

    The first fit that leaves white noise, or nothing, is the answer; ``holds`` are tried in order.
    When none does, the noise is modelled too, and the most likely fit is the answer: where friction
    drags both angles away from the model, their fast motion still counts in full. Raises
    NotEnoughDataError when the samples do not determine the axis.
    """
    found = []
    reason = NotEnoughDataError(_NOTHING_NEAR)
    for memory in (0, noise.MEMORY):
        for hold in holds:
            progress(f"output error, {hold}, {'coloured' if memory else 'white'} noise")
            try:
                candidate = _fit(_Problem(samples, hold), start, memory)
            except NotEnoughDataError as error:
                reason = error
                continue
            if memory == 0 and _nothing_left(candidate, samples):
                return candidate
            found.append(candidate)
    if not found:
        raise reason
    return min(found, key=lambda candidate: candidate.log_size)


def _nothing_left(found: OutputErrorFit, samples: Samples) -> bool:
    """Is what this fit leaves white noise, or no more than rounding of the record itself?"""
    twist = found.residual[:, 0] - found.residual[:, 1]
    if np.std(twist) < ROUNDING * np.std(samples.twist):
        return True
    return whiteness(found.residual).white


def _fit(problem: _Problem, start: core.Axis, memory: int) -> OutputErrorFit:
    """The most likely unknowns for noise with this memory.

    Gauss-Newton steps in a trust region, with the sensitivities of the float64 plant by central
    differences, repeated with the noise that the last round left.
    """
    unknowns, errors = problem.complete(start)
    scale = problem.scale(unknowns)
    unknowns[:_AXIS] = np.maximum(unknowns[:_AXIS], _START_MIN * scale[:_AXIS])
    lower = np.full(len(UNKNOWNS), -np.inf)
    lower[:_AXIS] = _AXIS_MIN
    model = problem.noise_in(errors, memory)

    for _ in range(_ROUNDS):

        def residual(x: Array, model: noise.Noise = model) -> Array:
            return model.whiten(problem.simulate(x * scale) - problem.measured).ravel()

        def jacobian(x: Array, model: noise.Noise = model) -> Array:
            return model.whiten(problem.sensitivity(x * scale, scale)).reshape(-1, len(x))

        solution = scipy.optimize.least_squares(
            residual,
            unknowns / scale,
            jacobian,
            bounds=(lower, np.inf),
            x_scale="jac",
            xtol=1e-12,
            ftol=1e-8,
            gtol=None,
            max_nfev=_EVALUATIONS_MAX,
        )
        unknowns = solution.x * scale
        errors = problem.simulate(unknowns) - problem.measured
        before, model = model, problem.noise_in(errors, memory)
        if abs(model.log_size - before.log_size) < _SETTLED:
            break
    if solution.status <= 0:
        raise NotEnoughDataError(_NOTHING_NEAR)

    slope = model.whiten(problem.sensitivity(unknowns, scale))
    return OutputErrorFit(
        hold=problem.hold,
        unknowns=unknowns,
        covariance=covariance(slope, model.whiten(errors)) * np.outer(scale, scale),
        simulated=problem.measured + errors,
        residual=errors,
        freedom=errors.size - len(UNKNOWNS),
        log_size=problem.noise_in(errors, noise.MEMORY).log_size,
    )


def find_start(samples: Samples, progress: Progress = lambda _: None) -> core.Axis:
    """An axis near enough to the answer for fit(), found without knowing anything.

    Regressions with the filter's corner all over the frequency range, each repeated with the
    corner moved to the natural frequency just found; the axis whose simulation is closest to the
    measurement is taken. Where hardly any is an axis, it may be one under a later torque. Raises
    NotEnoughDataError when none of them is.
    """
    found = _candidates(samples, progress)
    if len(found) < _FEW:
        # At a resonance two samples may be a quarter of a turn: what answers so is no axis.
        for late in range(1, _LATE_MAX + 1):
            progress(f"the torque {late} samples later")
            found += _candidates(_later(samples, late))
    if not found:
        raise NotEnoughDataError("no resonance of motor against table is to be seen in this record")
    return min(found, key=lambda one: one[0])[1]


def filter_corner(axis: core.Axis, samples: Samples) -> float:
    """The best corner of the filtered regression [rad/s]: at the natural frequency, where the twist
    shows, but below the Nyquist frequency."""
    return min(core.modal(axis).wn, 2.0 / samples.time_step)


def adjust_start(samples: Samples, axis: core.Axis, hold: Hold) -> Array:
    """The channels (n, c) as this axis has them, only state, zero and load adjusted to the samples.

    Raises NotEnoughDataError when the axis cannot be simulated with these samples.
    """
    problem = _Problem(samples, hold)
    return problem.measured + problem.complete(axis)[1]


class _Problem:
    """What is measured, and what the plant answers for given unknowns."""

    def __init__(self, samples: Samples, hold: Hold) -> None:
        self.hold = hold
        self._samples = samples
        channels = [samples.theta1, samples.table]
        if samples.has_speeds:
            channels += samples.speeds()
        self.measured: Array = np.column_stack(channels)

    def simulate(self, unknowns: Array) -> Array:
        """The channels (n, c) for these unknowns; infinite where there is no such axis."""
        axis = core.Axis(*(float(value) for value in unknowns[:_AXIS]))
        *state, zero, load = (float(value) for value in unknowns[_AXIS:])
        torque = self._samples.torque + load
        try:
            motion = self._run(axis, torque, core.State(*state))
        except InputError:
            return np.full_like(self.measured, np.inf)
        channels = [motion.theta1, motion.theta2 + zero]
        if self._samples.has_speeds:
            channels += [motion.omega1, motion.omega2]
        return np.column_stack(channels)

    def _run(self, axis: core.Axis, torque: Array, state: core.State) -> core.Motion:
        time_step = self._samples.time_step
        if self.hold == "newmark":
            return core.simulate(axis, time_step, torque, state)
        method: core.Method = "exact_held" if self.hold == "zoh" else "exact"
        return core.integrate(method, axis, time_step, torque, state)

    def sensitivity(self, unknowns: Array, scale: Array) -> Array:
        """Derivative (n, c, p) of the channels by the unknowns in units of ``scale``.

        Raises NotEnoughDataError at the limits of what the plant can be.
        """
        columns = []
        for i, unit in enumerate(scale):
            step = np.zeros(len(UNKNOWNS))
            step[i] = unit * _STEP if i < _AXIS else unit
            difference = self.simulate(unknowns + step) - self.simulate(unknowns - step)
            columns.append(difference * (unit / (2.0 * step[i])))
        result = np.stack(columns, axis=2)
        if not np.all(np.isfinite(result)):
            raise NotEnoughDataError(_NOTHING_NEAR)
        return result

    def complete(self, axis: core.Axis) -> tuple[Array, Array]:
        """The unknowns (10,) for this axis that fit best, and the errors (n, c) that they leave.

        All but the axis enter linearly: a linear regression, repeated with the channels weighed by
        the errors that it leaves. Raises NotEnoughDataError where there is no such axis or the
        samples do not determine the unknowns.
        """
        unknowns = np.zeros(len(UNKNOWNS))
        unknowns[:_AXIS] = [axis.I1, axis.I2, axis.B, axis.K]
        start = self.simulate(unknowns)
        scale = self.scale(unknowns)
        columns = []
        for i in range(_AXIS, len(UNKNOWNS)):
            step = np.zeros(len(UNKNOWNS))
            step[i] = scale[i]
            columns.append(self.simulate(unknowns + step) - start)
        slope = np.stack(columns, axis=2)
        if not (np.all(np.isfinite(slope)) and np.all(np.isfinite(start))):
            raise NotEnoughDataError(_NOTHING_NEAR)
        model = self.noise_in(self.measured - np.mean(self.measured, axis=0), 0)
        for _ in range(_COMPLETIONS):
            regressors = model.whiten(slope).reshape(self.measured.size, -1)
            wanted = model.whiten(self.measured - start).reshape(-1, 1)
            linear = least_squares(regressors, wanted).solution[:, 0]
            errors = start + slope @ linear - self.measured
            model = self.noise_in(errors, 0)
        unknowns[_AXIS:] = linear * scale[_AXIS:]
        return unknowns, errors

    def noise_in(self, errors: Array, memory: int) -> noise.Noise:
        """The noise in errors (n, c), not below what rounding leaves."""
        rounding = 4.0 * np.finfo(float).eps * np.max(np.abs(self.measured), axis=0)
        return noise.estimate(errors, rounding, memory)

    def misfit(self, axis: core.Axis) -> float:
        """The log size of what complete() leaves; infinite where there is no such axis."""
        try:
            return self.noise_in(self.complete(axis)[1], 0).log_size
        except NotEnoughDataError:
            return np.inf

    def scale(self, unknowns: Array) -> Array:
        """Sizes of the unknowns: such steps move the channels about as much as they move."""
        samples = self._samples
        axis = core.Axis(*(float(value) for value in unknowns[:_AXIS]))
        wn = core.modal(axis).wn
        twist = float(np.std(samples.twist))
        travel = float(np.ptp(samples.theta1))
        damping = max(axis.B, 2e-3 * axis.K / wn)
        speed = travel / samples.duration
        load = (axis.I1 + axis.I2) * speed / samples.duration
        state = (twist, twist * wn, speed, travel)
        return np.array([axis.I1, axis.I2, damping, axis.K, *state, twist, load])


def _candidates(
    samples: Samples, progress: Progress = lambda _: None
) -> list[tuple[float, core.Axis]]:
    """The axes that regressions find, each with its misfit to these samples."""
    problem = _Problem(samples, HOLDS[0])
    axes = []
    if samples.has_speeds:
        axes.append(_axis_from(regression.midpoint(samples)))
    lowest = 100.0 / samples.count  # the filter settles within a third of the samples
    for index, corner in enumerate(np.geomspace(lowest, 1.5, _CORNERS)):
        progress(f"filtered regression {index + 1} of {_CORNERS}")
        axes.append(_refiltered(samples, float(corner) / samples.time_step))
    found = [(problem.misfit(axis), axis) for axis in axes if axis is not None]
    return [one for one in found if one[0] < np.inf]


def _later(samples: Samples, late: int) -> Samples:
    """Where the torque acts so many samples later."""

    def cut(channel: Array | None) -> Array | None:
        return None if channel is None else channel[late:]

    return replace(
        samples,
        torque=samples.torque[: samples.count - late],
        theta1=samples.theta1[late:],
        theta2=cut(samples.theta2),
        omega1=cut(samples.omega1),
        omega2=cut(samples.omega2),
    )


def _refiltered(samples: Samples, corner: float) -> core.Axis | None:
    """The axis by filtered regression, the corner moved to its natural frequency each time."""
    found = None
    for _ in range(_PASSES):
        axis = _axis_from(regression.filtered(samples, corner))
        if axis is None:
            break
        found = axis
        before, corner = corner, filter_corner(axis, samples)
        if abs(corner / before - 1.0) < _CORNER_SETTLED:
            break
    return found


def _axis_from(equations: regression.Equations) -> core.Axis | None:
    """The axis that these equations give, None when what they give is no axis."""
    try:
        i1, i2, b, k = (float(value) for value in regression.solve(equations))
        axis = core.Axis(i1, i2, max(b, 0.0), k)
        core.modal(axis)
    except (NotEnoughDataError, InputError):
        return None
    return axis
