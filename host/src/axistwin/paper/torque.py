"""The excitation identified back (Eq. 18), Figures 7 and 8, and how well it could be done at best.

Eq. 18 between two samples, by the trapezoidal rule, is exact for samples of Newmark's method and
says what the mean torque over the step was (axt_torque.h). From noisy states there is a best
answer: beside Eq. 18 the trapezoidal rule gives three equations a step without any torque,

    theta1[k+1] - theta1[k] = Dt (omega1[k] + omega1[k+1]) / 2         and so for theta2
    I2 (omega2[k+1] - omega2[k]) / Dt = B mean(omega1 - omega2) + K mean(theta1 - theta2)

D X = 0 for short. The states that fulfil them and are nearest to the measured ones Y, weighed by
the noise's covariance S, are X = Y - S D' (D S D')^-1 D Y; Eq. 18 of these is the generalised
least-squares estimate of torques about which nothing is known beforehand (what a Kalman smoother
with an unknown input gives), and by Gauss and Markov no unbiased linear estimate scatters less.

When more is known, that the torque is periodic with 2k lines, the lines of the average period of
that estimate do better by far.
"""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from axistwin import core
from axistwin.core import Array, Axis, IdentSettings, Motion
from axistwin.paper import eq9, native
from axistwin.paper.measurement import measure, noise_level
from axistwin.paper.report import Report, Value
from axistwin.paper.settings import AXIS, RMS, SETTINGS, Setting
from axistwin.paper.style import BLUE, GREY, ORANGE, RED, panels

#: Samples of a record with noise, and how many records.
SAMPLES = 10240
RUNS = 20
NOISE_DB = 40.0

#: Steps whose variance the bound is the mean of: it hardly varies along a record.
_STEPS = 64


def run(report: Report) -> None:
    """Figures 7 and 8 and the study of Eq. 18."""
    values: list[Value] = []
    for number, setting in zip((7, 8), SETTINGS, strict=True):
        values += _clean(report, number, setting)
        report.progress(f"torque: {setting.title}, {RUNS} records with noise")
        values += _noisy(setting)
    report.study("Identified excitation (Eq. 18)", values)


@dataclass(frozen=True)
class Smoother:
    """Best linear unbiased estimate of the mean torque over each of n steps.

    ``deviation`` (4,) are the standard deviations of the noise on theta1, omega1, theta2, omega2.
    """

    axis: Axis
    time_step: float
    steps: int
    deviation: Array

    def estimate(self, measured: Array) -> Array:
        """Mean torques (n,) [N m] from measured states (n + 1, 4) of Eq. 8."""
        Y = measured.ravel()
        D, weighted, factor = self._factor()
        result: Array = self._torque() @ (Y - weighted.T @ factor.solve(D @ Y))
        return result

    def standard_error(self) -> float:
        """What it leaves, rms over the steps [N m]."""
        L = self._torque()[np.linspace(0, self.steps - 1, _STEPS).astype(np.intp)]
        _, weighted, factor = self._factor()
        noise = scipy.sparse.diags_array(np.tile(self.deviation**2, self.steps + 1))
        seen = (weighted @ L.T).toarray()
        explained = np.sum(seen * factor.solve(seen), axis=0)
        variance = np.asarray((L @ noise).multiply(L).sum(axis=1)) - explained
        return float(np.sqrt(np.mean(variance)))

    def _factor(self) -> tuple[Any, Any, Any]:
        """D, D S and a factorisation of D S D', each row of D scaled to unit noise."""
        I2, B, K, h = self.axis.I2, self.axis.B, self.axis.K, self.time_step
        start = [[-1.0, -h / 2, 0, 0], [0, 0, -1.0, -h / 2], [-K, -B, K, B - 2 * I2 / h]]
        end = [[1.0, -h / 2, 0, 0], [0, 0, 1.0, -h / 2], [-K, -B, K, B + 2 * I2 / h]]
        scale = np.linalg.norm(np.hstack([start, end]) * np.tile(self.deviation, 2), axis=1)
        D = _banded(start / scale[:, None], end / scale[:, None], self.steps)
        weighted = D @ scipy.sparse.diags_array(np.tile(self.deviation**2, self.steps + 1))
        return D, weighted, scipy.sparse.linalg.splu((weighted @ D.T).tocsc(), "NATURAL")

    def _torque(self) -> Any:
        """Eq. 18 as a sparse matrix (n, 4 (n + 1)) on the states."""
        I1, _, B, K = astuple(self.axis)
        start = np.array([[K / 2, B / 2 - I1 / self.time_step, -K / 2, -B / 2]])
        end = np.array([[K / 2, B / 2 + I1 / self.time_step, -K / 2, -B / 2]])
        return _banded(start, end, self.steps)


def _banded(start: Array, end: Array, steps: int) -> Any:
    """A matrix whose block row k is ``start`` at sample k and ``end`` at sample k + 1."""
    here = scipy.sparse.eye_array(steps, steps + 1)
    there = scipy.sparse.eye_array(steps, steps + 1, k=1)
    return (scipy.sparse.kron(here, start) + scipy.sparse.kron(there, end)).tocsr()


def relative_error(found: Array, true: Array) -> float:
    """Rms error of mean torques (n,), relative to the rms of the true ones (n,)."""
    return float(np.sqrt(np.mean((found - true) ** 2) / np.mean(true**2)))


def identified_axis(setting: Setting, motion: Motion, torque: Array) -> Axis:
    """The axis by the bias-free form, from the same samples."""
    settings = IdentSettings(setting.time_step, AXIS, RMS)
    return core.identify_motion(settings, motion, torque).last.axis


def _clean(report: Report, number: int, setting: Setting) -> list[Value]:
    h, torque = setting.time_step, setting.torque()
    single = core.simulate(AXIS, h, torque, precision="float32")
    double = core.simulate(AXIS, h, torque)
    found = {
        "float32": native.identified_torque(identified_axis(setting, single, torque), h, single),
        "float64": native.identified_torque(identified_axis(setting, double, torque), h, double),
        "LS of Eq. 9": native.identified_torque(eq9.identify(setting, torque), h, double),
    }
    true = (torque[:-1] + torque[1:]) / 2.0
    _figure(report, f"figure-{number:02d}-identified-excitation", setting, true, found)
    return [
        Value(f"clean, {name}", setting.title, relative_error(values, true))
        for name, values in found.items()
    ]


def _figure(
    report: Report, name: str, setting: Setting, true: Array, found: dict[str, Array]
) -> None:
    time = (np.arange(setting.N - 1) + 0.5) * setting.time_step * 1e3
    figure, (above, below) = panels(2, 1, height=2.4, sharex=True)
    figure.suptitle(f"Excitation identified by Eq. 18, {setting.title}")
    above.plot(time, true, color=GREY, lw=3.0, alpha=0.5, label="true")
    above.plot(time, found["LS of Eq. 9"], color=RED, lw=0.9, label="parameters by Eq. 9")
    above.plot(time, found["float32"], color=BLUE, lw=0.9, ls="--", label="by the bias-free form")
    above.set_ylabel("mean torque of a step [N m]")
    labels = {"LS of Eq. 9": "Eq. 9", "float32": "bias-free, float32", "float64": "float64"}
    for (key, label), colour in zip(labels.items(), (RED, BLUE, ORANGE), strict=True):
        below.semilogy(time, np.abs(found[key] - true), color=colour, lw=0.7, label=label)
    below.set_ylim(bottom=1e-17)
    below.set_ylabel("|error| [N m]")
    below.set_xlabel("time [ms]")
    for axes in (above, below):
        axes.legend(loc="upper right", ncols=3)
        axes.margins(x=0.0)
    above.set_ylim(top=above.get_ylim()[1] * 1.35)
    below.set_ylim(top=below.get_ylim()[1] * 30.0)
    columns = {f"identified, {key} [N m]": values for key, values in found.items()}
    report.figure(name, figure, {"time [ms]": time, "true mean torque [N m]": true, **columns})


def _noisy(setting: Setting) -> list[Value]:
    """Eq. 18 at 40 dB, parameters from the same noisy record, against the bound."""
    h = setting.time_step
    torque = setting.torque(SAMPLES // setting.N)
    mean = (torque[:-1] + torque[1:]) / 2.0
    clean = core.simulate(AXIS, h, torque)
    level = noise_level(clean, torque, NOISE_DB)
    deviation = np.array([level.angle, level.speed] * 2)
    rng = np.random.default_rng(18)
    squares = np.zeros(3)
    for _ in range(RUNS):
        motion, measured_torque = measure(clean, torque, level, rng)
        axis = identified_axis(setting, motion, measured_torque)
        direct = native.identified_torque(axis, h, motion)
        smoothed = Smoother(axis, h, SAMPLES - 1, deviation).estimate(eq9.states(motion))
        lines = excited_lines(setting, direct)
        for i, (found, true) in enumerate(
            ((direct, mean), (smoothed, mean), (lines, mean[-setting.N :]))
        ):
            squares[i] += relative_error(found, true) ** 2 / RUNS
    best = Smoother(AXIS, h, SAMPLES - 1, deviation).standard_error() / np.sqrt(np.mean(mean**2))
    direct_error, smoothed_error, lines_error = np.sqrt(squares)
    values = {
        "axt_torque": direct_error,
        "smoothed": smoothed_error,
        "lines only": lines_error,
        "best possible": best,
        "axt_torque / best": direct_error / best,
        "smoothed / best": smoothed_error / best,
    }
    return [Value(f"40 dB, {key}", setting.title, float(value)) for key, value in values.items()]


def excited_lines(setting: Setting, mean_torque: Array) -> Array:
    """The last period (N,) of mean torques, of which only the average's 2k lines are kept."""
    N = setting.N
    periods = mean_torque[len(mean_torque) % N :].reshape(-1, N)
    spectrum = np.fft.rfft(periods.mean(axis=0))
    spectrum[0] = 0.0
    spectrum[2 * setting.k + 1 :] = 0.0
    result: Array = np.fft.irfft(spectrum, N)
    return result
