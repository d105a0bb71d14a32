"""What an identification answers: numbers with uncertainty and validity, as table and as JSON."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from axistwin import core
from axistwin.core import Array
from axistwin.identify.samples import ROUNDING, Hold
from axistwin.identify.statistics import Whiteness, confidence_factor, gradient
from axistwin.record import Record

SCHEMA = "axistwin.identify/1"

AXIS = ("I1", "I2", "B", "K")
MODAL = ("wn", "wd", "zeta")

#: Units of a rotary and of a linear axis.
_UNITS = {
    "I1": ("kg m2", "kg"),
    "I2": ("kg m2", "kg"),
    "I": ("kg m2", "kg"),
    "B": ("N m s/rad", "N s/m"),
    "viscous": ("N m s/rad", "N s/m"),
    "K": ("N m/rad", "N/m"),
    "coulomb": ("N m", "N"),
    "offset": ("N m", "N"),
    "torque": ("N m", "N"),
    "angle": ("rad", "m"),
    "speed": ("rad/s", "m/s"),
    "wn": ("rad/s", "rad/s"),
    "wd": ("rad/s", "rad/s"),
    "zeta": ("1", "1"),
}

#: A parameter is determined when its standard error is below this share of it, as on the node.
_RELATIVE_ERROR_MAX = 0.1


def unit(name: str, linear: bool) -> str:
    """Unit of a parameter or channel, for a rotary or a linear axis."""
    return _UNITS[name][1 if linear else 0]


@dataclass(frozen=True)
class Quantity:
    """One number with its standard error, 95 % interval and unit."""

    value: float
    stderr: float
    ci95: tuple[float, float]
    unit: str

    @property
    def determined(self) -> bool:
        """True when the standard error is less than a tenth of the value."""
        return self.stderr < _RELATIVE_ERROR_MAX * abs(self.value)


@dataclass(frozen=True)
class Estimate:
    """The answer of one method: parameters by name and, for two inertias, modal properties."""

    method: str
    params: dict[str, Quantity]
    modal: dict[str, Quantity]

    @property
    def quantities(self) -> dict[str, Quantity]:
        """Parameters and modal properties together."""
        return {**self.params, **self.modal}


@dataclass(frozen=True)
class Comparison:
    """A channel as measured and as the identified model has it, (n,) each, over ``time`` [s].

    ``resolution`` is one encoder count in the channel's unit, None if unknown or not an encoder.
    """

    name: str
    unit: str
    time: Array
    measured: Array
    simulated: Array
    resolution: float | None = None

    @property
    def residual(self) -> Array:
        """simulated - measured, (n,)."""
        return self.simulated - self.measured

    @property
    def rms(self) -> float:
        """Of the residual, in the channel's unit."""
        return float(np.sqrt(np.mean(self.residual**2)))

    @property
    def relative_error(self) -> float:
        """rms of the residual against that of the channel about its mean; 0 at best."""
        return self.rms / float(np.std(self.measured))


@dataclass(frozen=True)
class Convergence:
    """The C estimator on the way: ``values`` and ``stderr`` (m, 4) of I1, I2, B, K after ``time``
    [s] (m,); not-a-number while there was no answer yet."""

    method: str
    time: Array
    values: Array
    stderr: Array


@dataclass(frozen=True)
class Validation:
    """How well the identified model predicts another record: rms error over rms of the channel."""

    source: str
    relative_error: dict[str, float]


@dataclass(frozen=True)
class Identification:
    """The result of an identification from the ``used`` samples of a record.

    ``comparisons`` are the channels that were fitted, ``others`` what further methods say,
    ``notes`` what a reader has to know, one line each. ``hold`` is how the torque went on between
    samples, where that matters.
    """

    model: str
    record: Record
    used: int
    estimate: Estimate
    comparisons: tuple[Comparison, ...]
    whiteness: Whiteness
    hold: Hold | None = None
    others: tuple[Estimate, ...] = ()
    notes: tuple[str, ...] = ()
    convergence: tuple[Convergence, ...] = ()
    validation: Validation | None = None

    @property
    def undetermined(self) -> tuple[str, ...]:
        """Names of the inertias, stiffness and damping that the record does not determine.

        Friction and offset may well be zero: they do not count.
        """
        names = AXIS if self.model == TWO_INERTIA else ("I",)
        return tuple(name for name in names if not self.estimate.params[name].determined)

    @property
    def valid(self) -> bool:
        """True when every parameter can be relied on."""
        return not self.undetermined

    def to_json(self) -> dict[str, object]:
        """The result as the schema axistwin.identify/1; numbers that are not finite become null."""
        return {
            "schema": SCHEMA,
            "record": {
                "path": self.record.source,
                "samples": len(self.record),
                "used": self.used,
                "rate_hz": 1.0 / self.record.time_step,
                "duration_s": self.record.duration,
                "channels": list(self.record.channels),
                "warnings": list(self.record.warnings),
            },
            "model": self.model,
            "hold": self.hold,
            **_estimate_json(self.estimate),
            "valid": self.valid,
            "undetermined": list(self.undetermined),
            "residual": [
                {
                    "channel": channel.name,
                    "unit": channel.unit,
                    "rms": _number(channel.rms),
                    "rms_counts": (
                        _number(channel.rms / channel.resolution) if channel.resolution else None
                    ),
                    "relative": _number(channel.relative_error),
                }
                for channel in self.comparisons
            ],
            "whiteness": {
                "lag1": _number(self.whiteness.lag1),
                "p_value": _number(self.whiteness.p_value),
                "white": self.whiteness.white,
            },
            "others": [_estimate_json(other) for other in self.others],
            "validation": (
                {
                    "path": self.validation.source,
                    "relative_error": dict(self.validation.relative_error),
                }
                if self.validation
                else None
            ),
            "notes": list(self.notes),
        }


RIGID = "rigid"
TWO_INERTIA = "two-inertia"


def axis_estimate(
    method: str, values: Array, covariance: Array, freedom: int, linear: bool
) -> Estimate:
    """The estimate of I1, I2, B, K from ``values`` (4,) and their ``covariance`` (4, 4).

    Modal properties follow by the delta method, from derivatives of the core's own function.
    """
    # B may be zero, where relative steps have no size: one that is small against critical is not
    tiny = 1e-6 * math.sqrt(values[3] * min(values[0], values[1]))
    at = np.array([values[0], values[1], max(values[2], tiny), values[3]])
    slope = gradient(_modal, at)
    factor = confidence_factor(freedom)
    return Estimate(
        method,
        quantities(AXIS, values, covariance, factor, linear),
        quantities(MODAL, _modal(values), slope @ covariance @ slope.T, factor, linear),
    )


def quantities(
    names: Sequence[str], values: Array, covariance: Array, factor: float, linear: bool
) -> dict[str, Quantity]:
    """Quantities by name from ``values`` (p,), their ``covariance`` (p, p) and the half width of
    the 95 % interval in standard errors."""
    found = {}
    for name, value, variance in zip(names, values, np.diag(covariance), strict=True):
        found[name] = quantity(name, float(value), math.sqrt(max(variance, 0.0)), factor, linear)
    return found


def quantity(name: str, value: float, stderr: float, factor: float, linear: bool) -> Quantity:
    """One quantity; ``factor`` as in quantities()."""
    interval = (value - factor * stderr, value + factor * stderr)
    return Quantity(value, stderr, interval, unit(name, linear))


def axis_truth(axis: core.Axis) -> dict[str, float]:
    """Parameters and modal properties of a known axis, by name."""
    values = np.array([axis.I1, axis.I2, axis.B, axis.K])
    return dict(zip((*AXIS, *MODAL), (*values.tolist(), *_modal(values).tolist()), strict=True))


def table(result: Identification, truth: Mapping[str, float] | None = None) -> str:
    """The result as text, laid out as the paper's tables: real, estimated, error.

    ``truth`` are the known values by name; without them the interval stands alone.
    """
    known = truth or {}
    lines = [_title(result), ""]
    header = f"{'':20}"
    if known:
        header += f"{'Real':>13}"
    header += f"{'Estimated':>13}"
    if known:
        header += f"{'Error (%)':>12}"
    lines.append(header + f"   {'95 % interval':27}{'± (%)':>8}")
    for name, item in result.estimate.quantities.items():
        lines.append(_row(name, item, known))
    if result.others:
        lines += ["", *_by_method(result, known)]
    lines += ["", *_quality(result)]
    lines += [f"Note: {note}" for note in (*result.record.warnings, *result.notes)]
    return "\n".join(lines)


def _title(result: Identification) -> str:
    name = {TWO_INERTIA: "Two-inertia axis", RIGID: "Rigid axis"}[result.model]
    step = result.record.time_step
    return (
        f"{name}, {result.estimate.method}: {result.used} samples, "
        f"{(result.used - 1) * step:.4g} s at {1.0 / step:.6g} Hz"
    )


def _row(name: str, item: Quantity, known: Mapping[str, float]) -> str:
    line = f"{f'{_label(name, item)} ({item.unit})':20}"
    if known:
        line += f"{known[name]:13.6g}" if name in known else f"{'':13}"
    line += f"{item.value:13.6g}"
    if known:
        line += f"{_percent(item.value, known[name]):>12}" if name in known else f"{'':12}"
    low, high = item.ci95
    line += f"   {f'{low:.6g} .. {high:.6g}':27}"
    half = 50.0 * (high - low)
    if half < 100.0 * abs(item.value):
        return line + f"{half / abs(item.value):8.2g}"
    return line + f"{'>100':>8}"


def _label(name: str, item: Quantity) -> str:
    """The name that the field gives it: inertias of a linear axis are masses."""
    return name.replace("I", "M") if item.unit == "kg" else name


def _by_method(result: Identification, known: Mapping[str, float]) -> list[str]:
    names = [name for name in result.estimate.params if not known or name in known]
    what = "Error (%) by method" if known else "By method"
    labels = [_label(name, result.estimate.params[name]) for name in names]
    lines = [f"{what:28}" + "".join(f"{label:>13}" for label in labels)]
    for estimate in (result.estimate, *result.others):
        cells = (
            _percent(estimate.params[name].value, known[name])
            if known
            else f"{estimate.params[name].value:.6g}"
            for name in names
        )
        lines.append(f"{estimate.method:28}" + "".join(f"{cell:>13}" for cell in cells))
    return lines


def _quality(result: Identification) -> list[str]:
    lines = []
    for channel in result.comparisons:
        if channel.resolution:
            size = f"{channel.rms / channel.resolution:.3g} counts"
        else:
            size = f"{channel.rms:.3g} {channel.unit}"
        lines.append(
            f"Residual of {channel.name}: {size} rms, "
            f"{100.0 * channel.relative_error:.3g} % of the signal"
        )
    if max(channel.relative_error for channel in result.comparisons) < ROUNDING:
        lines.append("The residual is no more than rounding: nothing is left to explain.")
    elif all(_is_reading_error(channel) for channel in result.comparisons):
        lines.append(
            "The residual is no more than the encoders' rounding: nothing is left to explain."
        )
    elif result.whiteness.white:
        lines.append("The residual is white: nothing is left to explain.")
    else:
        lines.append(
            f"The residual is not white (lag-1 correlation {result.whiteness.lag1:.2f}): the model "
            "misses something. The intervals allow for\ncorrelated noise, not for what is missing."
        )
    if result.validation:
        errors = ", ".join(
            f"{name} {100.0 * error:.3g} %"
            for name, error in result.validation.relative_error.items()
        )
        lines.append(f"Relative error on {result.validation.source}: {errors}")
    if not result.valid:
        lines.append(f"Not determined by this record: {', '.join(result.undetermined)}")
    return lines


def _is_reading_error(channel: Comparison) -> bool:
    """Whether a residual is as small as the rounding of encoders: 1 / sqrt(12) counts each."""
    encoders = 2 if channel.name == "twist" else 1
    rounding = math.sqrt(encoders / 12.0)
    return channel.resolution is not None and channel.rms <= 1.1 * rounding * channel.resolution


def _percent(value: float, true: float) -> str:
    return f"{100.0 * (value / true - 1.0):.2e}" if true else "-"


def _modal(values: Array) -> Array:
    found = core.modal(core.Axis(*(float(value) for value in values)))
    return np.array([found.wn, found.wd, found.zeta])


def _estimate_json(estimate: Estimate) -> dict[str, object]:
    every = estimate.quantities
    return {
        "method": estimate.method,
        "params": {name: _number(item.value) for name, item in estimate.params.items()},
        "modal": {name: _number(item.value) for name, item in estimate.modal.items()},
        "stderr": {name: _number(item.stderr) for name, item in every.items()},
        "ci95": {name: [_number(end) for end in item.ci95] for name, item in every.items()},
        "unit": {name: item.unit for name, item in every.items()},
    }


def _number(value: float) -> float | None:
    return value if math.isfinite(value) else None
