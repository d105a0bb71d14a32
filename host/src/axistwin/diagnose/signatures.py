"""The signature of a finding: the residual without it, and its own curve through that cloud.

An effect shows against what it depends on: friction against speed, ripple against the angle within
a period, a delay against the rate of change. What grows with time shows as a strength that is told
anew in each part of the record, and what vibrates shows in the spectrum. All other findings stay
in the model, so that each has a cloud of its own.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import matplotlib
import numpy as np

from axistwin.core import Array
from axistwin.diagnose import drawing
from axistwin.diagnose.panels import CLOUD, CLOUD_AFTER, COLOURS, STYLE, Panel, axes
from axistwin.diagnose.result import Contribution, Diagnosis, Finding, Signals
from axistwin.identify.result import unit

#: Parts of a record in which the strength of something that changes is told.
_PARTS = 40

#: What the model lacks at a place, as an axis says it.
RESIDUAL = {
    "motor": "residual at the motor",
    "table": "residual at the table",
    "encoder1": "residual of the motor encoder",
    "encoder2": "residual of the table encoder",
}


def panels(diagnosis: Diagnosis, index: int) -> list[Panel]:
    """The panels of the finding with this index."""
    finding = diagnosis.findings[index]
    with matplotlib.rc_context(STYLE):
        return _SIGNATURES[finding.effect](_Case(diagnosis, finding, index))


@dataclass(frozen=True)
class _Case:
    """A finding with its evidence."""

    diagnosis: Diagnosis
    finding: Finding
    index: int

    @property
    def signals(self) -> Signals:
        return self.diagnosis.evidence.signals

    @property
    def linear(self) -> bool:
        return self.diagnosis.record.linear

    @property
    def own(self) -> Contribution:
        """What the finding adds."""
        return self.diagnosis.evidence.contributions[self.index]

    @property
    def left(self) -> Array:
        """The residual with all findings, (n,)."""
        return self.diagnosis.evidence.residuals[self.own.place].after

    @property
    def alone(self) -> Array:
        """The residual without this finding alone, (n,)."""
        return self.left + self.own.values

    @property
    def unit(self) -> str:
        """Of the residual."""
        return place_unit(self.own.place, self.linear)

    @property
    def at_table(self) -> bool:
        return self.finding.location in ("table", "encoder2")

    @property
    def angle(self) -> Array:
        """Of the inertia where the finding is, (n,)."""
        return _known(self.signals.theta2) if self.at_table else self.signals.theta1

    @property
    def speed(self) -> Array:
        """Likewise."""
        return _known(self.signals.omega2) if self.at_table else self.signals.omega1

    @property
    def inertia(self) -> str:
        return "table" if self.at_table else "motor"


def place_unit(place: str, linear: bool) -> str:
    """Unit of the residual at a place."""
    return unit("angle" if place.startswith("encoder") else "torque", linear)


# ---- Against what it depends on


@dataclass(frozen=True)
class _Abscissa:
    """What something is drawn against: values (n,)."""

    label: str
    unit: str
    values: Array


def _speed(case: _Case) -> _Abscissa:
    return _Abscissa(f"speed of the {case.inertia}", unit("speed", case.linear), case.speed)


def _twist(case: _Case) -> _Abscissa:
    return _scaled("twist of the shaft", unit("angle", case.linear), _known(case.signals.twist))


def _command(case: _Case) -> _Abscissa:
    return _scaled("torque command", unit("torque", case.linear), case.signals.torque)


def _time(case: _Case) -> _Abscissa:
    return _Abscissa("time", "s", case.signals.time)


def _angle(case: _Case) -> _Abscissa:
    turn = 1.0 if case.linear else 2.0 * np.pi
    what = "position" if case.linear else "angle"
    cycles = case.finding.params.get("periods", 1.0) * case.angle / turn
    return _Abscissa(f"{case.inertia} {what} within a period", "°", _degrees(cycles))


def _period(case: _Case) -> _Abscissa:
    cycles = case.finding.params["frequency"] * case.signals.time / (2.0 * np.pi)
    return _Abscissa("time within a period", "°", _degrees(cycles))


def _rate(case: _Case) -> _Abscissa:
    """What is late is off by its rate of change."""
    if case.finding.location != "torque":
        return _speed(case)
    rate = np.gradient(case.signals.torque) / case.diagnosis.record.time_step
    return _scaled("rate of the torque command", f"{unit('torque', case.linear)}/s", rate)


def _count(case: _Case) -> _Abscissa:
    turn = 1.0 if case.linear else 2.0 * np.pi
    cycles = case.finding.params["counts"] * case.angle / turn
    return _Abscissa(f"{case.inertia} angle within a count", "°", _degrees(cycles))


def _scaled(label: str, name: str, values: Array) -> _Abscissa:
    factor, prefixed = drawing.scale(values, name)
    return _Abscissa(label, prefixed, factor * values)


def _degrees(cycles: Array) -> Array:
    degrees: Array = 360.0 * np.remainder(cycles, 1.0)
    return degrees


def _known(values: Array | None) -> Array:
    """Of an effect that takes the second encoder to be found."""
    if values is None:
        raise ValueError("a finding at the table or the shaft without its encoder")
    return values


def _against(abscissa: Callable[[_Case], _Abscissa]) -> Callable[[_Case], list[Panel]]:
    """The cloud without the effect and its curve, and the cloud that is left with it."""

    def draw(case: _Case) -> list[Panel]:
        against = abscissa(case)
        factor, prefixed = drawing.scale(case.alone, case.unit)
        label = f"{RESIDUAL[case.own.place]} [{prefixed}]"
        shown = drawing.limits(factor * case.alone, factor * case.own.values)
        drawn = []
        for title, values, line, caption in (
            (
                "Without it in the model",
                case.alone,
                True,
                "Points: the residual, sample by sample, when this effect alone is left out. "
                "Dots: its mean, with twice the standard error. Line: what the effect adds.",
            ),
            (
                "With it in the model",
                case.left,
                False,
                "The same with the effect in the model, on the same scale.",
            ),
        ):
            figure, plot = axes(title, f"{against.label} [{against.unit}]", label)
            drawing.cloud(plot, against.values, factor * values, CLOUD if line else CLOUD_AFTER)
            drawing.means(plot, against.values, factor * values)
            if line:
                drawing.curve(plot, against.values, factor * case.own.values)
            plot.set_xlim(drawing.limits(against.values))
            plot.set_ylim(shown)
            drawn.append(Panel(figure, caption))
        return drawn

    return draw


# ---- As a strength that changes with time


def _growing(
    label: str, units: tuple[str, str], carrier: Callable[[_Case], Array]
) -> Callable[[_Case], list[Panel]]:
    """How much of the ``carrier`` there is in the residual, told anew in each part.

    ``units`` are those of a rotary and of a linear axis.
    """

    def draw(case: _Case) -> list[Panel]:
        carried = carrier(case)
        time, found, error, line = [], [], [], []
        for part in np.array_split(np.arange(len(carried)), _PARTS):
            size = float(carried[part] @ carried[part]) or np.inf
            strength = float(carried[part] @ case.alone[part]) / size
            rest = case.alone[part] - strength * carried[part]
            time.append(float(np.mean(case.signals.time[part])))
            found.append(strength)
            error.append(2.0 * drawing.rms(rest) / np.sqrt(size))
            line.append(float(carried[part] @ case.own.values[part]) / size)
        factor, prefixed = drawing.scale(np.array(found), units[case.linear])
        figure, plot = axes("Along the record", "time [s]", f"{label} [{prefixed}]", wide=True)
        drawing.points(plot, np.array(time), factor * np.array(found), factor * np.array(error))
        plot.plot(time, factor * np.array(line), color=COLOURS["curve"], lw=2.0)
        caption = (
            f"Dots: the {label} in the residual of each part of the record when this effect alone "
            "is left out, with twice its standard error. Line: what the effect adds."
        )
        return [Panel(figure, caption, wide=True)]

    return draw


def _against_motion(case: _Case) -> Array:
    return -np.sign(case.speed)


def _twisted(case: _Case) -> Array:
    """The shaft turns the table with the twist and the motor against it."""
    twist = _known(case.signals.twist)
    return twist if case.own.place == "table" else -twist


def _accelerated(case: _Case) -> Array:
    return -np.gradient(_known(case.signals.omega2)) / case.diagnosis.record.time_step


# ---- In the spectrum


def _in_frequency(case: _Case) -> list[Panel]:
    factor, prefixed = drawing.scale(case.alone, case.unit)
    figure, plot = axes(
        "In the spectrum",
        "frequency [Hz]",
        f"{RESIDUAL[case.own.place]} [{prefixed}/√Hz]",
        wide=True,
        height=3.2,
    )
    for colour, label, values in (
        ("before", "without it in the model", case.alone),
        ("after", "with it in the model", case.left),
        ("curve", "what it adds", case.own.values),
    ):
        frequency, density = drawing.spectrum(case.signals.time, factor * values)
        plot.semilogx(frequency, density, color=COLOURS[colour], lw=1.2, label=label)
    drawing.logarithmic(plot)
    drawing.legend(plot, 3)
    caption = "The residual without this effect alone, with it, and what it adds."
    return [Panel(figure, caption, wide=True)]


_SIGNATURES: Mapping[str, Callable[[_Case], list[Panel]]] = {
    "friction_coulomb": _against(_speed),
    "friction_viscous": _against(_speed),
    "friction_asymmetry": _against(_speed),
    "friction_stribeck": _against(_speed),
    "friction_drift": _growing("friction", ("N m", "N"), _against_motion),
    "torque_offset": _against(_time),
    "backlash": _against(_twist),
    "stiffness_hardening": _against(_twist),
    "stiffness_drift": _growing("stiffness", ("N m/rad", "N/m"), _twisted),
    "torque_ripple": _against(_angle),
    "lead_error": _against(_angle),
    "encoder_eccentricity": _against(_angle),
    "delay": _against(_rate),
    "torque_saturation": _against(_command),
    "load_change": _growing("inertia", ("kg m²", "kg"), _accelerated),
    "extra_mode": _in_frequency,
    "disturbance": _against(_period),
    "quantisation": _against(_count),
    "sample_loss": _against(_time),
}
