"""Figures 4 and 9 to 12 of the paper, the map over N and k, and the family of excitations."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from axistwin import core
from axistwin.core import Array, IdentSettings
from axistwin.paper import eq9, printed
from axistwin.paper.measurement import measure, noise_level
from axistwin.paper.report import Report, Value
from axistwin.paper.settings import AXIS, MODAL, NAMES, RMS, SETTINGS, Setting, errors
from axistwin.paper.style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, panels

SYMBOLS = {"I1": "$I_1$", "I2": "$I_2$", "B": "$B$", "K": "$K$"}
UNITS = {"I1": "kg m²", "I2": "kg m²", "B": "N m s/rad", "K": "N m/rad"}

#: The paper's figures of recursive estimates.
RECURSIVE = {9: "K", 10: "B", 11: "I2", 12: "I1"}

#: Noise in the figures of recursive estimates [dB below the signal's rms].
NOISE_DB = 60.0

MAP_SAMPLES = (128, 256, 512, 1024, 2048, 4096)
MAP_STEPS = np.geomspace(0.012, 1.5, 15)

FAMILY_LINES = (2, 3, 4, 5, 6, 8, 10, 14, 20, 30, 50, 80)
FAMILY_DRAWS = 60

_P0 = 1e13

#: Samples before which nothing has been learned that could be drawn.
_FIRST = 10


def run(report: Report) -> None:
    """All of them."""
    _schroeder(report)
    _recursive(report)
    report.progress("figures: map over N and k")
    _map(report)
    report.progress("figures: family of excitations")
    _family(report)


def _schroeder(report: Report) -> None:
    figure, axes = panels(2, 2, height=2.3)
    figure.suptitle("Figure 4: Schroeder's signal, 2k lines from the first harmonic, 0.2 N m rms")
    data: dict[str, npt.ArrayLike] = {}
    values = []
    for setting, time_axes, spectrum_axes in zip(SETTINGS, axes[0:2], axes[2:4], strict=True):
        torque = setting.torque()
        time = np.arange(setting.N) * setting.time_step * 1e3
        crest = float(np.max(np.abs(torque)) / np.sqrt(np.mean(torque**2)))
        amplitude = 2.0 * np.abs(np.fft.rfft(torque)) / setting.N * 1e3
        frequency = np.fft.rfftfreq(setting.N, setting.time_step)
        shown = frequency <= 3.0 * MODAL.wn / (2.0 * np.pi)
        time_axes.plot(time, torque, color=BLUE, lw=0.9)
        time_axes.set(title=f"{setting.title}: crest factor {crest:.2f}", xlabel="time [ms]")
        spectrum_axes.vlines(frequency[shown], 0.0, amplitude[shown], color=BLUE, lw=1.0)
        spectrum_axes.axvline(MODAL.wn / (2.0 * np.pi), color=RED, ls="--", lw=1.0)
        spectrum_axes.set(xlabel="frequency [Hz]", ylim=(0.0, 1.25 * amplitude.max()))
        spectrum_axes.text(
            MODAL.wn / (2.0 * np.pi), 1.12 * amplitude.max(), "  resonance", color=RED, fontsize=8
        )
        values.append(Value("crest factor", setting.title, crest))
        data |= {
            f"time, {setting.title} [ms]": time,
            f"torque, {setting.title} [N m]": torque,
            f"frequency, {setting.title} [Hz]": frequency,
            f"amplitude, {setting.title} [mN m]": amplitude,
        }
    axes[0].set_ylabel("torque [N m]")
    axes[2].set_ylabel("amplitude [mN m]")
    report.figure("figure-04-schroeder", figure, data)
    report.study("Schroeder's signal", values)


@dataclass(frozen=True)
class _Course:
    """Estimates over the samples (n,): Eqs. 14-16 on Eq. 9 (n, 4), and bias-free with errors."""

    sample: Array
    paper: Array
    ours: Array
    ours_error: Array


def _course(setting: Setting) -> _Course:
    h = setting.time_step
    torque = setting.torque()
    motion = core.simulate(AXIS, h, torque)
    phi = eq9.recursive(eq9.rows(motion, torque), _P0, every=1)[_FIRST - 1 :]
    paper = np.array([astuple(eq9.read(entries, h)) for entries in phi])
    level = noise_level(motion, torque, NOISE_DB)
    measured, measured_torque = measure(motion, torque, level, np.random.default_rng(9))
    found = core.identify_motion(IdentSettings(h, AXIS, RMS), measured, measured_torque, every=1)
    return _Course(
        found.sample[_FIRST:].astype(np.float64),
        paper,
        found.axis[_FIRST:],
        found.axis_error[_FIRST:],
    )


def _recursive(report: Report) -> None:
    courses = {setting: _course(setting) for setting in SETTINGS}
    for number, name in RECURSIVE.items():
        column = NAMES.index(name)
        true = astuple(AXIS)[column]
        figure, axes = panels(1, 2, height=3.0)
        figure.suptitle(f"Figure {number}: recursive estimation of {SYMBOLS[name]} [{UNITS[name]}]")
        data: dict[str, npt.ArrayLike] = {}
        for setting, panel in zip(SETTINGS, axes, strict=True):
            course = courses[setting]
            half = 1.96 * course.ours_error[:, column]
            known = course.ours[:, column] > 0.0
            low, high = course.ours[:, column] - half, course.ours[:, column] + half
            sample = course.sample
            panel.plot(sample, course.paper[:, column], color=RED, label="Eqs. 9, 14-16, no noise")
            panel.fill_between(sample[known], low[known], high[known], color=SKY, alpha=0.5, lw=0.0)
            panel.plot(
                sample[known],
                course.ours[known, column],
                color=BLUE,
                label=f"bias-free, {NOISE_DB:.0f} dB noise, 95 %",
            )
            panel.axhline(true, color=GREY, ls="--", lw=1.0, label="true")
            end = course.paper[-1, column]
            reach = max(abs(end - true), 0.25 * true)
            panel.set(title=setting.title, xlabel="sample", xlim=(0, setting.N))
            panel.set_ylim(min(true, end) - 0.6 * reach, max(true, end) + 1.1 * reach)
            panel.xaxis.set_major_locator(MaxNLocator(5))
            key = setting.title
            data |= {
                f"sample, {key}": sample,
                f"{name} by Eqs. 9 and 14-16, {key} [{UNITS[name]}]": course.paper[:, column],
                f"{name} bias-free, {key} [{UNITS[name]}]": course.ours[:, column],
                f"{name} 95 % low, {key} [{UNITS[name]}]": low,
                f"{name} 95 % high, {key} [{UNITS[name]}]": high,
            }
        axes[0].set_ylabel(f"{SYMBOLS[name]} [{UNITS[name]}]")
        axes[1].legend(loc="upper right")
        report.figure(f"figure-{number:02d}-recursive-{name}", figure, data)


def _map(report: Report) -> None:
    """Error of each parameter by Eq. 9 over x = wn Dt = 2 pi k / N, for many N and k."""
    settings = [Setting("", N, k) for N in MAP_SAMPLES for k in _map_lines(N)]
    biased, free = (np.array(rows) for rows in zip(*map(_map_errors, settings), strict=True))
    N, x = np.array([s.N for s in settings]), np.array([s.x for s in settings])
    figure, axes = panels(2, 2, height=2.7, sharex=True)
    figure.suptitle("Error of Eq. 9 over the step, Schroeder's signal with 2k lines")
    for i, (name, panel) in enumerate(zip(NAMES, axes, strict=True)):
        _map_panel(panel, name, N, x, np.abs(biased[:, i]))
    for panel in axes[2:]:
        panel.set_xlabel("$x = \\omega_n \\Delta t = 2 \\pi k / N$")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=7)
    data: dict[str, npt.ArrayLike] = {"N": N, "k": [s.k for s in settings], "x": x}
    data |= {f"{name} by Eq. 9 [%]": biased[:, i] for i, name in enumerate(NAMES)}
    data |= {f"{name} bias-free [%]": free[:, i] for i, name in enumerate(NAMES)}
    report.figure("map-over-N-and-k", figure, data)
    closed = 100.0 * (1.0 - 1.0 / (1.0 + MODAL.zeta * x + x**2 / 4.0))
    report.study(
        "Map over N and k",
        [
            Value("points", "all", float(len(settings))),
            Value(
                "K by Eq. 9: farthest from the closed form, relative",
                "all",
                float(np.max(np.abs(-biased[:, 3] / closed - 1.0))),
            ),
            Value("bias-free: worst error", "all", float(np.max(np.abs(free))), "%"),
        ],
    )


def _map_lines(N: int) -> list[int]:
    """Values of k for which 2k lines fit into N samples, evenly over x."""
    lines = {round(x * N / (2.0 * np.pi)) for x in MAP_STEPS}
    return sorted(k for k in lines if 2 <= k < N / 4)


def _map_errors(setting: Setting) -> tuple[Array, Array]:
    """Errors (4,) by Eq. 9 and by the bias-free form [%]."""
    h, torque = setting.time_step, setting.torque()
    motion = core.simulate(AXIS, h, torque)
    free = core.identify_motion(IdentSettings(h, AXIS, RMS), motion, torque).last.axis
    return errors(eq9.identify(setting, torque)), errors(free)


def _map_panel(panel: Axes, name: str, N: npt.NDArray[np.int64], x: Array, biased: Array) -> None:
    colours = (SKY, BLUE, GREEN, ORANGE, RED, PURPLE)
    for samples, colour in zip(MAP_SAMPLES, colours, strict=True):
        here = samples == N
        panel.loglog(x[here], biased[here], "o", ms=3.5, color=colour, label=f"N = {samples}")
    curve = np.geomspace(x.min(), x.max(), 100)
    D = 1.0 + MODAL.zeta * curve + curve**2 / 4.0
    closed = {
        "K": (1.0 - 1.0 / D, "$1 - 1/D$"),
        "B": ((1.0 + curve / (4.0 * MODAL.zeta)) / D - 1.0, "$(1 + x / 4 \\zeta) / D - 1$"),
    }
    if name in closed:
        values, label = closed[name]
        (line,) = panel.loglog(curve, 100.0 * values, color="k", lw=0.9)
        panel.legend([line], [label], loc="lower right")
    for number, setting in enumerate(SETTINGS):
        text = dict(printed.TABLE_3)[name][1 + 2 * number]
        label = "the paper's Table 3" if number == 0 else "_"
        panel.loglog(setting.x, float(text), "*", ms=10, mfc="none", color="k", label=label)
    panel.set(title=SYMBOLS[name], ylabel="|error| [%]")


def _family(report: Report) -> None:
    """Errors by Eq. 9 for multisines of random lines, over their number, and the paper's."""
    figure, axes = panels(2, 3, height=2.7)
    figure.suptitle("Errors of Eq. 9: the lowest L harmonics, amplitudes and phases random")
    data: dict[str, list[float]] = {}
    rng = np.random.default_rng(7)
    values = []
    for row, setting in enumerate(SETTINGS):
        lines, found = _draw_family(setting, rng)
        fitted = errors(eq9.identify(setting, eq9.fitted_torque(setting)))
        fitted_lines = len(eq9.FITTED_LINES[setting.key])
        for name, panel in zip(("I1", "I2", "B"), axes[3 * row : 3 * row + 3], strict=True):
            column = NAMES.index(name)
            _family_panel(panel, setting, name, lines, found[:, column])
            panel.plot(fitted_lines, fitted[column], "*", ms=10, color=RED, label="the fitted one")
            below = float(np.mean(found[:, column] < _printed_error(setting, name)))
            values.append(Value(f"{name}: share below the paper's", setting.title, below))
        data[f"lines, {setting.title}"] = lines.tolist()
        for column, name in enumerate(NAMES):
            data[f"{name}, {setting.title} [%]"] = found[:, column].tolist()
            for end, value in (
                ("least", found[:, column].min()),
                ("most", found[:, column].max()),
            ):
                values.append(Value(f"{name}: {end}", setting.title, float(value), "%"))
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=3)
    report.figure("family-of-excitations", figure, data)
    report.study("Family of excitations", values)


def _draw_family(setting: Setting, rng: np.random.Generator) -> tuple[Array, Array]:
    lines, found = [], []
    for count in FAMILY_LINES:
        for _ in range(FAMILY_DRAWS):
            torque = eq9.multisine(setting.N, rng.standard_normal((count, 2)))
            lines.append(count)
            found.append(errors(eq9.identify(setting, torque)))
    return np.array(lines, np.float64), np.array(found)


def _printed_error(setting: Setting, name: str) -> float:
    """The paper's error [%] with its sign, which its estimate shows."""
    pair = dict(printed.TABLE_3)[name][2 * SETTINGS.index(setting) :][:2]
    real = dict(zip(NAMES, astuple(AXIS), strict=True))[name]
    return float(np.copysign(float(pair[1]), float(pair[0]) - real))


def _family_panel(panel: Axes, setting: Setting, name: str, lines: Array, found: Array) -> None:
    panel.plot(lines, found, ".", ms=3, color=BLUE, alpha=0.4, label="a signal")
    paper = _printed_error(setting, name)
    panel.axhline(paper, color=RED, ls="--", lw=1.0, label="the paper's Table 3")
    panel.set_xscale("log")
    panel.set_yscale("symlog", linthresh={"I1": 0.1, "I2": 1e-7, "B": 10.0}[name])
    panel.set(title=f"{SYMBOLS[name]}, {setting.title}", xlabel="lines L", ylabel="error [%]")
    panel.set_xticks([2, 5, 10, 20, 50], ["2", "5", "10", "20", "50"])
    panel.minorticks_off()
