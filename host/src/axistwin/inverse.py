"""Inverse dynamics: the torque that a model needs to move as it was measured (Eq. 18).

The two equations of motion are added, so that the shaft between the inertias drops out, and with it
the zero of the encoders and what acts in the shaft; with one encoder both inertias are taken to
move as one. All other effects of the model act along the measured motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy.interpolate

from axistwin.core import Array
from axistwin.diagnose import effects
from axistwin.diagnose.effects import DRY, FRICTION, EncoderDelay, Found, Motion, Push
from axistwin.diagnose.linear import TwoInertias
from axistwin.identify.band import Band
from axistwin.identify.result import Comparison, unit
from axistwin.identify.samples import Hold, Samples
from axistwin.model import Model

#: A speed below this many times its noise may be none, and hardly ever is that noise beyond it.
_KNOWN_SIGN = 4.0


def torque(model: Model, samples: Samples, band: Band, hold: Hold = "zoh") -> Comparison:
    """The torque that acted, as the model's drive makes it of the command, and the one needed.

    Both in the band, thinned out. Where an inertia rests, dry friction carries any torque up to
    its limit: of those that would do, the one nearest to what acted counts as needed.
    """
    found = [one for one in map(effects.of, model.effects) if one is not None]
    plant = TwoInertias(model.axis)
    motion = _motion(model, found, samples, band)
    acted = _acted([one.push(motion, plant) for one in found], samples.torque, hold)
    inertial = model.axis.I1 * motion.acceleration[0] + model.axis.I2 * motion.acceleration[1]
    needed = []
    for sign in (1.0, -1.0):  # what rests is held with all that friction has, one way or the other
        held = replace(motion, load=np.full_like(motion.load, sign * np.inf))
        friction = [one.push(held, plant) for one in found if isinstance(one.kind, FRICTION)]
        held = replace(held, friction=_at_places(friction, held))  # which may drift
        acting = _at_places([one.push(held, plant) for one in found], held)
        needed.append((inertial - np.sum(acting, axis=0))[0])
    nearest = np.clip(acted, np.minimum(*needed), np.maximum(*needed))
    return Comparison(
        "torque",
        unit("torque", samples.linear),
        band.time(samples.count),
        band.thin(band.smooth(acted)),
        band.thin(band.smooth(nearest)),
    )


def _motion(model: Model, found: Sequence[Found], samples: Samples, band: Band) -> Motion:
    """The measured motion of motor and table, in one window as long as the record."""
    angle = np.stack([samples.theta1, samples.theta1 if samples.theta2 is None else samples.theta2])
    nothing = np.zeros((2, 1, samples.count))
    time = samples.begin + samples.time_step * np.arange(samples.count, dtype=np.float64)
    grip = nothing.copy()
    for one in found:
        if isinstance(one.kind, DRY):
            grip[one.kind.place] += one.sizes[0]
    motion = Motion(
        time=time[None],
        time_step=samples.time_step,
        torque=samples.torque,
        index=np.arange(samples.count)[None],
        angle=samples.zero + angle[:, None],
        speed=nothing,
        acceleration=nothing,
        twist=nothing[0],
        twist_speed=nothing[0],
        friction=nothing,
        grip=grip,
        load=nothing,
        creep=np.zeros(2),
        turn=1.0 if samples.linear else 2.0 * np.pi,
    )
    angle = _turned(model, found, motion) - samples.zero
    speed, acceleration = np.stack([band.differentiate(one) for one in angle], axis=1)
    noise = np.std([one - band.smooth(one) for one in angle], axis=1)
    return replace(
        motion,
        angle=samples.zero + angle[:, None],
        speed=speed[:, None],
        acceleration=acceleration[:, None],
        creep=_KNOWN_SIGN * noise * band.noise(samples.count)[0],
    )


def _turned(model: Model, found: Sequence[Found], motion: Motion) -> Array:
    """Angles (2, n) without the errors of the encoders, which are small, and their delays."""
    angle: Array = motion.angle[:, 0].copy()
    plant, time = TwoInertias(model.axis), motion.time[0]
    for one in found:
        if not isinstance(one.kind, EncoderDelay):
            push = one.push(motion, plant)
            for i, error in enumerate((push.encoder1, push.encoder2)):
                angle[i] -= 0.0 if error is None else error[0]
    for one in found:
        if isinstance(one.kind, EncoderDelay):
            curve = scipy.interpolate.CubicSpline(time, angle[one.kind.place])
            angle[one.kind.place] = curve(np.minimum(time + one.shape[0], time[-1]))
    return angle


def _acted(pushes: Sequence[Push], command: Array, hold: Hold) -> Array:
    """The torque (n,) at the samples; held from each to the next it jumps there.

    What is straight from first to last in a step is shared by the samples at both its ends so that
    area and moment are kept.
    """
    first, last = command.copy(), command.copy()
    for push in pushes:
        if push.command is not None:
            first += push.command[0, 0]
            last += push.command[1, 0]
    if hold != "zoh":
        straight: Array = 0.5 * (first + last)
        return straight
    acted: Array = (2.0 * first + last) / 6.0
    acted[1:] += (first + 2.0 * last)[:-1] / 6.0
    acted[0] *= 2.0  # it was the same before
    return acted


def _at_places(pushes: Sequence[Push], motion: Motion) -> Array:
    """The torques (2, 1, n) at motor and table in all."""
    acting = np.zeros_like(motion.load)
    for push in pushes:
        for place, part in zip(acting, (push.motor, push.table), strict=True):
            if part is not None:
                place += part
    return acting
