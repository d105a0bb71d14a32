"""What a record holds that nothing in the catalogue is: the best of the forms that have no name."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from axistwin.diagnose.effects import Found
from axistwin.diagnose.fit import NEARLY_RIGHT
from axistwin.diagnose.forms import forms
from axistwin.diagnose.parallel import each
from axistwin.diagnose.state import State, Trial, possible
from axistwin.diagnose.trials import Progress, Trials, significant
from axistwin.errors import InputError

#: What a form has to win on held-out windows, in units of the error squared: it can be bent in so
#: many ways that some of it is chance. So many of the best are fitted in full.
_GAIN_MIN = 50.0
_CONTENDERS = 2

#: The share of what an effect explains that is left to it beside such a form, at least.
_STILL = 0.1

#: The share of all errors that a simulation of what makes them may be wrong by.
_INEXACT = 1e-6


@dataclass(frozen=True)
class Nameless:
    """A form of no name: what it gains over the best that has been found, and a state with it."""

    trial: Trial
    state: State


def find(base: State, last: State, progress: Progress) -> Nameless | None:
    """A form of no name, if that does on held-out windows what nothing in the catalogue can do.

    Near the noise such a form tells beside what has been found, or instead of several that only
    imitate it. Far from it what has been found may stand in its way, so it is tried beside parts of
    that, too. The errors of the ``base`` without any are what a simulation of them may be inexact
    by a little of.
    """
    if last.fit.corner > 0.0:
        return None  # there the torque is never all understood
    tried = [
        (beside, trial)
        for beside in (last, *_parts(last))
        for trial in Trials(beside).run(forms(last.fit.windows.channels), progress)[:_CONTENDERS]
    ]

    def fitted(one: tuple[State, Trial]) -> Nameless | None:
        beside, trial = one
        fit = replace(beside.fit, found=(*beside.fit.found, trial.found))
        with contextlib.suppress(InputError):  # an axis cannot have that beside the rest
            state = State.along(fit, beside.motion)
            known = beside.replay is not None  # better than a state along a motion can be
            return Nameless(trial if known else state.against(last, trial.found), state)
        return None

    inexact = _INEXACT * float(np.sum(base.errors[base.fit.windows.held_out]))

    def clear(one: Nameless) -> bool:
        least = _GAIN_MIN * last.scale
        if len(one.state.fit.found) > 1:
            least = max(least, inexact)
        return one.trial.total > least and significant(one.trial, last)

    candidates = [one for one in each(fitted, tried) if one is not None and clear(one)]
    return max(candidates, key=lambda one: one.trial.gain, default=None)


def _parts(state: State) -> list[State]:
    """States without the effects of a state; from afar with the first of them, and with all of them
    but one, too."""
    found = state.fit.found
    parts: list[tuple[Found, ...]] = [()] if len(found) > 1 else []
    if state.scale > NEARLY_RIGHT:
        parts = [found[:k] for k in range(len(found))]
        parts += [(*found[:i], *found[i + 1 :]) for i in range(len(found) - 1)]
    return possible(lambda part: State.along(replace(state.fit, found=part), state.motion), parts)


def still(state: State, last: State) -> Sequence[Found]:
    """The effects of a state that have something to explain beside the form that comes last in it.

    That is more than chance, and more than a small share of what they explain in the ``last`` state
    without a form: the form explains as well what has less, but for what it is not exact in.
    """
    *found, form = state.fit.found
    for one in tuple(reversed(found)):
        rest = [other for other in found if other is not one]
        without = State.along(replace(state.fit, found=(*rest, form)), state.motion)
        little = without.fitted - state.fitted < _STILL * _explained(one, last)
        if little or not significant(state.against(without, one), without):
            state, found = without, rest
    return found


def _explained(one: Found, state: State) -> float:
    """What the effects of that name explain in a state, in units of the error squared."""
    along = State.along(state.fit, state.motion)
    rest = tuple(other for other in state.fit.found if other.kind != one.kind)
    return State.along(replace(state.fit, found=rest), state.motion).fitted - along.fitted
