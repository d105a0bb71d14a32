"""Is each channel what its name says: exchanged, reversed and mis-scaled ones are told by physics.

Torque accelerates the motor, and the shaft alone accelerates the table: ``I2 theta2'' = K twist``.
So the ratio of the table's acceleration to the twist is ``wa^2 = K / I2`` at every frequency. With
the encoders exchanged that very ratio comes out as ``w^2 - wa^2`` (Eq. 3 solved for both), which
is another curve at any frequency. Both encoders travel alike, and an axis that is pushed forward
goes forward.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import scipy.optimize

from axistwin.core import Array
from axistwin.diagnose.responses import Responses, Spectrum

#: Parts of a record in which the mean of two channels is compared.
_PARTS = 200

#: Two channels are in proportion when this share of the smaller one is something else at most.
_UNRELATED_MAX = 0.2

#: They agree when their proportion is that close to 1.
_AGREEMENT = 0.05

#: What a proportion may be, to that relative precision.
_PRECISION = 0.02
_FACTORS = (
    (180.0 / np.pi, "degrees for radians"),
    (2.0 * np.pi, "turns for radians"),
    (30.0 / np.pi, "revolutions a minute for rad/s"),
    (60.0, "minutes for seconds"),
    (360.0, "degrees for turns"),
    (1e3, "thousandfold, such as milli"),
    (1e6, "millionfold, such as micro"),
)
_GEAR_MAX = 400

#: Frequencies that a statement about the whole axis rests on at least.
_FREQUENCIES_MIN = 6

#: The encoders are exchanged when that fits so well, the other way so badly, and so much worse.
_FITS, _FITS_NOT, _WORSE = 0.2, 0.15, 2.0

#: An axis is rigid where the twist is this small a share of the motion; without a second encoder in
#: this share of the related frequencies, the lowest.
_RIGID_TWIST = 0.3
_RIGID_SHARE = 0.2

#: A coherence beyond this is not worth more.
_COHERENCE_MAX = 0.999

#: Student's t of what is called reversed; what speaks against that, a delay does, has to be so
#: much less.
_SURE, _DOUBT = 6.0, 0.3


def proportion(first: Array, second: Array) -> float | None:
    """How many times as far the second channel (n,) moves as the first, slowly; None when they do
    not move in proportion. By total least squares on the means of parts of the record."""
    length = max(len(first) // _PARTS, 1)
    whole = len(first) // length * length
    means = np.stack([v[:whole].reshape(-1, length).mean(axis=1) for v in (first, second)])
    means -= np.mean(means, axis=1, keepdims=True)
    size = np.std(means, axis=1)
    if np.any(size == 0.0):
        return None
    correlation = float(np.mean(means[0] * means[1]) / (size[0] * size[1]))
    if 1.0 - correlation**2 > _UNRELATED_MAX**2:
        return None
    return float(np.sign(correlation) * size[1] / size[0])


def agree(factor: float) -> bool:
    """Is a proportion 1, as it should be?"""
    return abs(factor - 1.0) <= _AGREEMENT


def reason(factor: float) -> tuple[float, str]:
    """Why a channel may be so many times as large as it should be, with the exact number."""
    size = abs(factor)
    for known, words in _FACTORS:
        for number in (known, 1.0 / known):
            if abs(size / number - 1.0) <= _PRECISION:
                return number, words
    larger = max(size, 1.0 / size)
    gear = round(larger)
    if abs(larger - gear) <= _PRECISION and 2 <= gear <= _GEAR_MAX:
        return gear if size > 1.0 else 1.0 / gear, f"a gear of {gear} to 1"
    return size, "another unit or a gear"


@dataclass(frozen=True)
class Exchange:
    """Are the encoders exchanged? ``sure`` when ``as_named`` is not what the frequencies show, and
    ``exchanged`` is: misfits from 0, no difference, to 1."""

    as_named: float
    exchanged: float

    @property
    def sure(self) -> bool:
        """True when the encoders are exchanged."""
        return self.exchanged < _FITS and self.as_named > max(_FITS_NOT, _WORSE * self.exchanged)


def exchange(responses: Responses) -> Exchange | None:
    """Compares the two curves for theta2 and twist; None without enough related frequencies."""
    related = responses.related("theta2", "twist")
    if np.sum(related) < _FREQUENCIES_MIN:
        return None
    squared = responses.omega[related] ** 2
    gains = responses.gain["theta2"][related], responses.gain["twist"][related]
    # the twist is twice differentiated as well
    measured = -squared * gains[0] / gains[1]
    largest = float(np.max(squared))
    return Exchange(
        _misfit(measured, lambda level: np.full_like(squared, level), largest),
        _misfit(measured, lambda level: squared - level, largest),
    )


def _misfit(measured: Spectrum, curve: Callable[[float], Array], largest: float) -> float:
    """How far a curve with the best positive level stays off, at the median frequency."""

    def misfit(logarithm: float) -> float:
        wanted = curve(float(np.exp(logarithm)))
        return float(np.median(np.abs(measured - wanted) / (np.abs(measured) + np.abs(wanted))))

    levels = np.log(largest) + np.linspace(-8.0, 8.0, 81)
    values = [misfit(level) for level in levels]
    best = levels[int(np.argmin(values))]
    step = levels[1] - levels[0]
    found = scipy.optimize.minimize_scalar(misfit, bounds=(best - step, best + step))
    return float(min(found.fun, np.min(values)))


def pushed_back(responses: Responses) -> bool:
    """Does the motor go backwards when it is pushed forwards?

    ``1 = I A + d A / (jw) + k A / (jw)^2`` at low frequencies, A the acceleration for torque 1:
    inertia and friction have to come out positive. A spring or gravity is allowed for.
    """
    low = _rigid(responses)
    if len(low) < _FREQUENCIES_MIN:
        return False
    coherence = np.minimum(responses.coherence["theta1"][low], _COHERENCE_MAX)
    weight = np.sqrt(coherence / (1.0 - coherence))
    j = 1j * responses.omega[low]
    gain = responses.gain["theta1"][low]
    columns = np.stack([gain, gain / j, gain / j**2], axis=1) * weight[:, None]
    matrix = np.vstack([columns.real, columns.imag])
    matrix /= np.sqrt(np.sum(matrix**2, axis=0))
    wanted = np.concatenate([weight, np.zeros_like(weight)])
    inverse = np.linalg.pinv(matrix)
    solution = inverse @ wanted
    off = wanted - matrix @ solution
    spread = float(off @ off) / (len(wanted) - len(solution)) * np.sum(inverse**2, axis=1)
    inertia, friction, _ = solution / np.sqrt(np.maximum(spread, 1e-300))
    against, forward = sorted((float(inertia), float(friction)))
    return against < -_SURE and forward < -_DOUBT * against


def _rigid(responses: Responses) -> npt.NDArray[np.int64]:
    """The frequencies of little twist, at which the axis is rigid; with one encoder the lowest."""
    related = np.flatnonzero(responses.related("theta1"))
    if "twist" not in responses.gain:
        return related[: max(int(_RIGID_SHARE * len(related)), _FREQUENCIES_MIN)]
    twist = np.abs(responses.gain["twist"] / responses.gain["theta1"])[related]
    return related[twist < _RIGID_TWIST]
