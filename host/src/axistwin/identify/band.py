"""Torque against motion in the band that an inverse dynamic model is about.

The published recipe (M. Gautier, ICRA 1997; A. Janot, M. Gautier, M. Brunot, EMPS benchmark, 2019):
the position passes a low-pass forward and backward, so without delay; speed and acceleration are
central differences of it; then what is compared passes the same decimation filter, which takes
ripple above the band of interest out of both sides alike.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.signal

from axistwin.core import Array
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify.samples import Samples

#: The fastest motion to be explained, in samples a period, when nothing else is said: 20 Hz for a
#: position loop sampled at 1 kHz.
_SAMPLES_A_PERIOD = 50

#: Corner of the low-pass and of the decimation filter against that bandwidth, as published.
_LOW_PASS = 5.0
_DECIMATION = 0.2

#: Corner of scipy's decimation filter against the sample rate that it leaves.
_PASSED = 0.4

#: Samples at either end that the filters' start may have spoiled.
_BORDER = 50


@dataclass(frozen=True)
class Band:
    """``bandwidth`` [Hz] is that of the fastest motion to be explained, samples every ``time_step``
    [s] are thinned out by ``factor``."""

    time_step: float
    bandwidth: float

    @classmethod
    def of(cls, samples: Samples, bandwidth: float | None = None) -> Band:
        """Of a record; a fiftieth of its rate unless given.

        Raises InputError for a bandwidth beyond the record's rate, NotEnoughDataError for too few
        samples.
        """
        rate = 1.0 / samples.time_step
        if bandwidth is None:
            bandwidth = rate / _SAMPLES_A_PERIOD
        if not 0.0 < bandwidth < 0.5 * _DECIMATION * rate:
            raise InputError(
                f"a bandwidth of {bandwidth:g} Hz does not fit a record at {rate:g} Hz: "
                f"give one above 0 and below {0.5 * _DECIMATION * rate:g} Hz"
            )
        band = cls(samples.time_step, bandwidth)
        if samples.count < 2 * _BORDER + 10 * band.factor:
            raise NotEnoughDataError(
                f"{samples.count} samples are too few for a bandwidth of {bandwidth:g} Hz"
            )
        return band

    @property
    def factor(self) -> int:
        """One sample in so many is left."""
        return round(_DECIMATION / (self.bandwidth * self.time_step))

    @property
    def highest(self) -> float:
        """The frequency up to which torques are compared [Hz]."""
        return _PASSED / (self.factor * self.time_step)

    def smooth(self, position: Array) -> Array:
        """A position (n,) without what is far above the band, not delayed."""
        rate = 1.0 / self.time_step
        low_pass = scipy.signal.butter(4, _LOW_PASS * self.bandwidth, fs=rate, output="sos")
        smoothed: Array = scipy.signal.sosfiltfilt(low_pass, position)
        return smoothed

    def differentiate(self, position: Array) -> tuple[Array, Array]:
        """Speed and acceleration (n,) of the smoothed position (n,)."""
        speed = np.gradient(self.smooth(position), self.time_step)
        return speed, np.gradient(speed, self.time_step)

    def noise(self, count: int) -> tuple[float, float]:
        """Sizes of the noise of speed and acceleration for white noise of 1 in the position."""
        impulse = np.zeros(count)
        impulse[count // 2] = 1.0
        speed, acceleration = self.differentiate(impulse)
        return float(np.linalg.norm(speed)), float(np.linalg.norm(acceleration))

    def inner(self, signal: Array) -> Array:
        """A signal (n, ...) without its ends."""
        return signal[_BORDER:-_BORDER]

    def thin(self, signal: Array) -> Array:
        """The band of a signal (n, ...) without its ends, (m, ...)."""
        thinned: Array = scipy.signal.decimate(self.inner(signal), self.factor, axis=0)
        return thinned

    def time(self, count: int) -> Array:
        """Of the thinned samples (m,), from the first of ``count`` [s]."""
        time: Array = self.time_step * np.arange(count, dtype=np.float64)
        return self.inner(time)[:: self.factor]
