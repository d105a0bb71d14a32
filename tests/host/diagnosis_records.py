"""Records that the machine in C makes of an axis with effects, for the engine of the diagnosis."""

from __future__ import annotations

import numpy as np

from axistwin.core import Array, Axis, Effect
from axistwin.identify.samples import Hold
from axistwin.model import Model
from axistwin.record import Record

#: Resonance at 39 Hz, 245 rad/s.
AXIS = Axis(1e-3, 5e-4, 5e-3, 20.0)
STEP = 1e-3
NOISE = 1e-5

#: Steps of the machine between two samples: its own errors are then far below what is found.
SUBSTEPS = 16


def shake(samples: int, noise: float = 0.15, swing: float = 0.2) -> Array:
    """Torque [N m]: noise over all frequencies that move the axis, and a slow swing of many turns
    with many reversals."""
    white = np.random.default_rng(1).standard_normal(samples + 2)
    smooth = (white[:-2] + white[1:-1] + white[2:]) / 3.0
    torque: Array = noise * smooth + swing * np.sin(2.0 * np.pi * 1.1 * STEP * np.arange(samples))
    return torque


def record(*effects: Effect, torque: Array, axis: Axis = AXIS, hold: Hold = "zoh") -> Record:
    """What the machine does under a torque (n,), at rest in the beginning."""
    random = np.random.default_rng(2)
    motor, table = (
        angle + NOISE * random.standard_normal(len(torque))
        for angle in Model(axis, effects).simulate(torque, STEP, hold=hold, substeps=SUBSTEPS)
    )
    return Record(STEP * np.arange(len(torque), dtype=np.float64), torque, motor, STEP, table)
