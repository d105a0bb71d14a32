"""Verdicts and scores."""

from __future__ import annotations

from typing import Any

import pytest
from confusion import NOTHING, UNEXPLAINED, pairs
from score import judge, score

FRICTION = ("friction_coulomb", "table", {"torque": 0.01})
RIPPLE = ("torque_ripple", "motor", {"amplitude": 0.1, "periods": 3.0, "phase": 3.1})


def truth(kind: str, *effects: tuple[str, str, dict[str, float]], size: float = 5.0) -> Any:
    hidden = [{"effect": e, "location": w, "params": p, "thresholds": size} for e, w, p in effects]
    return {"kind": kind, "hidden": hidden}


def answer(
    *effects: tuple[str, str, dict[str, float]], width: float = 0.1, unexplained: bool = False
) -> Any:
    findings = [
        {
            "effect": effect,
            "location": where,
            "params": params,
            "ci95": {name: [value - width, value + width] for name, value in params.items()},
        }
        for effect, where, params in effects
    ]
    error = {"base": 2.0, "extended": 1.0, "noise_floor": 1.0}
    return {"findings": findings, "unexplained": unexplained, "error": error}


@pytest.mark.parametrize(
    ("hidden", "said", "right"),
    [
        (truth("clean"), answer(), True),
        (truth("clean"), answer(unexplained=True), False),
        (truth("clean"), answer(FRICTION), False),
        (truth("single", FRICTION), answer(FRICTION), True),
        (truth("single", FRICTION), answer(), False),
        (truth("single", FRICTION), answer(unexplained=True), False),
        (truth("single", FRICTION), answer(FRICTION, RIPPLE), False),
        (truth("single", FRICTION), answer(FRICTION, FRICTION), False),
        (truth("single", FRICTION), answer(("friction_coulomb", "motor", {})), False),
        (truth("pair", FRICTION, RIPPLE), answer(RIPPLE, FRICTION), True),
        (truth("pair", FRICTION, RIPPLE), answer(RIPPLE), False),
        (
            truth("single", ("torque_offset", "motor", {})),
            answer(("torque_offset", "table", {})),
            True,
        ),
        (
            truth("single", ("lead_error", "table", {"periods": 1.0})),
            answer(("encoder_eccentricity", "encoder2", {})),
            True,
        ),
        (
            truth("single", ("lead_error", "table", {"periods": 2.0})),
            answer(("encoder_eccentricity", "encoder2", {})),
            False,
        ),
        (truth("unknown", ("lugre", "table", {})), answer(unexplained=True), True),
        (truth("unknown", ("lugre", "table", {})), answer(FRICTION, unexplained=True), True),
        (truth("unknown", ("lugre", "table", {})), answer(FRICTION), False),
        (truth("unknown", ("lugre", "table", {})), answer(RIPPLE, unexplained=True), False),
        (truth("unknown", ("lugre", "table", {})), answer(), False),
    ],
)
def test_right_is_every_cause_and_place_and_nothing_else(
    hidden: Any, said: Any, right: bool
) -> None:
    assert judge(hidden, said).right is right


def test_an_interval_holds_the_truth_or_not() -> None:
    near = ("torque_ripple", "motor", {"amplitude": 0.15, "periods": 3.0, "phase": 2.9})
    inside = judge(truth("single", RIPPLE), answer(near, width=0.1)).inside
    assert inside == {
        "torque_ripple:amplitude": True,
        "torque_ripple:periods": True,
        "torque_ripple:phase": False,
    }


def test_phases_go_round_and_amplitudes_have_two_signs() -> None:
    round_the_turn = ("torque_ripple", "motor", {"amplitude": 0.1, "phase": 3.1 - 6.2832})
    below_zero = ("torque_ripple", "motor", {"amplitude": -0.1, "phase": 3.1 - 3.1416})
    for same in (round_the_turn, below_zero):
        inside = judge(truth("single", RIPPLE), answer(same, width=0.01)).inside
        assert inside == {"torque_ripple:amplitude": True, "torque_ripple:phase": True}


def test_an_interval_without_width_counts_neither_way() -> None:
    assert judge(truth("single", FRICTION), answer(FRICTION, width=0.0)).inside == {}


def test_a_score_is_of_effects_that_are_large_enough() -> None:
    results = [
        {"truth": truth("single", FRICTION), "answer": answer(FRICTION)},
        {"truth": truth("single", FRICTION), "error": "it crashed"},
        {"truth": truth("single", FRICTION, size=2.9), "answer": answer()},
        {"truth": truth("clean"), "answer": answer()},
    ]
    total = score(results, 3.0)
    assert (total.n, total.single_right, total.clean_right) == (4, 0.5, 1.0)
    assert (total.pair_right, total.unknown_right) == (None, None)
    assert (total.coverage95, total.floor_reached) == (1.0, 1.0)
    assert total.right_by_size == {"1": (1, 2)}
    assert score(results, 0.0).single_right == pytest.approx(1 / 3)


def test_the_confusion_names_what_was_said_instead() -> None:
    results = [
        {"truth": truth("pair", FRICTION, RIPPLE), "answer": answer(RIPPLE)},
        {"truth": truth("single", FRICTION), "answer": answer(RIPPLE)},
        {"truth": truth("clean"), "answer": answer(unexplained=True)},
    ]
    friction, ripple = "friction_coulomb table", "torque_ripple motor"
    assert pairs(results) == [
        (friction, NOTHING),
        (ripple, ripple),
        (friction, ripple),
        (NOTHING, UNEXPLAINED),
    ]
