"""Plants to begin with: near enough for effects to be told from what they leave."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from axistwin.diagnose.effects import Coulomb, Found, Offset, Push, Viscous
from axistwin.diagnose.fit import NEARLY_RIGHT, RIGHT, Fit, solve
from axistwin.diagnose.linear import Plant, Rigid
from axistwin.diagnose.parallel import each
from axistwin.diagnose.state import State
from axistwin.diagnose.windows import Windows
from axistwin.errors import NotEnoughDataError
from axistwin.identify.samples import Hold


def rigid_start(windows: Windows, hold: Hold) -> Rigid:
    """A first guess of a rigid axis: what its torque moves, with friction and load beside.

    Raises NotEnoughDataError when torque moves nothing.
    """
    fit = Fit(windows, hold, Rigid(1.0, 0.0))
    motion = fit.motion(None)
    command = motion.command()
    speed = np.gradient(fit.measured[0], windows.time_step, axis=1)
    pushes = [
        Push(command=np.stack([command, command])),
        Push(motor=-np.sign(speed)),
        Push(motor=np.ones_like(command)),
    ]
    columns = [fit.project(fit.answer([push])) for push in pushes]
    inverse = solve(np.stack(columns, axis=1), fit.project(fit.measured), ~windows.held_out)[0]
    if inverse <= 0.0:
        raise NotEnoughDataError(
            "the torque does not explain how the axis moves: excite it with more acceleration"
        )
    return Rigid(1.0 / float(inverse), 0.0)


def bases(start: Fit, hopeless: float = np.inf) -> list[State]:
    """Plants that are near enough for effects to be told, without any; one when that is clear.

    Friction and load drag both angles away from a plant that has none: while its parameters are
    adjusted there is some of both. Where even so the error is far from noise, from wherever it is
    adjusted, something else drags: then one plant is as the start, which looks at fast motion only,
    had it, and another as the adjustment left it. Beyond a ``hopeless`` error [noise squared] no
    other plants are tried.
    """
    channels = start.windows.channels
    dragging = (Coulomb(), Viscous(), Offset()) if channels == 2 else (Coulomb(), Offset())
    found = tuple(Found(kind, np.zeros(1), ()) for kind in dragging)
    start = start.with_noise(start.motion(None))

    def fitted(plant: Plant) -> State:
        state = State.along(replace(start, plant=plant, found=found))
        return State.along(state.fit.with_noise(state.motion), state.motion)

    best = fitted(start.plant)
    if RIGHT <= best.scale < hopeless:
        best = min([best, *each(fitted, start.plant.others())], key=lambda state: state.scale)
    if best.scale < NEARLY_RIGHT:
        without = State(replace(best.fit, found=()), best.motion)
        adjusted = State.along(without.fit, without.motion)
        return [adjusted if adjusted.scale < NEARLY_RIGHT else without]
    adjusted = State(replace(best.fit, found=(), noise=start.noise), best.motion)
    return sorted([State(start, start.motion(None)), adjusted], key=lambda state: state.scale)
