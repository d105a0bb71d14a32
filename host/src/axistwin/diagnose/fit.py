"""A linear axis with effects, fitted to the windows of a record (Gauss-Newton on the output error).

What is minimised is the difference of simulated and measured angles, over all windows that are not
held out, each channel in units of its noise. The initial state of every window enters linearly and
is projected out (variable projection, Golub and Pereyra 1973).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt
import scipy.linalg
import scipy.signal

from axistwin.core import Array
from axistwin.diagnose.effects import DRY, FRICTION, ExtraMode, Found, Motion, Push, Viscous
from axistwin.diagnose.linear import Linear, Plant, Rigid, ThreeInertias, Torque, TwoInertias
from axistwin.diagnose.windows import Windows, noise_floor
from axistwin.errors import InputError
from axistwin.identify.samples import Hold

#: Mean square of an error, in units of the noise, that leaves the plant where it should be; and
#: from which nothing better need be tried, as the noise itself is known no better.
NEARLY_RIGHT = 2.0
RIGHT = 1.015

#: Relative step of the differences that make sensitivities.
_STEP = 1e-5

#: Least samples of the smoothing polynomial, and its degree.
_SMOOTH_MIN = 7
_DEGREE = 3

#: A speed this many times its noise has a known sign.
_KNOWN_SIGN = 2.0

#: As long as the noise is not known: the share of the usual speed.
_CREEP = 0.02

#: Smoothed errors up to this many times what noise leaves are noise.
_SURELY_NOISE = 1.2

_HALVINGS = 6

#: Rounds in a row without a better fit that are put up with.
_RISES = 2

#: So much [1] the parameters of a further mode usually change in a step (Levenberg 1944): far off,
#: the record hardly tells them from those of the plant.
_TRUST = 0.3

#: A further inertia of this size is a usual one.
_MASS_RATIO = 0.01

#: A parameter of the plant changes by this factor at most in a step.
_FACTOR = 2.0


@dataclass(frozen=True)
class _Acting:
    """What effects do (c, w, l): errors of the encoders [rad], and at each place [N m] the torque,
    the part of it that is friction, and up to what that holds the axis at rest."""

    misread: Array
    torque: Array
    friction: Array
    grip: Array


@dataclass(frozen=True)
class Fit:
    """``plant`` with ``found`` effects; ``zero`` of encoder 2 against 1 [rad]; ``noise`` (c,) the
    size of each channel's error that counts as 1. Below the frequency ``corner`` [rad/s] errors of
    the torque outweigh it; then errors count less, by the square of the frequency."""

    windows: Windows
    hold: Hold
    plant: Plant
    zero: float = 0.0
    found: tuple[Found, ...] = ()
    noise: Array | None = None
    corner: float = 0.0

    # ---- Simulation

    @cached_property
    def measured(self) -> Array:
        """Angles (c, w, l) from where the motor was at the start of each window."""
        angles: Array = self.windows.angles - self._origin
        return angles

    @property
    def _origin(self) -> Array:
        return self.windows.angles[:1, :, :1]

    @cached_property
    def system(self) -> Linear:
        """All that is linear: the plant, with a further mode if one has been found."""
        mode = next((one for one in self.found if isinstance(one.kind, ExtraMode)), None)
        if mode is None or not isinstance(self.plant, TwoInertias):
            return self.plant
        (mass_ratio,), (frequency, damping_ratio) = mode.sizes.tolist(), mode.shape
        return ThreeInertias(self.plant.axis, frequency, damping_ratio, mass_ratio)

    def answer(self, pushes: Sequence[Push], states: Array | None = None) -> Array:
        """The angles (c, w, l) that the pushes alone make."""
        return self._answer(pushes, states)[0]

    def _answer(
        self,
        pushes: Sequence[Push],
        states: Array | None,
        command: Array | None = None,
    ) -> tuple[Array, Array]:
        shape = self.windows.angles.shape
        smooth, errors = np.zeros((2, *shape))
        for push in pushes:
            _add(smooth, push.motor, push.table)
            _add(errors, push.encoder1, push.encoder2)
        commanded = self.commanded(pushes, command)
        torque = Torque.smooth(smooth)
        torque.first[0] += commanded[0]
        torque.last[0] += commanded[1]
        angles, speeds = self.system.respond(self.windows.time_step, torque, states)
        return angles + errors, speeds

    def commanded(self, pushes: Sequence[Push], command: Array | None = None) -> Array:
        """The torque command (w, l) with what pushes add, as (2, w, l): at each sample, and just
        before the next."""
        commanded = np.zeros((2, *self.windows.index.shape))
        if command is not None:
            commanded += command
        for push in pushes:
            if push.command is not None:
                commanded += push.command
        if self.hold == "zoh":
            return commanded
        line = np.mean(commanded, axis=0)  # straight from sample to sample
        return np.stack([line, np.concatenate([line[:, 1:], line[:, -1:]], axis=1)])

    def delivered(self, motion: Motion) -> Array:
        """The torque command (w, l) with what the effects make of it along a motion."""
        command = self.windows.cut(self.windows.torque)
        delivered: Array = self.commanded(self._pushes(motion), command)[0]
        return delivered

    def _pushes(self, motion: Motion | None) -> list[Push]:
        """What each effect does along a motion; nothing as long as that is unknown, or where it is
        part of the linear system."""
        if motion is None:
            return []
        return [
            Push() if isinstance(one.kind, ExtraMode) else one.push(motion, self.plant)
            for one in self.found
        ]

    def simulate(self, motion: Motion | None, states: Array | None = None) -> tuple[Array, Array]:
        """Angles and speeds (c, w, l) of the model, what its effects do taken along ``motion``."""
        command = self.windows.cut(self.windows.torque)
        angles, speeds = self._answer(self._pushes(motion), states, command)
        if self.windows.channels == 2:
            angles[1] += self.zero
        return angles, speeds

    # ---- Projection of the initial states

    @cached_property
    def _free(self) -> tuple[Array, Array]:
        """Orthonormal basis (c l, s) of the motion without torque, weighted, and its triangle."""
        free = self.system.free(self.windows.time_step, self.windows.length)
        columns = self.vectors(free.transpose(1, 0, 2)).T
        q, r = scipy.linalg.qr(columns, mode="economic")
        return q, r

    @property
    def weights(self) -> Array:
        """Of the channels (c, 1, 1)."""
        noise = np.ones(self.windows.channels) if self.noise is None else self.noise
        weights: Array = 1.0 / noise[:, None, None]
        return weights

    @cached_property
    def whitening(self) -> tuple[Array, Array]:
        """Numerator and denominator of the filter that leaves of the error white noise.

        A white torque w moves an inertia I by w / (I s^2). Beside white noise of the encoder that
        is a spectrum in proportion to 1 + (corner / frequency)^4, the inverse of a Butterworth
        high-pass of the second order.
        """
        rate = 2.0 * np.pi / self.windows.time_step
        b, a = scipy.signal.butter(2, self.corner, "highpass", fs=rate)
        return b, a

    def vectors(self, angles: Array) -> Array:
        """Angles (c, w, l), weighted, as vectors (w, c l)."""
        white = angles * self.weights
        if self.corner > 0.0:
            white = scipy.signal.lfilter(*self.whitening, white, axis=2)
        vectors: Array = white.transpose(1, 0, 2).reshape(angles.shape[1], -1)
        return vectors

    def angles(self, vectors: Array) -> Array:
        """The way back."""
        white = self.channels(vectors)
        if self.corner > 0.0:
            white = scipy.signal.lfilter(*self.whitening[::-1], white, axis=2)
        angles: Array = white / self.weights
        return angles

    def slopes(self, vectors: Array) -> Array:
        """Inner products of weighted vectors (w, c l) with those of unit angles (c, w, l)."""
        white = self.channels(vectors)
        if self.corner > 0.0:
            white = scipy.signal.lfilter(*self.whitening, white[:, :, ::-1], axis=2)[:, :, ::-1]
        slopes: Array = white * self.weights
        return slopes

    def channels(self, vectors: Array) -> Array:
        """Weighted vectors (w, c l) as channels (c, w, l), still weighted."""
        shape = (len(vectors), self.windows.channels, -1)
        channels: Array = vectors.reshape(shape).transpose(1, 0, 2)
        return channels

    def project(self, angles: Array) -> Array:
        """Angles (c, w, l) as weighted vectors (w, c l) without what initial states can explain."""
        vectors = self.vectors(angles)
        q, _ = self._free
        projected: Array = vectors - (vectors @ q) @ q.T
        return projected

    def states(self, errors: Array) -> Array:
        """The initial states (w, s) that explain most of the errors (c, w, l)."""
        vectors = self.vectors(errors)
        q, r = self._free
        # A window may have run away, which is no error of the others.
        states: Array = scipy.linalg.solve_triangular(r, q.T @ vectors.T, check_finite=False).T
        return states

    # ---- What is known of the motion

    @property
    def smoothing(self) -> int:
        """Samples that a polynomial is laid through: about a period of the fastest vibration."""
        length = self.windows.length
        if isinstance(self.plant, TwoInertias):
            period = 2.0 * np.pi / (self.plant.frequency * self.windows.time_step)
        else:
            period = length / 20.0
        samples = int(min(max(period, _SMOOTH_MIN), length / 3))
        return samples + 1 - samples % 2

    def motion(self, before: Motion | None) -> Motion:
        """The motion as simulation and measurement together tell it.

        The simulation carries the fast part, and the smoothed difference to what was measured is
        added. ``before`` is the motion along which effects act in that simulation.
        """
        angles, speeds = self.simulate(before, self.starts(before))
        return self.motion_of(before, angles, speeds)

    def motion_of(self, before: Motion | None, angles: Array, speeds: Array) -> Motion:
        """The same of a simulation (c, w, l) that has been made."""
        windows = self.windows
        missed = self._missed(self.measured - angles)
        acting = self._acting(before)
        angles = angles - acting.misread
        load = acting.torque - acting.friction
        load[0] += windows.cut(windows.torque)
        acceleration = missed[2]
        twist, twist_speed = np.zeros((2, *load.shape[1:]))
        if isinstance(self.plant, TwoInertias):
            axis = self.plant.axis
            shaft = axis.K * (angles[0] - angles[1]) + axis.B * (speeds[0] - speeds[1])
            carried = self._carried(angles[1], speeds[1], shaft + acting.torque[1])
            load[0] -= shaft
            load[1] += shaft + carried
            acceleration[1] += (shaft + carried + acting.torque[1]) / axis.I2
            twist = angles[0] - angles[1] + missed[0][0] - missed[0][1]
            twist_speed = speeds[0] - speeds[1] + missed[1][0] - missed[1][1]
        speed = speeds + missed[1]
        return Motion(
            time=windows.time,
            time_step=windows.time_step,
            torque=windows.torque,
            index=windows.index,
            angle=angles + missed[0] + self._origin,
            speed=speed,
            acceleration=acceleration,
            twist=twist,
            twist_speed=twist_speed,
            friction=acting.friction,
            grip=acting.grip,
            load=load,
            creep=self._creep(speed),
            turn=1.0 if windows.linear else 2.0 * np.pi,
        )

    def _carried(self, angle: Array, speed: Array, others: Array) -> Array:
        """The torque (w, l) of a further mode on a table that moves so under the ``others``."""
        carried = np.zeros_like(others)
        if isinstance(self.system, ThreeInertias):
            # Angles and speeds three samples long give the acceleration to the fourth order.
            step = self.windows.time_step
            bend = np.diff(angle, 2, axis=1) / step**2
            inside = 2.0 * bend - (speed[:, 2:] - speed[:, :-2]) / (2.0 * step)
            carried[:, 1:-1] = self.system.axis.I2 * inside - others[:, 1:-1]
            carried[:, 0], carried[:, -1] = carried[:, 1], carried[:, -2]
        return carried

    def starts(self, motion: Motion | None) -> Array:
        """The initial state (w, s) that suits each window."""
        return self.states(self.measured - self.simulate(motion)[0])

    def _acting(self, motion: Motion | None) -> _Acting:
        """What the effects that have been found do along a motion."""
        misread, torque, friction, grip = np.zeros((4, *self.windows.angles.shape))
        for one, push in zip(self.found, self._pushes(motion), strict=False):
            _add(misread, push.encoder1, push.encoder2)
            _add(torque, push.motor, push.table)
            if isinstance(one.kind, FRICTION):
                _add(friction, push.motor, push.table)
            if isinstance(one.kind, DRY):
                grip[one.kind.place] += one.sizes[0]
        if self.windows.channels == 2:
            misread[1] += self.zero
        return _Acting(misread, torque, friction, grip)

    def _missed(self, error: Array) -> list[Array]:
        """The motion that a simulation with this error (c, w, l) lacks, and two derivatives."""
        trust = self._trust(error)
        return [
            trust
            * scipy.signal.savgol_filter(
                error,
                self.smoothing,
                _DEGREE,
                deriv=order,
                delta=self.windows.time_step,
                axis=2,
            )
            for order in range(3)
        ]

    def _creep(self, speed: Array) -> Array:
        """The speeds (c,) that may be none, from what noise makes of the smoothed error."""
        if self.noise is None:
            share: Array = _CREEP * np.sqrt(np.mean(speed**2, axis=(1, 2)))
            return share
        kept = np.linalg.norm(scipy.signal.savgol_coeffs(self.smoothing, _DEGREE, 1))
        creep: Array = _KNOWN_SIGN * float(kept) * self.noise / self.windows.time_step
        return creep

    def _trust(self, error: Array) -> Array:
        """How much of the smoothed error (c, w, l) is motion that the simulation lacks, by channel.

        The rest is noise; taken for motion, it would explain itself.
        """
        if self.noise is None:
            return np.ones((len(error), 1, 1))
        kept = np.linalg.norm(scipy.signal.savgol_coeffs(self.smoothing, _DEGREE))
        smooth = scipy.signal.savgol_filter(error, self.smoothing, _DEGREE, axis=2)
        power = np.mean(smooth**2, axis=(1, 2))
        motion = np.maximum(power - (_SURELY_NOISE * kept * self.noise) ** 2, 0.0)
        trust: Array = (motion / np.maximum(power, 1e-300))[:, None, None]
        return trust

    # ---- Fitting

    @property
    def names(self) -> list[str]:
        """Of the unknowns: the plant's, the zero, then each effect's."""
        names = list(self.plant.names) + (["zero"] if self.windows.channels == 2 else [])
        for effect in self.found:
            names += [f"{effect.kind.name}[{i}]" for i in range(len(effect.values))]
        return names

    def with_values(self, values: Array) -> Fit:
        """The same model with other unknowns, in the order of ``names``."""
        k = len(self.plant.names)
        plant = self.plant.with_values(values[:k])
        zero = 0.0
        if self.windows.channels == 2:
            zero, k = float(values[k]), k + 1
        found = []
        for effect in self.found:
            n = len(effect.values)
            found.append(effect.with_values(values[k : k + n]))
            k += n
        return replace(self, plant=plant, zero=zero, found=tuple(found))

    @property
    def values(self) -> Array:
        """The unknowns (k,) in the order of ``names``."""
        zero = [self.zero] if self.windows.channels == 2 else []
        effects = [value for effect in self.found for value in effect.values]
        return np.array([*self.plant.values, *zero, *effects])

    def residual(self, motion: Motion) -> Array:
        """Weighted errors (w, c l), measured less simulated."""
        return self.project(self.measured - self.simulate(motion)[0])

    def simulation_error(self, motion: Motion) -> Array:
        """Measured less simulated angles (c, w, l), each window from the state that suits it."""
        error: Array = self.measured - self.simulate(motion, self.starts(motion))[0]
        return error

    @property
    def directions(self) -> Array:
        """Changes of the unknowns (k, k), a column each: those of the plant, then one by one.

        Those of a further mode are in proportion, its inertia at the expense of the table's.
        """
        k = len(self.plant.names)
        directions = np.eye(len(self.values))
        directions[:k, :k] = self.plant.directions
        mode = self._of_mode
        directions[mode, mode] = self._mode_sizes
        for i in mode[:1]:  # what is slow does not feel whether an inertia is tied or on a spring
            directions[1, i] = -self.values[1] * directions[i, i] / (1.0 + self.values[i])
        return directions

    @property
    def _of_mode(self) -> list[int]:
        """Which unknowns are those of a further mode, which is adjusted as the plant is."""
        first, which = len(self.plant.names) + self.windows.channels - 1, list[int]()
        for effect in self.found:
            if isinstance(effect.kind, ExtraMode):
                which += range(first, first + len(effect.values))
            first += len(effect.values)
        return which

    def sensitivity(self, motion: Motion) -> Array:
        """Derivatives (w, k, c l) of the simulation along ``directions``, projected."""
        states = self.starts(motion)
        base, _ = self.simulate(motion, states)
        values, directions = self.values, self.directions

        def change(direction: Array) -> Array:
            moved, _ = self.with_values(values + _STEP * direction).simulate(motion, states)
            return self.project((moved - base) / _STEP)

        mode = self._of_mode
        columns = [change(directions[:, i]) for i in range(len(self.plant.names))]
        if self.windows.channels == 2:
            one = np.zeros_like(base)
            one[1] = 1.0
            columns.append(self.project(one))
        for effect in self.found:
            if isinstance(effect.kind, ExtraMode):
                columns += [change(directions[:, i]) for i in mode]
            else:
                columns += self.columns(effect, motion)
        return np.stack(columns, axis=1)

    def columns(self, effect: Found, motion: Motion) -> list[Array]:
        """Derivatives (w, c l) by the values of one effect, weighted and projected."""
        return [self.project(angles) for angles in self.moves(effect, motion)]

    def by_size(self, effect: Found, motion: Motion) -> list[Array]:
        """Derivatives (w, c l) by the sizes of one effect."""
        return [self.project(angles) for angles in self._by_size(effect, motion)]

    def moves(self, effect: Found, motion: Motion) -> list[Array]:
        """Derivatives of the angles (c, w, l) by the values of one effect."""
        return [*self._by_size(effect, motion), *self._by_shape(effect, motion)]

    def _by_size(self, effect: Found, motion: Motion) -> list[Array]:
        if effect.kind.sizes == 0:
            return []
        pushes = effect.kind.pushes(motion, self.plant, effect.shape)
        return [self.answer([push]) for push in pushes]

    def _by_shape(self, effect: Found, motion: Motion) -> list[Array]:
        columns = []
        if len(effect.values) > len(effect.sizes):
            base = self.answer([effect.push(motion, self.plant)])
        for i in range(len(effect.sizes), len(effect.values)):
            step = np.zeros_like(effect.values)
            step[i] = effect.kind.difference * max(abs(effect.values[i]), 1e-9)
            pushed = effect.with_values(effect.values + step).push(motion, self.plant)
            columns.append((self.answer([pushed]) - base) / step[i])
        return columns

    @property
    def _mode_sizes(self) -> Array:
        """Of the parameters of a further mode; an inertia has one however small it is."""
        sizes = self.values[self._of_mode]
        sizes[:1] = np.maximum(sizes[:1], _MASS_RATIO)
        return sizes

    def _size(self, i: int) -> float:
        """The size of a parameter of the plant; damping has one even when it is zero."""
        values = self.plant.values
        if isinstance(self.plant, TwoInertias) and i == 2:
            return max(float(values[2]), 2e-3 * float(values[3]) / self.plant.frequency)
        if not isinstance(self.plant, TwoInertias) and i == 1:
            return max(float(values[1]), float(values[0]) / self.windows.time_step * 1e-6)
        return float(values[i])

    def adjust(
        self, before: Motion | None = None, rounds: int = 16, tolerance: float = 1e-6
    ) -> tuple[Fit, Motion]:
        """The best unknowns near the present ones, and the motion along which effects act then.

        ``before`` is the motion known so far, ``tolerance`` the relative gain that ends it.
        """
        fit, motion = self, before if before is not None else self.motion(None)
        best = (np.inf, fit, motion)
        rises = 0
        for _ in range(rounds):
            residual = fit.residual(motion)
            misfit = fit.misfit(residual)
            if not np.isfinite(misfit):
                break
            rises = rises + 1 if misfit > best[0] * (1.0 - tolerance) else 0
            if misfit < best[0]:
                best = (misfit, fit, motion)
            if rises > _RISES:
                break
            trust = np.zeros(len(fit.values))
            trust[fit._of_mode] = fit.scale(residual) / _TRUST**2
            step = solve(fit.sensitivity(motion), residual, ~fit.windows.held_out, trust)
            step = fit.directions @ fit._bounded(step)
            moved = fit._line_search(step, motion, misfit)
            if moved is None:
                break
            # The motion known now is another one, along which the error may have grown.
            fit, motion = moved
        if fit.misfit(fit.residual(motion)) < best[0]:
            return fit, motion
        return best[1], best[2]

    def scale(self, residual: Array) -> float:
        """Mean square where the fit may look."""
        return self.misfit(residual) / residual[~self.windows.held_out].size

    def misfit(self, residual: Array) -> float:
        """Sum of squares where the fit may look; infinite where any window has run away."""
        if not np.all(np.isfinite(residual)):
            return np.inf
        return float(np.sum(residual[~self.windows.held_out] ** 2))

    def viscous(self, place: int) -> float:
        """The viscous friction at a place [N m s/rad]: that of a rigid plant is its own."""
        own = self.plant.viscous if isinstance(self.plant, Rigid) else 0.0
        found = (one for one in self.found if isinstance(one.kind, Viscous))
        return own + sum(float(one.sizes[0]) for one in found if one.kind.place == place)

    def moved(self, step: Array) -> Fit:
        """The model with other unknowns, no parameter of the plant all too far off.

        Raises InputError for unknowns that no axis has.
        """
        moved = self.values + step
        k = len(self.plant.names)
        sizes = np.array([self._size(i) for i in range(k)])
        for i in self._of_mode[:1]:  # the sum of both, which is known best, stays to all orders
            before, after = 1.0 + self.values[i], 1.0 + moved[i]
            tied = moved[1] + self.values[1] * step[i] / before
            moved[1] = tied * before / after
        lowest = np.where(self.plant.values < sizes, 0.0, sizes / _FACTOR)
        moved[:k] = np.clip(moved[:k], lowest, sizes * _FACTOR)
        return self.with_values(moved)

    def _bounded(self, step: Array) -> Array:
        """A step along the directions that leaves a further mode within a factor."""
        mode, sizes = self._of_mode, self._mode_sizes
        values = self.values[mode]
        lowest, highest = values / _FACTOR - values, _FACTOR * sizes - values
        bounded: Array = step.copy()
        bounded[mode] = np.clip(step[mode], lowest / sizes, highest / sizes)
        return bounded

    def _line_search(self, step: Array, motion: Motion, before: float) -> tuple[Fit, Motion] | None:
        """The fit so far along a step that it is better along the motion, and what moves then."""
        for halving in range(_HALVINGS):
            try:
                fit = self.moved(step * 0.5**halving)
                if fit.misfit(fit.residual(motion)) < before:
                    return fit, fit.motion(motion)
            except InputError:  # no axis has these values
                continue
        return None

    def with_noise(self, motion: Motion) -> Fit:
        """The same, each channel weighted by its noise."""
        return self.hearing(self.simulation_error(motion))

    def hearing(self, errors: Array) -> Fit:
        """The same, each channel weighted by the noise in errors (c, w, l) of a simulation, or by
        the rounding of its encoder if that is more: it is not white."""
        digits = 1e-15 * float(np.max(np.abs(self.windows.angles)))
        rounding = np.array([step or 0.0 for step in self.windows.steps]) / np.sqrt(12.0)
        floor = np.maximum(noise_floor(errors), rounding)
        return replace(self, noise=np.maximum(floor, max(digits, 1e-300)))


def _add(sums: Array, *parts: Array | None) -> None:
    """Adds to each channel or place of sums (c, w, l) its part (w, l)."""
    for one, part in enumerate(parts):
        if part is not None:
            sums[one] += part


def solve(
    columns: Array,
    residual: Array,
    chosen: npt.NDArray[np.bool_],
    trust: Array | float = 0.0,
) -> Array:
    """Least squares (k,) of residual (w, n) by columns (w, k, n) over the chosen windows.

    With ``trust`` (k,) the sum of it times the solution squared counts as well.
    """
    gram = np.einsum("wan,wbn->ab", columns[chosen], columns[chosen], optimize=True)
    gram += np.diag(np.broadcast_to(trust, len(gram)))
    right = np.einsum("wan,wn->a", columns[chosen], residual[chosen], optimize=True)
    return solve_normal(gram, right)


def solve_normal(gram: Array, right: Array) -> Array:
    """The least-squares solution of scaled normal equations; what is not determined stays 0.

    All of it where something has run away.
    """
    if not (np.all(np.isfinite(gram)) and np.all(np.isfinite(right))):
        return np.zeros_like(right)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    values, vectors = np.linalg.eigh(gram / np.outer(size, size))
    good = values > 1e-11 * values[-1]
    inner = vectors[:, good] / values[good]
    solution: Array = inner @ (vectors[:, good].T @ (right / size)) / size
    return solution
