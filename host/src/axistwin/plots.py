"""Pictures of an identification, as PNG files; no display is needed."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from axistwin.core import Array
from axistwin.errors import FileError
from axistwin.identify.result import AXIS, RIGID, Comparison, Convergence, Identification
from axistwin.identify.statistics import confidence_factor
from axistwin.output import atomic_write

_MEASURED = "#1f4e79"
_SIMULATED = "#d1701f"
_REFERENCE = "#444444"
_DPI = 130

#: Samples of a channel in the close-up: enough to see shapes, few enough to see both curves.
_CLOSE_UP = 300

#: Share of a convergence curve, from its end, whose band sets the scale.
_SCALED_BY = 0.8

_NAMES = {
    "I1": "Motor inertia I1",
    "I2": "Table inertia I2",
    "B": "Damping B",
    "K": "Stiffness K",
}

_PREFIXES = ((1.0, ""), (1e3, "m"), (1e6, "µ"), (1e9, "n"))


def save_all(
    result: Identification, folder: str | Path, truth: Mapping[str, float] | None = None
) -> list[Path]:
    """Write every picture that this result has into a folder, made if need be.

    ``truth`` are known values by name. Returns the paths. Raises FileError.
    """
    target = Path(folder)
    try:
        target.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise FileError(f"cannot make the folder {target}: {error.strerror or error}") from error
    figures = {"measured_simulated": measured_and_simulated(result)}
    if result.convergence:
        figures["convergence"] = convergence(result, truth or {})
    return [_save(figure, target / f"{name}.png") for name, figure in figures.items()]


def measured_and_simulated(result: Identification) -> Figure:
    """Twist and motor angle (the torque of a rigid axis), measured and simulated: a close-up, and
    the error over the whole record."""
    shown = result.comparisons if result.model == RIGID else result.comparisons[:2]
    figure = Figure(figsize=(4.0 + 4.5 * len(shown), 6.4), layout="constrained")
    rows = figure.subplots(2, len(shown), squeeze=False, height_ratios=[3, 2])
    for column, channel in enumerate(shown):
        _draw_close_up(rows[0, column], channel)
        _draw_error(rows[1, column], channel)
    figure.suptitle(f"{Path(result.record.source).name}: measured and simulated")
    return figure


def convergence(result: Identification, truth: Mapping[str, float]) -> Figure:
    """Recursive estimates of I1, I2, B, K over time with their 95 % bands, as a drive has them.

    They are drawn as deviation from the known value, from the final estimate where it is unknown.
    """
    curve = result.convergence[-1]
    figure = Figure(figsize=(10.0, 6.8), layout="constrained")
    rows = figure.subplots(2, 2, sharex=True)
    for index, (axes, name) in enumerate(zip(rows.flat, AXIS, strict=True)):
        final = result.estimate.params[name]
        reference = truth.get(name, final.value)
        _draw_curve(axes, curve, index, reference)
        axes.set_title(f"{_NAMES[name]}, {reference:.6g} {final.unit}")
    for axes in rows[1]:
        axes.set_xlabel("time [s]")
    what = "real value" if truth else f"estimate by {result.estimate.method}"
    figure.supylabel(f"deviation from the {what} [%]")
    handles, labels = rows[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.suptitle(f"{Path(result.record.source).name}: convergence of the {curve.method}")
    return figure


def _draw_close_up(axes: Axes, channel: Comparison) -> None:
    middle = len(channel.time) // 2
    part = slice(max(0, middle - _CLOSE_UP // 2), middle + _CLOSE_UP // 2)
    time, measured, simulated = (
        values[part] for values in (channel.time, channel.measured, channel.simulated)
    )
    scale, unit = _scale(measured, channel.unit)
    axes.plot(time, scale * measured, color=_MEASURED, lw=3.0, alpha=0.5, label="measured")
    axes.plot(time, scale * simulated, color=_SIMULATED, lw=1.1, label="simulated")
    axes.set_title(f"{channel.name.capitalize()}, {len(time)} of {len(channel.time)} samples")
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"{channel.name} [{unit}]")
    axes.margins(x=0, y=0.2)
    axes.legend(loc="upper right", frameon=False, ncols=2)


def _draw_error(axes: Axes, channel: Comparison) -> None:
    if channel.resolution:
        scale, unit = 1.0 / channel.resolution, "counts"
    else:
        scale, unit = _scale(channel.residual, channel.unit)
    axes.plot(channel.time, scale * channel.residual, color=_SIMULATED, lw=0.6)
    axes.axhline(0.0, color=_REFERENCE, lw=0.8)
    axes.set_title(f"Error over the whole record, {scale * channel.rms:.3g} {unit} rms")
    axes.set_xlabel("time [s]")
    axes.set_ylabel(f"simulated - measured [{unit}]")
    axes.margins(x=0)


def _draw_curve(axes: Axes, curve: Convergence, index: int, reference: float) -> None:
    known = np.isfinite(curve.values[:, index])
    time = curve.time[known]
    percent = 100.0 / reference
    deviation = percent * (curve.values[known, index] - reference)
    half = abs(percent) * confidence_factor(len(time)) * curve.stderr[known, index]
    low, high = deviation - half, deviation + half
    axes.fill_between(time, low, high, color=_SIMULATED, alpha=0.25, lw=0, label="95 % band")
    axes.plot(time, deviation, color=_SIMULATED, lw=1.3, label="estimate")
    axes.axhline(0.0, color=_REFERENCE, ls="--", lw=1.0)
    late = slice(int((1.0 - _SCALED_BY) * len(time)), None)
    limit = 1.1 * float(np.max(np.abs(deviation[late]) + half[late], initial=0.0))
    if limit > 0.0:
        axes.set_ylim(-limit, limit)
    axes.margins(x=0)


def _scale(values: Array, unit: str) -> tuple[float, str]:
    """Factor and unit with the prefix in which the largest value is 1 or more."""
    largest = float(np.max(np.abs(values)))
    for factor, prefix in _PREFIXES:
        if factor * largest >= 1.0:
            return factor, prefix + unit
    return 1.0, unit


def _save(figure: Figure, path: Path) -> Path:
    with atomic_write(path) as partial:
        figure.savefig(partial, dpi=_DPI)
    return path
