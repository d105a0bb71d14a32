"""Whether an answer is right.

Right is an answer that names every hidden effect by cause and place, and nothing else. Two pairs of
names stand for one thing, whichever of them is answered, because no record can tell them apart:

* a torque offset at motor and at table. They accelerate the axis alike and differ by a constant
  twist, and that is what the unknown zero of encoder 2 is, too;
* a lead error of one period a turn and an eccentricity of encoder 2: the same formula.

Where nothing is hidden, nothing may be named and nothing called unexplained. A truth that is not in
the catalogue has to be called unexplained; besides, only its nearest kin may be named. The place of
the kin is not asked for: what tells the places apart is less than what stays unexplained.

An interval counts when its effect is right. Of a phase it is taken modulo a turn, and an amplitude
below zero is one above zero half a period later. What is given without an interval (an interval
without width: whole periods a turn, counts) is not counted as covered or not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

Named = tuple[str, str]

#: What a truth without a name may be taken for, beside being unexplained.
KIN: dict[str, tuple[str, ...]] = {
    "lugre": ("friction_coulomb", "friction_viscous", "friction_stribeck"),
    "square_drag": ("friction_coulomb", "friction_viscous", "friction_stribeck"),
    "uneven_friction": ("friction_coulomb", "friction_viscous", "friction_stribeck"),
    "hysteresis": ("stiffness_hardening", "backlash"),
    "torque_fall": ("torque_saturation",),
}

_TURN = 2.0 * np.pi


@dataclass(frozen=True)
class Verdict:
    """How an answer compares with the truth.

    ``named`` are hidden effects that were found, ``missed`` those that were not, ``accused`` what
    was named and is not there. ``inside`` says of each parameter of what was found whether its
    interval holds the truth.
    """

    right: bool
    named: tuple[Named, ...]
    missed: tuple[Named, ...]
    accused: tuple[Named, ...]
    inside: Mapping[str, bool]


def judge(truth: Mapping[str, Any], answer: Mapping[str, Any]) -> Verdict:
    """Compares an answer (axistwin.diagnosis/1) with a truth (hidden.truth_of())."""
    hidden: Sequence[Mapping[str, Any]] = truth["hidden"]
    findings: Sequence[Mapping[str, Any]] = answer["findings"]
    if truth["kind"] == "unknown":
        return _judge_unknown(hidden[0], findings, bool(answer["unexplained"]))
    wanted = {_identity(effect): effect for effect in hidden}
    found = {_identity(finding): finding for finding in findings}
    inside: dict[str, bool] = {}
    for same in wanted.keys() & found.keys():
        inside |= _inside(wanted[same], found[same])
    missed = tuple(_name(e) for same, e in wanted.items() if same not in found)
    accused = tuple(_name(f) for same, f in found.items() if same not in wanted)
    nothing_left = bool(hidden) or not answer["unexplained"]
    twice = len(found) < len(findings)
    return Verdict(
        right=not missed and not accused and nothing_left and not twice,
        named=tuple(_name(e) for same, e in wanted.items() if same in found),
        missed=missed,
        accused=accused,
        inside=inside,
    )


def _judge_unknown(
    effect: Mapping[str, Any], findings: Sequence[Mapping[str, Any]], unexplained: bool
) -> Verdict:
    kin = KIN[effect["effect"]]
    accused = tuple(_name(f) for f in findings if f["effect"] not in kin)
    return Verdict(
        right=unexplained and not accused,
        named=(),
        missed=() if unexplained else (_name(effect),),
        accused=accused,
        inside={},
    )


def _name(effect: Mapping[str, Any]) -> Named:
    return effect["effect"], effect["location"]


def _identity(effect: Mapping[str, Any]) -> Named:
    """One name for what no record can tell apart."""
    name, place = _name(effect)
    if name == "torque_offset":
        return name, "motor or table"
    if name == "lead_error" and round(effect["params"].get("periods", 0.0), 2) == 1.0:
        return "encoder_eccentricity", "encoder2"
    return name, place


def _inside(effect: Mapping[str, Any], finding: Mapping[str, Any]) -> dict[str, bool]:
    true = _upright(effect["params"])
    shift = _upright(finding["params"]).get("phase", 0.0) - finding["params"].get("phase", 0.0)
    inside = {}
    for name, (low, high) in finding["ci95"].items():
        if name not in true or not low < high:
            continue
        value = true[name]
        if name == "phase":
            middle = 0.5 * (low + high) + shift
            off = float(np.remainder(value - middle + np.pi, _TURN)) - np.pi
            inside[f"{effect['effect']}:{name}"] = abs(off) <= 0.5 * (high - low)
        elif name == "amplitude" and finding["params"][name] < 0.0:
            inside[f"{effect['effect']}:{name}"] = -high <= value <= -low
        else:
            inside[f"{effect['effect']}:{name}"] = low <= value <= high
    return inside


def _upright(params: Mapping[str, float]) -> dict[str, float]:
    """A wave with its amplitude above zero."""
    upright = dict(params)
    if "phase" in params and params.get("amplitude", 0.0) < 0.0:
        upright["amplitude"] = -params["amplitude"]
        upright["phase"] = params["phase"] + np.pi
    return upright


@dataclass(frozen=True)
class Score:
    """Shares of right answers for effects of at least ``least`` thresholds; None of no cases.

    ``coverage95`` is the share of parameters whose 95 % interval holds the truth.
    ``floor_reached`` is the share of right answers to records with something hidden whose extended
    model comes within 10 % of the noise floor on unseen data. ``counts`` are the cases of each
    kind, ``coverage_of`` is (inside, all) of each parameter, and ``right_by_size`` (right, all) of
    each decade of the smallest hidden effect.
    """

    n: int
    least: float
    clean_right: float | None
    single_right: float | None
    pair_right: float | None
    unknown_right: float | None
    coverage95: float | None
    floor_reached: float | None
    counts: Mapping[str, int]
    coverage_of: Mapping[str, tuple[int, int]]
    right_by_size: Mapping[str, tuple[int, int]]


def score(results: Sequence[Mapping[str, Any]], least: float) -> Score:
    """The score of results {"truth", "answer" or "error"}; no answer is a wrong one."""
    right: dict[str, list[bool]] = {kind: [] for kind in ("clean", "single", "pair", "unknown")}
    by_size: dict[str, list[bool]] = {}
    inside: dict[str, list[bool]] = {}
    floor = []
    for result in results:
        truth = result["truth"]
        smallest = min((effect["thresholds"] for effect in truth["hidden"]), default=np.inf)
        if smallest < least:
            continue
        verdict = judge(truth, result["answer"]) if "answer" in result else None
        right[truth["kind"]].append(verdict is not None and verdict.right)
        if truth["hidden"]:
            decade = f"{10.0 ** np.floor(np.log10(smallest)):g}"
            by_size.setdefault(decade, []).append(right[truth["kind"]][-1])
        if verdict is None:
            continue
        for name, covered in verdict.inside.items():
            inside.setdefault(name, []).append(covered)
        if verdict.right and truth["kind"] in ("single", "pair"):
            error = result["answer"]["error"]
            floor.append(error["extended"] <= 1.1 * error["noise_floor"])
    every = [covered for values in inside.values() for covered in values]
    return Score(
        n=len(results),
        least=least,
        **{f"{kind}_right": _share(values) for kind, values in right.items()},
        coverage95=_share(every),
        floor_reached=_share(floor),
        counts={kind: len(values) for kind, values in right.items()},
        coverage_of=_counted(inside),
        right_by_size=_counted(by_size),
    )


def _counted(outcomes: Mapping[str, Sequence[bool]]) -> dict[str, tuple[int, int]]:
    return {name: (sum(values), len(values)) for name, values in sorted(outcomes.items())}


def _share(values: Sequence[bool]) -> float | None:
    return sum(values) / len(values) if values else None
