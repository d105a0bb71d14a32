"""What a record cannot tell, and the experiment that would."""

from __future__ import annotations

import math

import numpy as np

from axistwin.core import Array
from axistwin.diagnose.responses import Responses
from axistwin.record import Record

#: Travel in one direction for less than this share is no reversal.
_REVERSAL_SHARE = 2e-3

#: A step of an angle is motion when it is this many times its noise.
_CLEAR = 4.0

#: Frequencies beyond a resonance that show it.
_BEYOND_MIN = 3

#: Up to this share of half the sampling rate there is room for an excitation further up, and how
#: much further.
_NEAR_NYQUIST = 0.5
_FURTHER = 3.0

#: Shorter records [s] do not show what changes slowly.
_LONG_ENOUGH = 10.0

_ONE_ENCODER = (
    "one encoder: stiffness, backlash and friction of the table cannot be told from this record; "
    "log an encoder at the table (theta2), too: axistwin trace --excite"
)

#: A period of the excitation that every node has room for [samples].
_LENGTH = 8192


def advise(record: Record, responses: Responses) -> tuple[str, ...]:
    """One line for each kind of question that a record leaves open."""
    lines = [
        _reversal(record),
        _ONE_ENCODER if record.theta2 is None else _resonance(record, responses),
        _turn(record),
        _duration(record),
    ]
    return tuple(line for line in lines if line is not None)


def _excite(record: Record, *options: str) -> str:
    """The command that excites a node's axis at least as much as here."""
    rms = float(np.std(record.torque))
    return " ".join(["axistwin excite on", *options, f"--rms {rms:.2g}"])


def _reversal(record: Record) -> str | None:
    if _travels_both_ways(record.theta1):
        return None
    return (
        "the axis moves in one direction only: Coulomb friction cannot be told from an offset; "
        f"excite it about standstill: {_excite(record, f'--length {_LENGTH}', '--first 1')}"
    )


def _travels_both_ways(angle: Array) -> bool:
    """Does it travel back by more than noise does?"""
    noise = float(np.std(np.diff(angle, 3))) / math.sqrt(20.0)
    lag = 1
    while True:
        steps = angle[lag:] - angle[:-lag]
        size = np.abs(steps)
        clear = size > _CLEAR * noise
        if np.sum(size[clear]) > 0.9 * np.sum(size) or 20 * lag > len(angle):
            break
        lag *= 2
    forward, backward = (float(np.sum(size[clear & (way * steps > 0.0)])) for way in (1, -1))
    return min(forward, backward) > _REVERSAL_SHARE * (forward + backward)


def _resonance(record: Record, responses: Responses) -> str | None:
    """Is there motion about the resonance of motor against table?"""
    if _resonance_seen(responses):
        return None
    highest = float(np.max(responses.omega[responses.related("twist")], initial=0.0))
    highest /= 2.0 * math.pi
    rate = 1.0 / record.time_step
    what = (
        f"the twist shows no resonance up to {highest:.3g} Hz"
        if highest > 0.0
        else "the twist does not follow the torque at any frequency"
    )
    what += ": stiffness, damping and hardening of the shaft are uncertain"
    if highest > _NEAR_NYQUIST * 0.5 * rate:
        return (
            f"{what}; half the sampling rate is {0.5 * rate:.4g} Hz, take a trace at the full "
            "control rate: axistwin trace --excite"
        )
    wanted = _FURTHER * highest if highest > 0.0 else 0.5 * _NEAR_NYQUIST * rate
    lines = min(math.ceil(wanted / rate * _LENGTH), _LENGTH // 2 - 1)
    options = (f"--length {_LENGTH}", "--first 1", f"--lines {lines}")
    return (
        f"{what}; excite up to {lines * rate / _LENGTH:.3g} Hz, at a control rate of {rate:.4g} "
        f"Hz: {_excite(record, *options)}"
    )


def _resonance_seen(responses: Responses) -> bool:
    """Does the twist go with the torque at low frequencies, and against it at some higher ones?

    At all of those that lie between the two, that is: the largest fall of the sum over frequencies.
    """
    related = responses.related("twist")
    acceleration = responses.gain["twist"][related]
    if len(acceleration) == 0:
        return False
    with_torque = np.cumsum(-np.real(acceleration / np.abs(acceleration)))
    fall = np.maximum.accumulate(with_torque) - with_torque
    return bool(np.max(fall) > _BEYOND_MIN)


def _turn(record: Record) -> str | None:
    turns = float(np.ptp(record.theta1)) / (2.0 * math.pi)
    if record.linear or turns >= 1.0:
        return None
    return (
        f"theta1 travels {turns:.2g} turns: what repeats once a turn (eccentricity, lead error) "
        f"cannot be told; let it turn: {_excite(record, '--length 32768', '--lines 4')}"
    )


def _duration(record: Record) -> str | None:
    if record.duration >= _LONG_ENOUGH:
        return None
    return (
        f"{record.duration:.3g} s are too short for what changes slowly (warm-up of friction and "
        f"stiffness); log some minutes: {_excite(record, '--duration 300')}"
    )
