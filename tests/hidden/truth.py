"""An axis as it truly moves: the equations written down once more, solved adaptively, with events.

Nothing of the C core is used. Between two moments at which something jumps - the torque at a
sample, an inertia that comes to rest or breaks away, the shaft that meets or leaves a flank, the
load that changes - the motion is smooth and is integrated by the pair of Dormand and Prince of
orders 5 and 4 with step control; the moments themselves are found by bisection to the last digit.

Beside what axistwin can name there are truths that it cannot: friction that bends before it slips
(LuGre: Canudas de Wit, Olsson, Astrom, Lischinsky 1995), drag with the square of the speed,
friction that depends on the angle, a shaft with hysteresis (Dahl 1968), a motor whose torque
constant falls with torque.

What was decided where the physics leaves a choice:
* the torque is held from each sample to the next; a late torque changes that much later, wherever
  between two samples that is;
* when the load changes the speed goes on, not the momentum;
* shaft damping acts in contact only, and then also while it pulls;
* the further inertia comes on top of I2; its frequency and damping ratio are those of it alone with
  the table held;
* phases are told in the angle of the axis, in which a relaxed shaft has no twist, not in that of
  an encoder that was mounted anywhere;
* noise comes before the rounding to counts.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeVar, cast

import numba
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., Any])
Numbers = TypeVar("Numbers", bound=tuple[Any, ...])


def compiled(function: Function) -> Function:
    """Compiles a function to machine code, once: the result is kept beside the source."""
    return cast(Function, numba.njit(cache=True, error_model="numpy")(function))


class Friction(NamedTuple):
    """Friction of one inertia. All zero: none."""

    coulomb: float = 0.0  # [N m]
    viscous: float = 0.0  # [N m s/rad]
    stribeck: float = 0.0  # [N m] more than Coulomb's at rest
    stribeck_speed: float = 1.0  # [rad/s]
    drift: float = 0.0  # [1/s] of all of it
    square: float = 0.0  # [N m s2/rad2]
    uneven: float = 0.0  # share of Coulomb's that changes with the angle
    periods: float = 0.0  # a turn, of that
    bristles: float = 0.0  # [N m/rad] stiffness before it slips (LuGre); 0: it sticks
    bristle_damping: float = 0.0  # [N m s/rad]


class Wave(NamedTuple):
    """amplitude sin(rate x + phase)."""

    amplitude: float = 0.0
    rate: float = 0.0
    phase: float = 0.0


class Encoder(NamedTuple):
    """What an encoder does to an angle, in this order: late, in error, moved, noisy, in counts."""

    delay: float = 0.0  # [s]
    once: Wave = Wave()  # eccentricity [rad], in the angle of the axis
    lead: Wave = Wave()  # lead error [rad], likewise
    zero: float = 0.0  # [rad] where it was mounted
    counts: float = 0.0  # a turn, 0: not rounded


class Truth(NamedTuple):
    """An axis with whatever it does."""

    I1: float
    I2: float
    B: float
    K: float
    friction1: Friction = Friction()
    friction2: Friction = Friction()
    offset1: float = 0.0  # [N m]
    offset2: float = 0.0
    disturbance1: Wave = Wave()  # [N m], in time
    disturbance2: Wave = Wave()
    ripple: Wave = Wave()  # [N m], in the motor's angle
    gap: float = 0.0  # [rad]
    hardening: float = 0.0  # [N m/rad3]
    stiffness_drift: float = 0.0  # [1/s]
    hysteresis: float = 0.0  # [N m/rad] of a second spring that slips (Dahl)
    hysteresis_reach: float = 1.0  # [rad] at which it slips
    load_ratio: float = 0.0  # I2 becomes (1 + ratio) I2
    load_time: float = 0.0  # [s]
    mode_frequency: float = 1.0  # [rad/s]
    mode_damping: float = 0.0
    mode_mass: float = 0.0  # in units of I2
    torque_delay: float = 0.0  # [s]
    torque_limit: float = np.inf  # [N m]
    torque_fall: float = 0.0  # [1/(N m)2]: T becomes T (1 - fall T^2)
    encoder1: Encoder = Encoder()
    encoder2: Encoder = Encoder()


class Loop(NamedTuple):
    """A controller at the drive: position P, speed PI on the filtered difference of the encoder."""

    position: float = 0.0  # [1/s]
    speed: float = 0.0  # [N m s/rad]
    integral: float = 0.0  # [N m/rad]
    smoothing: float = 0.0  # share of the last speed that is kept, below 1


OPEN = Loop()

# State: angles, speeds of motor and table, then what is there but sometimes.
_Q1, _Q2, _W1, _W2, _Q3, _W3, _Z1, _Z2, _H = range(9)
STATES = 9

_NEVER = np.inf


@compiled
def _dry(f: Friction, t: float, q: float, w: float) -> float:
    """What dry friction holds against motion at most."""
    level = f.coulomb
    if f.uneven != 0.0:
        level *= 1.0 + f.uneven * np.sin(f.periods * q)
    if f.stribeck != 0.0:
        ratio = w / f.stribeck_speed
        level += f.stribeck * np.exp(-ratio * ratio)
    return level * max(0.0, 1.0 + f.drift * t)


@compiled
def _sticks(f: Friction) -> bool:
    return (f.coulomb > 0.0 or f.stribeck > 0.0) and f.bristles == 0.0


@compiled
def _drag(f: Friction, t: float, w: float) -> float:
    """Friction that is smooth in the speed."""
    return (f.viscous * w + f.square * w * abs(w)) * max(0.0, 1.0 + f.drift * t)


@compiled
def _bristle_rate(f: Friction, t: float, q: float, w: float, z: float) -> float:
    return w - abs(w) * f.bristles * z / _dry(f, t, q, w)


@compiled
def _wave(wave: Wave, x: float) -> float:
    return wave.amplitude * np.sin(wave.rate * x + wave.phase) if wave.amplitude != 0.0 else 0.0


@compiled
def _forces(
    p: Truth, t: float, y: Array, contact: int, torque: float
) -> tuple[float, float, float]:
    """Torques on motor, table and further inertia without dry friction that sticks."""
    twist, rate = y[_Q1] - y[_Q2], y[_W1] - y[_W2]
    shaft = 0.0
    if p.gap == 0.0 or contact != 0:
        z = twist - contact * 0.5 * p.gap
        K = p.K * max(0.0, 1.0 + p.stiffness_drift * t)
        shaft = K * z + p.hardening * z * z * z + p.B * rate
    if p.hysteresis != 0.0:
        shaft += p.hysteresis * y[_H]
    motor = torque + p.offset1 + _wave(p.ripple, y[_Q1]) + _wave(p.disturbance1, t) - shaft
    table = shaft + p.offset2 + _wave(p.disturbance2, t)
    motor -= _drag(p.friction1, t, y[_W1])
    table -= _drag(p.friction2, t, y[_W2])
    if p.friction1.bristles != 0.0:
        slip = _bristle_rate(p.friction1, t, y[_Q1], y[_W1], y[_Z1])
        motor -= p.friction1.bristles * y[_Z1] + p.friction1.bristle_damping * slip
    if p.friction2.bristles != 0.0:
        slip = _bristle_rate(p.friction2, t, y[_Q2], y[_W2], y[_Z2])
        table -= p.friction2.bristles * y[_Z2] + p.friction2.bristle_damping * slip
    mode = 0.0
    if p.mode_mass != 0.0:
        f = p.mode_frequency
        pull = f * f * (y[_Q2] - y[_Q3]) + 2.0 * p.mode_damping * f * (y[_W2] - y[_W3])
        mode = p.mode_mass * p.I2 * pull
    return motor, table - mode, mode


# How the axis moves now: which way motor and table slide (0: they stick), which flank is touched.
_SLIDE1, _SLIDE2, _CONTACT, _LOADED = range(4)


@compiled
def _rates(p: Truth, t: float, y: Array, how: Array, torque: float, rates: Array) -> None:
    motor, table, mode = _forces(p, t, y, int(how[_CONTACT]), torque)
    rates[_Q1] = y[_W1]
    rates[_Q2] = y[_W2]
    rates[_W1] = motor / p.I1
    rates[_W2] = table / (p.I2 * (1.0 + how[_LOADED] * p.load_ratio))
    if _sticks(p.friction1):
        dry = how[_SLIDE1] * _dry(p.friction1, t, y[_Q1], y[_W1])
        rates[_W1] = (motor - dry) / p.I1 if how[_SLIDE1] != 0.0 else 0.0
    if _sticks(p.friction2):
        inertia = p.I2 * (1.0 + how[_LOADED] * p.load_ratio)
        dry = how[_SLIDE2] * _dry(p.friction2, t, y[_Q2], y[_W2])
        rates[_W2] = (table - dry) / inertia if how[_SLIDE2] != 0.0 else 0.0
    for i in range(_Q3, STATES):
        rates[i] = 0.0
    if p.mode_mass != 0.0:
        rates[_Q3] = y[_W3]
        rates[_W3] = mode / (p.mode_mass * p.I2)
    if p.friction1.bristles != 0.0:
        rates[_Z1] = _bristle_rate(p.friction1, t, y[_Q1], y[_W1], y[_Z1])
    if p.friction2.bristles != 0.0:
        rates[_Z2] = _bristle_rate(p.friction2, t, y[_Q2], y[_W2], y[_Z2])
    if p.hysteresis != 0.0:
        rate = y[_W1] - y[_W2]
        rates[_H] = rate - abs(rate) * y[_H] / p.hysteresis_reach


@compiled
def _margin(p: Truth, t: float, y: Array, how: Array, torque: float, which: int) -> float:
    """How far the axis is from moving in another way: negative when it should already."""
    if which == _CONTACT:
        if p.gap == 0.0:
            return _NEVER
        twist = y[_Q1] - y[_Q2]
        if how[_CONTACT] == 0.0:
            return float(0.5 * p.gap - abs(twist))
        return float(how[_CONTACT] * twist - 0.5 * p.gap)
    f = p.friction1 if which == _SLIDE1 else p.friction2
    if not _sticks(f):
        return _NEVER
    if how[which] != 0.0:
        return float(how[which] * y[_W1 + which])
    force = _forces(p, t, y, int(how[_CONTACT]), torque)[which]
    limit = _dry(f, t, y[_Q1 + which], 0.0)
    return limit * (1.0 + 1e-9) - abs(force)


@compiled
def _least_margin(p: Truth, t: float, y: Array, how: Array, torque: float) -> float:
    least = _NEVER
    for which in range(3):
        least = min(least, _margin(p, t, y, how, torque, which))
    return least


@compiled
def _settle(p: Truth, t: float, y: Array, how: Array, torque: float) -> None:
    """Changes the way of moving until it is one that can go on."""
    for _ in range(8):
        changed = False
        for which in (_CONTACT, _SLIDE1, _SLIDE2):
            if _margin(p, t, y, how, torque, which) >= 0.0:
                continue
            changed = True
            if which == _CONTACT:
                twist = y[_Q1] - y[_Q2]
                how[_CONTACT] = 0.0 if how[_CONTACT] != 0.0 else np.sign(twist)
                continue
            y[_W1 + which] = 0.0
            how[which] = 0.0
            if _margin(p, t, y, how, torque, which) < 0.0:
                force = _forces(p, t, y, int(how[_CONTACT]), torque)[which]
                how[which] = np.sign(force)
        if not changed:
            return


# Dormand and Prince 1980: nodes, weights of the stages, and of the difference to order 4.
_NODE = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
_STAGE = np.array(
    [
        [0.0, 0.0, 0.0, 0.0, 0.0, 0.0],
        [1 / 5, 0.0, 0.0, 0.0, 0.0, 0.0],
        [3 / 40, 9 / 40, 0.0, 0.0, 0.0, 0.0],
        [44 / 45, -56 / 15, 32 / 9, 0.0, 0.0, 0.0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0.0, 0.0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0.0],
        [35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
_ERROR = np.array([71 / 57600, 0, -71 / 16695, 71 / 1920, -17253 / 339200, 22 / 525, -1 / 40])

_ANGLE_TOLERANCE = 1e-11  # [rad] a step
_HALVINGS = 44


@compiled
def _step(
    p: Truth, t: float, h: float, y: Array, how: Array, torque: float, k: Array, out: Array
) -> float:
    """One step into `out`; its error in units of the tolerance. k (7, STATES): k[0] is given."""
    fast = np.sqrt(p.K / p.I1 + p.K / p.I2)
    for stage in range(1, 7):
        for i in range(STATES):
            total = 0.0
            for j in range(stage):
                total += _STAGE[stage, j] * k[j, i]
            out[i] = y[i] + h * total
        _rates(p, t + _NODE[stage] * h, out, how, torque, k[stage])
    worst = 0.0
    for i in range(STATES):
        error = 0.0
        for j in range(7):
            error += _ERROR[j] * k[j, i]
        speed = i in (_W1, _W2, _W3)
        worst = max(worst, abs(h * error) / (_ANGLE_TOLERANCE * (fast if speed else 1.0)))
    return worst


@compiled
def _advance(
    p: Truth,
    t0: float,
    length: float,
    y: Array,
    how: Array,
    torque: float,
    step: float,
    work: tuple[Array, Array],
) -> float:
    """Moves y on by `length` [s] with the torque constant; the length of step to go on with.

    A negative answer means that it cannot be integrated.
    """
    k, new = work
    longest = 0.5 / np.sqrt(p.K / p.I1 + p.K / p.I2)  # or speed could change sign twice unseen
    passed = 0.0
    _settle(p, t0, y, how, torque)
    _rates(p, t0, y, how, torque, k[0])
    for _ in range(1_000_000):
        if passed >= length:
            return step
        t = t0 + passed
        h = min(step, longest, length - passed)
        last = h == length - passed
        error = _step(p, t, h, y, how, torque, k, new)
        if not error <= 1.0:  # NaN too
            step = h * (max(0.2, 0.9 * error**-0.2) if error < np.inf else 0.2)
            continue
        if _least_margin(p, t + h, new, how, torque) < 0.0:
            before, after = 0.0, h
            for _ in range(_HALVINGS):
                middle = 0.5 * (before + after)
                _step(p, t, middle, y, how, torque, k, new)
                if _least_margin(p, t + middle, new, how, torque) < 0.0:
                    after = middle
                else:
                    before = middle
            h, last = after, False
            _step(p, t, h, y, how, torque, k, new)
            y[:] = new
            _settle(p, t + h, y, how, torque)
            _rates(p, t + h, y, how, torque, k[0])
        else:
            y[:] = new
            k[0, :] = k[6]
            if not (last and step > h):  # a short last step says nothing of the next
                step = h * min(4.0, 0.9 * max(error, 1e-9) ** -0.2)
        passed = length if last else passed + h
    return -1.0


@compiled
def _shown(encoder: Encoder, angle: float) -> float:
    """What the encoder would show without noise and rounding."""
    return angle + _wave(encoder.once, angle) + _wave(encoder.lead, angle) + encoder.zero


@compiled
def _rounded(encoder: Encoder, angle: float) -> float:
    if encoder.counts == 0.0:
        return angle
    count = 2.0 * np.pi / encoder.counts
    return float(np.round(angle / count) * count)


@compiled
def _run(
    p: Truth,
    time_step: float,
    feed: Array,
    reference: Array,
    loop: Loop,
    noise: Array,
    start: Array,
    window: int,
    command: Array,
    states: Array,
    late: Array,
    shown: Array,
    readings: Array,
) -> int:
    """Fills in command (n,), states (n, STATES), late, shown and readings (n, 2); samples done.

    Every `window` samples the axis is put into a row of `start` (windows, STATES). `late` are the
    angles as late as the delays' parts of a sample say.
    """
    n = len(feed)
    whole = np.zeros(3, np.int64)
    part = np.zeros(3)
    for i, delay in enumerate((p.torque_delay, p.encoder1.delay, p.encoder2.delay)):
        whole[i] = int(np.floor(delay / time_step + 1e-9))
        part[i] = max(0.0, delay / time_step - whole[i])
    moments = np.array([part[0], 1.0 - part[1], 1.0 - part[2], 2.0, 1.0])
    k, new = np.zeros((7, STATES)), np.zeros(STATES)
    y, how = np.zeros(STATES), np.zeros(4)
    step, speed, integral, last_reading = 0.1 * time_step, 0.0, 0.0, 0.0
    for at in range(n):
        if at % window == 0:
            y[:] = start[at // window]
            twist = y[_Q1] - y[_Q2]
            how[_CONTACT] = np.sign(twist) if abs(twist) > 0.5 * p.gap else 0.0
            how[_SLIDE1] = np.sign(y[_W1])
            how[_SLIDE2] = np.sign(y[_W2])
            late[at, 0] = y[_Q1] - y[_W1] * part[1] * time_step
            late[at, 1] = y[_Q2] - y[_W2] * part[2] * time_step
        t0 = at * time_step
        states[at] = y
        first = at - at % window
        shown[at, 0] = _shown(p.encoder1, late[max(first, at - whole[1]), 0])
        shown[at, 1] = _shown(p.encoder2, late[max(first, at - whole[2]), 1])
        readings[at, 0] = _rounded(p.encoder1, shown[at, 0] + noise[at, 0])
        readings[at, 1] = _rounded(p.encoder2, shown[at, 1] + noise[at, 1])
        command[at] = feed[at]
        if loop.speed > 0.0:
            if at > 0:
                measured = (readings[at, 0] - last_reading) / time_step
                speed += (1.0 - loop.smoothing) * (measured - speed)
            last_reading = readings[at, 0]
            off = loop.position * (reference[at] - readings[at, 0]) - speed
            integral += loop.integral * off * time_step
            command[at] += loop.speed * off + integral
        if at == n - 1:
            break
        passed = 0.0
        moments[3] = 2.0
        how[_LOADED] = 1.0 if p.load_ratio != 0.0 and t0 >= p.load_time else 0.0
        if p.load_ratio != 0.0 and how[_LOADED] == 0.0:
            moments[3] = (p.load_time - t0) / time_step
        while passed < 1.0:
            end = 1.0
            for moment in moments:
                if passed < moment < end:
                    end = moment
            back = whole[0] + (1 if passed < part[0] else 0)
            torque = min(max(command[max(0, at - back)], -p.torque_limit), p.torque_limit)
            torque *= 1.0 - p.torque_fall * torque * torque
            step = _advance(
                p,
                t0 + passed * time_step,
                (end - passed) * time_step,
                y,
                how,
                torque,
                step,
                (k, new),
            )
            if step < 0.0 or not np.isfinite(y[_W1]):
                return at
            passed = end
            if passed == moments[1]:
                late[at + 1, 0] = y[_Q1]
            if passed == moments[2]:
                late[at + 1, 1] = y[_Q2]
            if passed == moments[3]:
                how[_LOADED] = 1.0
    return n


def _floats(numbers: Numbers) -> Numbers:
    """The same with every number a float: machine code is made for one type, once."""
    kind: Any = type(numbers)
    made: Numbers = kind(*(_floats(x) if isinstance(x, tuple) else float(x) for x in numbers))
    return made


@dataclass(frozen=True)
class Run:
    """What an axis did: the command (n,) [N m], its states (n, STATES), the readings (n, 2) [rad].

    ``shown`` (n, 2) are the readings without noise and rounding.
    """

    command: Array
    states: Array
    shown: Array
    readings: Array


def simulate(
    truth: Truth,
    time_step: float,
    feed: Array,
    *,
    reference: Array | None = None,
    loop: Loop = OPEN,
    noise: Array | None = None,
    start: Array | None = None,
    window: int | None = None,
) -> Run:
    """The motion under the torque `feed` (n,) [N m] and what a controller adds to it.

    The controller follows `reference` (n,) [rad] by the readings of encoder 1, which have `noise`
    (n, 2) [rad]. The axis starts in the state `start` (STATES,), at rest by default; with `window`
    samples it is put every so many into the next of `start` (windows, STATES), the past being that
    of an even motion. Raises RuntimeError when the motion cannot be integrated.
    """
    n = len(feed)
    places = np.zeros((1, STATES)) if start is None else np.atleast_2d(start)
    run = Run(np.zeros(n), np.zeros((n, STATES)), np.zeros((n, 2)), np.zeros((n, 2)))
    done = _run(
        _floats(truth),
        float(time_step),
        np.ascontiguousarray(feed),
        np.zeros(n) if reference is None else reference,
        _floats(loop),
        np.zeros((n, 2)) if noise is None else noise,
        np.ascontiguousarray(places),
        window or n,
        run.command,
        run.states,
        np.zeros((n, 2)),
        run.shown,
        run.readings,
    )
    if done < n:
        raise RuntimeError(f"the motion cannot be integrated at sample {done}")
    return run
