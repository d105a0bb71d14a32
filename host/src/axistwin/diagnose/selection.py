"""Forward selection: one effect after another, each has to prove itself on held-out windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from axistwin.diagnose import resonance
from axistwin.diagnose.effects import (
    FRICTION,
    MOTOR,
    TABLE,
    Asymmetry,
    Coulomb,
    ExtraMode,
    Found,
    FrictionDrift,
    Kind,
    LeadError,
    Offset,
    Push,
    Ripple,
    Stribeck,
    catalogue,
)
from axistwin.diagnose.fit import NEARLY_RIGHT, RIGHT, Fit, solve
from axistwin.diagnose.linear import TwoInertias
from axistwin.diagnose.parallel import each
from axistwin.diagnose.state import State, Trial, possible
from axistwin.diagnose.trials import GAIN_MIN, MOST, T_MIN, Progress, Trials, significant
from axistwin.errors import InputError

#: Effects that are named at most; of an axis that is told by its torque, where each is a small part
#: of what is left.
EFFECTS_MAX = 4
EFFECTS_OF_TORQUE_MAX = 6

#: A simpler effect that gains this share of what another one does comes first.
NEARLY = 0.9

#: Of the best trials, so many are fitted in full, if they gain this share of what the best does.
CONTENDERS = 5
CONTENDER = 0.3

#: Effects of which an axis can have several at a place, and so many of each at most: what the core
#: can simulate.
SEVERAL = (Ripple, LeadError)
WAVES_MAX = 4

#: What a model gains over another one with as many unknowns that is 1 to 50 against it, in units of
#: the error squared.
LIKELIER = 8.0

#: What a further mode has to explain of what is more than noise. Where the response does not show
#: where it is, it is looked for from such shares of the resonance, with such a share of the inertia
#: and such a damping ratio.
_GOOD_PART = 0.3
_SHARES = (0.25, 0.5, 1.0, 2.0)
_LITTLE, _DAMPING = 1e-3, 0.05

#: So many of the best contenders are simulated.
_SIMULATED = 2

#: Where friction at the other end leaves so many times the error it cannot be there.
_FAR_OFF = 10.0

#: How often the effects that were found may be replaced by others.
_REVISIONS = 3

#: A noise that is told anew is the same but for such a share.
_SAME_NOISE = 0.01


@dataclass(frozen=True)
class Search:
    """The states on the way, the first without effects, and what was tried on each.

    ``form`` is what the record holds that has no name, as far as one can say what that goes with.
    """

    states: tuple[State, ...]
    trials: tuple[tuple[Trial, ...], ...]
    form: Trial | None = None


def extended(
    states: list[State],
    tried: list[tuple[Trial, ...]],
    progress: Progress,
    *,
    modes: bool = True,
) -> Search:
    """Adds effects one at a time while held-out data say so; ``modes``, too, or all others."""
    while True:
        state = states[-1]
        kinds = [one for one in addable(state.fit) if modes or not isinstance(one, ExtraMode)]
        trials = Trials(state).run(kinds, progress)
        tried.append(tuple(trials))
        better = None
        most = EFFECTS_MAX if state.fit.corner == 0.0 else EFFECTS_OF_TORQUE_MAX
        if len(state.fit.found) < most:
            better = _best(state, trials, progress)
        if better is None:
            return Search(tuple(states), tuple(tried))
        if state.replay is None and state.scale < RIGHT:
            # What is left near the noise may be what effects along a motion lack.
            replayed = state.replayed()
            if replayed is not state:
                states[-1] = replayed
                tried.pop()
                continue
        states = _heard([*states, _at_better_end(better)])


def settled(found: Search, progress: Progress) -> Search:
    """Revised until every effect stands."""
    for _ in range(_REVISIONS):
        revised = _revised(found, progress)
        if revised is None:
            break
        found = revised
    return found


def _revised(search: Search, progress: Progress) -> Search | None:
    """Every effect has to stand against all others once the rest are known.

    None when they all do.
    """
    last = search.states[-1]
    found = last.fit.found
    if len(found) < 2:
        return None
    for i in range(len(found) - 1):
        rest = (*found[:i], *found[i + 1 :])
        if any(_drifting_alone(one.kind, rest) for one in rest):
            continue
        along = State.along(replace(last.fit, found=rest), last.motion)
        trials = Trials(along).run(addable(along.fit), progress)
        again = bool(trials) and trials[0].found.kind == found[i].kind
        if again and last.scale < RIGHT and significant(trials[0], along):
            continue  # it comes first again, and hardly anything is left to gain
        without = along.simulated()
        if without is not along:
            trials = Trials(without).run(addable(without.fit), progress)
        better = _best(without, trials, progress)
        if better is None:
            worse = significant(last.against(without, found[i]), without)
            if not without.plausible or worse or not preferred(without, last):
                continue  # from there no way led back, but here it is
            return extended(chain_to(search, rest), list(search.trials[: len(rest)]), progress)
        if last.scale < RIGHT and better.fit.found[-1].kind == found[i].kind:
            continue  # the same again
        if preferred(better, last):
            chain = way_to(search.states[0], better)
            return extended(chain, list(search.trials[: len(chain) - 1]), progress)
    return None


def _drifting_alone(kind: Kind, found: Sequence[Found]) -> bool:
    """Is it the drift of a friction that is none of these?"""
    places = [one.kind.place for one in found if isinstance(one.kind, FRICTION)]
    return isinstance(kind, FrictionDrift) and kind.place not in places


def preferred(one: State, other: State) -> bool:
    """Whether one model is the better one: clearly, or with fewer unknowns and on held-out windows
    as good."""
    unseen = one.excess(held_out=True) - other.excess(held_out=True)
    if len(one.fit.values) < len(other.fit.values):
        return unseen < LIKELIER * other.scale
    seen = one.excess(held_out=False) - other.excess(held_out=False)
    return seen < -GAIN_MIN * other.scale and unseen < 0.0


def chain_to(search: Search, found: Sequence[Found]) -> list[State]:
    """The states on the way to these effects, in this order."""
    states = [search.states[0]]
    for k in range(1, len(found) + 1):
        before = search.states[-1]
        states.append(State.of(replace(before.fit, found=tuple(found[:k])), before.motion))
    return states


def way_to(base: State, last: State) -> list[State]:
    """The states from the one without effects to another one, an effect more in each."""
    if not last.fit.found:
        return [base]
    return [*chain_to(Search((base, last), ()), last.fit.found[:-1]), last]


def sure(state: State, i: int) -> bool:
    """Whether the sizes of the i-th effect are not nothing."""
    one = state.fit.found[i]
    k = max(len(one.sizes), 1)  # a gap, a limit or a delay is the size of an effect without
    spread, sizes = state.spread(i)[:k, :k], one.values[:k]
    chi2 = float(sizes @ np.linalg.pinv(spread, hermitian=True) @ sizes)
    return chi2 > k * T_MIN**2


def by_error(state: State) -> float:
    """What orders states from the nearest one to that which is farthest off."""
    return state.fitted


def addable(fit: Fit) -> list[Kind]:
    """The kinds that can be added: waves several times, all others once."""
    names = [found.kind.name for found in fit.found]
    viscous = [place for place in range(fit.windows.channels) if fit.viscous(place) > 0.0]
    return [
        kind
        for kind in catalogue(
            fit.windows.channels,
            fit.windows.linear,
            fit.corner > 0.0 and "friction_coulomb:motor" in names,
        )
        if names.count(kind.name) < (WAVES_MAX if isinstance(kind, SEVERAL) else 1)
        and not _drifting_alone(kind, fit.found)
        and (not isinstance(kind, Asymmetry) or kind.place in viscous)
    ]


def _best(state: State, trials: Sequence[Trial], progress: Progress) -> State | None:
    """The trials that gain most, each fitted with all the rest; the best of them that holds."""
    # Far from noise an effect may be significant only when it is fitted in full.
    anyway = _SIMULATED if state.scale > NEARLY_RIGHT else 0
    good = [trial for i, trial in enumerate(trials) if i < anyway or significant(trial, state)]
    if not good:
        excess = state.fitted * (1.0 - 1.0 / state.scale)
        good = [trial for trial in trials if trial.gain > MOST * excess > GAIN_MIN]
    good = [
        trial
        for i, trial in enumerate(good[:CONTENDERS])
        if i < anyway or trial.gain >= CONTENDER * good[0].gain
    ]

    def replayable(kind: Kind) -> bool:
        # What the steps of a replay leave, a further mode and its initial states may explain.
        return state.scale > RIGHT or not isinstance(kind, ExtraMode)

    def fitted(i: int) -> State:
        one = good[i].found
        progress(f"fitting {one.kind.effect} at {one.kind.location}")
        fit = replace(state.fit, found=(*state.fit.found, one))
        near = i < _SIMULATED and replayable(one.kind)
        return state.beside(fit) if near else State.along(fit, state.motion)

    def simulated(one: State) -> State:
        return one.simulated() if replayable(one.fit.found[-1].kind) else one

    contenders = sorted(possible(fitted, range(len(good))), key=by_error)
    contenders[:_SIMULATED] = each(simulated, contenders[:_SIMULATED])
    fits = [
        one
        for one in contenders
        if one.plausible
        and significant(one.against(state, one.fit.found[-1]), state)
        and _of_some_size(one)
    ]
    best = min(fits, key=by_error, default=None)
    left = best or state
    mode = any(isinstance(trial.found.kind, ExtraMode) for trial in trials)
    if mode and (left.scale > RIGHT or left.coloured):
        progress("looking for a further resonance")
        fits += _resonating(state, left)
        best = min(fits, key=by_error, default=None)
    if best is None:
        return None
    simpler = _simpler(best.fit.found[-1].kind)
    for one in fits:
        enough = NEARLY * (state.fitted - best.fitted)
        if one.fit.found[-1].kind == simpler and state.fitted - one.fitted > enough:
            return one
    return best


def _of_some_size(state: State) -> bool:
    """Is the effect that came last one, and no further mode of next to no inertia?

    The initial states of one may explain what is left of windows that begin in a wrong state.
    """
    found = state.fit.found
    return not isinstance(found[-1].kind, ExtraMode) or sure(state, len(found) - 1)


def _simpler(kind: Kind) -> Kind | None:
    """What comes first if it does nearly as well; the rest can still be added to it.

    Dry friction of one size can still fall with speed, a load can still be more with speed.
    """
    if isinstance(kind, Stribeck):
        return Coulomb(kind.place)
    return Offset(MOTOR) if isinstance(kind, Asymmetry) else None


def _heard(states: list[State]) -> list[State]:
    """The states with the noise that the last one hears, if that is the first one to come near it.

    In the errors of an axis that is far off there is more than noise at all frequencies.
    """
    *rest, before, last = states
    if not last.scale < NEARLY_RIGHT <= before.scale:
        return states
    heard = last.heard()
    noise = heard.fit.noise
    if noise is None or last.fit.noise is None:
        return states
    if np.allclose(noise, last.fit.noise, rtol=_SAME_NOISE):
        return states
    near = heard.simulated() if last.replay is None else heard.replayed(last.replay)
    return [*(State(replace(one.fit, noise=noise), one.motion) for one in (*rest, before)), near]


def _at_better_end(state: State) -> State:
    """The same, or with all friction at the other end if that fits better: of one that came before
    another effect was known that may not have been told.

    There are as many unknowns, so a likelihood that is clearly larger decides.
    """
    ends = (*FRICTION, FrictionDrift)
    rubbing = [isinstance(one.kind, ends) for one in state.fit.found]
    if state.fit.windows.channels < 2 or not any(rubbing):
        return state
    moved = tuple(
        replace(one, kind=replace(one.kind, place=1 - one.kind.place))
        if isinstance(one.kind, ends)
        else one
        for one in state.fit.found
    )
    other = State.along(replace(state.fit, found=moved), state.motion)
    worse = _FAR_OFF if rubbing[-1] else 1.0
    if other.fitted > worse * State.along(state.fit, state.motion).fitted:
        return state
    other = other.simulated()
    if other.plausible and other.fitted < state.fitted - LIKELIER * state.scale:
        return other
    return state


def _resonating(state: State, besides: State) -> list[State]:
    """The fits with a further mode that explain a good part of what the best without one leaves.

    A mode bends a whole response: with so many unknowns it would find something to better anywhere.
    So where something else holds, the response has to show it.
    """

    def explains(candidate: State) -> bool:
        return (
            besides.scale - candidate.scale > _GOOD_PART * (besides.scale - 1.0)
            and candidate.plausible
            and significant(candidate.against(state, candidate.fit.found[-1]), state)
        )

    ways = [_with_modes, _from_anywhere] if besides is state else [_with_modes]
    for fits in ways:
        candidates = possible(lambda fit: State.along(fit, state.motion), fits(state))
        found = [candidate for candidate in candidates if explains(candidate)]
        if found:
            return found
    return []


def _with_modes(state: State) -> list[Fit]:
    """The fit from axes with a further mode, as the record seems to show one."""
    fit = state.fit
    torque = fit.delivered(state.motion)
    zero = np.zeros_like(fit.measured)
    zero[1] = 1.0
    fits = []
    for plant, mode in resonance.find(fit.windows, torque):
        fit = replace(state.fit, plant=plant, zero=0.0, found=(*state.fit.found, mode))
        # The inertias in proportion to the torque, which a response tells far less well.
        try:
            moved = fit.answer([Push(command=np.stack([torque, torque]))])
        except InputError:  # two vibrations are one, or too fast
            continue
        columns = np.stack([fit.project(angles) for angles in (moved, zero)], axis=1)
        size, shift = solve(columns, fit.project(fit.measured), ~fit.windows.held_out)
        if size > 0.0:
            scaled = plant.with_values(plant.values / size)
            fits.append(replace(fit, plant=scaled, zero=float(shift)))
    return fits


def _from_anywhere(state: State) -> list[Fit]:
    """The fit with a little of a further mode around the resonance, as it may be told from afar."""
    plant = state.fit.plant
    if not isinstance(plant, TwoInertias):
        return []
    modes = (
        Found(ExtraMode(TABLE), np.array([_LITTLE]), (share * plant.frequency, _DAMPING))
        for share in _SHARES
    )
    return [replace(state.fit, found=(*state.fit.found, mode)) for mode in modes]
