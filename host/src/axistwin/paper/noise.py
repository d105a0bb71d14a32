"""What noise does to each estimator, over many records, against the least that is possible.

Records of 10,240 samples from rest under Schroeder's signal, measured in five ways: with white
noise at 60, 40 and 20 dB on torque, angles and speeds, and by encoders of 2^20 and 10^4 counts a
turn with the torque as commanded and nothing else. No estimator is told anything of the axis but a
guess that is off by a factor of two, and that the excitation is periodic. Where only encoders are
there, estimators that take speeds get them by central differences.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from axistwin import core
from axistwin.core import Array, Axis, IdentSettings, Motion, State
from axistwin.errors import NotEnoughDataError
from axistwin.identify import output_error
from axistwin.identify.samples import Samples
from axistwin.paper import eq9, equations, spectral
from axistwin.paper.bound import cramer_rao
from axistwin.paper.equations import Equations
from axistwin.paper.measurement import (
    NoiseLevel,
    central_differences,
    measure,
    noise_level,
    quantisation,
    read_encoders,
)
from axistwin.paper.report import Report, Value
from axistwin.paper.settings import AXIS, NAMES, RMS, SETTINGS, Setting, errors
from axistwin.paper.style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, SKY, panels

SAMPLES = 10240
RUNS = 100
_SEED = 5

_TURN = 2.0 * np.pi

#: What the C estimators are told of the axis, off by a factor of two: it scales their regressors
#: and puts the corner of the filter, at first at half the natural frequency.
EXPECTED = Axis(I1=5.0e-5, I2=1.6e-5, B=1.0e-3, K=60.0)

#: The finest encoders that the core takes stand for angles with noise.
_FINEST = 2**24


@dataclass(frozen=True)
class Record:
    """What is known of one run of the axis.

    ``channels`` (n, 2 or 4) are theta1, theta2 [rad] and, when measured, omega1, omega2 [rad/s];
    ``torque`` (n,) [N m]. ``motion`` and ``motion_torque`` are the samples that have speeds,
    measured or by central differences; ``counts`` (n, 2) are those of the encoders.
    """

    setting: Setting
    torque: Array
    channels: Array
    motion: Motion
    motion_torque: Array
    counts: npt.NDArray[np.int32]
    counts_per_turn: int

    @property
    def rounding(self) -> float:
        """A step of the angles [rad]; none that matters where they carry noise."""
        return _TURN / self.counts_per_turn

    @property
    def settings(self) -> IdentSettings:
        """Settings of the C estimators."""
        return IdentSettings(self.setting.time_step, EXPECTED, RMS)

    @cached_property
    def equations(self) -> Equations:
        """Equations from the samples that have speeds."""
        return equations.from_motion(self.settings, self.motion, self.motion_torque)

    @cached_property
    def average(self) -> spectral.Average:
        """The average period at the excited lines."""
        setting = self.setting
        lines = np.arange(1, 2 * setting.k + 1)
        return spectral.average(
            setting.time_step, setting.N, lines, self.torque, self.channels, self.rounding
        )

    @cached_property
    def rough(self) -> Axis:
        """Least squares on the average period."""
        return spectral.rough(self.average)

    def average_samples(self) -> Samples:
        """The average period, sample by sample."""
        N = self.setting.N
        columns = np.column_stack([self.torque, self.channels])
        torque, theta1, theta2, *speeds = columns.reshape(-1, N, columns.shape[1]).mean(axis=0).T
        omega1, omega2 = speeds or (None, None)
        return Samples(
            time_step=self.setting.time_step,
            torque=torque,
            theta1=theta1,
            theta2=theta2,
            omega1=omega1,
            omega2=omega2,
            resolution=(self.rounding, self.rounding),
            linear=False,
        )


@dataclass(frozen=True)
class Case:
    """A way to measure: noise at so many ``decibels`` on everything, or encoders alone.

    Started from rest, the axis comes to drift, and every period is rounded differently. Without
    ``drift`` it is started such that it does not: rounding repeats and averaging is of no help.
    """

    title: str
    decibels: float | None = None
    counts_per_turn: int = _FINEST
    drift: bool = True

    def motion(self, setting: Setting, torque: Array) -> Motion:
        """The motion (n,) under a torque (n,) of whole periods."""
        motion = core.simulate(AXIS, setting.time_step, torque)
        if self.drift:
            return motion
        travel = float(motion.theta1[-1] - motion.theta1[-1 - setting.N])
        against = State(speed=-travel / (setting.N * setting.time_step))
        return core.simulate(AXIS, setting.time_step, torque, against)

    def level(self, motion: Motion, torque: Array) -> NoiseLevel:
        """The noise; of encoders, white noise of the power that their rounding has."""
        if self.decibels is None:
            return quantisation(self.counts_per_turn)
        return noise_level(motion, torque, self.decibels)

    def record(
        self, setting: Setting, motion: Motion, torque: Array, rng: np.random.Generator
    ) -> Record:
        """One record of a motion (n,) under torque (n,) [N m]."""
        if self.decibels is None:
            counts = read_encoders(motion, self.counts_per_turn, rng)
            speeds = central_differences(counts, self.counts_per_turn, setting.time_step)
            channels = counts.astype(np.float64) * (_TURN / self.counts_per_turn)
            known = (speeds, torque[1:-1])
        else:
            motion, torque = measure(motion, torque, self.level(motion, torque), rng)
            counts = read_encoders(motion, self.counts_per_turn, rng)
            states = [motion.theta1, motion.theta2, motion.omega1, motion.omega2]
            channels, known = np.column_stack(states), (motion, torque)
        return Record(setting, torque, channels, *known, counts, self.counts_per_turn)


CASES = (
    Case("60 dB", 60.0),
    Case("40 dB", 40.0),
    Case("20 dB", 20.0),
    Case("2^20 counts", counts_per_turn=2**20),
    Case("10^4 counts", counts_per_turn=10**4),
    Case("10^4 counts, no drift", counts_per_turn=10**4, drift=False),
)


@dataclass(frozen=True)
class Estimator:
    """``estimate`` gives the axis, or raises NotEnoughDataError.

    The simulation-error fit takes a second where the others take milliseconds: it is given records
    of encoders alone (``encoders_only``), which it is for.
    """

    title: str
    estimate: Callable[[Record], Axis]
    colour: str
    marker: str
    encoders_only: bool = False


def _axis(found: Array) -> Axis:
    """The last of found axes (k, 4). Raises NotEnoughDataError when it is none."""
    if np.isnan(found[-1, 0]):
        raise NotEnoughDataError("what was found is no axis")
    return Axis(*found[-1].tolist())


def _paper(record: Record) -> Axis:
    rows = eq9.rows(record.motion, record.motion_torque)
    return eq9.read(eq9.least_squares(rows), record.setting.time_step)


def _filtered(record: Record) -> Axis:
    """Twice: the second time with the filter's corner at the natural frequency just found."""
    axis = EXPECTED
    for _ in range(2):
        settings = replace(record.settings, expected=axis)
        per_turn = (record.counts_per_turn, record.counts_per_turn)
        given = equations.from_counts(settings, record.counts, per_turn, record.torque)
        axis = _axis(equations.least_squares(given))
    return axis


ESTIMATORS = (
    Estimator("Eq. 9, LS", _paper, GREY, "x"),
    Estimator("midpoint, RLS", lambda r: _axis(equations.least_squares(r.equations)), RED, "o"),
    Estimator("midpoint, ELS", lambda r: _axis(equations.extended(r.equations)), PURPLE, "v"),
    Estimator(
        "midpoint, IV",
        lambda r: _axis(equations.instrumental(r.equations, r.setting.N)),
        ORANGE,
        "^",
    ),
    Estimator("filter, RLS", _filtered, GREEN, "s"),
    Estimator("periods, LS", lambda r: r.rough, SKY, "D"),
    Estimator(
        "periods, simulation error",
        lambda r: output_error.fit(r.average_samples(), r.rough).axis,
        "black",
        "+",
        encoders_only=True,
    ),
    Estimator(
        "periods, maximum likelihood",
        lambda r: spectral.maximum_likelihood(r.average, r.rough).axis,
        BLUE,
        "*",
    ),
)


#: Goals for the worst rms error over both settings [%]: of I1, I2 and K, and of B.
GOALS = {
    "60 dB": (0.01, 0.1),
    "40 dB": (0.1, 1.0),
    "20 dB": (1.0, 6.0),
    "2^20 counts": (0.05, 0.3),
    "10^4 counts": (3.0, 3.0),
    "10^4 counts, no drift": (3.0, 3.0),
}


@dataclass(frozen=True)
class Result:
    """``found`` are errors of I1, I2, B, K (records, 4) [%] by estimator, nan where there is no
    axis; ``bounds`` (4,) [%] those with and without measured speeds."""

    found: dict[str, Array]
    bounds: dict[str, Array]

    def rms(self, estimator: str) -> Array | None:
        """Root mean square errors (4,) [%]; None unless every record gave an axis."""
        found = self.found.get(estimator)
        if found is None or np.any(np.isnan(found)):
            return None
        result: Array = np.sqrt(np.mean(found**2, axis=0))
        return result

    def values(self, case: str) -> Iterator[Value]:
        """The rows of the table."""
        for title, least in self.bounds.items():
            yield from _row(f"{case}, {title}", "", least)
        for title, found in self.found.items():
            row, rms = f"{case}, {title}", self.rms(title)
            yield Value(row, "records without an axis", int(np.sum(np.isnan(found[:, 0]))))
            if rms is not None:
                yield from _row(row, " bias", np.mean(found, axis=0))
                yield from _row(row, " scatter", np.std(found, axis=0))
                yield from _row(row, " rms", rms)


def run(report: Report) -> None:
    """Tables and figure of the estimators under noise."""
    results: dict[str, dict[str, Result]] = {}
    for setting in SETTINGS:
        found = results[setting.title] = {}
        for number, case in enumerate(CASES):
            report.progress(f"noise: {setting.title}, {case.title}, {RUNS} records")
            rng = np.random.default_rng([_SEED, setting.N, number])
            found[case.title] = study(setting, case, rng)
        rows = [result.values(case) for case, result in found.items()]
        report.study(f"Noise, {setting.title}", itertools.chain(*rows))
    report.study("Noise, worst of both settings", _worst(results))
    _figure(report, results)


def study(setting: Setting, case: Case, rng: np.random.Generator, runs: int = RUNS) -> Result:
    """All estimators on records of one case."""
    torque = setting.torque(SAMPLES // setting.N)
    motion = case.motion(setting, torque)
    chosen = [e for e in ESTIMATORS if case.decibels is None or not e.encoders_only]
    found: dict[str, list[Array]] = {estimator.title: [] for estimator in chosen}
    for _ in range(runs):
        record = case.record(setting, motion, torque, rng)
        for estimator in chosen:
            found[estimator.title].append(_error(estimator, record))
    rows = {title: np.array(rows) for title, rows in found.items()}
    return Result(rows, _bounds(setting, case, motion, torque))


def _error(estimator: Estimator, record: Record) -> Array:
    """Errors (4,) [%], nan when there is no axis."""
    try:
        return errors(estimator.estimate(record))
    except NotEnoughDataError:
        return np.full(len(NAMES), np.nan)


def _bounds(setting: Setting, case: Case, motion: Motion, torque: Array) -> dict[str, Array]:
    level = case.level(motion, torque)
    if not case.drift:
        torque = torque[: setting.N]  # further periods say nothing new
    which = {"bound, angles and torque": False}
    if case.decibels is not None:
        which["bound, all measured"] = True
    return {
        title: 100.0 * cramer_rao(AXIS, setting.time_step, torque, level, speeds=speeds)
        for title, speeds in which.items()
    }


def _row(row: str, what: str, values: Array) -> Iterator[Value]:
    for name, value in zip(NAMES, values, strict=True):
        yield Value(row, name + what, float(value), "%")


def _worst(results: dict[str, dict[str, Result]]) -> Iterator[Value]:
    """The larger rms error of the two settings, where both have one, and the larger bound."""
    for case in CASES:
        pair = [found[case.title] for found in results.values()]
        for title in pair[0].bounds:
            yield from _row(
                f"{case.title}, {title}", "", np.max([r.bounds[title] for r in pair], axis=0)
            )
        for estimator in ESTIMATORS:
            rms = [result.rms(estimator.title) for result in pair]
            known = [values for values in rms if values is not None]
            if len(known) == len(rms):
                yield from _row(f"{case.title}, {estimator.title}", "", np.max(known, axis=0))
        most = np.array([GOALS[case.title][name == "B"] for name in NAMES])
        yield from _row(f"{case.title}, goal", "", most)


def _figure(report: Report, results: dict[str, dict[str, Result]]) -> None:
    figure, axes = panels(len(NAMES), len(SETTINGS), height=2.4, sharex=True)
    figure.suptitle(f"Rms error over {RUNS} records of {SAMPLES} samples")
    data: dict[str, npt.ArrayLike] = {}
    for column, (title, found) in enumerate(results.items()):
        for row, name in enumerate(NAMES):
            panel = axes[row * len(SETTINGS) + column]
            _plot(panel, row, list(found.values()))
            panel.set_ylabel(f"error of {name} [%]")
        axes[column].set_title(title)
        for case, result in found.items():
            data |= {
                f"{title}, {value.row}, {value.column}": [value.value]
                for value in result.values(case)
            }
    for panel in axes:
        panel.set_xticks(range(len(CASES)), [case.title.replace(", ", "\n") for case in CASES])
        panel.set_ylim(2e-4, 2e3)
        panel.tick_params(axis="x", labelrotation=30)
    figure.legend(
        handles=axes[0].get_legend_handles_labels()[0], loc="outside lower center", ncols=4
    )
    report.figure("noise", figure, data)


def _plot(axes: Axes, parameter: int, found: list[Result]) -> None:
    """One parameter in one setting: bounds and goals as lines, a marker for each estimator."""
    places = np.arange(len(CASES))
    for title, style in (("bound, all measured", "-"), ("bound, angles and torque", ":")):
        at = [i for i, result in enumerate(found) if title in result.bounds]
        least = [found[i].bounds[title][parameter] for i in at]
        axes.hlines(
            least, np.array(at) - 0.4, np.array(at) + 0.4, ls=style, color="black", label=title
        )
    goals = [GOALS[case.title][NAMES[parameter] == "B"] for case in CASES]
    axes.hlines(goals, places - 0.4, places + 0.4, color=GREY, lw=3.0, alpha=0.4, label="goal")
    for number, estimator in enumerate(ESTIMATORS):
        rms = [result.rms(estimator.title) for result in found]
        at = [i for i, values in enumerate(rms) if values is not None]
        heights = [values[parameter] for values in rms if values is not None]
        shift = 0.7 * (number / (len(ESTIMATORS) - 1) - 0.5)
        axes.semilogy(
            np.array(at) + shift,
            heights,
            estimator.marker,
            ms=5.0,
            color=estimator.colour,
            label=estimator.title,
        )
