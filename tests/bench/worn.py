"""A record of a worn axis, for everybody: 60 s at 1 kHz, two encoders, dry friction at the table.

Made by the simulator that the hidden effects are made with (tests/hidden/truth.py), which shares
nothing with the core and finds every moment at which the table sticks or breaks away.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from truth import Encoder, Friction, Truth, simulate

from axistwin import core

Array = NDArray[np.float64]

AXIS = core.Axis(1e-3, 5e-4, 5e-3, 20.0)
COULOMB = 0.02  # [N m], at the table
TIME_STEP = 1e-3
DURATION = 60.0
COUNTS = 2.0**20


@dataclass(frozen=True)
class Worn:
    """Torque (n,) [N m], true motion (n, 4) (angles, speeds), angles as measured (n, 2) [rad]."""

    torque: Array
    motion: Array
    measured: Array

    @property
    def time(self) -> Array:
        """Of the samples (n,) [s]."""
        return TIME_STEP * np.arange(len(self.torque), dtype=np.float64)


@functools.cache
def record() -> Worn:
    """The record: a multisine of 160 lines up to twice the resonance, held between samples."""
    count = round(DURATION / TIME_STEP)
    torque = np.resize(core.schroeder(2048, 160, 0.2), count)
    encoder = Encoder(counts=COUNTS)
    axis = Truth(
        AXIS.I1,
        AXIS.I2,
        AXIS.B,
        AXIS.K,
        friction2=Friction(coulomb=COULOMB),
        encoder1=encoder,
        encoder2=encoder,
    )
    run = simulate(axis, TIME_STEP, torque)
    return Worn(torque, run.states[:, :4].copy(), run.readings)
