"""What the node's estimator says of its own errors, against the scatter of a thousand runs."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pytest

from axistwin import core

RUNS = 1000
PERIOD = 512
PERIODS = 4
COUNTS = 2**20
Array = npt.NDArray[np.float64]


def runs(forgetting: float, encoders: bool) -> tuple[Array, Array, Array]:
    """Truth (6,), and found values and stated errors (RUNS, 6): I1, I2, B, K, wn, zeta.

    A torque that the estimator does not know of, its mean over each step white, shakes the axis,
    and with encoders their rounding comes on top.
    """
    axis = core.paper_axis()
    modal = core.modal(axis)
    step = core.time_step(PERIOD, 10, modal.wn)
    torque = np.tile(core.schroeder(PERIOD, 20, 0.2), PERIODS)
    settings = core.IdentSettings(step, axis, 0.2, forgetting=forgetting)
    random = np.random.default_rng(5)
    found, stated = np.zeros((RUNS, 6)), np.zeros((RUNS, 6))
    for run in range(RUNS):
        disturbance = white_means(random, torque.size)
        state = core.State(speed=random.uniform(-3, 3), angle=random.uniform(0, 1))
        motion = core.simulate(axis, step, torque + disturbance, state)
        if encoders:
            counts = core.read_encoders(motion, (COUNTS, COUNTS))
            last = core.identify_counts(settings, counts, (COUNTS, COUNTS), torque).last
        else:
            last = core.identify_motion(settings, motion, torque).last
        found[run] = values(last.axis, last.modal)
        stated[run] = values(last.axis_error, last.modal_error)
    return values(axis, modal), found, stated


def white_means(random: np.random.Generator, length: int) -> Array:
    """Torque whose mean of two neighbours is white, of 2 mN m."""
    fresh = random.normal(0, 2e-3, length)
    signs = (-1.0) ** np.arange(length)
    means: Array = signs * np.cumsum(2 * fresh * signs)
    return means


def values(axis: core.Axis, modal: core.Modal) -> Array:
    """The six quantities in a row."""
    return np.array([axis.I1, axis.I2, axis.B, axis.K, modal.wn, modal.zeta])


@pytest.mark.parametrize("forgetting", [1.0, 0.999])
@pytest.mark.parametrize("encoders", [False, True], ids=["motion", "counts"])
def test_stated_errors_are_the_scatter_of_a_thousand_runs(
    forgetting: float, encoders: bool
) -> None:
    truth, found, stated = runs(forgetting, encoders)
    scatter = found.std(axis=0)
    ratio = np.sqrt((stated**2).mean(axis=0)) / scatter
    assert np.all(np.abs(ratio - 1) < 0.2), ratio
    assert np.all(np.abs(found.mean(axis=0) - truth) < 0.3 * scatter)
