"""What a diagnosis answers: named causes with their numbers, what else was considered, evidence.

Everything reads rad, N m, kg m2; for a linear axis m, N, kg.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

import numpy as np
import numpy.typing as npt

from axistwin.core import Array
from axistwin.identify.result import Quantity
from axistwin.identify.samples import Hold
from axistwin.model import Model, parameter_unit
from axistwin.record import Record

SCHEMA = "axistwin.diagnosis/1"


@dataclass(frozen=True)
class Finding:
    """A named cause, in the identifiers of the catalogue.

    ``params`` and ``ci95`` by name, in the units of axistwin.model.parameter_unit(). ``gain`` is
    the share of the held-out error variance of the base model that it removes, after the findings
    named before it: the gains of all findings add up to what they remove together.
    """

    effect: str
    location: str
    params: Mapping[str, float]
    ci95: Mapping[str, tuple[float, float]]
    gain: float


@dataclass(frozen=True)
class Considered:
    """An effect that was not named.

    ``gain`` is the share of the held-out error variance of the base model that it would remove
    beside the findings. ``verdict`` is "no", or why else it was not named, such as "look-alike of
    delay at torque" or "cannot be told from this record: the speed never reverses".
    """

    effect: str
    location: str
    gain: float
    verdict: str


@dataclass(frozen=True)
class ErrorSummary:
    """The rms of the held-out simulation error: ``what`` it is of and its ``unit``.

    Of the base model, of the extended model, and the ``noise_floor`` that no model goes below.
    """

    what: str
    unit: str
    base: float
    extended: float
    noise_floor: float


@dataclass(frozen=True)
class Signals:
    """The smoothed motion, (n,) each: ``time`` [s] in order, with gaps where windows do not touch.

    ``torque`` as commanded [N m], ``theta1``, ``theta2`` [rad], ``omega1``, ``omega2`` [rad/s],
    ``twist`` [rad] without the zero of the encoders; None where there is one encoder.
    """

    time: Array
    torque: Array
    theta1: Array
    omega1: Array
    theta2: Array | None = None
    omega2: Array | None = None
    twist: Array | None = None


@dataclass(frozen=True)
class Residual:
    """What the model lacks at one place along the Signals, (n,) each.

    At ``motor`` and ``table`` the torque [N m] that would have been needed there beyond what was
    applied (Eq. 18), so that friction shows against the speed; at ``encoder1`` and ``encoder2`` the
    angle [rad] measured beyond what was simulated. ``before`` is the axis of the extended model
    without its effects, ``after`` with them.
    """

    before: Array
    after: Array


@dataclass(frozen=True)
class Contribution:
    """What a finding adds at a ``place`` of the residuals along the Signals: ``values`` (n,).

    Its sign is that of the Residual: the residual after, plus this, is the cloud that the curve of
    the finding goes through.
    """

    place: str
    values: Array


@dataclass(frozen=True)
class Shown:
    """A channel as measured and as simulated in windows, (w, l) each [rad]; ``time`` [s].

    ``before`` is the base model, ``after`` the extended one; ``held_out`` (w,) are the windows that
    no fit has seen.
    """

    name: str
    time: Array
    measured: Array
    before: Array
    after: Array
    held_out: npt.NDArray[np.bool_]


@dataclass(frozen=True)
class Autocorrelation:
    """Of the held-out simulation error of a channel, at ``lag`` (m,) [s] from 0.

    ``before`` and ``after`` (m,), 1 at lag 0; white noise stays within -``band`` .. ``band`` at
    95 % of the lags.
    """

    name: str
    lag: Array
    before: Array
    after: Array
    band: float


@dataclass(frozen=True)
class Track:
    """A parameter of the axis fitted to parts of the record: ``value`` and ``stderr`` (m,) around
    ``time`` (m,) [s], every other parameter and the findings as in the extended model."""

    name: str
    unit: str
    time: Array
    value: Array
    stderr: Array


@dataclass(frozen=True)
class Evidence:
    """What a sceptic looks at: ``residuals`` by place, and ``contributions`` of the findings.

    The findings that act along the motion come first, each with its Contribution; those of the
    record, such as lost samples, have none.
    """

    signals: Signals
    residuals: Mapping[str, Residual]
    contributions: tuple[Contribution, ...]
    shown: tuple[Shown, ...]
    whiteness: tuple[Autocorrelation, ...]
    tracks: tuple[Track, ...] = ()


@dataclass(frozen=True)
class Resemblance:
    """What an error of no name goes with: a ``form``, free in its details, at a ``location``, and
    the ``share`` it takes of the held-out error that the catalogue leaves beyond noise."""

    form: str
    location: str
    share: float


@dataclass(frozen=True)
class Diagnosis:
    """The answer for a record.

    ``base`` are the parameters of the axis without any effect and ``axis`` those of the extended
    ``model``, by name: I1, I2, B, K with two encoders, I and viscous with one. ``base_valid`` says
    whether the record determines them. ``findings`` are in the order in which they were named.
    ``unexplained`` means that something is left that no effect of the catalogue accounts for, which
    ``resembles`` a form where one does better than all of them.
    ``warnings`` of the intake and the fit, ``advice`` which experiment answers what this record
    cannot; one line each. ``window`` is the length of a simulation [s].
    """

    record: Record
    base: Mapping[str, Quantity]
    base_valid: bool
    axis: Mapping[str, Quantity]
    findings: tuple[Finding, ...]
    considered: tuple[Considered, ...]
    unexplained: bool
    error: ErrorSummary
    model: Model
    hold: Hold
    window: float
    evidence: Evidence = field(repr=False)
    warnings: tuple[str, ...] = ()
    advice: tuple[str, ...] = ()
    resembles: Resemblance | None = None

    @property
    def healthy(self) -> bool:
        """True when the base model says all there is to say."""
        return not self.findings and not self.unexplained

    def to_json(self, model_path: str | None = None) -> dict[str, object]:
        """The answer as the schema axistwin.diagnosis/1; numbers that are not finite become null.

        ``model_path`` is where the extended model was written, if it was.
        """
        record, linear = self.record, self.record.linear
        return {
            "schema": SCHEMA,
            "record": {
                "path": record.source,
                "samples": len(record),
                "rate_hz": 1.0 / record.time_step,
                "duration_s": record.duration,
                "channels": list(record.channels),
                "linear": linear,
                "warnings": list(dict.fromkeys((*record.warnings, *self.warnings))),
            },
            "hold": self.hold,
            "window_s": self.window,
            "base_model": {**_quantities(self.base), "valid": self.base_valid},
            "extended_axis": _quantities(self.axis),
            "findings": [_finding(finding, linear) for finding in self.findings],
            "considered": [
                {
                    "effect": one.effect,
                    "location": one.location,
                    "gain": _number(one.gain),
                    "verdict": one.verdict,
                }
                for one in self.considered
            ],
            "unexplained": self.unexplained,
            "resembles": None if self.resembles is None else asdict(self.resembles),
            "error": {
                "what": self.error.what,
                "unit": self.error.unit,
                "base": _number(self.error.base),
                "extended": _number(self.error.extended),
                "noise_floor": _number(self.error.noise_floor),
            },
            "advice": list(self.advice),
            "extended_model": model_path,
        }


def _quantities(quantities: Mapping[str, Quantity]) -> dict[str, object]:
    return {
        "params": {name: _number(item.value) for name, item in quantities.items()},
        "stderr": {name: _number(item.stderr) for name, item in quantities.items()},
        "unit": {name: item.unit for name, item in quantities.items()},
    }


def _finding(finding: Finding, linear: bool) -> dict[str, object]:
    return {
        "effect": finding.effect,
        "location": finding.location,
        "params": {name: _number(value) for name, value in finding.params.items()},
        "ci95": {name: [_number(end) for end in ends] for name, ends in finding.ci95.items()},
        "unit": {
            name: parameter_unit(finding.effect, finding.location, name, linear)
            for name in finding.params
        },
        "gain": _number(finding.gain),
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
