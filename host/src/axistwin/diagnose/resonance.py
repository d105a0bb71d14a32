"""Whether the table carries a further inertia on a spring, from how it answers the motor.

What hangs on the table changes its apparent inertia with frequency. Whatever moves the motor, the
twist tells it (s = j w):

    (K + s B) (theta1 - theta2) = -s^2 I2 (1 + m H) theta2,
    H = (p^2 + 2 zeta p s) / (p^2 + 2 zeta p s + s^2).

For a given p and zeta this is linear in what is left, so that all frequencies can be tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.optimize
import scipy.signal

from axistwin.core import Array, Axis
from axistwin.diagnose.effects import TABLE, ExtraMode, Found
from axistwin.diagnose.linear import Complexes, TwoInertias
from axistwin.diagnose.windows import WINDOWS_MIN, Windows

#: Frequencies and damping ratios that are tried.
_FREQUENCIES = 150
_DAMPINGS = (0.01, 0.03, 0.1)

#: What is looked at: from so many periods in a segment, up to this share of the sampling frequency.
_PERIODS_MIN = 10
_HIGHEST = 0.4

#: Windows that follow each other are joined to segments this long [s], where there are enough.
_SEGMENT = 2.0

#: They overlap so that each sample is in so many segments: the ends of one hardly count.
_OVERLAP = 2

#: The torque drives the axis where it has this share of its mean power.
_DRIVEN = 1e-3

#: Of so many frequencies of unrelated signals one passes for related.
_CHANCE = 1e-6

#: Frequencies that have to be driven for the rest to be told.
_DRIVEN_MIN = 10

#: So many modes are proposed, if their likelihoods are exp(10) apart at most.
_MODES = 3
_LIKELY = 20.0

#: Adjusted damping ratios and mass ratios.
_LEAST, _MOST = (1e-3, 1e-6), (0.5, 10.0)


@dataclass(frozen=True)
class _Spectra:
    """At ``omega`` (f,) [rad/s]: accelerations for torque 1, and motor for table 1 (``ratio``) with
    the weight of that."""

    omega: Array
    motor: Complexes
    table: Complexes
    ratio: Complexes
    weight: Array


def find(windows: Windows, acting: Array) -> list[tuple[TwoInertias, Found]]:
    """Axes with a further mode that explain most under a torque (w, l), the likeliest first."""
    spectra = _measured(windows, acting)
    if np.count_nonzero(spectra.weight) < _DRIVEN_MIN:
        return []
    found = []
    for frequency in np.geomspace(spectra.omega[0], spectra.omega[-1], _FREQUENCIES):
        trials = [(damping, *_linear(spectra, frequency, damping)) for damping in _DAMPINGS]
        damping, (load, carried, drag), left = min(trials, key=lambda trial: trial[2])
        mass = max(carried / load, _LEAST[1])
        found.append((left, np.array([load, drag, frequency, damping, mass])))
    errors = np.array([np.inf, *(error for error, _ in found), np.inf])
    valley = (errors[1:-1] < errors[:-2]) & (errors[1:-1] < errors[2:])
    likely = valley & (errors[1:-1] < np.min(errors) + _LIKELY)
    best = sorted((found[i] for i in np.flatnonzero(likely)), key=lambda one: one[0])[:_MODES]
    scaled = (_scaled(spectra, _adjusted(spectra, values)) for _, values in best if values[0] > 0.0)
    return [one for one in scaled if one is not None]


def _measured(windows: Windows, acting: Array) -> _Spectra:
    step = windows.time_step
    chosen = _segments(windows)
    length = chosen.shape[1] - 3

    def segments(values: Array) -> Array:
        cut: Array = values.ravel()[chosen]
        return cut

    bins = np.arange(_PERIODS_MIN, int(_HIGHEST * length))
    taper = scipy.signal.windows.blackmanharris(length, sym=False)

    def spectrum(values: Array) -> Complexes:
        found: Complexes = np.fft.rfft(taper * values, axis=1)[:, bins]
        return found

    # What is slow is much larger: differences keep it from leaking into all else.
    torque = spectrum(np.diff(segments(acting)[:, 1:-1], axis=1))
    motor, table = (spectrum(np.diff(segments(angle), 3, axis=1)) for angle in windows.angles)
    omega: Array = 2.0 * np.pi / (length * step) * bins.astype(np.float64)
    half = 0.5 * omega * step
    power, of_motor, of_table = (
        np.sum(np.conj(torque) * answer, axis=0) for answer in (torque, motor, table)
    )
    chance = _related(len(torque))
    related = [
        np.abs(cross) ** 2 > chance * power.real * np.sum(np.abs(answer) ** 2, axis=0)
        for cross, answer in ((of_motor, motor), (of_table, table))
    ]
    drive = power.real / np.sin(half) ** 2
    driven = (len(drive) * drive > _DRIVEN * np.sum(drive)) & related[0] & related[1]
    ratio = of_motor / of_table
    noise = np.sum(np.abs(motor - ratio * table) ** 2, axis=0)
    independent = len(torque) / _OVERLAP
    weight: Array = driven * np.abs(of_table) / np.sqrt(power.real * noise / independent)
    # A torque that is held acts half a sample late, and a second difference is not s^2.
    exact = (half / np.sin(half)) ** 3 * np.exp(1j * half) / step**2 / power
    return _Spectra(omega, exact * of_motor, exact * of_table, ratio, weight)


def _segments(windows: Windows) -> npt.NDArray[np.intp]:
    """Which of the samples in windows, one window after the other, are in each segment (s, l)."""
    breaks = np.flatnonzero(np.diff(windows.index.ravel()) != 1) + 1
    runs = np.split(np.arange(windows.index.size), breaks)
    wanted = int(np.ceil(_SEGMENT / (windows.length * windows.time_step)))
    shortest = min(len(run) for run in runs) // windows.length
    length = min(wanted, shortest, windows.count // WINDOWS_MIN) * windows.length
    starts = [run[: len(run) - length + 1 : length // _OVERLAP] for run in runs]
    return np.concatenate(starts)[:, None] + np.arange(length)


def _related(count: int) -> float:
    """The coherence of so many segments that is more than chance."""
    return 1.0 - float(_CHANCE ** (1.0 / (count - 1)))


def _carried(omega: Array, frequency: float, damping: float) -> Complexes:
    """H."""
    s = 1j * omega / frequency
    carried: Complexes = (1.0 + 2.0 * damping * s) / (1.0 + 2.0 * damping * s + s**2)
    return carried


def _linear(spectra: _Spectra, frequency: float, damping: float) -> tuple[Array, float]:
    """I2 / K, that times m, and B / K (3,) for a mode; and the error that is left."""
    s = 1j * spectra.omega
    twist = spectra.ratio - 1.0
    carried = _carried(spectra.omega, frequency, damping)
    columns = np.stack([s**2, s**2 * carried, -s * twist], axis=1)
    return _solve(columns, twist, spectra.weight)


def _solve(columns: Complexes, right: Complexes, weight: Array) -> tuple[Array, float]:
    """Least squares of complex equations with real unknowns (k,)."""
    weights = weight[:, None]
    a = np.concatenate([weights * columns.real, weights * columns.imag])
    b = np.concatenate([weight * right.real, weight * right.imag])
    solution: Array = np.linalg.lstsq(a, b, rcond=None)[0]
    return solution, float(np.sum((b - a @ solution) ** 2))


def _adjusted(spectra: _Spectra, values: Array) -> Array:
    """I2 / K, B / K, p, zeta, m that fit best."""
    s = 1j * spectra.omega

    def errors(changed: Array) -> Array:
        load, drag, frequency, damping, mass = changed * size
        loaded = load * (1.0 + mass * _carried(spectra.omega, frequency, damping))
        error = spectra.weight * (spectra.ratio - 1.0 - s**2 * loaded / (1.0 + s * drag))
        both: Array = np.concatenate([error.real, error.imag])
        return both

    size = np.maximum(values, [0.0, values[0] * spectra.omega[-1] * 1e-2, 0.0, 0.0, 0.0])
    slowest, fastest = 0.5 * spectra.omega[0], 2.0 * spectra.omega[-1]
    low = [0.0, 0.0, slowest, _LEAST[0], _LEAST[1]] / size
    high = [np.inf, np.inf, fastest, _MOST[0], _MOST[1]] / size
    start = np.clip(values / size, low + 1e-9, high - 1e-9)
    found = scipy.optimize.least_squares(errors, start, bounds=(low, high), max_nfev=100)
    adjusted: Array = found.x * size
    return adjusted


def _scaled(spectra: _Spectra, values: Array) -> tuple[TwoInertias, Found] | None:
    """With the inertias that take this torque."""
    load, drag, frequency, damping, mass = values.tolist()
    loaded = spectra.table * (1.0 + mass * _carried(spectra.omega, frequency, damping))
    columns = np.stack([spectra.motor, loaded], axis=1)
    torque = np.ones(len(columns), np.complex128)
    inertias, _ = _solve(columns, torque, spectra.weight / np.abs(spectra.ratio))
    motor, table = inertias.tolist()
    if min(motor, table) <= 0.0:
        return None
    axis = Axis(motor, table, drag * table / load, table / load)
    return TwoInertias(axis), Found(ExtraMode(TABLE), np.array([mass]), (frequency, damping))
