"""The C core, called over arrays: the same code that runs on the drive.

It is compiled twice, in single and in double precision; ``precision`` chooses. Whatever the
precision, arrays that come out are float64 (or integers), SI units, angles in rad.
"""

from __future__ import annotations

import functools
import importlib
import itertools
import os
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import astuple, dataclass, field
from typing import Any, Literal, TypeAlias

import numpy as np
import numpy.typing as npt

from axistwin.errors import AxisTwinError, InputError, NotEnoughDataError

Precision: TypeAlias = Literal["float32", "float64"]
Form: TypeAlias = Literal["3x2", "5x4"]
Method: TypeAlias = Literal["newmark", "houbolt", "wilson", "runge_kutta", "exact", "exact_held"]
Array: TypeAlias = npt.NDArray[np.float64]

_MODULES = {"float32": "axistwin._core32", "float64": "axistwin._core64"}
_FORMS = {"3x2": "AXT_IDENT_3X2", "5x4": "AXT_IDENT_5X4"}
_TURN = 2.0 * np.pi

# Steps of a simulation that are worth a thread of their own: some milliseconds.
_WORTH_A_THREAD = 100_000


@dataclass(frozen=True)
class Axis:
    """Parameters of the axis (Eq. 3): motor and table inertia joined by a shaft.

    ``I1``, ``I2`` [kg m2], ``B`` [N m s/rad], ``K`` [N m/rad]; kg, N s/m, N/m for a linear axis.
    """

    I1: float
    I2: float
    B: float
    K: float


@dataclass(frozen=True)
class Modal:
    """The vibration of the shaft: ``wn`` [rad/s], ``wd`` [rad/s], ``zeta`` [1]."""

    wn: float
    wd: float
    zeta: float


@dataclass(frozen=True)
class State:
    """Where an axis is and how it moves, seen from the motor.

    ``twist`` theta1 - theta2 [rad], ``twist_speed`` [rad/s], ``speed`` and ``angle`` of the motor
    [rad/s], [rad].
    """

    twist: float = 0.0
    twist_speed: float = 0.0
    speed: float = 0.0
    angle: float = 0.0


@dataclass(frozen=True)
class Newmark:
    """Newmark's alpha and delta (Eqs. 4-6); 1/4, 1/2 is the trapezoidal rule."""

    alpha: float = 0.25
    delta: float = 0.5


@dataclass(frozen=True)
class Effect:
    """Something that an axis does and Eq. 3 does not say; see effect_parameters().

    ``effect`` and ``location`` are identifiers, ``params`` the values of its parameters by name;
    those not given are zero. An axis can have several ripples and lead errors, each one Effect.
    """

    effect: str
    location: str
    params: Mapping[str, float]


@dataclass(frozen=True)
class EffectParameter:
    """One parameter of one effect at one location.

    Its ``unit`` is that of a rotary axis, N^force rad^angle times a power of s. An axis can have
    ``instances`` of the effect there.
    """

    effect: str
    location: str
    parameter: str
    unit: str
    force: int
    angle: int
    instances: int
    at: int = field(repr=False)
    stride: int = field(repr=False)


@dataclass(frozen=True)
class Motion:
    """Motion of an axis at n instants, as the core keeps it: turns counted apart from the angle.

    Each property is a new array (n,) in rad or rad/s.
    """

    precision: Precision
    samples: npt.NDArray[np.void] = field(repr=False)

    def __len__(self) -> int:
        return len(self.samples)

    def _column(self, name: str) -> Array:
        return self.samples[name].astype(np.float64)

    @property
    def twist(self) -> Array:
        """theta1 - theta2 [rad]."""
        return self._column("twist")

    @property
    def twist_speed(self) -> Array:
        """omega1 - omega2 [rad/s]."""
        return self._column("twist_speed")

    @property
    def theta1(self) -> Array:
        """Angle of the motor [rad]."""
        fraction = self._column("fraction") + self._column("fraction_low")
        return _TURN * (self._column("turns") + fraction)

    @property
    def theta2(self) -> Array:
        """Angle of the table [rad]."""
        return self.theta1 - self.twist

    @property
    def omega1(self) -> Array:
        """Speed of the motor [rad/s]."""
        return self._column("speed")

    @property
    def omega2(self) -> Array:
        """Speed of the table [rad/s]."""
        return self.omega1 - self.twist_speed


@dataclass(frozen=True)
class IdentSettings:
    """Settings of the recursive identification; see lib/axt_regressor.h.

    ``time_step`` between samples [s]; ``expected`` the axis within a factor of 10 and ``torque``
    the size of the torque [N m] likewise: they scale, and never set the answer. ``forgetting``
    is lambda, 0.9 to 1.
    """

    time_step: float
    expected: Axis
    torque: float
    form: Form = "3x2"
    forgetting: float = 1.0


@dataclass(frozen=True)
class Estimate:
    """What the identification says, with standard errors.

    ``valid`` says which of I1, I2, B, K can be relied on; modal values need all of them.
    ``samples`` is how many were taken into account, None when that is unknown.
    """

    axis: Axis
    modal: Modal
    axis_error: Axis
    modal_error: Modal
    valid: tuple[bool, bool, bool, bool]
    samples: int | None = None


@dataclass(frozen=True)
class Estimates:
    """A run of estimates, k of them.

    ``sample`` (k,) how many samples of the record each has seen, ``used`` (k,) how many of them
    were taken into account; ``axis``, ``axis_error`` (k, 4) for I1, I2, B, K; ``modal``,
    ``modal_error`` (k, 3) for wn, wd, zeta; ``valid`` (k, 4). ``rejected`` is how many samples the
    estimator refused.
    """

    sample: npt.NDArray[np.int64]
    axis: Array
    axis_error: Array
    modal: Array
    modal_error: Array
    valid: npt.NDArray[np.bool_]
    used: npt.NDArray[np.int64]
    rejected: int

    @property
    def last(self) -> Estimate:
        """The final answer."""
        return Estimate(
            Axis(*self.axis[-1].tolist()),
            Modal(*self.modal[-1].tolist()),
            Axis(*self.axis_error[-1].tolist()),
            Modal(*self.modal_error[-1].tolist()),
            (*self.valid[-1].tolist(),),
            int(self.used[-1]),
        )


def paper_axis() -> Axis:
    """The axis of the paper's Table 1."""
    return _axis_of(_load("float64").lib.axt_axis_paper)


def modal(axis: Axis, precision: Precision = "float64") -> Modal:
    """Natural frequency, damped frequency and damping ratio of an axis.

    Raises InputError when a parameter is out of its range.
    """
    core = _load(precision)
    found = core.ffi.new("axt_modal *")
    _check(core, core.lib.axt_axis_modal(_axis(core, axis), found), str(axis))
    return Modal(found.wn, found.wd, found.zeta)


def axis_from_modal(
    I1: float, I2: float, wn: float, zeta: float, precision: Precision = "float64"
) -> Axis:
    """The axis with inertias I1, I2 [kg m2] that vibrates at wn [rad/s] with damping ratio zeta.

    Raises InputError when there is no such axis.
    """
    core = _load(precision)
    given = core.ffi.new("axt_modal *", {"wn": wn, "zeta": zeta})
    found = core.ffi.new("axt_axis *")
    status = core.lib.axt_axis_from_modal(I1, I2, given, found)
    _check(core, status, f"axis with {I1=}, {I2=}, {wn=}, {zeta=}")
    return _axis_of(found)


def time_step(N: int, k: int, wn: float) -> float:
    """The paper's criterion Dt = 2 pi k / (N wn) [s].

    Raises InputError when N, k or wn is not positive.
    """
    found: float = _load("float64").lib.axt_time_step(max(N, 0), max(k, 0), wn)
    if found <= 0.0:
        raise InputError(f"no time step for {N=}, {k=}, {wn=}: all have to be positive")
    return found


def schroeder(
    length: int,
    lines: int,
    rms: float,
    *,
    first: int = 1,
    stride: int = 1,
    seed: int = 0,
    precision: Precision = "float64",
) -> Array:
    """One period (length,) of Schroeder's multisine: ``lines`` harmonics from ``first``.

    ``rms`` in the unit wanted; a ``seed`` other than 0 draws random phases. Raises InputError when
    the lines do not fit into the period.
    """
    core = _load(precision)
    what = f"excitation with {length=}, {lines=}, {rms=}, {first=}, {stride=}, {seed=}"
    numbers = {"length": length, "lines": lines, "first": first, "stride": stride, "seed": seed}
    for number in numbers.values():
        if not 0 <= number < 2**32:
            raise InputError(f"{what}: {number} is not a 32-bit number")
    signal = core.ffi.new("axt_schroeder *", {**numbers, "rms": rms})
    _check(core, core.lib.axt_schroeder_check(signal), what)
    table = np.zeros(length, core.real)
    pointer = core.ffi.from_buffer("axt_real[]", table, require_writable=True)
    _check(core, core.lib.axt_schroeder_fill(signal, pointer, length), what)
    return table.astype(np.float64)


@functools.cache
def effect_parameters() -> tuple[EffectParameter, ...]:
    """All parameters of all effects inside an axis and its encoders, as the core lists them."""
    core = _load("float64")
    found: list[EffectParameter] = []
    while (entry := core.lib.axt_catalogue(len(found))) != core.ffi.NULL:
        texts = (entry.effect, entry.location, entry.parameter, entry.unit)
        effect, location, parameter, unit = (core.ffi.string(text).decode() for text in texts)
        found.append(
            EffectParameter(
                effect,
                location,
                parameter,
                unit,
                entry.force,
                entry.angle,
                entry.instances,
                entry.at,
                entry.stride,
            )
        )
    return tuple(found)


def check_effects(effects: Sequence[Effect]) -> None:
    """Raises InputError for an effect, a location or a parameter that there is not.

    Whether values are in their ranges shows when they are simulated: some depend on the time step.
    """
    place_effects(effects)


def place_effects(
    effects: Sequence[Effect],
) -> list[tuple[int, dict[str, EffectParameter]]]:
    """For each effect, which one of its kind it is at its location, and its parameters' entries.

    Raises as check_effects().
    """
    places = _places()
    count: dict[tuple[str, str], int] = {}
    found = []
    for effect in effects:
        key = (effect.effect, effect.location)
        if key not in places:
            raise InputError(_unknown_effect(effect))
        instance = count.get(key, 0)
        count[key] = instance + 1
        for name in effect.params:
            place = places[key].get(name)
            if place is None:
                known = ", ".join(places[key])
                raise InputError(f"{effect.effect} has no parameter {name!r}; it has {known}")
            if instance >= place.instances:
                raise InputError(
                    f"an axis can have {effect.effect} at {effect.location} "
                    f"{place.instances} times at most"
                )
        found.append((instance, {name: places[key][name] for name in effect.params}))
    return found


def effect_member(entry: EffectParameter, instance: int) -> str:
    """The member of axt_effects that this parameter is in C, such as ``friction[1].coulomb``."""
    core = _load("float64")
    at = (entry.at + instance * entry.stride) * core.real.itemsize
    member, kind = "", core.ffi.typeof("axt_effects")
    while kind.kind != "primitive":
        if kind.kind == "array":
            kind = kind.item
            index, at = divmod(at, core.ffi.sizeof(kind))
            member += f"[{index}]"
        else:
            name, found = next(f for f in reversed(kind.fields) if f[1].offset <= at)
            kind, at = found.type, at - found.offset
            member += f".{name}"
    return member.removeprefix(".")


def simulate(
    axis: Axis,
    time_step: float,
    torque: npt.ArrayLike,
    state: State | None = None,
    *,
    newmark: Newmark | None = None,
    precision: Precision = "float64",
) -> Motion:
    """Motion of the axis under torque (n,) [N m], one sample every ``time_step`` [s].

    Sample 0 is ``state`` (at rest at angle 0 unless given) with torque[0] acting; each further one
    is a step of Newmark's method, the torque linear in between. Raises InputError for an axis, a
    time step or a sample that is out of range or not finite.
    """
    core = _load(precision)
    run = _Simulation(core, torque, state)
    parameters = core.ffi.new("axt_newmark *", astuple(newmark or Newmark()))
    status = core.lib.axt_loop_simulate(_axis(core, axis), time_step, parameters, *run.arguments)
    return run.finish(status, f"simulation of {axis}, {time_step=}")


def simulate_effects(
    axis: Axis,
    effects: Sequence[Effect],
    time_step: float,
    torque: npt.ArrayLike,
    state: State | None = None,
    *,
    held: bool = False,
    substeps: int = 1,
    precision: Precision = "float64",
) -> Motion:
    """Motion of an axis with effects, as its encoders show it; see lib/axt_machine.h.

    As simulate(), with ``substeps`` steps from one sample to the next, so that the sample rate of a
    record does not limit the accuracy: wn time_step / substeps <= 0.3 keeps frequencies to 1 %,
    and delays may last up to 1022 of these steps. The torque is linear between samples, or
    ``held`` from each to the next as a drive does it. Without effects, held torque and substeps
    the answer is that of simulate() to the last bit. About 5 to 20 million steps a second.
    Raises InputError also for an effect that is not known, has a parameter out of range or that an
    axis cannot have that often.
    """
    if not 1 <= substeps < 2**32:
        raise InputError(f"{substeps} steps from sample to sample: has to be 1 or more")
    core = _load(precision)
    run = _Simulation(core, torque, state)
    numbers = _effects(core, effects)
    course = core.lib.AXT_TORQUE_HELD if held else core.lib.AXT_TORQUE_LINEAR
    status = core.lib.axt_loop_simulate_effects(
        _axis(core, axis),
        time_step,
        course,
        core.array("axt_effects", numbers),
        substeps,
        *run.arguments,
    )
    return run.finish(status, f"simulation of {axis} with {list(effects)}, {time_step=}")


def integrate(
    method: Method,
    axis: Axis,
    time_step: float,
    torque: npt.ArrayLike,
    state: State | None = None,
    precision: Precision = "float64",
) -> Motion:
    """As simulate(), by any method of axt_integrator.h.

    The torque is linear between samples, or held from each to the next with ``exact_held``.
    """
    core = _load(precision)
    run = _Simulation(core, torque, state)
    chosen = getattr(core.lib, f"AXT_METHOD_{method.upper()}")
    status = core.lib.axt_loop_integrate(chosen, _axis(core, axis), time_step, *run.arguments)
    found = run.finish(status, f"{method} for {axis}, {time_step=}")
    found.samples["turns"] += run.start["turns"]  # the integrators start within a turn
    return found


def respond(
    damping: float,
    stiffness: float,
    time_step: float,
    first: Array,
    last: Array,
    start: Array | None = None,
) -> tuple[Array, Array]:
    """Position and speed (w, n) of x'' + damping x' + stiffness x = force, exactly.

    Between samples ``time_step`` [s] apart the force goes straight from ``first`` (w, n) to
    ``last`` (w, n); they are the same for a force that is held. Each of the w windows begins anew
    from ``start`` (w, 2), position and speed, at rest unless given. About 100 million steps a
    second. Raises InputError for damping or stiffness that is negative or too large for the time
    step.
    """
    core = _load("float64")
    windows, length = first.shape
    states = np.zeros((windows, 2)) if start is None else start
    given = [np.ascontiguousarray(array, np.float64) for array in (first, last, states)]
    found = np.empty((2, windows, length))
    status = core.lib.axt_loop_respond(
        damping,
        stiffness,
        time_step,
        *(core.array("axt_real", array) for array in given),
        windows,
        length,
        *(core.array("axt_real", array) for array in found),
    )
    _check(core, status, f"response with {damping=}, {stiffness=}, {time_step=}")
    return found[0], found[1]


def simulate_windows(
    axis: Axis,
    effects: Sequence[Effect],
    time_step: float,
    torque: Array,
    times: Array,
    starts: Array,
    substeps: int = 1,
) -> tuple[Array, Array]:
    """Angles and speeds (2, w, n) of motor and table of an axis with effects, in w windows.

    As simulate_effects() with each sample of the ``torque`` (w, n) held until the next, but without
    errors of the encoders. Each window begins anew from ``starts`` (w, 4), in the order of State,
    at its time (w,) [s], until which everything that drifts and turns has gone on. Two columns more
    are angle and speed of the table less the inertia of a further mode, which without them is at
    rest there. Angles are counted from where the motor was at the start of each window. On all
    cores. Raises InputError as simulate_effects(), also when a stiffness has drifted to nothing by
    a window.
    """
    core = _load("float64")
    numbers, motions = _effects(core, effects), _motions_of(core, starts[:, :4])
    modes = np.zeros((len(starts), 2))
    modes[:, : starts.shape[1] - 4] = starts[:, 4:]

    def run(part: slice) -> tuple[int, Array]:
        acting = np.ascontiguousarray(torque[part], np.float64)
        found = np.empty((2, 2, *acting.shape))
        status = core.lib.axt_loop_windows(
            _axis(core, axis),
            core.array("axt_effects", numbers),
            time_step,
            substeps,
            core.array("axt_real", np.ascontiguousarray(times[part], np.float64)),
            core.array("axt_motion", motions[part]),
            core.array("axt_real", modes[part]),
            core.array("axt_real", acting),
            *acting.shape,
            core.array("axt_real", found[0]),
            core.array("axt_real", found[1]),
        )
        return status, found

    worth = int(torque.size * substeps / _WORTH_A_THREAD) + 1
    count = min(os.cpu_count() or 1, worth, len(torque))
    bounds = np.linspace(0, len(torque), count + 1).astype(int).tolist()
    with ThreadPoolExecutor(count) as threads:
        parts = list(threads.map(run, itertools.starmap(slice, itertools.pairwise(bounds))))
    for status, _ in parts:
        _check(core, status, f"simulation of {axis} with {list(effects)}, {time_step=}")
    angles, speeds = np.concatenate([found for _, found in parts], axis=2)
    return angles, speeds


def motion(states: Iterable[State], precision: Precision = "float64") -> Motion:
    """Motion through given states, as a sample each.

    Raises InputError when one of them is not finite or too many turns away.
    """
    core = _load(precision)
    return Motion(precision, _motions(core, list(states)))


def read_encoders(motion: Motion, counts_per_turn: Sequence[int]) -> npt.NDArray[np.int32]:
    """What encoders at motor and table read, (n, 2) counts, wrapping around at 32 bits.

    Raises InputError when ``counts_per_turn`` is not two numbers from 1 to 2^24.
    """
    core = _load(motion.precision)
    counts = np.zeros((2, len(motion)), np.int32)
    places = (core.lib.AXT_ENCODER_MOTOR, core.lib.AXT_ENCODER_TABLE)
    done = core.ffi.new("size_t *")
    for place, resolution, row in zip(places, _resolutions(counts_per_turn), counts, strict=True):
        status = core.lib.axt_loop_read_encoder(
            resolution,
            place,
            core.array("axt_motion", motion.samples),
            len(motion),
            core.array("int32_t", row),
            done,
        )
        _check(core, status, f"encoder with {resolution} counts a turn, sample {done[0]}")
    return np.ascontiguousarray(counts.T)


def identify_motion(
    settings: IdentSettings,
    motion: Motion,
    torque: npt.ArrayLike,
    *,
    gaps: npt.ArrayLike = (),
    every: int | None = None,
) -> Estimates:
    """Recursive identification from motion with speeds and torque (n,) [N m].

    ``gaps`` are the indices of samples that do not follow the one before by one time step. An
    estimate is taken every ``every`` samples and at the end (only there by default). Raises
    InputError for settings out of range.
    """
    core = _load(motion.precision)
    run = _IdentRun(core, settings, torque, gaps, every, (0, 0))
    run.expect(len(motion), "motion")
    samples = core.array("axt_motion", motion.samples)
    return run.finish(core.lib.axt_loop_ident_motion(run.config, samples, *run.arguments))


def identify_counts(
    settings: IdentSettings,
    counts: npt.ArrayLike,
    counts_per_turn: Sequence[int],
    torque: npt.ArrayLike,
    *,
    gaps: npt.ArrayLike = (),
    every: int | None = None,
    precision: Precision = "float64",
) -> Estimates:
    """Recursive identification from encoder counts (n, 2) of motor and table and torque (n,).

    As identify_motion(); the counts may wrap around at 32 bits.
    """
    core = _load(precision)
    run = _IdentRun(core, settings, torque, gaps, every, _resolutions(counts_per_turn))
    columns = np.asarray(counts)
    if columns.ndim != 2 or columns.shape[1] != 2 or columns.dtype.kind not in "iu":
        raise InputError("counts have to be an array of integers with two columns, motor and table")
    run.expect(len(columns), "counts")
    wrapped = np.ascontiguousarray(columns.T.astype(np.int64).astype(np.int32))
    motor, table = (core.array("int32_t", row) for row in wrapped)
    return run.finish(core.lib.axt_loop_ident_counts(run.config, motor, table, *run.arguments))


class _Core:
    """The core in one precision."""

    def __init__(self, precision: Precision) -> None:
        module: Any = importlib.import_module(_MODULES[precision])
        self.ffi: Any = module.ffi
        self.lib: Any = module.lib
        self.precision = precision
        self.real = np.dtype(precision)

    def dtype(self, name: str) -> np.dtype[Any]:
        """The numpy type with the memory layout of a C type."""
        return self._dtype_of(self.ffi.typeof(name))

    def _dtype_of(self, ctype: Any) -> np.dtype[Any]:
        if ctype.kind != "struct":
            name: str = ctype.cname
            return np.dtype({"float": "f4", "double": "f8"}.get(name, name.removesuffix("_t")))
        fields = ctype.fields
        return np.dtype(
            {
                "names": [name for name, _ in fields],
                "formats": [self._dtype_of(f.type) for _, f in fields],
                "offsets": [f.offset for _, f in fields],
                "itemsize": self.ffi.sizeof(ctype),
            }
        )

    def array(self, name: str, values: npt.NDArray[Any]) -> Any:
        """A contiguous numpy array as a C array of this type, in place."""
        return self.ffi.from_buffer(f"{name}[]", values)


@functools.cache
def _load(precision: Precision) -> _Core:
    if precision not in _MODULES:
        raise InputError(f"precision {precision!r} is neither float32 nor float64")
    return _Core(precision)


def _check(core: _Core, status: int, what: str) -> None:
    """Raises the exception that a status of the core stands for; ``what`` was being done."""
    if status == core.lib.AXT_OK:
        return
    kind: type[AxisTwinError] = InputError
    if status == core.lib.AXT_ERROR_NO_DATA:
        kind = NotEnoughDataError
    raise kind(f"{what}: {core.ffi.string(core.lib.axt_status_string(status)).decode()}")


def _axis(core: _Core, axis: Axis) -> Any:
    return core.ffi.new("axt_axis *", astuple(axis))


def _axis_of(axis: Any) -> Axis:
    return Axis(axis.I1, axis.I2, axis.B, axis.K)


def _reals(core: _Core, values: npt.ArrayLike, what: str) -> npt.NDArray[Any]:
    array = np.ascontiguousarray(values, dtype=core.real)
    if array.ndim != 1 or len(array) == 0:
        raise InputError(f"{what} has to be a list of one or more numbers")
    return array


def _motions(core: _Core, states: Sequence[State]) -> npt.NDArray[np.void]:
    """The states as the core keeps them, turns counted apart from the angle."""
    return _motions_of(core, np.array([astuple(state) for state in states], np.float64))


def _motions_of(core: _Core, columns: Array) -> npt.NDArray[np.void]:
    """The same of states (n, 4), in the order of State."""
    if not np.all(np.isfinite(columns)):
        raise InputError("a state of the axis is not finite")
    angle = columns[:, 3] / _TURN
    turns = np.rint(angle)
    if np.any(np.abs(turns) >= 2.0**31):
        raise InputError("an angle is more than 2^31 turns away")
    samples = np.zeros(len(columns), core.dtype("axt_motion"))
    samples["twist"], samples["twist_speed"], samples["speed"] = columns[:, :3].T
    samples["turns"] = turns
    samples["fraction"] = angle - turns
    samples["fraction_low"] = (angle - turns) - samples["fraction"]
    return samples


def _resolutions(counts_per_turn: Sequence[int]) -> tuple[int, int]:
    numbers = tuple(counts_per_turn)
    if len(numbers) != 2 or not all(0 < number < 2**32 for number in numbers):
        raise InputError(f"counts a turn of two encoders have to be positive, not {numbers}")
    return numbers[0], numbers[1]


def _effects(core: _Core, effects: Sequence[Effect]) -> npt.NDArray[Any]:
    """The effects as the core keeps them: axt_effects seen as an array of numbers."""
    numbers = np.zeros(core.ffi.sizeof("axt_effects") // core.real.itemsize, core.real)
    for effect, (instance, entries) in zip(effects, place_effects(effects), strict=True):
        for name, entry in entries.items():
            numbers[entry.at + instance * entry.stride] = effect.params[name]
    return numbers


@functools.cache
def _places() -> dict[tuple[str, str], dict[str, EffectParameter]]:
    """The parameters by effect and location, then by name."""
    found: dict[tuple[str, str], dict[str, EffectParameter]] = {}
    for entry in effect_parameters():
        found.setdefault((entry.effect, entry.location), {})[entry.parameter] = entry
    return found


def _unknown_effect(effect: Effect) -> str:
    locations = [place for name, place in _places() if name == effect.effect]
    if locations:
        return f"{effect.effect} is not at {effect.location!r} but at {' or '.join(locations)}"
    known = ", ".join(dict.fromkeys(name for name, _ in _places()))
    return f"no effect {effect.effect!r}; there are {known}"


class _Simulation:
    """One run of a simulation: what goes in, room for what comes out."""

    def __init__(self, core: _Core, torque: npt.ArrayLike, state: State | None) -> None:
        self._core = core
        self._torque = _reals(core, torque, "torque")
        self._motion = np.zeros(len(self._torque), core.dtype("axt_motion"))
        self._done = core.ffi.new("size_t *")
        self.start = _motions(core, [state or State()])

    @property
    def arguments(self) -> tuple[Any, ...]:
        """What the loops have in common."""
        core = self._core
        return (
            core.array("axt_motion", self.start),
            core.array("axt_real", self._torque),
            len(self._torque),
            core.array("axt_motion", self._motion),
            self._done,
        )

    def finish(self, status: int, what: str) -> Motion:
        """The motion, or the exception for the status; ``what`` was being done."""
        _check(self._core, status, f"{what}, stopped at sample {self._done[0]}")
        return Motion(self._core.precision, self._motion)


class _IdentRun:
    """One run of the recursive identification: what goes in, room for what comes out."""

    def __init__(
        self,
        core: _Core,
        settings: IdentSettings,
        torque: npt.ArrayLike,
        gaps: npt.ArrayLike,
        every: int | None,
        counts_per_turn: tuple[int, int],
    ) -> None:
        self._core = core
        self._settings = settings
        self._torque = _reals(core, torque, "torque")
        self._n = len(self._torque)
        self._every = self._n if every is None else every
        if self._every < 1:
            raise InputError(f"an estimate every {every} samples: has to be 1 or more")
        self._gap = np.zeros(self._n, np.uint8)
        self._gap[np.asarray(gaps, dtype=np.int64)] = 1
        self._estimates = np.zeros(-(-self._n // self._every), core.dtype("axt_estimate"))
        self._rejected = core.ffi.new("uint32_t *")
        self.config = core.ffi.new(
            "axt_ident_config *",
            {
                "form": getattr(core.lib, _FORMS[settings.form]),
                "time_step": settings.time_step,
                "forgetting": settings.forgetting,
                "expected": astuple(settings.expected),
                "torque": settings.torque,
                "counts_per_turn": counts_per_turn,
            },
        )

    @property
    def arguments(self) -> tuple[Any, ...]:
        """What the two loops have in common."""
        core = self._core
        return (
            core.array("axt_real", self._torque),
            core.array("uint8_t", self._gap),
            self._n,
            self._every,
            core.array("axt_estimate", self._estimates),
            self._rejected,
        )

    def expect(self, length: int, what: str) -> None:
        """Raises InputError unless ``what`` is as long as the torque."""
        if length != self._n:
            raise InputError(f"{what} has {length} samples, torque has {self._n}")

    def finish(self, status: int) -> Estimates:
        """The estimates, or the exception for the status."""
        _check(self._core, status, f"identification with {self._settings}")
        found = self._estimates
        ends = np.minimum(np.arange(1, len(found) + 1) * self._every, self._n)
        bits = 1 << np.arange(4)
        return Estimates(
            sample=ends,
            axis=_table(found["axis"]),
            axis_error=_table(found["axis_error"]),
            modal=_table(found["modal"]),
            modal_error=_table(found["modal_error"]),
            valid=(found["valid"][:, None] & bits) != 0,
            used=found["samples"].astype(np.int64),
            rejected=self._rejected[0],
        )


def _table(structures: npt.NDArray[np.void]) -> Array:
    """Structures (k,) of equal numbers as a plain array (k, fields)."""
    names = structures.dtype.names or ()
    return np.column_stack([structures[name].astype(np.float64) for name in names])
