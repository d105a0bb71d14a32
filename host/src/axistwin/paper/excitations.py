"""The excitations that the paper names as future work, beside Schroeder's, at equal rms torque.

A signal is persistently exciting when the regressors of the bias-free form are independent: when
the least eigenvalue of their information matrix, and not only the largest, is far from zero. A
condition number says by how much one combination of q, q' and T is excited less than another.
What that is worth is said by the errors under the same noise, and by the least that any estimator
could do (bound.py).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from axistwin import core
from axistwin.core import Array, IdentSettings, Motion, State
from axistwin.paper import bound, equations
from axistwin.paper.measurement import NoiseLevel, measure, noise_level
from axistwin.paper.report import Report, Value
from axistwin.paper.settings import AXIS, MODAL, NAMES, RMS, SETTINGS, Setting, errors
from axistwin.paper.style import BLUE, GREEN, GREY, ORANGE, RED, panels

#: Samples of a record, and how many records with noise.
SAMPLES = 10240
RUNS = 100

#: Noise on torque, angles and speeds, against torque and twist under Schroeder's signal.
NOISE_DB = 40.0

_SEED = 3

#: Before a record begins, the transient has died away to this.
_TRANSIENT = 1e-9

#: A condition number beyond this is rounding: the regressors depend on each other.
_SINGULAR = 1e12


_COLOURS = (BLUE, GREEN, RED, ORANGE)


@dataclass(frozen=True)
class Excitation:
    """A signal: ``period`` makes one period of it for a setting, of any size."""

    title: str
    period: Callable[[Setting], Array]

    def torque(self, setting: Setting, samples: int) -> Array:
        """The signal from its first sample on, (samples,), RMS [N m] over a whole period."""
        c = core._load("float64")
        table = self.period(setting)
        status = c.lib.axt_table_scale_to_rms(c.array("axt_real", table), len(table), RMS)
        core._check(c, status, self.title)
        return np.resize(table, samples)


def filled(name: str, length: int, *arguments: int) -> Array:
    """A period (length,) by one of the core's fill functions. Raises InputError when it refuses."""
    c = core._load("float64")
    table = np.zeros(length)
    status = getattr(c.lib, f"axt_{name}_fill")(c.array("axt_real", table), length, *arguments)
    core._check(c, status, f"{name} of {length} samples")
    return table


def _binary(hold: Callable[[Setting], int]) -> Callable[[Setting], Array]:
    """Maximum-length binary sequence, the longest that N samples hold, each bit held."""

    def period(setting: Setting) -> Array:
        held = hold(setting)
        stages = int(math.log2(setting.N / held + 1))
        return filled("binary", (2**stages - 1) * held, stages, held)

    return period


EXCITATIONS = (
    Excitation("Schroeder, 2k lines", lambda s: core.schroeder(s.N, 2 * s.k, 1.0)),
    Excitation("harmonic at wn", lambda s: filled("harmonic", s.N, s.k)),
    Excitation("impulse", lambda s: filled("impulse", s.N)),
    Excitation("white noise", lambda s: filled("noise", s.N, _SEED)),
    Excitation("binary, to the Nyquist frequency", _binary(lambda _: 1)),
    Excitation("binary, to about 2 wn", _binary(lambda s: max(1, round(s.N / (4 * s.k))))),
    Excitation("chirp, 0 to 2 wn", lambda s: filled("chirp", s.N, 1, 2 * s.k)),
)


@dataclass(frozen=True)
class Record:
    """Steady motion under a torque (n,) [N m], and the state at its first sample."""

    motion: Motion
    torque: Array
    start: State


def steady(excitation: Excitation, setting: Setting, samples: int = SAMPLES) -> Record:
    """Simulates until the transient has died away, and then a record of so many samples."""
    lead = math.ceil(-math.log(_TRANSIENT) / (MODAL.zeta * MODAL.wn * setting.time_step))
    torque = excitation.torque(setting, lead + samples)
    motion = core.simulate(AXIS, setting.time_step, torque)
    steady = Motion(motion.precision, motion.samples[lead:])
    start = State(*(float(x[0]) for x in (steady.twist, steady.twist_speed, steady.omega1)))
    return Record(steady, torque[lead:], start)


def run(report: Report) -> None:
    """Table and figure of the excitations."""
    results: dict[str, list[Result]] = {}
    for setting in SETTINGS:
        reference = steady(EXCITATIONS[0], setting)
        level = noise_level(reference.motion, reference.torque, NOISE_DB)
        report.progress(f"excitations: {setting.title}, {RUNS} records of each")
        results[setting.title] = [_study(excitation, setting, level) for excitation in EXCITATIONS]
        report.study(
            f"Excitations, {setting.title}",
            [value for result in results[setting.title] for value in result.values()],
        )
    _figure(report, results)


@dataclass(frozen=True)
class Result:
    """What a signal is worth: ``rms`` errors of the recursive estimate over the records that gave
    an axis, and the ``bound``, each (4,) [%]; ``failed`` is how many records gave none."""

    title: str
    crest_factor: float
    condition: float
    eigenvalue: float
    rms: Array
    bound: Array
    failed: int

    def values(self) -> list[Value]:
        """A row of the table."""
        row = self.title
        values = [
            Value(row, "crest factor", self.crest_factor),
            Value(row, "condition number", self.condition),
            Value(row, "least eigenvalue", self.eigenvalue),
        ]
        for name, rms, least in zip(NAMES, self.rms, self.bound, strict=True):
            values.append(Value(row, f"{name} rms", float(rms), "%"))
            values.append(Value(row, f"{name} bound", float(least), "%"))
        return [*values, Value(row, "records without an axis", self.failed)]


def _study(excitation: Excitation, setting: Setting, level: NoiseLevel) -> Result:
    record = steady(excitation, setting)
    settings = IdentSettings(setting.time_step, AXIS, RMS)
    clean = equations.from_motion(settings, record.motion, record.torque)
    rng = np.random.default_rng(_SEED)
    found = np.vstack([_measured(settings, record, level, rng) for _ in range(RUNS)])
    good = found[~np.isnan(found[:, 0])]
    limit = bound.cramer_rao(AXIS, setting.time_step, record.torque, level, start=record.start)
    return Result(
        excitation.title,
        crest_factor=float(np.max(np.abs(record.torque)) / RMS),
        condition=_condition(clean.information),
        eigenvalue=max(0.0, float(np.linalg.eigvalsh(clean.information)[0])),
        rms=np.sqrt(np.mean(errors(good) ** 2, axis=0)),
        bound=100.0 * limit,
        failed=len(found) - len(good),
    )


def _condition(information: Array) -> float:
    """Condition number for regressors of equal rms, at most what can be told from rounding."""
    size = np.sqrt(np.diag(information))
    least, *_, most = np.linalg.eigvalsh(information / np.outer(size, size)).tolist()
    return float(most / least) if least * _SINGULAR > most else _SINGULAR


def _measured(
    settings: IdentSettings, record: Record, level: NoiseLevel, rng: np.random.Generator
) -> Array:
    """I1, I2, B, K (1, 4) from the record as measured with noise; nan when that is no axis."""
    motion, torque = measure(record.motion, record.torque, level, rng)
    return equations.least_squares(equations.from_motion(settings, motion, torque))


def _figure(report: Report, results: dict[str, list[Result]]) -> None:
    figure, axes = panels(len(SETTINGS), 2, height=3.0)
    figure.suptitle(f"Excitations at {RMS} N m rms; errors with noise at {NOISE_DB:.0f} dB")
    data: dict[str, npt.ArrayLike] = {}
    for row, (title, found) in enumerate(results.items()):
        condition, error = axes[2 * row : 2 * row + 2]
        _plot_condition(condition, found)
        data[f"{title}: condition number"] = [result.condition for result in found]
        places = np.arange(len(found))
        for i, (name, colour) in enumerate(zip(NAMES, _COLOURS, strict=True)):
            rms = np.array([result.rms[i] for result in found])
            least = np.array([result.bound[i] for result in found])
            at = places + 0.16 * (i - 1.5)
            error.semilogx(rms, at, "o", ms=3.5, color=colour, label=name)
            error.semilogx(least, at, "|", ms=6.0, mew=1.6, color=colour)
            data[f"{title}: {name} rms [%]"], data[f"{title}: {name} bound [%]"] = rms, least
        error.set_title(title)
        error.set_xlim(5e-3, 2e4)
        error.set_xlabel("dot: rms error of RLS, bar: bound [%]")
        error.set_yticks(places, [""] * len(found))
        error.legend(loc="lower right")
        for panel in (condition, error):
            panel.set_ylim(len(found) - 0.5, -0.5)
    report.figure("excitations", figure, data)


def _plot_condition(axes: Axes, found: list[Result]) -> None:
    """Bars; that of a signal whose regressors depend on each other is cut off and says so."""
    numbers = [result.condition for result in found]
    axes.barh(np.arange(len(found)), numbers, color=GREY, height=0.6)
    axes.set_xlim(0.0, 3.0)
    axes.set_xlabel("condition number of the information matrix")
    axes.set_yticks(np.arange(len(found)), [result.title for result in found])
    for place, number in enumerate(numbers):
        singular = number >= _SINGULAR
        text, colour = ("singular", "white") if singular else (f"{number:.2f}", "black")
        axes.text(2.95, place, text, color=colour, ha="right", va="center")
