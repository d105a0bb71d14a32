"""Recursive estimators that forget, on an axis whose stiffness drifts.

The stiffness falls by a fifth and comes back, in steps of the plant's parameters. What an estimator
remembers limits it from two sides: much, and it lags behind; little, and noise is not averaged. Two
ways to forget are compared. Exponential forgetting forgets everything at the same rate; when the
excitation pauses it forgets what nothing renews, and what is left to learn from is noise.
Directional forgetting (axt_rls.h) forgets in each direction what the samples renew there: it keeps
all through a pause.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeAlias

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from axistwin import core
from axistwin.core import Array, IdentSettings, Motion, State
from axistwin.paper import equations
from axistwin.paper.equations import Equations
from axistwin.paper.measurement import measure, noise_level, read_encoders
from axistwin.paper.report import Report, Value
from axistwin.paper.settings import AXIS, RMS, B
from axistwin.paper.style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, panels

#: The second setting: 9.3 kHz, a period of 0.22 s.
SETTING = B
PERIODS = 60
SAMPLES = PERIODS * SETTING.N

#: The stiffness changes every so many samples; at most by this share of it.
HELD = 256
DEPTH = 0.2

#: Periods without excitation in the second record.
PAUSE = (27, 36)

NOISE_DB = 40.0
COUNTS = 2**20
_SEED = 4

#: Samples that the estimators remember, 1 / (1 - lambda).
MEMORIES = (256, 512, 1024, 2048, 4096, 8192, 16384)

#: That of the curves shown: a period.
SHOWN = SETTING.N

#: An estimate is taken every so many samples; those before the first periods are over do not count.
EVERY = 64
_ERROR_TICKS = (0.5, 1.0, 2.0, 5.0)  # of the figure [%]
_START_PERIODS = 4

Estimator: TypeAlias = Callable[..., Array]


@dataclass(frozen=True)
class Method:
    """An estimator over equations from speeds, or from the filter on encoders."""

    title: str
    estimate: Estimator
    encoders: bool
    colour: str


METHODS = (
    Method("RLS, exponential forgetting", equations.exponential, False, BLUE),
    Method("RLS, directional forgetting", equations.least_squares, False, RED),
    Method("ELS, directional forgetting", equations.extended, False, PURPLE),
    Method(
        "IV, exponential forgetting",
        partial(equations.instrumental, delay=SETTING.N),
        False,
        GREEN,
    ),
    Method("filter on encoders, RLS, exponential", equations.exponential, True, ORANGE),
)


@dataclass(frozen=True)
class Record:
    """Equations from speeds and from encoders, and the stiffness (n,) at each sample."""

    speeds: Equations
    encoders: Equations
    stiffness: Array


def run(report: Report) -> None:
    """Table and figure of what follows a drifting stiffness, and what survives a pause."""
    report.progress("estimators: a drifting stiffness, with and without a pause")
    drifting, paused = record(pause=False), record(pause=True)
    tracking = {
        method.title: np.array([_rms(_error(method, drifting, m)) for m in MEMORIES])
        for method in METHODS
    }
    values = [
        Value(title, f"memory {memory}", float(error), "%")
        for title, errors in tracking.items()
        for memory, error in zip(MEMORIES, errors, strict=True)
    ]
    for method in METHODS[:2]:
        worst = float(np.nanmax(np.abs(_error(method, paused, SHOWN))))
        values.append(Value(method.title, f"worst with a pause, memory {SHOWN}", worst, "%"))
    report.study("Tracking a drifting stiffness: error of K", values)
    _figure(report, drifting, paused, tracking)


def stiffness() -> Array:
    """The stiffness [N m/rad] at each sample (SAMPLES,)."""
    time = np.arange(SAMPLES) // HELD * HELD / SAMPLES
    result: Array = AXIS.K * (1.0 - 0.5 * DEPTH * (1.0 - np.cos(2.0 * np.pi * time)))
    return result


def drifting_motion(torque: Array, stiffness: Array) -> Motion:
    """Motion of the axis from rest under torque (n,), the plant set up anew every HELD samples."""
    motion = core.simulate(AXIS, SETTING.time_step, np.zeros_like(torque))
    state = State()
    for first in range(0, len(torque) - 1, HELD):
        part = slice(first, first + HELD + 1)
        axis = replace(AXIS, K=float(stiffness[first + 1]))
        steps = core.simulate(axis, SETTING.time_step, torque[part], state)
        motion.samples[part] = steps.samples
        last = (steps.twist, steps.twist_speed, steps.omega1, steps.theta1)
        state = State(*(float(channel[-1]) for channel in last))
    return motion


def record(*, pause: bool) -> Record:
    """The drifting axis as measured: with speeds and noise, and with encoders alone."""
    torque = SETTING.torque(PERIODS)
    level = noise_level(core.simulate(AXIS, SETTING.time_step, torque), torque, NOISE_DB)
    if pause:
        torque[PAUSE[0] * SETTING.N : PAUSE[1] * SETTING.N] = 0.0
    true = stiffness()
    motion = drifting_motion(torque, true)
    rng = np.random.default_rng(_SEED)
    settings = IdentSettings(SETTING.time_step, AXIS, RMS)
    per_turn = (COUNTS, COUNTS)
    return Record(
        equations.from_motion(settings, *measure(motion, torque, level, rng)),
        equations.from_counts(settings, read_encoders(motion, COUNTS, rng), per_turn, torque),
        true,
    )


def _estimates(method: Method, record: Record, memory: int) -> tuple[npt.NDArray[np.int64], Array]:
    """Samples (k,) and stiffness found there (k,) [N m/rad], nan where there was no answer."""
    given = record.encoders if method.encoders else record.speeds
    axes = method.estimate(given, forgetting=1.0 - 1.0 / memory, every=EVERY)
    ends = np.minimum(np.arange(1, len(axes) + 1) * EVERY, len(given.sample)) - 1
    return given.sample[ends], axes[:, 3]


def _error(method: Method, record: Record, memory: int) -> Array:
    """Error of K [%] of each estimate after the first periods."""
    samples, found = _estimates(method, record, memory)
    error: Array = 100.0 * (found / record.stiffness[samples] - 1.0)
    return error[samples >= _START_PERIODS * SETTING.N]


def _rms(error: Array) -> float:
    return float(np.sqrt(np.mean(error**2)))


def _figure(report: Report, drifting: Record, paused: Record, tracking: dict[str, Array]) -> None:
    figure, axes = panels(3, 1, height=2.7)
    figure.suptitle(
        f"A stiffness that drifts, {SETTING.title}, {NOISE_DB:.0f} dB; encoders 2^20 counts a turn"
    )
    data: dict[str, npt.ArrayLike] = {"memory [samples]": MEMORIES}
    title = f"memory {SHOWN} samples"
    _plot_stiffness(axes[0], drifting, "", METHODS, data)
    axes[0].set_title(title)
    _plot_stiffness(axes[1], paused, ", with a pause", METHODS[:2], data)
    axes[1].set_title(f"{title}, the excitation off in between")
    begin, end = (n * SETTING.N * SETTING.time_step for n in PAUSE)
    axes[1].axvspan(begin, end, color=GREY, alpha=0.2, lw=0.0)
    for method in METHODS:
        errors = tracking[method.title]
        data[f"{method.title}: rms error of K [%]"] = errors
        axes[2].loglog(MEMORIES, errors, "o-", ms=4.0, color=method.colour, label=method.title)
    axes[2].set_xlabel("memory 1 / (1 - lambda) [samples]")
    axes[2].set_ylabel("rms error of K [%]")
    axes[2].set_xticks(MEMORIES, [str(memory) for memory in MEMORIES])
    axes[2].set_yticks(_ERROR_TICKS, [f"{error:g}" for error in _ERROR_TICKS])
    axes[2].minorticks_off()
    figure.legend(handles=axes[0].lines, loc="outside lower center", ncols=3)
    report.figure("estimators", figure, data)


def _plot_stiffness(
    axes: Axes,
    record: Record,
    what: str,
    methods: tuple[Method, ...],
    data: dict[str, npt.ArrayLike],
) -> None:
    time = np.arange(SAMPLES) * SETTING.time_step
    axes.plot(time[::EVERY], record.stiffness[::EVERY], color="black", lw=1.6, label="true")
    data[f"time [s]{what}"] = time[::EVERY]
    data[f"K [N m/rad]{what}"] = record.stiffness[::EVERY]
    for method in methods:
        samples, found = _estimates(method, record, SHOWN)
        axes.plot(time[samples], found, color=method.colour, lw=0.9, label=method.title)
        data[f"time [s], {method.title}{what}"] = time[samples]
        data[f"K [N m/rad], {method.title}{what}"] = found
    axes.set_ylabel("K [N m/rad]")
    axes.set_xlabel("time [s]")
    axes.set_ylim((1.0 - 1.3 * DEPTH) * AXIS.K, (1.0 + 0.5 * DEPTH) * AXIS.K)
    axes.margins(x=0.0)
