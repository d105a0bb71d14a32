"""Figures of a whole diagnosis: simulations, residuals, whiteness, parameters over time."""

from __future__ import annotations

from dataclasses import dataclass

import matplotlib
import numpy as np

from axistwin.core import Array
from axistwin.diagnose import drawing, words
from axistwin.diagnose.panels import CLOUD, CLOUD_AFTER, COLOURS, STYLE, Panel, axes
from axistwin.diagnose.result import Autocorrelation, Diagnosis, Shown, Track
from axistwin.diagnose.signatures import place_unit
from axistwin.identify.result import unit
from axistwin.identify.statistics import confidence_factor

_MODELS = {"before": "base model", "after": "extended model"}


def _models(diagnosis: Diagnosis) -> dict[str, str]:
    """The models that there are: without a finding, the base model is all."""
    return _MODELS if diagnosis.findings else {"before": _MODELS["before"]}


# ---- Measured and simulated


@dataclass(frozen=True)
class _Channel:
    """A channel in windows, with a name for people and its unit."""

    label: str
    unit: str
    shown: Shown
    models: dict[str, str]

    @property
    def simulated(self) -> dict[str, Array]:
        """Of each model, (w, l)."""
        both = {"before": self.shown.before, "after": self.shown.after}
        return {name: both[name] for name in self.models}

    @property
    def errors(self) -> dict[str, Array]:
        """Simulated less measured, (w, l), of each model."""
        return {name: values - self.shown.measured for name, values in self.simulated.items()}


def simulations(diagnosis: Diagnosis) -> list[Panel]:
    """Channels in the held-out window where the base model is worst, and the error in all."""
    with matplotlib.rc_context(STYLE):
        channels = _channels(diagnosis)
        worst = _worst(channels[-1])
        panels = []
        for channel in channels:
            panels += [_window(channel, worst), _window_error(channel, worst)]
        return [*panels, _along(channels[-1])]


def _channels(diagnosis: Diagnosis) -> list[_Channel]:
    """The motor angle, and with two encoders the twist, in which the shaft shows."""
    angle = unit("angle", diagnosis.record.linear)
    by_name = {shown.name: shown for shown in diagnosis.evidence.shown}
    motor, table = by_name["theta1"], by_name.get("theta2")
    what = "position" if diagnosis.record.linear else "angle"
    channels = [_Channel(f"motor {what}", angle, motor, _models(diagnosis))]
    if table is not None:
        twist = Shown(
            "twist",
            motor.time,
            motor.measured - table.measured,
            motor.before - table.before,
            motor.after - table.after,
            motor.held_out,
        )
        channels.append(_Channel("twist", angle, twist, _models(diagnosis)))
    return channels


def _worst(channel: _Channel) -> int:
    error = np.mean(channel.errors["before"] ** 2, axis=1)
    return int(np.argmax(np.where(channel.shown.held_out, error, -1.0)))


def _window(channel: _Channel, window: int) -> Panel:
    shown = channel.shown
    middle = float(np.mean(shown.measured[window]))
    factor, prefixed = drawing.scale(shown.measured[window] - middle, channel.unit)
    figure, plot = axes(
        f"{words.title(channel.label)}, measured and simulated",
        "time [s]",
        f"{channel.label} about its mean [{prefixed}]",
    )
    time = shown.time[window]

    def draw(values: Array, colour: str, label: str, width: float) -> None:
        line = factor * (values[window] - middle)
        plot.plot(time, line, color=COLOURS[colour], lw=width, label=label)

    draw(shown.measured, "measured", "measured", 3.4)
    for name, values in channel.simulated.items():
        draw(values, name, channel.models[name], 1.3)
    drawing.legend(plot, 3)
    return Panel(figure, "The window that no fit has seen in which the base model is worst.")


def _window_error(channel: _Channel, window: int) -> Panel:
    errors = {name: values[window] for name, values in channel.errors.items()}
    factor, prefixed = drawing.scale(errors["before"], channel.unit)
    figure, plot = axes(
        f"{words.title(channel.label)}, error in that window",
        "time [s]",
        f"simulated less measured [{prefixed}]",
    )
    for name, error in errors.items():
        time = channel.shown.time[window]
        plot.plot(time, factor * error, color=COLOURS[name], lw=1.0, label=_MODELS[name])
    drawing.legend(plot, 2)
    sizes = [
        f"{words.shown(drawing.rms(error), channel.unit).with_unit} with the {_MODELS[name]}"
        for name, error in errors.items()
    ]
    return Panel(figure, f"rms {words.listed(sizes)}.")


def _along(channel: _Channel) -> Panel:
    shown = channel.shown
    sizes = {name: np.sqrt(np.mean(error**2, axis=1)) for name, error in channel.errors.items()}
    factor, prefixed = drawing.scale(sizes["before"], channel.unit)
    figure, plot = axes(
        f"Error of the {channel.label}, window by window",
        "time [s]",
        f"rms [{prefixed}]",
        wide=True,
    )
    for name, size in sizes.items():
        for chosen, filled, label in (
            (~shown.held_out, "none", "fitted"),
            (shown.held_out, COLOURS[name], "not seen by any fit"),
        ):
            plot.plot(
                shown.time[chosen, 0],
                factor * size[chosen],
                "o",
                ms=3.6,
                color=COLOURS[name],
                mfc=filled,
                label=f"{_MODELS[name]}, {label}",
            )
    drawing.logarithmic(plot)
    drawing.legend(plot, 2)
    return Panel(
        figure,
        "If the windows that no fit has seen did worse than the others, noise would have been "
        "fitted.",
        wide=True,
    )


# ---- Residual torque


def residuals(diagnosis: Diagnosis, place: str) -> list[Panel]:
    """The residual at a place before and after, against all that an effect may depend on."""
    signals = diagnosis.evidence.signals
    residual = diagnosis.evidence.residuals[place]
    linear = diagnosis.record.linear
    factor, prefixed = drawing.scale(residual.before, place_unit(place, linear))
    before, after = factor * residual.before, factor * residual.after
    shown = drawing.limits(before)
    label = f"residual [{prefixed}]"
    with matplotlib.rc_context(STYLE):
        panels = []
        for name, x in _abscissae(diagnosis, place):
            figure, plot = axes(f"Against {name.partition(' [')[0]}", name, label)
            drawing.cloud(plot, x, before, CLOUD)
            if diagnosis.findings:
                drawing.cloud(plot, x, after, CLOUD_AFTER)
            plot.set_xlim(drawing.limits(x))
            plot.set_ylim(shown)
            panels.append(Panel(figure, ""))
        figure, plot = axes("Against frequency", "frequency [Hz]", f"residual [{prefixed}/√Hz]")
        for key in _models(diagnosis):
            frequency, density = drawing.spectrum(
                signals.time, {"before": before, "after": after}[key]
            )
            plot.semilogx(frequency, density, color=COLOURS[key], lw=1.1)
        drawing.logarithmic(plot)
        return [*panels, Panel(figure, "")]


def _abscissae(diagnosis: Diagnosis, place: str) -> list[tuple[str, Array]]:
    signals, linear = diagnosis.evidence.signals, diagnosis.record.linear
    table = place in ("table", "encoder2")
    name = "table" if table else "motor"
    speed = signals.omega2 if table else signals.omega1
    angle = signals.theta2 if table else signals.theta1
    found = []
    if speed is not None:
        found.append((f"speed of the {name} [{unit('speed', linear)}]", speed))
    if angle is not None and linear:
        found.append((f"position of the {name} [m]", angle))
    elif angle is not None:
        turns = angle / (2.0 * np.pi)
        within = np.ptp(turns) > 1.0
        what = f"angle of the {name} within a turn" if within else f"angle of the {name}"
        degrees = 360.0 * (np.remainder(turns, 1.0) if within else turns)
        found.append((f"{what} [°]", degrees))
    if signals.twist is not None:
        factor, prefixed = drawing.scale(signals.twist, unit("angle", linear))
        found.append((f"twist of the shaft [{prefixed}]", factor * signals.twist))
    factor, prefixed = drawing.scale(signals.torque, unit("torque", linear))
    found.append((f"torque command [{prefixed}]", factor * signals.torque))
    found.append(("time [s]", signals.time))
    return found


# ---- Is it noise, and does it stay


def whiteness(diagnosis: Diagnosis) -> list[Panel]:
    """Autocorrelation of the error of each channel, before and after."""
    with matplotlib.rc_context(STYLE):
        return [
            _autocorrelation(channel, _models(diagnosis))
            for channel in diagnosis.evidence.whiteness
        ]


def _autocorrelation(channel: Autocorrelation, models: dict[str, str]) -> Panel:
    figure, plot = axes(f"Error of {channel.name}", "lag [ms]", "autocorrelation")
    lag = 1e3 * channel.lag
    plot.axhspan(-channel.band, channel.band, color=COLOURS["band"], lw=0.0)
    for name, label in models.items():
        values = {"before": channel.before, "after": channel.after}[name]
        plot.plot(lag, values, color=COLOURS[name], label=label)
    drawing.legend(plot, 2)
    return Panel(figure, "Of white noise, 95 % of the points lie in the band.")


def tracks(diagnosis: Diagnosis) -> list[Panel]:
    """Each parameter of the axis, fitted to parts of the record."""
    with matplotlib.rc_context(STYLE):
        return [_track(diagnosis, track) for track in diagnosis.evidence.tracks]


def _track(diagnosis: Diagnosis, track: Track) -> Panel:
    whole = diagnosis.axis[track.name]
    reference = whole.value or 1.0
    figure, plot = axes(
        f"{track.name} along the record", "time [s]", "off the value for the whole [%]"
    )
    low, high = (100.0 * (end / reference - 1.0) for end in whole.ci95)
    plot.axhspan(low, high, color=COLOURS["band"], lw=0.0)
    plot.axhline(0.0, color=COLOURS["after"], lw=1.0)
    drawing.points(
        plot,
        track.time,
        100.0 * (track.value / reference - 1.0),
        100.0 * confidence_factor(len(track.time)) * track.stderr / abs(reference),
    )
    value = words.quantity(whole).with_unit
    return Panel(figure, f"Bars and band: 95 % intervals of a part and of the whole, {value}.")
