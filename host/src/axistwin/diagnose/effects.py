"""The catalogue as the diagnosis sees it: what each effect adds along a motion that is known.

A kind of effect has ``sizes``, in proportion to which it acts, and a ``shape``, which decides how
(a speed, a frequency, a gap). Along a measured motion its pushes are known for each shape; the
sizes then follow by least squares.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import scipy.interpolate

from axistwin import core
from axistwin.core import Array, Effect
from axistwin.diagnose.linear import Plant, TwoInertias

Shape = tuple[float, ...]

#: Moments at which the load may have changed that are tried first.
_MOMENTS = 64

#: Windows that have to be left on either side of a moment.
_SOME = 3

#: A mode that is damped more than this shows no resonance of its own.
_NO_RESONANCE = 0.15

#: A further mode has at least this share of the table's inertia: with less, all that it explains is
#: what its initial states may.
_MASS_RATIO_MIN = 1e-5

#: A change of speed by this share of what matters is fine enough; otherwise a step is divided into
#: so many parts.
_FINE = 0.25
_PARTS = 32

#: An axis that moves both ways does so for this share of the time, at this share of its speed.
_BOTH_SHARE = 0.01
_BOTH_WAYS = 0.1

#: The shape of a wave that there is once a turn.
_ONCE: Shape = (1.0,)

#: Places of a torque, and channels.
MOTOR, TABLE = 0, 1
_PLACES = ("motor", "table")


@dataclass(frozen=True)
class Motion:
    """How the axis moves in the windows (w, l), as far as is known.

    ``angle``, ``speed``, ``acceleration`` (c, w, l) [rad], the angles as the record counts them;
    ``torque`` (n,) of the whole record; ``twist`` is without the zero of the encoders. At each
    place (c, w, l) [N m]: ``friction`` is the torque of the friction that has been found so far,
    ``grip`` up to what it holds the axis at rest, and ``load`` what acts on it beside friction. A
    speed below ``creep`` (c,) may be none. A ``turn`` is 2 pi rad, or 1 m of a linear
    axis.
    """

    time: Array
    time_step: float
    torque: Array
    index: npt.NDArray[np.int64]
    angle: Array
    speed: Array
    acceleration: Array
    twist: Array
    twist_speed: Array
    friction: Array
    grip: Array
    load: Array
    creep: Array
    turn: float

    def recut(self, length: int) -> Motion:
        """The same in windows of another length."""

        def recut(values: Array) -> Array:
            return values.reshape(*values.shape[:-2], -1, length)

        return replace(
            self,
            time=recut(self.time),
            index=self.index.reshape(-1, length),
            angle=recut(self.angle),
            speed=recut(self.speed),
            acceleration=recut(self.acceleration),
            twist=recut(self.twist),
            twist_speed=recut(self.twist_speed),
            friction=recut(self.friction),
            grip=recut(self.grip),
            load=recut(self.load),
        )

    def command(self, steps: int = 0) -> Array:
        """The torque (w, l) as it was so many samples earlier."""
        earlier: Array = self.torque[np.maximum(self.index - steps, 0)]
        return earlier


@dataclass(frozen=True)
class Push:
    """What acts (w, l) where: torques [N m] at motor and table, straight from sample to sample, and
    errors of the encoders [rad]. What is added to the ``command`` (2, w, l) goes straight from the
    first value to the second until the next sample, and jumps there."""

    motor: Array | None = None
    table: Array | None = None
    command: Array | None = None
    encoder1: Array | None = None
    encoder2: Array | None = None


def torque_at(place: int, torque: Array) -> Push:
    """A torque at motor or table."""
    return Push(motor=torque) if place == MOTOR else Push(table=torque)


def _reads(channel: int, error: Array) -> Push:
    return Push(encoder1=error) if channel == MOTOR else Push(encoder2=error)


@dataclass(frozen=True)
class Kind:
    """An effect at a place. ``place`` is that of its torque, or the channel of its encoder."""

    place: int = MOTOR

    effect = ""
    #: What the catalogue calls the sizes, which act in proportion, and the numbers of the shape.
    #: Without sizes, the shape alone says what is added.
    size_names: ClassVar[tuple[str, ...]] = ()
    shape_names: ClassVar[tuple[str, ...]] = ()
    #: Whether the numbers of the shape can be adjusted continuously, and the relative step of the
    #: differences that do.
    adjustable = True
    difference = 1e-4
    #: Whether it begins, or all of it happens, at a moment that may be in a window held out.
    moment = False

    @property
    def sizes(self) -> int:
        """How many there are."""
        return len(self.size_names)

    @property
    def location(self) -> str:
        return _PLACES[self.place]

    @property
    def name(self) -> str:
        return f"{self.effect}:{self.location}"

    def shapes(self, motion: Motion) -> Sequence[Shape]:
        """Shapes to begin with, close enough for one of them to be adjusted to the best."""
        return [()]

    def around(self, motion: Motion, shape: Shape, level: int) -> Sequence[Shape]:
        """Shapes next to a good one, closer for each ``level``, where it cannot be adjusted from
        afar."""
        return []

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        """What is added for each size of 1, or in all if there are no sizes."""
        raise NotImplementedError

    def params(self, sizes: Array, shape: Shape) -> dict[str, float]:
        """The parameters as the catalogue names them."""
        values = (*sizes.tolist(), *shape)
        return dict(zip((*self.size_names, *self.shape_names), values, strict=True))

    def found(self, params: Mapping[str, float]) -> Found:
        """The effect that has these parameters; one that is left out is 0."""
        sizes = [params.get(name, 0.0) for name in self.size_names]
        shape = tuple(params.get(name, 0.0) for name in self.shape_names)
        return Found(self, np.array(sizes), shape)

    def plausible(self, sizes: Array, shape: Shape) -> bool:
        """Whether there can be such an effect."""
        return True

    def possible(self, motion: Motion, shape: Shape) -> bool:
        """Whether such a motion can show an effect of this shape."""
        return True


# ---- Friction and other torques at one place


class Coulomb(Kind):
    """Dry friction against the motion; at standstill what holds the load, up to its size."""

    effect = "friction_coulomb"
    size_names = ("torque",)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [torque_at(self.place, -_dry(motion, self.place, np.ones_like, np.inf))]

    def plausible(self, sizes: Array, shape: Shape) -> bool:
        return bool(sizes[0] > 0.0)


class Viscous(Kind):
    """Friction in proportion to speed."""

    effect = "friction_viscous"
    size_names = ("coefficient",)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [torque_at(self.place, -motion.speed[self.place])]

    def plausible(self, sizes: Array, shape: Shape) -> bool:
        return bool(sizes[0] > 0.0)


class Asymmetry(Kind):
    """Viscous friction that is more in one direction than in the other."""

    effect = "friction_asymmetry"
    size_names = ("coefficient",)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [torque_at(self.place, -np.abs(motion.speed[self.place]))]

    def possible(self, motion: Motion, shape: Shape) -> bool:
        """In one direction it is viscous friction."""
        speed = motion.speed[self.place]
        fast = _BOTH_WAYS * float(np.sqrt(np.mean(speed**2)))
        return bool(min(np.mean(speed > fast), np.mean(speed < -fast)) > _BOTH_SHARE)


@dataclass(frozen=True)
class Stribeck(Kind):
    """Dry friction on top, of which a higher speed leaves nothing.

    It can also be less than none: the friction of an axis that slides before it breaks away only
    ``rises`` to its size with speed.
    """

    rises: bool = False

    effect = "friction_stribeck"
    size_names = ("torque",)
    shape_names = ("speed",)

    def shapes(self, motion: Motion) -> Sequence[Shape]:
        typical = float(np.sqrt(np.mean(motion.speed[self.place] ** 2)))
        return [(share * typical,) for share in (0.02, 0.05, 0.1, 0.2, 0.4, 0.8)]

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        def falling(speed: Array) -> Array:
            share: Array = np.exp(-((speed / shape[0]) ** 2))
            return share

        return [torque_at(self.place, -_dry(motion, self.place, falling, abs(shape[0])))]

    def params(self, sizes: Array, shape: Shape) -> dict[str, float]:
        return {"torque": float(sizes[0]), "speed": abs(shape[0])}

    def plausible(self, sizes: Array, shape: Shape) -> bool:
        return bool((sizes[0] > 0.0 or self.rises) and shape[0] > 0.0)

    def possible(self, motion: Motion, shape: Shape) -> bool:
        """Beyond the speeds that occur it could not be told from dry friction."""
        fast = float(np.quantile(np.abs(motion.speed[self.place]), 0.8))
        return 0.0 < shape[0] < fast


#: Friction, which can drift, and what of it holds an axis at rest.
FRICTION = (Coulomb, Viscous, Asymmetry, Stribeck)
DRY = (Coulomb, Stribeck)


class FrictionDrift(Kind):
    """The friction that has been found, growing with time."""

    effect = "friction_drift"
    size_names = ("rate",)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [torque_at(self.place, motion.time * motion.friction[self.place])]


class Offset(Kind):
    """A constant torque."""

    effect = "torque_offset"
    size_names = ("torque",)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [torque_at(self.place, np.ones_like(motion.time))]


def _dry(motion: Motion, place: int, share: Callable[[Array], Array], width: float) -> Array:
    """The sign of the speed times ``share`` of it (w, l), as dry friction has it.

    It changes fast where the speed reverses, or changes by more than a part of ``width``. Where the
    axis sticks, friction is what it takes to hold the load.
    """
    speed = motion.speed[place]
    first, last = speed[:, :-1], speed[:, 1:]
    fast = (first * last < 0.0) | (
        (np.abs(last - first) > _FINE * width)
        & (np.minimum(np.abs(first), np.abs(last)) < 3.0 * width)
    )
    values = _sampled(lambda speed: np.sign(speed) * share(speed), speed, fast)
    stuck = (np.abs(speed) < motion.creep[place]) & (motion.grip[place] > 0.0)
    grip = np.where(stuck, motion.grip[place], 1.0)
    holding = np.clip(motion.load[place] / grip, -1.0, 1.0) * share(speed)
    torque: Array = np.where(stuck, holding, values)
    return torque


def _sampled(law: Callable[[Array], Array], quantity: Array, fast: npt.NDArray[np.bool_]) -> Array:
    """A law of a quantity at the samples (w, l), between which a torque goes straight.

    Where it is ``fast`` (w, l - 1) between two samples, these share the torque in between so that
    its area and its moment are right.
    """
    values = law(quantity)
    window, sample = np.nonzero(fast)
    if len(window) == 0:
        return values
    at = (np.arange(_PARTS) + 0.5) / _PARTS
    first, last = quantity[window, sample][:, None], quantity[window, sample + 1][:, None]
    inside = law(first + (last - first) * at)
    straight = (
        values[window, sample][:, None] * (1.0 - at) + values[window, sample + 1][:, None] * at
    )
    missing = inside - straight
    moved = np.zeros_like(values)
    np.add.at(moved, (window, sample), np.mean(missing * (1.0 - at), axis=1))
    np.add.at(moved, (window, sample + 1), np.mean(missing * at, axis=1))
    moved[:, 1:-1] -= np.diff(moved, 2, axis=1) / 12.0  # hats overlap: so much flatter they are
    shared: Array = values + moved
    return shared


# ---- What is periodic: two sizes, of sine and cosine


class Wave(Kind):
    """A sine of some phase, so many times a turn."""

    size_names = ("sine", "cosine")
    shape_names: ClassVar[tuple[str, ...]] = ("periods",)

    def argument(self, motion: Motion) -> Array:
        """What it is periodic in, a turn being 2 pi, (w, l)."""
        turned: Array = motion.angle[self.place] * (2.0 * np.pi / motion.turn)
        return turned

    def possible(self, motion: Motion, shape: Shape) -> bool:
        """Less than a period of travel could be anything."""
        return abs(shape[0]) * float(np.ptp(self.argument(motion))) > 2.0 * np.pi

    def push(self, values: Array) -> Push:
        """What a wave of these values (w, l) adds."""
        return torque_at(self.place, values)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        argument = shape[0] * self.argument(motion)
        return [self.push(np.sin(argument)), self.push(np.cos(argument))]

    def params(self, sizes: Array, shape: Shape) -> dict[str, float]:
        return {
            "amplitude": float(np.hypot(*sizes)),
            "phase": float(np.arctan2(sizes[1], sizes[0])),
            **dict(zip(self.shape_names, shape, strict=False)),
        }

    def found(self, params: Mapping[str, float]) -> Found:
        amplitude, phase = params.get("amplitude", 0.0), params.get("phase", 0.0)
        shape = tuple(params.get(name, 0.0) for name in self.shape_names)
        sizes = amplitude * np.array([np.cos(phase), np.sin(phase)])
        return Found(self, sizes, shape or _ONCE)


class Ripple(Wave):
    """A torque that repeats with the angle of the motor: cogging, slots, teeth."""

    effect = "torque_ripple"
    adjustable = False


class Disturbance(Wave):
    """A torque that repeats with time [s]; its frequency in rad/s."""

    effect = "disturbance"
    shape_names = ("frequency",)
    difference = 1e-8  # in a minute even that turns it visibly

    def argument(self, motion: Motion) -> Array:
        return motion.time


class LeadError(Wave):
    """The reading of the table, wrong in a way that repeats with its angle."""

    effect = "lead_error"
    adjustable = False

    def push(self, values: Array) -> Push:
        return Push(encoder2=values)


class Eccentricity(Wave):
    """An encoder mounted off its centre: wrong once a turn."""

    effect = "encoder_eccentricity"
    shape_names = ()
    adjustable = False

    @property
    def location(self) -> str:
        return f"encoder{self.place + 1}"

    def shapes(self, motion: Motion) -> Sequence[Shape]:
        return [_ONCE]

    def push(self, values: Array) -> Push:
        return _reads(self.place, values)


# ---- The shaft


class Shaft(Kind):
    """An effect between motor and table."""

    @property
    def location(self) -> str:
        return "shaft"


class Hardening(Shaft):
    """A shaft that gets stiffer with the cube of its twist."""

    effect = "stiffness_hardening"
    size_names = ("coefficient",)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [torque_between(motion.twist**3)]


class StiffnessDrift(Shaft):
    """A stiffness that changes in proportion to time."""

    effect = "stiffness_drift"
    size_names = ("rate",)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        return [torque_between(_axis(plant).K * motion.time * motion.twist)]


class Backlash(Shaft):
    """The shaft lets go within the gap: what the linear shaft would carry there is taken back."""

    effect = "backlash"
    shape_names = ("gap",)

    def shapes(self, motion: Motion) -> Sequence[Shape]:
        reach = 2.0 * float(np.quantile(np.abs(motion.twist), 0.95))
        return [(share * reach,) for share in (1e-3, 3e-3, 0.01, 0.03, 0.1, 0.2, 0.35, 0.5, 0.7)]

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        axis, half = _axis(plant), 0.5 * shape[0]

        def within(twist: Array) -> Array:
            return np.clip(twist, -half, half)

        taken = within(motion.twist)
        speed = np.gradient(taken, motion.time_step, axis=1)
        fast = np.diff(np.abs(motion.twist) < half, axis=1) | (
            motion.twist[:, :-1] * motion.twist[:, 1:] < 0.0
        )
        return [torque_between(-axis.K * _sampled(within, motion.twist, fast) - axis.B * speed)]

    def possible(self, motion: Motion, shape: Shape) -> bool:
        """A gap that the twist never fills would hide the shaft."""
        return 0.0 < shape[0] < 2.0 * float(np.max(np.abs(motion.twist)))


def torque_between(torque: Array) -> Push:
    """A torque that the shaft carries beyond that of the linear one."""
    return Push(motor=-torque, table=torque)


def _axis(plant: Plant) -> core.Axis:
    if not isinstance(plant, TwoInertias):
        raise TypeError("a rigid axis has no shaft")
    return plant.axis


# ---- The table


class LoadChange(Kind):
    """Part of the torque that moves the table is used up by what was added."""

    effect = "load_change"
    size_names = ("ratio",)
    shape_names = ("time",)
    moment = True

    def shapes(self, motion: Motion) -> Sequence[Shape]:
        ends = float(motion.time[0, 0]), float(motion.time[-1, -1])
        return [(float(time),) for time in np.linspace(*ends, _MOMENTS + 2)[1:-1]]

    def around(self, motion: Motion, shape: Shape, level: int) -> Sequence[Shape]:
        spacing = (float(motion.time[-1, -1]) - float(motion.time[0, 0])) / (_MOMENTS + 1)
        reach = spacing / 10.0**level
        return [(shape[0] + share * reach,) for share in np.linspace(-1.0, 1.0, 21).tolist()]

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        after = np.clip((motion.time - shape[0]) / motion.time_step + 0.5, 0.0, 1.0)
        return [Push(table=-_axis(plant).I2 * motion.acceleration[TABLE] * after)]

    def plausible(self, sizes: Array, shape: Shape) -> bool:
        return bool(sizes[0] > -1.0)

    def possible(self, motion: Motion, shape: Shape) -> bool:
        """There have to be some windows before and after."""
        first, last = float(motion.time[_SOME, 0]), float(motion.time[-_SOME, -1])
        return first < shape[0] < last


class ExtraMode(Kind):
    """A further inertia on a spring on the table: answers the table's acceleration."""

    effect = "extra_mode"
    size_names = ("mass_ratio",)
    shape_names = ("frequency", "damping_ratio")

    def shapes(self, motion: Motion) -> Sequence[Shape]:
        duration = float(motion.time[0, -1] - motion.time[0, 0])
        lowest, highest = 10.0 / duration, 2.5 / motion.time_step
        frequencies = np.geomspace(lowest, highest, 48)
        return [
            (float(frequency), damping) for frequency in frequencies for damping in (0.01, 0.06)
        ]

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        frequency, damping = abs(shape[0]), abs(shape[1])
        law = (2.0 * damping * frequency, frequency**2)
        driven = -motion.acceleration[TABLE]
        first = driven.reshape(1, -1)  # its vibration goes on from window to window
        last = np.concatenate([first[:, 1:], first[:, -1:]], axis=1)
        behind, closing = core.respond(*law, motion.time_step, first, last)
        carried = law[0] * closing + law[1] * behind
        return [Push(table=_axis(plant).I2 * carried.reshape(driven.shape))]

    def plausible(self, sizes: Array, shape: Shape) -> bool:
        frequency, damping_ratio = shape
        swings = frequency > 0.0 and 0.0 <= damping_ratio < _NO_RESONANCE
        return bool(sizes[0] > _MASS_RATIO_MIN and swings)


# ---- The command and the channels


class TorqueDelay(Kind):
    """A command that acts later than the record has it."""

    effect = "delay"
    shape_names = ("time",)

    @property
    def location(self) -> str:
        return "torque"

    def shapes(self, motion: Motion) -> Sequence[Shape]:
        return _delays(motion)

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        steps = min(max(shape[0] / motion.time_step, 0.0), len(motion.torque))
        whole = int(np.floor(steps))
        part = steps - whole
        newer, older = motion.command(whole), motion.command(whole + 1)
        # The older torque lasts for a part of the step: straight lines of its area and moment.
        late = part * (older - newer)
        lines = np.stack([(4.0 - 3.0 * part) * late, (3.0 * part - 2.0) * late])
        return [Push(command=newer - motion.command() + lines)]

    def plausible(self, sizes: Array, shape: Shape) -> bool:
        return shape[0] > 0.0


class EncoderDelay(TorqueDelay):
    """A reading that is older than the record has it."""

    @property
    def location(self) -> str:
        return f"encoder{self.place + 1}"

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        late = _late(
            motion.angle[self.place],
            motion.speed[self.place],
            shape[0] / motion.time_step,
            motion.time_step,
        )
        return [_reads(self.place, late - motion.angle[self.place])]


def _delays(motion: Motion) -> Sequence[Shape]:
    return [(steps * motion.time_step,) for steps in (0.1, 0.4, 1.0, 2.0, 4.0, 8.0, 16.0)]


def _late(angle: Array, speed: Array, steps: float, time_step: float) -> Array:
    """Angles (w, l) as they were so many steps before; before the window by the first speed."""
    at = np.arange(angle.shape[1], dtype=np.float64)
    curve = scipy.interpolate.CubicHermiteSpline(at, angle, speed * time_step, axis=1)
    wanted = at - steps
    late: Array = curve(np.clip(wanted, 0.0, at[-1]))
    before = np.minimum(wanted, 0.0) * time_step
    return late + before * speed[:, :1]


class Saturation(Kind):
    """A drive that gives less torque than it is told, beyond a limit."""

    effect = "torque_saturation"
    shape_names = ("limit",)
    moment = True

    def shapes(self, motion: Motion) -> Sequence[Shape]:
        size = np.abs(motion.torque)
        levels = np.quantile(size, 1.0 - np.geomspace(0.5, 1e-3, 20))
        near = np.array([0.7, 0.8, 0.9, 0.95, 0.98, 0.995]) * float(np.max(size))
        return [(float(level),) for level in np.unique([*levels, *near]) if level > 0.0]

    def around(self, motion: Motion, shape: Shape, level: int) -> Sequence[Shape]:
        most = float(np.max(np.abs(motion.torque)))
        cut = most - shape[0]
        shares = 1.0 + 0.8 * np.linspace(-1.0, 1.0, 17) / 8.0**level
        return [(most - share * cut,) for share in shares.tolist()]

    def possible(self, motion: Motion, shape: Shape) -> bool:
        """The command has to go beyond the limit."""
        return 0.0 < abs(shape[0]) < float(np.max(np.abs(motion.torque)))

    def pushes(self, motion: Motion, plant: Plant, shape: Shape) -> list[Push]:
        command = motion.command()
        cut = np.clip(command, -abs(shape[0]), abs(shape[0])) - command
        return [Push(command=np.stack([cut, cut]))]

    def params(self, sizes: Array, shape: Shape) -> dict[str, float]:
        return {"limit": abs(shape[0])}


def catalogue(channels: int, linear: bool, rises: bool = False) -> list[Kind]:
    """Every kind that a record with so many encoders can show; a ``linear`` scale has no centre."""
    kinds: list[Kind] = []
    for place in range(channels):
        kinds += [Coulomb(place), Stribeck(place, rises), Disturbance(place)]
        kinds += [FrictionDrift(place), Asymmetry(place)]
        if not linear:
            kinds.append(Eccentricity(place))
        if channels == 2:
            kinds += [Viscous(place), EncoderDelay(place)]
    # A constant torque only moves the zero between the encoders when it acts at the table.
    kinds += [Offset(MOTOR), Ripple(), TorqueDelay(), Saturation()]
    if channels == 2:
        kinds += [Hardening(), StiffnessDrift(), Backlash(), LeadError(TABLE)]
        kinds += [LoadChange(TABLE), ExtraMode(TABLE)]
    return kinds


def of(effect: Effect) -> Found | None:
    """An effect of a model; None for one that is of the record and no motion shows."""
    for kind in (*catalogue(2, linear=False), Offset(TABLE)):
        if (kind.effect, kind.location) == (effect.effect, effect.location):
            return kind.found(effect.params)
    return None


@dataclass(frozen=True)
class Found:
    """An effect of some size and shape."""

    kind: Kind
    sizes: Array
    shape: Shape

    @property
    def values(self) -> Array:
        """Sizes, then the shape as far as it can be adjusted."""
        return np.array([*self.sizes, *(self.shape if self.kind.adjustable else ())])

    def with_values(self, values: Array) -> Found:
        """The same effect with other ``values``."""
        n = len(self.sizes)
        shape = tuple(values[n:].tolist()) if self.kind.adjustable else self.shape
        return replace(self, sizes=np.array(values[:n]), shape=shape)

    @property
    def params(self) -> Mapping[str, float]:
        return self.kind.params(self.sizes, self.shape)

    @property
    def plausible(self) -> bool:
        return self.kind.plausible(self.sizes, self.shape)

    def push(self, motion: Motion, plant: Plant) -> Push:
        """What it adds in all."""
        pushes = self.kind.pushes(motion, plant, self.shape)
        if self.kind.sizes == 0:
            return pushes[0]
        return total(pushes, self.sizes)


def total(pushes: Sequence[Push], sizes: Sequence[float] | Array) -> Push:
    """The sum of pushes, each so many times."""
    summed: dict[str, Array] = {}
    for push, size in zip(pushes, sizes, strict=True):
        for name, values in vars(push).items():
            if values is not None:
                summed[name] = summed.get(name, 0.0) + size * values
    return Push(**summed)
