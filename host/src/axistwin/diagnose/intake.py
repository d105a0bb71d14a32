"""What is looked at before a record is diagnosed: can it be, is it what it says?

A fit takes any numbers. A diagnosis would explain exchanged encoders or a clipped channel by
effects that the axis does not have, so these are named first, each with what to do about it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from axistwin.core import Array
from axistwin.diagnose import channels, wiring
from axistwin.diagnose.advice import advise
from axistwin.diagnose.responses import Responses, measure
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.identify.samples import check_excitation, longest_stretch
from axistwin.record import Record

#: Samples a second of a servo axis: outside of this the time has another unit.
_RATE_MIN, _RATE_MAX = 20.0, 2e5

#: No motor is faster [rad/s, m/s], nor has a larger acceleration [rad/s2] times the cube root of
#: its torque [N m]: large and small motors have that in common, some 1e5 at best.
_SPEED_MAX = {False: 2e4, True: 1e2}
_LIVELINESS_MAX = 1e6

#: Inertias [kg m2] and masses [kg] that an axis may have.
_INERTIA = {False: (1e-10, 1e4), True: (1e-5, 1e6)}

#: What a radian may have become.
_UNITS = (
    (180.0 / np.pi, "degrees"),
    (0.5 / np.pi, "turns"),
    (1e3, "milliradians"),
    (1e-3, "thousands of radians"),
)

#: Relative precision to which a quantisation step is a turn divided; an encoder's bits at least.
_STEP_PRECISION = 1e-5
_BITS_MIN = 8

#: Fewer steps of the encoder are no motion.
_MOTION_MIN = 5

#: Torque and motion are related when the slow motion explains this share of the slow torque.
_EXPLAINED_MIN = 0.1

#: Parts of a record whose means are the slow torque and motion.
_PARTS = 200


@dataclass(frozen=True)
class Intake:
    """What is wrong with a record, and what it cannot tell; one clear line each.

    ``warnings`` are those of the record and what was found beside; ``advice`` names the experiment
    that would answer what this record cannot.
    """

    warnings: tuple[str, ...]
    advice: tuple[str, ...]


def examine(record: Record) -> Intake:
    """Examines a record before it is diagnosed, some seconds for 1e7 samples.

    Raises NotEnoughDataError for a record that is too short or has no excitation or no motion.
    Raises InputError when a channel is not what its name says: torque of another axis, encoders
    exchanged, reversed or on another scale than each other.
    """
    check_excitation(longest_stretch(record))
    warnings = [*record.warnings, *_rate(record), *_speeds(record), *_torque(record.torque)]
    whole = True
    for name, counts in zip(("theta1", "theta2"), record.counts_per_turn, strict=True):
        if name in record.channels:
            angle = record.channels[name]
            step = channels.resolution(angle)
            _check_motion(f"{record.source}: {name}", angle, step)
            cut = _clipped(name, angle, step)
            whole &= not cut
            warnings += [*cut, *_disturbed(name, angle, step)]
            warnings += [] if record.linear else _scale(name, step, counts)
    responses = _connected(record, whole)
    warnings += _plausible(record, responses)
    return Intake(tuple(warnings), advise(record, responses))


# ---- Each channel by itself


def _rate(record: Record) -> list[str]:
    rate = 1.0 / record.time_step
    if _RATE_MIN <= rate <= _RATE_MAX:
        return []
    unit = "milliseconds: --scale t=1e-3" if rate > 1e-3 * _RATE_MIN else "microseconds: t=1e-6"
    hint = f"; is the time in {unit}" if rate < _RATE_MIN else ""
    return [f"{rate:.4g} samples a second are not those of a servo axis{hint}"]


def _check_motion(name: str, angle: Array, step: float | None) -> None:
    if step is not None and float(np.ptp(angle)) < _MOTION_MIN * step:
        raise NotEnoughDataError(
            f"{name} moves by less than {_MOTION_MIN} steps of its encoder: release the brake, or "
            "excite with more torque"
        )


def _clipped(name: str, angle: Array, step: float | None) -> list[str]:
    dwell = channels.clipped(angle, step, smooth=True)
    if dwell is None:
        return []
    return [
        f"{name} is cut off at {dwell.level:.4g}: it stops dead there {dwell.times} times "
        f"({100.0 * dwell.share:.2g} % of the samples); look for an end stop, or for the largest "
        "number that the log can hold"
    ]


def _disturbed(name: str, angle: Array, step: float | None) -> list[str]:
    times, share = channels.repeated(angle, step)
    if times > 0:
        return [
            f"{name} has {times} spikes of the sampling: it stands still in full motion and "
            f"catches up with the next sample ({100.0 * share:.2g} % of the samples are repeats); "
            "log every sample once, with its own time"
        ]
    outliers = channels.outliers(np.diff(angle), step)
    if outliers is None:
        return []
    return [
        f"{name} jumps between two samples {len(outliers.at)} times, by up to "
        f"{outliers.largest:.3g}, first at sample {outliers.at[0]}: lost or disturbed samples, "
        "not motion"
    ]


def _torque(torque: Array) -> list[str]:
    found = []
    step = channels.resolution(torque)
    dwell = channels.clipped(torque, step, smooth=False)
    if dwell is not None:
        found.append(
            f"the torque is cut off at {dwell.level:.4g}: it stays there {dwell.times} times "
            f"({100.0 * dwell.share:.2g} % of the samples); excite with less torque, or log the "
            "torque that acts"
        )
    outliers = channels.outliers(torque, step)
    if outliers is not None:
        found.append(
            f"the torque has {len(outliers.at)} spikes of a sample, up to {outliers.largest:.3g} "
            f"beyond its neighbours, first at sample {outliers.at[0]}: of the sampling, or of a "
            "controller that stumbled over it"
        )
    return found


def _scale(name: str, step: float | None, counts: int | None) -> list[str]:
    """Warns when the quantisation step is that of an encoder in another unit."""
    if step is None:
        return []
    if abs(step - round(step)) < _STEP_PRECISION * step:
        return [
            f"{name} is in whole numbers: in encoder counts? Make it radians with "
            f"--scale {name}=FACTOR, 2 pi / counts a turn"
        ]
    for radian, unit in _UNITS:
        per_turn = 2.0 * np.pi * radian / step
        # unless the counts are known an encoder can only be told by its power of two
        like = counts or 2 ** max(round(np.log2(per_turn)), _BITS_MIN)
        if abs(per_turn / like - 1.0) < _STEP_PRECISION:
            return [
                f"{name} looks like {unit}: its step is that of an encoder with {like} counts a "
                f"turn; make it radians with --scale {name}={1.0 / radian:.9g}"
            ]
    return []


def _speeds(record: Record) -> list[str]:
    """Warns of speeds that are not the rate of their angle."""
    found = []
    for angle, speed in (("theta1", "omega1"), ("theta2", "omega2")):
        if speed in record.channels:
            rate = np.gradient(record.channels[angle], record.time_step)
            factor = wiring.proportion(rate, record.channels[speed])
            if factor is None:
                found.append(f"{speed} is not the speed of {angle}: another axis, or much delayed?")
            elif not wiring.agree(factor):
                size, why = wiring.reason(factor)
                why = "reversed" if wiring.agree(-factor) else why
                found.append(
                    f"{speed} is {factor:.4g} times the rate of {angle} ({why}): "
                    f"--scale {speed}={np.copysign(1.0 / size, factor):.6g}, or the time has "
                    "another unit"
                )
    return found


# ---- The channels together


def _connected(record: Record, whole: bool) -> Responses:
    """The responses of the axis, whose angles are ``whole`` or cut off.

    Raises InputError when the channels do not belong together.
    """
    wrong = []
    torque, theta1, theta2 = record.torque, record.theta1, record.theta2
    factor = None if theta2 is None or not whole else wiring.proportion(theta1, theta2)
    if theta2 is not None and factor is not None and not wiring.agree(factor):
        theta2 = theta2 / factor
        if not wiring.agree(abs(factor)):
            size, why = wiring.reason(factor)
            wrong.append(
                f"theta2 moves {abs(factor):.4g} times as far as theta1 ({why}): "
                f"--scale theta2={1.0 / size:.9g}, or theta1={size:.9g}"
            )
    responses = _measure(torque, theta1, theta2, record.time_step)
    if theta2 is not None and (swap := wiring.exchange(responses)) is not None and swap.sure:
        theta1, theta2 = theta2, theta1
        responses = _measure(torque, theta1, theta2, record.time_step)
        wrong.append(
            "theta1 and theta2 are exchanged: the torque acts on the acceleration of theta2, the "
            f"shaft on theta1 (misfit {swap.exchanged:.2g} that way, {swap.as_named:.2g} as "
            "named): --map theta1 and theta2 the other way round"
        )
    if not np.any(responses.related("theta1")) and _explained(record) < _EXPLAINED_MIN:
        raise InputError(
            f"{record.source}: torque and motion have nothing to do with each other: is it the "
            "torque of this axis? --map torque=COLUMN"
        )
    backwards = wiring.pushed_back(responses)
    if factor is not None and factor < 0.0:
        name = "theta1" if backwards else "theta2"
        wrong.append(f"{name} is reversed: it runs against the other encoder: --scale {name}=-1")
    elif backwards:
        wrong.append(
            "torque, or every angle, is reversed: the inertia would be negative: --scale torque=-1"
        )
    if wrong:
        raise InputError(f"{record.source}: {'; '.join(wrong)}")
    return responses


def _measure(torque: Array, theta1: Array, theta2: Array | None, time_step: float) -> Responses:
    angles = {"theta1": theta1}
    if theta2 is not None:
        angles |= {"theta2": theta2, "twist": theta1 - theta2}
    return measure(torque, angles, time_step)


def _explained(record: Record) -> float:
    """The share of the slow torque that inertia, viscous and dry friction and an offset explain."""
    length = max(len(record) // _PARTS, 1)
    whole = len(record) // length * length
    torque, angle = (
        values[:whole].reshape(-1, length).mean(axis=1) for values in (record.torque, record.theta1)
    )
    speed = np.gradient(angle)
    columns = [np.gradient(speed), speed, np.sign(speed), np.ones_like(speed)]
    columns = [column / (np.max(np.abs(column)) or 1.0) for column in columns]
    off = torque - np.column_stack(columns) @ np.linalg.lstsq(np.column_stack(columns), torque)[0]
    spread = float(np.var(torque))
    return 1.0 - float(np.var(off)) / spread if spread > 0.0 else 0.0


def _plausible(record: Record, responses: Responses) -> list[str]:
    """Warns of numbers that no motor has: torque alone has no other yardstick."""
    found = []
    angle, inertia_unit = ("m", "kg") if record.linear else ("rad", "kg m2")
    speed = float(np.quantile(np.abs(np.diff(record.theta1)), 0.99)) / record.time_step
    if speed > _SPEED_MAX[record.linear]:
        found.append(
            f"theta1 moves at {speed:.3g} {angle}/s, faster than any motor: is it in {angle}?"
        )
    related = responses.related("theta1")
    if not np.any(related):
        return found
    inertia = 1.0 / float(np.median(np.abs(responses.gain["theta1"][related])))
    low, high = _INERTIA[record.linear]
    torque = float(np.std(record.torque))
    lively = not record.linear and torque ** (4.0 / 3.0) / inertia > _LIVELINESS_MAX
    if lively or not low < inertia < high:
        found.append(
            f"torque and motion make an axis of about {inertia:.2g} {inertia_unit}, which is hard "
            "to believe: check the units of torque, theta1 and time, a factor of 1000 is soon lost"
        )
    return found
