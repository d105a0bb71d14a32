"""Records of emulated axes for the tests of identification, made by the C core."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from axistwin import core
from axistwin.identify import Quantity
from axistwin.record import Record

PARAMETERS = ("I1", "I2", "B", "K")

#: The paper's second setting: Dt = 2 pi k / (N wn).
PERIOD, LINE = 2048, 146

#: One step of the torque on the wire: a tenth of a per mille of 0.64 N m.
TORQUE_STEP = 0.64e-4

_TURN = 2.0 * np.pi


def excitation(rms: float = 0.2, seed: int = 0) -> tuple[core.Array, float]:
    """One period of the excitation as it goes over the wire, and the time step it is made for."""
    table = core.schroeder(PERIOD, 2 * LINE, rms, seed=seed, precision="float32")
    time_step = core.time_step(PERIOD, LINE, core.modal(core.paper_axis()).wn)
    return np.float64(TORQUE_STEP) * np.rint(table / TORQUE_STEP), time_step


def evenly(count: int, time_step: float) -> core.Array:
    """Times of ``count`` samples [s]."""
    return time_step * np.arange(count, dtype=np.float64)


def trace(
    seed: int = 1,
    *,
    axis: core.Axis | None = None,
    samples: int = 2048,
    run_up: int = 3000,
    rms: float = 0.2,
    counts: tuple[int, int] = (2**20, 2**20),
    decimation: int = 1,
) -> Record:
    """What a drive records in mid-run: single precision plant, encoder counts, torque on the wire.

    The run-up makes the axis travel and vibrate before the first sample.
    """
    table, time_step = excitation(rms, seed)
    torque = np.resize(table, run_up + samples * decimation)
    motion = core.simulate(axis or core.paper_axis(), time_step, torque, precision="float32")
    chosen = slice(run_up, None, decimation)
    angles = core.read_encoders(motion, counts)[chosen] * (_TURN / np.array(counts))
    step = time_step * decimation
    return Record(
        time=evenly(samples, step),
        torque=torque[chosen],
        theta1=angles[:, 0],
        theta2=angles[:, 1],
        time_step=step,
        counts_per_turn=counts,
        source="trace.csv",
    )


def ideal(
    axis: core.Axis,
    time_step: float,
    torque: core.Array,
    *,
    precision: core.Precision = "float64",
    speeds: bool = False,
    state: core.State | None = None,
) -> Record:
    """The motion itself, not rounded to counts."""
    motion = core.simulate(axis, time_step, torque, state, precision=precision)
    return Record(
        time=evenly(len(torque), time_step),
        torque=torque,
        theta1=motion.theta1,
        theta2=motion.theta2,
        omega1=motion.omega1 if speeds else None,
        omega2=motion.omega2 if speeds else None,
        time_step=time_step,
    )


def relative_errors(params: Mapping[str, Quantity], axis: core.Axis) -> core.Array:
    """Relative errors of I1, I2, B, K, (4,)."""
    return np.array([params[name].value / getattr(axis, name) - 1.0 for name in PARAMETERS])
