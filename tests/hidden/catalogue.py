"""What can be hidden in a record: identifiers of the catalogue, how each is put into a truth, and
how one is drawn at random.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from truth import Truth

#: Where each parameter is in a truth.
_PLACES = {
    ("friction_drift", "motor", "rate"): "friction1.drift",
    ("friction_drift", "table", "rate"): "friction2.drift",
    ("torque_offset", "motor", "torque"): "offset1",
    ("torque_offset", "table", "torque"): "offset2",
    ("backlash", "shaft", "gap"): "gap",
    ("stiffness_hardening", "shaft", "coefficient"): "hardening",
    ("stiffness_drift", "shaft", "rate"): "stiffness_drift",
    ("load_change", "table", "ratio"): "load_ratio",
    ("load_change", "table", "time"): "load_time",
    ("extra_mode", "table", "frequency"): "mode_frequency",
    ("extra_mode", "table", "damping_ratio"): "mode_damping",
    ("extra_mode", "table", "mass_ratio"): "mode_mass",
    ("delay", "torque", "time"): "torque_delay",
    ("torque_saturation", "motor", "limit"): "torque_limit",
    # not in the catalogue
    ("hysteresis", "shaft", "stiffness"): "hysteresis",
    ("hysteresis", "shaft", "reach"): "hysteresis_reach",
    ("torque_fall", "motor", "fall"): "torque_fall",
}
for _i, _where in enumerate(("motor", "table"), 1):
    for _effect, _parameter, _name in (
        ("friction_coulomb", "torque", "coulomb"),
        ("friction_viscous", "coefficient", "viscous"),
        ("friction_stribeck", "torque", "stribeck"),
        ("friction_stribeck", "speed", "stribeck_speed"),
        # not in the catalogue
        ("lugre", "torque", "coulomb"),
        ("lugre", "stiffness", "bristles"),
        ("lugre", "damping", "bristle_damping"),
        ("square_drag", "coefficient", "square"),
        ("uneven_friction", "torque", "coulomb"),
        ("uneven_friction", "share", "uneven"),
        ("uneven_friction", "periods", "periods"),
    ):
        _PLACES[_effect, _where, _parameter] = f"friction{_i}.{_name}"
    _PLACES["delay", f"encoder{_i}", "time"] = f"encoder{_i}.delay"
    _PLACES["quantisation", f"encoder{_i}", "counts"] = f"encoder{_i}.counts"
for _effect, _where, _rate, _wave in (
    ("disturbance", "motor", "frequency", "disturbance1"),
    ("disturbance", "table", "frequency", "disturbance2"),
    ("torque_ripple", "motor", "periods", "ripple"),
    ("lead_error", "table", "periods", "encoder2.lead"),
    ("encoder_eccentricity", "encoder1", "", "encoder1.once"),
    ("encoder_eccentricity", "encoder2", "", "encoder2.once"),
):
    for _parameter, _name in (("amplitude", "amplitude"), (_rate, "rate"), ("phase", "phase")):
        _PLACES[_effect, _where, _parameter] = f"{_wave}.{_name}"

#: Truths that axistwin has no name for.
UNKNOWN = ("lugre", "square_drag", "uneven_friction", "hysteresis", "torque_fall")


@dataclass(frozen=True)
class Hidden:
    """An effect as it is: identifiers and parameters of the public catalogue, or of UNKNOWN."""

    effect: str
    location: str
    params: Mapping[str, float]

    def into(self, truth: Truth) -> Truth:
        """The truth with this effect, too."""
        if self.effect == "encoder_eccentricity":
            truth = _with(truth, f"{self.location}.once.rate", 1.0)
        for parameter, value in self.params.items():
            place = _PLACES.get((self.effect, self.location, parameter))
            if place is not None:  # sample_loss is of the file
                truth = _with(truth, place, value)
        return truth


def _with(numbers: Any, place: str, value: float) -> Any:
    name, _, rest = place.partition(".")
    new = _with(getattr(numbers, name), rest, value) if rest else value
    return numbers._replace(**{name: new})


@dataclass(frozen=True)
class Probe:
    """The axis without effects under the excitation: what sizes are measured against."""

    truth: Truth
    time_step: float
    duration: float
    torque_rms: float
    torque_peak: float
    speed_rms: float
    speed_peak: float
    twist_rms: float
    noise: tuple[float, float]

    @property
    def natural_frequency(self) -> float:
        """Of the shaft [rad/s]."""
        return float(np.sqrt(self.truth.K * (1 / self.truth.I1 + 1 / self.truth.I2)))


@dataclass(frozen=True)
class Draft:
    """An effect but for its size: the parameter ``vary`` is ``base + slope size``.

    ``along`` are parameters that grow in proportion to the size, ``most`` is the largest size that
    is physical. What is ``seen_directly`` is an angle, not the work of a torque.
    """

    effect: str
    location: str
    shape: Mapping[str, float]
    vary: str
    most: float
    base: float = 0.0
    slope: float = 1.0
    along: Mapping[str, float] = field(default_factory=dict)
    seen_directly: bool = False

    def at(self, size: float) -> Hidden:
        """The effect of that size."""
        value = self.base + self.slope * size
        along = {name: size * per for name, per in self.along.items()}
        return Hidden(self.effect, self.location, {**self.shape, **along, self.vary: value})


Drawer = Callable[[np.random.Generator, Probe], Draft]


def _log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(low * (high / low) ** rng.uniform())


def _phase(rng: np.random.Generator) -> float:
    return float(rng.uniform(-np.pi, np.pi))


def _place(rng: np.random.Generator) -> str:
    return str(rng.choice(["motor", "table"]))


def _periods(rng: np.random.Generator, probe: Probe) -> float:
    """Whole periods a turn, slow enough for the sampling and not so slow as to be none."""
    most = min(72.0, 0.5 * np.pi / (probe.time_step * probe.speed_peak))
    return float(max(1, round(_log_uniform(rng, 1.0, max(1.5, most)))))


def _coulomb(rng: np.random.Generator, probe: Probe) -> Draft:
    return Draft("friction_coulomb", _place(rng), {}, "torque", 0.6 * probe.torque_rms)


def _viscous(rng: np.random.Generator, probe: Probe) -> Draft:
    most = 0.6 * probe.torque_rms / probe.speed_rms
    return Draft("friction_viscous", _place(rng), {}, "coefficient", most)


def _stribeck(rng: np.random.Generator, probe: Probe) -> Draft:
    speed = _log_uniform(rng, 0.05, 0.4) * probe.speed_rms
    return Draft(
        "friction_stribeck", _place(rng), {"speed": speed}, "torque", 0.6 * probe.torque_rms
    )


def _offset(rng: np.random.Generator, probe: Probe) -> Draft:
    sign = float(rng.choice([-1.0, 1.0]))
    return Draft("torque_offset", _place(rng), {}, "torque", 0.5 * probe.torque_rms, slope=sign)


def _backlash(rng: np.random.Generator, probe: Probe) -> Draft:
    del rng
    return Draft("backlash", "shaft", {}, "gap", 6.0 * probe.twist_rms)


def _hardening(rng: np.random.Generator, probe: Probe) -> Draft:
    del rng
    most = 0.5 * probe.truth.K / probe.twist_rms**2
    return Draft("stiffness_hardening", "shaft", {}, "coefficient", most)


def _ripple(rng: np.random.Generator, probe: Probe) -> Draft:
    shape = {"periods": _periods(rng, probe), "phase": _phase(rng)}
    return Draft("torque_ripple", "motor", shape, "amplitude", 0.5 * probe.torque_rms)


def _lead(rng: np.random.Generator, probe: Probe) -> Draft:
    shape = {"periods": _periods(rng, probe), "phase": _phase(rng)}
    return Draft("lead_error", "table", shape, "amplitude", 0.05, seen_directly=True)


def _eccentricity(rng: np.random.Generator, probe: Probe) -> Draft:
    del probe
    where = str(rng.choice(["encoder1", "encoder2"]))
    shape = {"phase": _phase(rng)}
    return Draft("encoder_eccentricity", where, shape, "amplitude", 0.05, seen_directly=True)


def _delay(rng: np.random.Generator, probe: Probe) -> Draft:
    where = str(rng.choice(["torque", "encoder1", "encoder2"]))
    return Draft("delay", where, {}, "time", 5.0 * probe.time_step)


def _saturation(rng: np.random.Generator, probe: Probe) -> Draft:
    del rng
    most = 0.5 * probe.torque_peak
    return Draft(
        "torque_saturation", "motor", {}, "limit", most, base=probe.torque_peak, slope=-1.0
    )


def _stiffness_drift(rng: np.random.Generator, probe: Probe) -> Draft:
    sign = float(rng.choice([-1.0, 1.0]))
    return Draft("stiffness_drift", "shaft", {}, "rate", 0.3 / probe.duration, slope=sign)


def _friction_drift(rng: np.random.Generator, probe: Probe) -> Draft:
    sign = float(rng.choice([-1.0, 1.0]))
    return Draft("friction_drift", _place(rng), {}, "rate", 0.8 / probe.duration, slope=sign)


def _load_change(rng: np.random.Generator, probe: Probe) -> Draft:
    sign = float(rng.choice([-1.0, 1.0]))
    shape = {"time": probe.duration * float(rng.uniform(0.25, 0.75))}
    return Draft("load_change", "table", shape, "ratio", 1.0 if sign > 0 else 0.5, slope=sign)


def _extra_mode(rng: np.random.Generator, probe: Probe) -> Draft:
    shape = {
        "frequency": probe.natural_frequency * _log_uniform(rng, 0.3, 2.0),
        "damping_ratio": _log_uniform(rng, 0.01, 0.05),
    }
    return Draft("extra_mode", "table", shape, "mass_ratio", 0.5)


def _disturbance(rng: np.random.Generator, probe: Probe) -> Draft:
    fastest = min(1.5 * probe.natural_frequency, 0.5 * np.pi / probe.time_step)
    shape = {"frequency": _log_uniform(rng, 4 * np.pi, fastest), "phase": _phase(rng)}
    return Draft("disturbance", _place(rng), shape, "amplitude", 0.5 * probe.torque_rms)


def _lugre(rng: np.random.Generator, probe: Probe) -> Draft:
    """Bristles that slip after what the axis moves at its rms speed in 0.3 .. 30 ms."""
    time = _log_uniform(rng, 3e-4, 3e-2)
    reach = probe.speed_rms * time
    along = {"stiffness": 1.0 / reach, "damping": 0.1 * time / reach}
    return Draft("lugre", _place(rng), {}, "torque", 0.6 * probe.torque_rms, along=along)


def _square_drag(rng: np.random.Generator, probe: Probe) -> Draft:
    most = 0.6 * probe.torque_rms / probe.speed_rms**2
    return Draft("square_drag", _place(rng), {}, "coefficient", most)


def _uneven_friction(rng: np.random.Generator, probe: Probe) -> Draft:
    shape = {
        "share": float(rng.uniform(0.6, 0.95)),
        "periods": float(rng.integers(1, 4)),
    }
    return Draft("uneven_friction", _place(rng), shape, "torque", 0.6 * probe.torque_rms)


def _hysteresis(rng: np.random.Generator, probe: Probe) -> Draft:
    shape = {"reach": probe.twist_rms * _log_uniform(rng, 0.3, 1.0)}
    return Draft("hysteresis", "shaft", shape, "stiffness", 0.5 * probe.truth.K)


def _torque_fall(rng: np.random.Generator, probe: Probe) -> Draft:
    del rng
    return Draft("torque_fall", "motor", {}, "fall", 0.3 / probe.torque_peak**2)


#: How each effect of the catalogue, and each that is not in it, is drawn.
DRAWERS: dict[str, Drawer] = {
    "friction_coulomb": _coulomb,
    "friction_viscous": _viscous,
    "friction_stribeck": _stribeck,
    "torque_offset": _offset,
    "backlash": _backlash,
    "stiffness_hardening": _hardening,
    "torque_ripple": _ripple,
    "lead_error": _lead,
    "encoder_eccentricity": _eccentricity,
    "delay": _delay,
    "torque_saturation": _saturation,
    "stiffness_drift": _stiffness_drift,
    "friction_drift": _friction_drift,
    "load_change": _load_change,
    "extra_mode": _extra_mode,
    "disturbance": _disturbance,
    "lugre": _lugre,
    "square_drag": _square_drag,
    "uneven_friction": _uneven_friction,
    "hysteresis": _hysteresis,
    "torque_fall": _torque_fall,
}
