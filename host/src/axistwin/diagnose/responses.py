"""How the motion answers the torque, frequency by frequency (P. D. Welch, IEEE Trans. Audio and
Electroacoustics 15 (1967) 70-73).

Cross spectra with the torque leave out what is not caused by it, the noise of an encoder above all;
the coherence says how much that is.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.signal

from axistwin.core import Array

Spectrum = npt.NDArray[np.complex128]

#: Segments there are at least, samples of each at least and at most, and segments at most.
_SEGMENTS_MIN = 12
_LENGTH_MIN, _LENGTH_MAX = 64, 2**14
_SEGMENTS_MAX = 200

#: Share of its largest power that the torque has where it drives the axis.
_DRIVEN = 1e-4

#: Of so many frequencies of unrelated signals one passes for related.
_CHANCE = 1e-5


@dataclass(frozen=True)
class Responses:
    """``omega`` (f,) [rad/s]; of each angle, by name, the second derivative for torque 1, ``gain``
    (f,), and ``coherence`` (f,) 0 .. 1; what is below ``significant`` is chance. ``power`` (f,) of
    the torque, 1 at its largest."""

    omega: Array
    power: Array
    gain: Mapping[str, Spectrum]
    coherence: Mapping[str, Array]
    significant: float

    def related(self, *names: str) -> npt.NDArray[np.bool_]:
        """The frequencies at which the torque drives each of these (f,).

        Where it has next to no power, friction at the table may be what drives the axis.
        """
        driven = self.power > _DRIVEN
        for name in names:
            driven &= self.coherence[name] > self.significant
        return driven


def measure(torque: Array, angles: Mapping[str, Array], time_step: float) -> Responses:
    """From torque (n,) to angles (n,), from segments spread over the record."""
    length = int(2 ** np.floor(np.log2(len(torque) / _SEGMENTS_MIN * 2.0)))
    length = min(max(length, _LENGTH_MIN), _LENGTH_MAX)
    count = min(2 * (len(torque) - 2) // length - 1, _SEGMENTS_MAX)
    starts = np.linspace(0, len(torque) - 2 - length, max(count, 2)).astype(np.int64)
    window = scipy.signal.windows.hann(length, sym=False)

    def spectra(values: Array) -> Spectrum:
        cut = values[starts[:, None] + np.arange(length)]
        cut = cut - np.mean(cut, axis=1, keepdims=True)
        result: Spectrum = np.fft.rfft(window * cut, axis=1)[:, 2 : length // 2]
        return result

    omega = 2.0 * np.pi / (length * time_step) * np.arange(2.0, length // 2)
    # a central second difference multiplies by -4 sin^2(w dt / 2) / dt^2, not by -w^2
    exact = (0.5 * omega * time_step / np.sin(0.5 * omega * time_step)) ** 2 / time_step**2
    drive = spectra(torque[1:-1])
    power = np.mean(np.abs(drive) ** 2, axis=0)
    gain, coherence = {}, {}
    for name, angle in angles.items():
        answer = spectra(np.diff(angle, 2))
        cross = np.mean(np.conj(drive) * answer, axis=0)
        both = power * np.mean(np.abs(answer) ** 2, axis=0)
        known = both > 0.0
        gain[name] = exact * cross / np.where(power > 0.0, power, 1.0)
        coherence[name] = np.where(known, np.abs(cross) ** 2 / np.where(known, both, 1.0), 0.0)
    # of segments that overlap by half nine in ten count as independent
    independent = max(0.9 * len(starts), 2.0)
    largest = float(np.max(power))
    relative = power / largest if largest > 0.0 else power
    return Responses(omega, relative, gain, coherence, 1.0 - _CHANCE ** (1.0 / (independent - 1.0)))
