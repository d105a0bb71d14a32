"""A model of an axis: its parameters and its effects, as a file and as a simulation.

The file is TOML::

    schema = "axistwin.model/1"
    linear = false            # true: kg, N s/m, N/m, and m, N for rad, N m below

    [axis]
    I1 = 2.7e-5               # kg m2
    I2 = 8.3e-6               # kg m2
    B = 2.1e-3                # N m s/rad
    K = 110.0                 # N m/rad

    [[effects]]               # any number of them
    effect = "friction_coulomb"
    location = "table"
    params = { torque = 0.012 }

    [meta]                    # whatever else; not read

Identifiers are those of the catalogue (core.effect_parameters()); what is periodic counts its
periods a turn, or a metre where the axis is linear. One effect is no part of the axis but of the
record: ``sample_loss`` at ``record`` with ``fraction``, the share of samples that go missing.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from axistwin import core
from axistwin.core import Array, Axis, Effect, State
from axistwin.errors import InputError
from axistwin.identify.samples import HOLDS, Hold
from axistwin.output import atomic_write

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

#: What the first line of a model file says.
SCHEMA = "axistwin.model/1"

#: The effect that is no part of the axis.
SAMPLE_LOSS = "sample_loss"

#: A step of the simulation turns the vibration of the shaft by this much at most: its frequency
#: is then right to 1 part in 300.
_VIBRATION_STEP_MAX = 0.2

#: What drifts with the friction at a place.
_FRICTION = ("friction_coulomb", "friction_viscous", "friction_asymmetry", "friction_stribeck")

_AXIS = tuple(entry.name for entry in fields(Axis))

#: Of the parameters of a rotary axis.
AXIS_UNITS = {"I1": "kg m2", "I2": "kg m2", "B": "N m s/rad", "K": "N m/rad"}


@dataclass(frozen=True)
class Model:
    """An axis with its effects; a ``linear`` one in kg, N, m. ``meta`` is anything TOML can hold.

    Raises InputError for effects or parameters that are not in the catalogue.
    """

    axis: Axis
    effects: tuple[Effect, ...] = ()
    linear: bool = False
    meta: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        core.check_effects(self._inside)
        for effect in self.effects:
            if effect.effect == SAMPLE_LOSS:
                fraction = effect.params.get("fraction", 0.0)
                if (effect.location, set(effect.params)) != ("record", {"fraction"}):
                    raise InputError(f"{SAMPLE_LOSS} is at record and has the parameter fraction")
                if not 0.0 <= fraction < 1.0:
                    raise InputError(f"{SAMPLE_LOSS}: a fraction of {fraction} is not 0 to 1")

    @property
    def _inside(self) -> tuple[Effect, ...]:
        return tuple(effect for effect in self.effects if effect.effect != SAMPLE_LOSS)

    @property
    def sample_loss(self) -> float:
        """The share of samples that go missing."""
        return sum(e.params["fraction"] for e in self.effects if e.effect == SAMPLE_LOSS)

    # ---- As a vector, for fits

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all parameters, such as ``K`` or ``friction_coulomb:table:torque``.

        A second ripple at the same place has ``torque_ripple#2:motor:...``.
        """
        return (*_AXIS, *(name for name, _, _ in self._places()))

    @property
    def values(self) -> Array:
        """The parameters (k,) in the order of ``names``."""
        inside = [self.effects[i].params[parameter] for _, i, parameter in self._places()]
        return np.array([*astuple(self.axis), *inside], np.float64)

    def with_values(self, values: npt.ArrayLike) -> Model:
        """The same model with other parameters (k,) in the order of ``names``."""
        numbers = np.asarray(values, np.float64).tolist()
        places = self._places()
        if len(numbers) != len(_AXIS) + len(places):
            raise InputError(f"{len(numbers)} values for {len(_AXIS) + len(places)} parameters")
        params = [dict(effect.params) for effect in self.effects]
        for (_, i, parameter), number in zip(places, numbers[len(_AXIS) :], strict=True):
            params[i][parameter] = number
        effects = tuple(
            replace(effect, params=own) for effect, own in zip(self.effects, params, strict=True)
        )
        return replace(self, axis=Axis(*numbers[: len(_AXIS)]), effects=effects)

    def _places(self) -> list[tuple[str, int, str]]:
        """Name, index of the effect and parameter of every parameter of an effect."""
        found = []
        count: dict[tuple[str, str], int] = {}
        for i, effect in enumerate(self.effects):
            key = (effect.effect, effect.location)
            count[key] = count.get(key, 0) + 1
            number = "" if count[key] == 1 else f"#{count[key]}"
            for parameter in effect.params:
                found.append(
                    (f"{effect.effect}{number}:{effect.location}:{parameter}", i, parameter)
                )
        return found

    # ---- As a simulation

    def later(self, time: float) -> Model:
        """The model for a simulation that starts ``time`` [s] later.

        Drifts, disturbances and the change of the load count from the start of a simulation; here
        they are as far as they have come by then. What began before is taken from the State that
        the simulation is given. Raises InputError for a stiffness that has drifted to nothing.
        """
        grown = {
            (effect.effect, effect.location): 1.0 + effect.params.get("rate", 0.0) * time
            for effect in self.effects
            if effect.effect in ("friction_drift", "stiffness_drift")
        }
        stiffness = grown.get(("stiffness_drift", "shaft"), 1.0)
        if stiffness <= 0.0:
            raise InputError(f"{time} s later the stiffness has drifted to nothing")
        return replace(
            self,
            axis=replace(self.axis, K=self.axis.K * stiffness),
            effects=tuple(_later(effect, time, grown) for effect in self.effects),
        )

    @property
    def natural_frequency(self) -> float:
        """Of the shaft, undamped [rad/s]."""
        return core.modal(self.rotary()[0]).wn

    def substeps(self, time_step: float) -> int:
        """Steps from one sample to the next, ``time_step`` [s], that the vibration asks for."""
        wn = self.natural_frequency
        modes = [e.params.get("frequency", 0.0) for e in self.effects if e.effect == "extra_mode"]
        fastest = max([wn, *modes])
        return max(1, int(np.ceil(fastest * time_step / _VIBRATION_STEP_MAX)))

    def simulate(
        self,
        torque: npt.ArrayLike,
        time_step: float,
        state: State | None = None,
        *,
        hold: Hold = "zoh",
        substeps: int | None = None,
    ) -> tuple[Array, Array]:
        """theta1, theta2 (n,) as the encoders show them under torque (n,).

        As core.simulate_effects(), for linear axes too. ``hold`` says how the torque goes on
        between samples: held from each to the next, as a drive does it (zoh), linear (foh), or by
        one step of Newmark's method (newmark), as the emulated axis at its own rate. Unless given,
        zoh and foh take as many ``substeps`` as the vibration asks for. Raises InputError.
        """
        axis, effects = self.rotary()
        steps = substeps or (1 if hold == "newmark" else self.substeps(time_step))
        scale = self._angle
        start = state or State()
        motion = core.simulate_effects(
            axis,
            effects,
            time_step,
            np.asarray(torque, np.float64) / scale,
            State(*(scale * value for value in astuple(start))),
            held=hold == "zoh",
            substeps=steps,
        )
        return motion.theta1 / scale, motion.theta2 / scale

    @property
    def _angle(self) -> float:
        """Angle in the core for 1 of the model: a metre is a turn, so that periods are whole."""
        return 2.0 * np.pi if self.linear else 1.0

    def rotary(self, force: float = 1.0) -> tuple[Axis, tuple[Effect, ...]]:
        """The same axis in the core's units, with what is inside it of the effects.

        A metre of a linear axis is a turn in there; force x distance is kept. All that is measured
        in forces can be ``force`` times as large, which changes no motion.
        """
        scale = self._angle
        axis = Axis(*(value * force / scale**2 for value in astuple(self.axis)))
        units = {
            (entry.effect, entry.location, entry.parameter): scale ** (entry.angle - entry.force)
            * force**entry.force
            for entry in core.effect_parameters()
        }
        effects = tuple(
            replace(
                effect,
                params={
                    name: value * units[effect.effect, effect.location, name]
                    for name, value in effect.params.items()
                },
            )
            for effect in self._inside
        )
        return axis, effects

    # ---- For an emulated axis

    def emulator_options(self) -> list[str]:
        """The options of axistwin-emulator that make its axis this one.

        Raises InputError for a linear axis: the emulated drive turns. Samples are lost on the bus,
        not by a drive, so ``sample_loss`` is refused, too.
        """
        self._check_emulated()
        options = ["--axis", ",".join(map(repr, astuple(self.axis)))]
        for effect in self.effects:
            params = ",".join(f"{name}={value!r}" for name, value in effect.params.items())
            options += ["--effect", f"{effect.effect}:{effect.location}:{params}"]
        return options

    def commands(self) -> list[tuple[str, float]]:
        """The commands on the bus, each with its argument, that make an emulated axis this one.

        Raises as emulator_options().
        """
        self._check_emulated()
        catalogue = core.effect_parameters()
        commands = [("EffectsClear", 0.0)]
        commands += [(f"Axis{name}", getattr(self.axis, name)) for name in _AXIS]
        places = core.place_effects(self.effects)
        for effect, (instance, entries) in zip(self.effects, places, strict=True):
            for name, entry in entries.items():
                commands.append(("EffectSelect", catalogue.index(entry) | instance << 8))
                commands.append(("EffectValue", effect.params[name]))
        return [*commands, ("AxisRestart", 0.0)]

    def _check_emulated(self) -> None:
        """Raises InputError for a model that no emulated axis can be."""
        if self.linear:
            raise InputError("the emulated axis is a rotary one, the model is linear")
        if self.sample_loss > 0.0:
            raise InputError(f"the emulated axis cannot have {SAMPLE_LOSS}: that is of the record")


def _later(effect: Effect, time: float, grown: Mapping[tuple[str, str], float]) -> Effect:
    """One effect of Model.later(); ``grown`` is by how much what drifts has grown by then."""
    params = dict(effect.params)
    if effect.effect == "load_change":
        params["time"] = max(0.0, params.get("time", 0.0) - time)
    elif effect.effect == "disturbance":
        phase = params.get("phase", 0.0) + params.get("frequency", 0.0) * time
        params["phase"] = float(np.remainder(phase, 2.0 * np.pi))
    elif effect.effect in ("friction_drift", "stiffness_drift"):
        now = grown[effect.effect, effect.location]
        params["rate"] = params.get("rate", 0.0) / now if now > 0.0 else 0.0
    elif effect.effect in _FRICTION:
        now = max(0.0, grown.get(("friction_drift", effect.location), 1.0))
        for name in ("torque", "coefficient"):
            if name in params:
                params[name] *= now
    return replace(effect, params=params)


# ---- As a file


def add_hold_argument(parser: argparse.ArgumentParser) -> None:
    """Adds --hold: what a simulation takes the torque to do between samples."""
    parser.add_argument(
        "--hold",
        choices=HOLDS,
        default="zoh",
        help="the torque between samples: held from each to the next as a drive does it (zoh), "
        "linear (foh), or by the trapezoidal rule of the emulated axis (newmark) (default: zoh)",
    )


def read(path: str | Path) -> Model:
    """A model from a file. Raises InputError that says what is wrong with it."""
    try:
        with Path(path).open("rb") as file:
            content = tomllib.load(file)
    except OSError as error:
        raise InputError(f"cannot read {path}: {error.strerror or error}") from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is no TOML: {error}") from error
    try:
        return _parse(content)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def write(model: Model, path: str | Path) -> None:
    """Writes a model; reading it back gives the same one. ``meta`` values are numbers or text.

    Raises FileError.
    """
    with atomic_write(path) as partial:
        partial.write_text("\n".join(_lines(model)) + "\n", encoding="utf-8")


def _parse(content: Mapping[str, Any]) -> Model:
    schema = content.get("schema")
    if schema != SCHEMA:
        raise InputError(f"the schema is {schema!r}; this version reads {SCHEMA!r}")
    _only(content, {"schema", "linear", "axis", "effects", "meta"}, "the file")
    linear = content.get("linear", False)
    if not isinstance(linear, bool):
        raise InputError("linear is neither true nor false")
    axis = _table(content.get("axis"), "axis")
    _only(axis, set(_AXIS), "axis")
    missing = [name for name in _AXIS if name not in axis]
    if missing:
        raise InputError(f"axis has no {', '.join(missing)}")
    effects = content.get("effects", [])
    if not isinstance(effects, list):
        raise InputError("effects are not a list: begin each with [[effects]]")
    return Model(
        Axis(*(_number(axis[name], name) for name in _AXIS)),
        tuple(_effect(_table(entry, "an effect")) for entry in effects),
        linear,
        _table(content.get("meta", {}), "meta"),
    )


def _effect(entry: Mapping[str, Any]) -> Effect:
    _only(entry, {"effect", "location", "params"}, "an effect")
    texts = [entry.get("effect"), entry.get("location")]
    if not all(isinstance(text, str) for text in texts):
        raise InputError("an effect has no name (effect) or no location")
    params = _table(entry.get("params", {}), "params")
    return Effect(
        str(texts[0]),
        str(texts[1]),
        {name: _number(value, f"{texts[0]}: {name}") for name, value in params.items()},
    )


def _table(value: Any, what: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise InputError(f"{what} is not a table")
    return value


def _only(table: Mapping[str, Any], known: set[str], what: str) -> None:
    for key in table:
        if key not in known:
            raise InputError(f"{what} has {key!r}; known are {', '.join(sorted(known))}")


def _number(value: Any, what: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
        raise InputError(f"{what} is {value!r}, not a number")
    return float(value)


def parameter_unit(effect: str, location: str, parameter: str, linear: bool) -> str:
    """Unit of a parameter of an effect, for a rotary or a linear axis; 1 for a number without."""
    units = {(e.effect, e.location, e.parameter): e.unit for e in core.effect_parameters()}
    return _unit(units.get((effect, location, parameter), "1"), linear)


def _lines(model: Model) -> Sequence[str]:
    lines = [f'schema = "{SCHEMA}"', f"linear = {str(model.linear).lower()}", "", "[axis]"]
    for name in _AXIS:
        unit = _unit(AXIS_UNITS[name], model.linear)
        lines.append(f"{name} = {float(getattr(model.axis, name))!r} # {unit}")
    for effect in model.effects:
        lines += ["", "[[effects]]", f'effect = "{effect.effect}"']
        lines += [f'location = "{effect.location}"', "[effects.params]"]
        for name, value in effect.params.items():
            unit = parameter_unit(effect.effect, effect.location, name, model.linear)
            note = "" if unit == "1" else f" # {unit}"
            lines.append(f"{name} = {float(value)!r}{note}")
    if model.meta:
        lines += ["", "[meta]"]
        lines += [f"{_key(name)} = {_toml(value)}" for name, value in model.meta.items()]
    return lines


def _unit(unit: str, linear: bool) -> str:
    """A unit of a rotary axis, or what it is for a linear one."""
    if not linear:
        return unit
    return {"kg m2": "kg", "rad": "m", "rad/s": "m/s"}.get(
        unit, unit.replace("N m", "N").replace("rad", "m")
    )


def _key(name: str) -> str:
    return _toml(str(name))


def _toml(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, (int, float)):
        return repr(value)
    escaped = str(value).replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    return f'"{escaped}"'
