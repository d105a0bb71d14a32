"""A diagnosis in an engineer's words: names, numbers with sensible units and digits, sentences."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from axistwin.diagnose.result import Considered, Diagnosis, Finding
from axistwin.identify.result import Quantity
from axistwin.model import parameter_unit

#: An effect as a sentence names it; what stands for its place follows.
_EFFECTS = {
    "friction_coulomb": "dry friction",
    "friction_viscous": "viscous friction",
    "friction_asymmetry": "friction that differs by direction",
    "friction_stribeck": "break-away friction (Stribeck)",
    "friction_drift": "a drift of the friction",
    "torque_offset": "a constant torque",
    "backlash": "backlash",
    "stiffness_hardening": "stiffening with twist",
    "stiffness_drift": "a drift of the stiffness",
    "torque_ripple": "torque ripple",
    "lead_error": "a lead error",
    "encoder_eccentricity": "eccentricity",
    "delay": "a delay",
    "torque_saturation": "saturation of the torque",
    "load_change": "a change of the load",
    "extra_mode": "a further resonance",
    "disturbance": "a periodic disturbance",
    "quantisation": "coarse counts",
    "sample_loss": "lost samples",
}

_PLACES = {
    "motor": "at the motor",
    "table": "at the table",
    "shaft": "of the shaft",
    "torque": "of the torque",
    "encoder1": "of the motor encoder",
    "encoder2": "of the table encoder",
    "record": "in the record",
}

#: Numbers that read better in another unit: by parameter, factor and unit.
_SHOWN_AS = {
    "phase": (180.0 / math.pi, "°"),
    "frequency": (0.5 / math.pi, "Hz"),
    "rate": (100.0, "%/s"),
    "ratio": (100.0, "%"),
    "mass_ratio": (100.0, "%"),
    "fraction": (100.0, "%"),
    "counts": (1.0, "a turn"),
    "periods": (1.0, "a turn"),
}

_PREFIXES = {3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}

#: Units that take a prefix. Others, such as kg m2, are written with a power of ten.
_PREFIXED = ("N", "rad", "m", "s", "Hz")

#: Significant digits of the half width of an interval, and of a number without one.
_DIGITS_OF_WIDTH, _DIGITS = 2, 3

#: More digits than this nobody reads.
_DIGITS_MAX = 8

#: Per cent below which a share is none, or the whole.
_SHARE_MIN = 0.005

_COUNTS = {1: "One cause", 2: "Two causes", 3: "Three causes", 4: "Four causes"}


# ---- Numbers


@dataclass(frozen=True)
class Shown:
    """A number as text, with its ``interval``, empty where there is none, and its ``unit``."""

    value: str
    interval: str
    unit: str

    @property
    def with_unit(self) -> str:
        """Such as ``12.3 mN m``."""
        return joined(self.value, self.unit)


def joined(number: str, unit: str) -> str:
    """A number and its unit, which a degree sign follows closely."""
    return f"{number}{'' if unit in ('', '°') else ' '}{unit}"


def shown(value: float, unit: str, interval: tuple[float, float] | None = None) -> Shown:
    """A number in ``unit``, with a prefix that suits it and the digits that its interval leaves."""
    unit = "" if unit == "1" else unit.replace("m2", "m²").replace("rad3", "rad³")
    power = _power(value) if unit.startswith(_PREFIXED) else 0
    scale, unit = 10.0**-power, _PREFIXES[power] + unit
    ends = None if interval is None else (scale * interval[0], scale * interval[1])
    width = 0.0 if ends is None else 0.5 * abs(ends[1] - ends[0])
    if width == 0.0 and ends is not None and value == round(value):
        return Shown(f"{value:.0f}", "", unit)
    number = _Number(scale * value, width)
    if ends is None or width == 0.0:
        return Shown(number.text(scale * value), "", unit)
    return Shown(
        number.text(scale * value), f"{number.text(ends[0])} .. {number.text(ends[1])}", unit
    )


def parameter(finding: Finding, name: str, linear: bool) -> Shown:
    """A parameter of a finding, in the unit in which it reads best."""
    unit = parameter_unit(finding.effect, finding.location, name, linear)
    factor, unit = _SHOWN_AS.get(name, (1.0, unit))
    if linear and unit == "a turn":
        unit = "a metre"
    low, high = finding.ci95.get(name, (0.0, 0.0))
    return shown(factor * finding.params[name], unit, (factor * low, factor * high))


def quantity(item: Quantity) -> Shown:
    """A parameter of the axis."""
    return shown(item.value, item.unit, item.ci95)


def percent(share: float) -> str:
    """A share, such as ``86 %``, ``0.4 %`` or ``99.97 %``."""
    number = 100.0 * share
    if not math.isfinite(number):
        return "-"
    rest = min(abs(number), abs(100.0 - number))
    if rest < _SHARE_MIN:
        return f"{number:.0f} %"
    return f"{number:.{max(0, -math.floor(math.log10(rest)))}f} %"


def _power(value: float) -> int:
    """The power of ten of the prefix with which a number is 1 to 1000, where there is one."""
    if value == 0.0 or not math.isfinite(value):
        return 0
    wanted = 3 * math.floor(math.log10(abs(value)) / 3.0)
    return max(min(wanted, max(_PREFIXES)), min(_PREFIXES))


class _Number:
    """How many digits a number has that is known to so much."""

    def __init__(self, value: float, width: float) -> None:
        size = abs(value) if value != 0.0 and math.isfinite(value) else 1.0
        self._leading = math.floor(math.log10(size))
        digits = _DIGITS
        if width > 0.0 and math.isfinite(width):
            digits = self._leading - math.floor(math.log10(width)) + _DIGITS_OF_WIDTH
        self._digits = min(max(digits, 2), _DIGITS_MAX)

    def text(self, value: float) -> str:
        """A number with as many decimals as that one."""
        if not math.isfinite(value):
            return "?"
        if not -2 <= self._leading < 6:
            scale = 10.0**self._leading
            return f"{value / scale:.{self._digits - 1}f}e{self._leading}"
        return f"{value:.{max(self._digits - 1 - self._leading, 0)}f}"


# ---- Names and sentences


def cause(effect: str, location: str) -> str:
    """Such as ``dry friction at the table``."""
    return f"{what(effect)} {where(location)}"


def what(effect: str) -> str:
    """Such as ``dry friction``."""
    return _EFFECTS[effect]


def where(location: str) -> str:
    """Such as ``at the table``."""
    return _PLACES[location]


def title(text: str) -> str:
    """A name that begins a line: without its article, with a capital."""
    bare = text.removeprefix("a ")
    return bare[:1].upper() + bare[1:]


def listed(parts: Sequence[str]) -> str:
    """``a, b and c``."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def record_line(diagnosis: Diagnosis) -> str:
    """What was looked at, in one line without the name."""
    record = diagnosis.record
    encoders = "one encoder" if record.theta2 is None else "motor and table encoder"
    return (
        f"{len(record)} samples, {record.duration:.4g} s at {1.0 / record.time_step:.6g} Hz, "
        f"{encoders}"
    )


def explained(diagnosis: Diagnosis) -> list[float]:
    """The share that each finding removes of the squared error that those before it leave."""
    gains = [finding.gain for finding in diagnosis.findings]
    return [_of_rest(gain, gains[:i]) for i, gain in enumerate(gains)]


def would_explain(diagnosis: Diagnosis, considered: Considered) -> float:
    """The share that it would remove of the squared error that the findings leave."""
    return _of_rest(considered.gain, [finding.gain for finding in diagnosis.findings])


def _of_rest(gain: float, before: Sequence[float]) -> float:
    rest = 1.0 - sum(before)
    return gain / rest if rest > 0.0 else math.nan


def verdict(diagnosis: Diagnosis) -> str:
    """The answer in a few words."""
    if diagnosis.healthy:
        return "Nothing wrong"
    if not diagnosis.findings:
        return "Something is wrong that is none of these"
    count = len(diagnosis.findings)
    named = f"{_COUNTS.get(count, f'{count} causes')} named"
    return f"{named}, and something is left" if diagnosis.unexplained else named


def paragraph(diagnosis: Diagnosis) -> str:
    """The answer as one short paragraph."""
    error = diagnosis.error
    base, extended, floor = (
        shown(value, error.unit).with_unit
        for value in (error.base, error.extended, error.noise_floor)
    )
    tried = len({(one.effect, one.location) for one in diagnosis.considered})
    if diagnosis.healthy:
        return (
            f"Nothing is wrong: {_base_model(diagnosis)} simulates windows that no fit has seen to "
            f"{base} rms, where noise alone makes {floor}. None of the {tried} effects that were "
            "tried makes it better."
        )
    if not diagnosis.findings:
        return (
            f"Something is wrong that is none of the {tried} effects known here: on windows that "
            f"no fit has seen the simulation is {base} rms off, where noise alone makes {floor}. "
            f"Nothing is named, so that nothing is accused wrongly.{_resembling(diagnosis)}"
        )
    causes = [cause(one.effect, one.location) for one in diagnosis.findings]
    named = listed(causes)
    verb, them = ("explains", "it") if len(causes) == 1 else ("explain", "them")
    whole = sum(one.gain for one in diagnosis.findings)
    ending = (
        f"Something is left that is none of the effects known here.{_resembling(diagnosis)}"
        if diagnosis.unexplained
        else "What is left is noise."
    )
    # Where a torque that is not understood outweighs noise errors are weighted as that torque is.
    grown = diagnosis.error.extended > diagnosis.error.base
    falls = "is less torque, but adds up to more: " if grown else "falls "
    return (
        f"{named[:1].upper()}{named[1:]} {verb} {percent(whole)} of the error of the simulation: "
        f"with {them} in the model, the error on windows that no fit has seen {falls}from {base} "
        f"to {extended} rms, where noise alone makes {floor}. {ending}"
    )


def _resembling(diagnosis: Diagnosis) -> str:
    """A sentence on what an error of no name goes with, if that is known."""
    one = diagnosis.resembles
    if one is None:
        return ""
    goes = _GOES_WITH[one.form].format(place=where(one.location))
    return f" It goes {goes}: that takes {percent(one.share)} of what is left beyond noise."


def _base_model(diagnosis: Diagnosis) -> str:
    if diagnosis.record.theta2 is None:
        return "a rigid axis with viscous friction"
    return "an axis of two inertias and a shaft"


def next_steps(diagnosis: Diagnosis) -> list[str]:
    """What to do next: a line for each finding, then for what is left and not determined."""
    linear = diagnosis.record.linear
    steps = [_step(finding, linear) for finding in diagnosis.findings]
    if diagnosis.resembles is not None:
        one = diagnosis.resembles
        steps.append(_LOOK_AT[one.form].format(place=where(one.location)))
    elif diagnosis.unexplained:
        steps.append(
            "Measure again: slower, faster and at another place of the travel. What is left goes "
            "with one of them; the residual torque in the report says with which to begin."
        )
    if not diagnosis.base_valid and not diagnosis.advice:
        steps.append(
            "Measure again with more excitation: a multisine up to beyond the resonance of the "
            "shaft (axistwin excite), with several reversals of speed."
        )
    if diagnosis.healthy and diagnosis.base_valid:
        steps.append("Retune with this model as it is: nothing has to be compensated.")
    return steps


def reason(verdict: str) -> str:
    """Why an effect was not named, with the names that people use."""
    effect, at, location = verdict.removeprefix(_LOOK_ALIKE).partition(" at ")
    if verdict.startswith(_LOOK_ALIKE) and at and effect in _EFFECTS and location in _PLACES:
        return f"{_LOOK_ALIKE}{cause(effect, location)}"
    return verdict


def rejected(diagnosis: Diagnosis) -> dict[str, list[Considered]]:
    """What was considered and not named, by the reason why, other than a plain no."""
    reasons: dict[str, list[Considered]] = {}
    for one in diagnosis.considered:
        if one.verdict != "no":
            reasons.setdefault(reason(one.verdict), []).append(one)
    return reasons


def _step(finding: Finding, linear: bool) -> str:
    """The line of _STEPS, with the finding's own numbers."""
    place = finding.location
    template = _STEPS.get(f"{finding.effect}:{place}") or _STEPS[finding.effect]
    if finding.effect == "friction_stribeck" and finding.params["torque"] < 0.0:
        template = _LESS_AT_REST
    numbers = {name: parameter(finding, name, linear).with_unit for name in finding.params}
    channel = {"encoder1": "theta1", "encoder2": "theta2"}.get(place, "")
    return template.format(place=where(place), channel=channel, **numbers)


#: What an error of no name goes with, and what to look at.
_GOES_WITH = {
    "torque_curve": "with the torque command, as of a drive whose torque is not in proportion",
    "speed_curve": "with the speed {place}, otherwise than any friction that is known here",
    "uneven_friction": "with the direction and the place on the turn {place}, as of dry friction "
    "that is not the same all around",
    "presliding": "with the way since the last reversal {place}, as of friction that gives way "
    "before it slips",
    "hysteresis": "with what the twist {place} was before, as of joints that slip",
    "twist_curve": "with the twist {place}, otherwise than any stiffness that is known here",
}
_LOOK_AT = {
    "torque_curve": "Measure the drive's torque against its command, up to the peaks (torque "
    "sensor, or a locked shaft): current sensor, saturation of the motor's iron, dead time.",
    "speed_curve": "Measure at several steady speeds in both directions: the torque that each of "
    "them takes shows the law of the friction {place}.",
    "uneven_friction": "Turn slowly, and look where on the turn friction {place} is high: bent "
    "shaft, a seal or a guide that is not true.",
    "presliding": "Measure with moves of some counts about standstill: they show how far parts "
    "give way {place} before they slip. Friction of one size would be wrong there.",
    "hysteresis": "Load the shaft slowly back and forth and look at the loop: bolted joints, "
    "clamping hubs, a belt.",
    "twist_curve": "Load the shaft slowly and measure twist against torque: stops, a coupling with "
    "steps in its stiffness.",
}

#: How the verdict on an effect begins that another one can pass for.
_LOOK_ALIKE = "look-alike of "

#: What to do about break-away friction that is negative.
_LESS_AT_REST = (
    "Compensate with less near standstill: friction {place} rises to its size only with speed "
    "({torque} at rest, up to about {speed}), as of parts that give before they slide."
)

#: What to do about an effect.
_STEPS = {
    "friction_coulomb": "Compensate: feed {torque} forward in the direction of motion. Lubricate, "
    "and check preload and alignment {place}, if it was less when new.",
    "friction_viscous": "Compensate: feed {coefficient} times the speed forward. Change the "
    "lubricant {place} if it was less when new.",
    "friction_asymmetry": "Compensate: feed {coefficient} times the speed forward on top of the "
    "viscous friction when it is positive, as much less when it is negative. Look for what drags "
    "in one direction {place}: a seal, a brush, a cable, the preload of the nut.",
    "friction_stribeck": "Lubricate {place}: it takes {torque} more to break away than to keep "
    "moving, which makes the axis stick and slip below {speed}.",
    "friction_drift": "Warm up before tuning: the friction {place} changes by {rate}. Lubricate it "
    "if it still rises when warm.",
    "torque_offset": "Compensate: feed {torque} against it at all times. Look for gravity, a "
    "spring or a dragging cable {place}, or a torque sensor that is off zero.",
    "backlash": "Repair: take up a play of {gap} between motor and table (preload, nut, coupling, "
    "key). Until then, lower the gain at reversals.",
    "stiffness_hardening": "Retune for the stiffness at working load: it grows by three times "
    "{coefficient} times the twist squared.",
    "stiffness_drift": "Retune warm: the stiffness changes by {rate}. Check the preload of nut and "
    "bearings.",
    "torque_ripple": "Compensate: subtract {amplitude} at {periods}, {phase}, from the torque "
    "command. The phase holds as long as the zero of the motor encoder does.",
    "lead_error": "Compensate: correct the position of the table by {amplitude} at {periods}, "
    "{phase} (pitch error compensation).",
    "encoder_eccentricity": "Repair: centre the disc of the encoder, or correct {channel} by "
    "{amplitude} once a turn at {phase}.",
    "delay:torque": "Re-time the channel: the torque acts {time} after the record says. Shift it "
    "before using it; if the drive itself is that late, lower the bandwidth.",
    "delay": "Re-time the channel: {channel} is {time} late. Shift it before using it; if it "
    "closes the loop, lower the bandwidth.",
    "torque_saturation": "Ask for less: keep the command within {limit}, or raise the drive's "
    "limit.",
    "load_change": "Retune for the new load: the inertia of the table changes by {ratio} at "
    "{time}.",
    "extra_mode": "Retune with a notch filter at {frequency}, or stiffen what vibrates there on "
    "the table.",
    "disturbance": "Find what turns or chops at {frequency} {place}, and balance or isolate it.",
    "quantisation": "Use a finer encoder than {counts} for {channel}, or interpolate it.",
    "sample_loss": "Mend the logging: {fraction} of the samples are missing or late. Check the "
    "load of the bus and the time base, then measure again.",
}
