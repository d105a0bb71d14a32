"""A limit of the torque that is reached for a moment, in a window that nothing is fitted to."""

from __future__ import annotations

import numpy as np
import pytest

from axistwin.core import Array, Effect
from axistwin.diagnose import diagnose
from axistwin.diagnose.windows import FOLD

from .diagnosis_records import STEP, record, shake

WINDOW = 0.25
LIMIT = 0.6


def torque() -> Array:
    """Beyond the limit for a few samples of one window that is held out."""
    command = shake(6000, 0.1, 0.1)
    held_out = int((3 * FOLD - 0.5) * WINDOW / STEP)
    command[held_out : held_out + 3] = [0.65, 0.7, 0.62]
    assert np.count_nonzero(np.abs(command) > LIMIT) == 3
    return command


def test_a_limit_that_only_a_held_out_window_shows_is_named() -> None:
    limit = Effect("torque_saturation", "motor", {"limit": LIMIT})
    found = diagnose(record(limit, torque=torque()), window=WINDOW)
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
    found = diagnose(record(*other, torque=torque()), window=WINDOW)
    assert [(one.effect, one.location) for one in found.findings] == [
        (one.effect, one.location) for one in other
    ]
