"""A limit of the torque that is reached for a moment, in a window that nothing is fitted to."""

from __future__ import annotations

import numpy as np
import pytest

from axistwin.core import Array, Axis, Effect
from axistwin.diagnose import diagnose
from axistwin.diagnose.windows import FOLD
from axistwin.model import Model
from axistwin.record import Record

AXIS = Axis(1e-3, 5e-4, 5e-3, 20.0)
STEP = 1e-3
LENGTH = 6000
NOISE = 1e-5
WINDOW = 0.25
LIMIT = 0.6


def torque() -> Array:
    """Beyond the limit for a few samples of one window that is held out."""
    noise = np.random.default_rng(1).standard_normal(LENGTH + 2)
    smooth = (noise[:-2] + noise[1:-1] + noise[2:]) / 3.0
    command: Array = 0.1 * smooth + 0.1 * np.sin(2.0 * np.pi * 1.1 * STEP * np.arange(LENGTH))
    held_out = int((3 * FOLD - 0.5) * WINDOW / STEP)
    command[held_out : held_out + 3] = [0.65, 0.7, 0.62]
    assert np.count_nonzero(np.abs(command) > LIMIT) == 3
    return command


def record(*effects: Effect) -> Record:
    """What the machine in C does under torque()."""
    random = np.random.default_rng(2)
    command = torque()
    motor, table = (
        angle + NOISE * random.standard_normal(LENGTH)
        for angle in Model(AXIS, effects).simulate(command, STEP, substeps=16)
    )
    return Record(STEP * np.arange(LENGTH, dtype=np.float64), command, motor, STEP, table)


def test_a_limit_that_only_a_held_out_window_shows_is_named() -> None:
    found = diagnose(record(Effect("torque_saturation", "motor", {"limit": LIMIT})), window=WINDOW)
    assert [(one.effect, one.location) for one in found.findings] == [
        ("torque_saturation", "motor")
    ]
    assert found.findings[0].params["limit"] == pytest.approx(LIMIT, rel=1e-3)


@pytest.mark.parametrize(
    "other",
    [
        (),
        (Effect("friction_coulomb", "motor", {"torque": 0.01}),),
        (Effect("backlash", "shaft", {"gap": 1e-3}),),
    ],
    ids=["nothing", "friction", "backlash"],
)
def test_a_large_command_is_not_taken_for_a_limit(other: tuple[Effect, ...]) -> None:
    found = diagnose(record(*other), window=WINDOW)
    assert [(one.effect, one.location) for one in found.findings] == [
        (one.effect, one.location) for one in other
    ]
