"""Which effects are in a record: one after another, each has to prove itself on held-out data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from axistwin.diagnose import nameless, resonance
from axistwin.diagnose.effects import (
    FRICTION,
    MOTOR,
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
from axistwin.diagnose.fit import Fit, solve
from axistwin.diagnose.parallel import each
from axistwin.diagnose.state import NEARLY_RIGHT, RIGHT, State, Trial, possible
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

#: Of a record that is not understood, an effect that is named leaves such a part of what was more
#: than noise, and all that are named such a rest: else any of them may be another one's image.
_PART_LEFT = 0.5
_ALL_LEFT = 0.1

#: What a further mode has to explain of what is more than noise.
_GOOD_PART = 0.3

#: So many of the best contenders are simulated.
_SIMULATED = 2

#: How often the effects that were found may be replaced by others.
_REVISIONS = 3

#: So often the errors are weighted anew, unless the corner is the same but for such a share.
_WEIGHINGS = 2
_SAME_CORNER = 0.1

#: Mean square of an error, in units of the noise, from which a search in long windows is no use.
_LOST = 1e3

#: What is left has a mean square this many times that of the noise, at least: then there is more.
UNEXPLAINED = 1.1


def with_modes(state: State) -> list[Fit]:
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


@dataclass(frozen=True)
class Search:
    """The states on the way, the first without effects, and what was tried on each.

    ``form`` is what the record holds that has no name, as far as one can say what that goes with.
    """

    states: tuple[State, ...]
    trials: tuple[tuple[Trial, ...], ...]
    form: Trial | None = None


def look(bases: Sequence[State], progress: Progress, parts: int = 1) -> Search:
    """All effects that held-out data speak for.

    Where what they leave is far more than the noise of the encoder, they are looked for once more,
    every error weighted as such errors are: then they are told by what they do to the torque.
    ``parts`` windows in a row are parts of a longer one, where the search goes on in the end.
    """
    found = _searched(bases, progress)
    last = found.states[-1]
    if last.scale < NEARLY_RIGHT:
        if parts > 1:
            found = _lengthened(found, parts, progress)
    else:
        found = _weighted(found, bases, progress)
    return _understood(_ordered(found, progress), progress)


def _weighted(found: Search, bases: Sequence[State], progress: Progress) -> Search:
    """Searched again with errors weighted as what the last search has left is.

    What is left when little is understood tells that badly, so it is asked again.
    """
    corner = 0.0
    for _ in range(_WEIGHINGS):
        known, corner = corner, found.states[-1].corner
        if abs(corner - known) <= _SAME_CORNER * known:
            break
        progress("weighting the errors as those of a torque")
        weighted = [State(replace(base.fit, corner=corner), base.motion) for base in bases]
        found = _searched(weighted, progress)
    return found


def _searched(bases: Sequence[State], progress: Progress) -> Search:
    """All effects with the weights that the errors of the bases have."""
    found = _extended([bases[0]], [], progress)
    for base in bases[1:]:
        if found.states[-1].scale < RIGHT:
            break
        other = _extended([base], [], progress)
        if other.states[-1].fitted < found.states[-1].fitted:
            found = other
    found = _settled(found, progress)
    honest = min([*bases, *(State.of(base.fit, base.motion) for base in bases)], key=_fitted)
    return replace(found, states=(honest, *found.states[1:]))


def _lengthened(search: Search, parts: int, progress: Progress) -> Search:
    """The search carried on in longer windows, which show what is slow and small.

    As it was where those cannot be simulated down to noise, be it with a form of no name: what is
    found in short ones holds.
    """
    progress("going on in longer windows")

    def longer(state: State) -> State:
        windows = state.fit.windows
        length = parts * windows.length
        return State(replace(state.fit, windows=windows.recut(length)), state.motion.recut(length))

    last = longer(search.states[-1]).replayed()
    if last.replay is None:
        last = State.of(last.fit, last.motion)
    if last.scale > _LOST:
        return search
    base = longer(search.states[0])
    base = min(base, State.of(base.fit, base.motion), key=_fitted)
    known = Search((base, last), search.trials)
    chain = [*_chain(known, last.fit.found[:-1]), last] if last.fit.found else [last]
    found = _settled(_extended(chain, list(search.trials[:-1]), progress), progress)
    if found.states[-1].scale < NEARLY_RIGHT:
        return found
    left = nameless.find(base, found.states[-1], progress)
    return found if left is not None and left.state.scale < NEARLY_RIGHT else search


def _settled(found: Search, progress: Progress) -> Search:
    """Revised until every effect stands."""
    for _ in range(_REVISIONS):
        revised = _revised(found, progress)
        if revised is None:
            break
        found = revised
    return found


def _fitted(state: State) -> float:
    return state.fitted


def _extended(states: list[State], tried: list[tuple[Trial, ...]], progress: Progress) -> Search:
    """Adds effects one at a time while held-out data say so."""
    while True:
        state = states[-1]
        trials = Trials(state).run(_left(state.fit), progress)
        tried.append(tuple(trials))
        better = None
        most = EFFECTS_MAX if state.fit.corner == 0.0 else EFFECTS_OF_TORQUE_MAX
        if len(state.fit.found) < most:
            better = _best(state, trials, progress)
        if better is None:
            return Search(tuple(states), tuple(tried))
        states.append(_at_better_end(better))


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
        along = State.along(replace(last.fit, found=rest), last.motion)
        trials = Trials(along).run(_left(along.fit), progress)
        again = bool(trials) and trials[0].found.kind == found[i].kind
        if again and last.scale < RIGHT and significant(trials[0], along):
            continue  # it comes first again, and hardly anything is left to gain
        without = along.simulated()
        if without is not along:
            trials = Trials(without).run(_left(without.fit), progress)
        better = _best(without, trials, progress)
        if better is None:
            if not without.plausible or significant(last.against(without, found[i]), without):
                continue  # from there no way led back, but here it is
            return _extended(_chain(search, rest), list(search.trials[: len(rest)]), progress)
        if last.scale < RIGHT and better.fit.found[-1].kind == found[i].kind:
            continue  # the same again
        if better.fitted < last.fitted - GAIN_MIN * last.scale:
            chain = _chain(search, better.fit.found)
            return _extended(chain, list(search.trials[: len(chain) - 1]), progress)
    return None


def _at_better_end(state: State) -> State:
    """The same, or if friction has come last, all of it at the other end if that fits better.

    There are as many unknowns, so a likelihood that is clearly larger decides.
    """
    ends = (*FRICTION, FrictionDrift)
    if state.fit.windows.channels < 2 or not isinstance(state.fit.found[-1].kind, ends):
        return state
    moved = tuple(
        replace(one, kind=replace(one.kind, place=1 - one.kind.place))
        if isinstance(one.kind, ends)
        else one
        for one in state.fit.found
    )
    other = State.of(replace(state.fit, found=moved), state.motion)
    if other.plausible and other.fitted < state.fitted - LIKELIER * state.scale:
        return other
    return state


def _chain(search: Search, found: Sequence[Found]) -> list[State]:
    """The states on the way to these effects, in this order."""
    states = [search.states[0]]
    for k in range(1, len(found) + 1):
        before = search.states[-1]
        states.append(State.of(replace(before.fit, found=tuple(found[:k])), before.motion))
    return states


def _ordered(search: Search, progress: Progress) -> Search:
    """What explains most comes first, and what it hid was found beside it."""
    errors = [state.fitted for state in search.states]
    gains = [before - after for before, after in pairwise(errors)]
    order = sorted(range(len(gains)), key=lambda i: -gains[i])
    last = search.states[-1]
    if order == sorted(order):
        return search
    found = [last.fit.found[i] for i in order]
    whole = last.beside(replace(last.fit, found=tuple(found)))
    states = [*_chain(search, found[:-1]), whole]
    tried = [tuple(Trials(state).run(_left(state.fit), progress)) for state in states[1:-1]]
    return Search(tuple(states), (search.trials[0], *tried, search.trials[-1]))


def _understood(search: Search, progress: Progress) -> Search:
    """Of a record that is not understood, only what is by far the most of it is named.

    Nor is anything named whose size may be none, nor what a form that has no name leaves nothing
    of.
    """
    states = list(search.states)
    last = states[-1]
    named = [one for i, one in enumerate(last.fit.found) if _sure(last, i)]
    found = nameless.find(search.states[0], last, progress)
    if found is not None:
        still = [one.kind for one in nameless.still(found.state)]
        named = [one for one in named if one.kind in still]
    if len(named) < len(states) - 1:
        states = _chain(search, named)
    far = states[-1].scale > UNEXPLAINED and states[-1].fit.corner == 0.0
    if far or found is not None:
        excess = [state.scale - 1.0 for state in states]
        less = [after < _PART_LEFT * before for before, after in pairwise(excess)]
        states = states[: [*less, False].index(False) + 1]
        if excess[len(states) - 1] > _ALL_LEFT * excess[0]:
            states = states[:1]
    form = None if found is None else found.trial
    return Search(tuple(states), search.trials[: len(states)], form)


def _sure(state: State, i: int) -> bool:
    """Whether the sizes of the i-th effect are not nothing."""
    one = state.fit.found[i]
    k = max(len(one.sizes), 1)  # a gap, a limit or a delay is the size of an effect without
    spread, sizes = state.spread(i)[:k, :k], one.values[:k]
    chi2 = float(sizes @ np.linalg.pinv(spread, hermitian=True) @ sizes)
    return chi2 > k * T_MIN**2


def _left(fit: Fit) -> list[Kind]:
    """The kinds that can be added: waves several times, all others once."""
    names = [found.kind.name for found in fit.found]
    frictions = [found.kind.place for found in fit.found if isinstance(found.kind, FRICTION)]
    viscous = [place for place in range(fit.windows.channels) if fit.viscous(place) > 0.0]
    return [
        kind
        for kind in catalogue(
            fit.windows.channels,
            fit.windows.linear,
            fit.corner > 0.0 and "friction_coulomb:motor" in names,
        )
        if names.count(kind.name) < (WAVES_MAX if isinstance(kind, SEVERAL) else 1)
        and (not isinstance(kind, FrictionDrift) or kind.place in frictions)
        and (not isinstance(kind, Asymmetry) or kind.place in viscous)
    ]


def _resonating(state: State, besides: State) -> list[State]:
    """The fits with a further mode that explain a good part of what the best without one leaves.

    A mode bends a whole response: with so many unknowns it would find something to better anywhere.
    """
    found = []
    for candidate in possible(lambda fit: State.along(fit, state.motion), with_modes(state)):
        part = (besides.scale - candidate.scale) / (besides.scale - 1.0)
        if (
            part > _GOOD_PART
            and candidate.plausible
            and significant(candidate.against(state, candidate.fit.found[-1]), state)
        ):
            found.append(candidate)
    return found


def _best(state: State, trials: Sequence[Trial], progress: Progress) -> State | None:
    """The trials that gain most, each fitted with all the rest; the best of them that holds."""
    good = [trial for trial in trials if significant(trial, state)]
    if not good:  # fitted in full one of them may be
        excess = state.fitted * (1.0 - 1.0 / state.scale)
        good = [trial for trial in trials if trial.gain > MOST * excess > GAIN_MIN]
    good = [trial for trial in good[:CONTENDERS] if trial.gain >= CONTENDER * good[0].gain]

    def fitted(i: int) -> State:
        progress(f"fitting {good[i].found.kind.effect} at {good[i].found.kind.location}")
        fit = replace(state.fit, found=(*state.fit.found, good[i].found))
        return state.beside(fit) if i < _SIMULATED else State.along(fit, state.motion)

    contenders = sorted(possible(fitted, range(len(good))), key=_fitted)
    contenders[:_SIMULATED] = each(State.simulated, contenders[:_SIMULATED])
    fits = [
        one
        for one in contenders
        if one.plausible and significant(one.against(state, one.fit.found[-1]), state)
    ]
    best = min(fits, key=_fitted, default=None)
    left = best or state
    if left.scale > RIGHT and any(isinstance(trial.found.kind, ExtraMode) for trial in trials):
        progress("looking for a further resonance")
        fits += _resonating(state, left)
        best = min(fits, key=_fitted, default=None)
    if best is None:
        return None
    simpler = _simpler(best.fit.found[-1].kind)
    for one in fits:
        enough = NEARLY * (state.fitted - best.fitted)
        if one.fit.found[-1].kind == simpler and state.fitted - one.fitted > enough:
            return one
    return best


def _simpler(kind: Kind) -> Kind | None:
    """What comes first if it does nearly as well; the rest can still be added to it.

    Dry friction of one size can still fall with speed, a load can still be more with speed.
    """
    if isinstance(kind, Stribeck):
        return Coulomb(kind.place)
    return Offset(MOTOR) if isinstance(kind, Asymmetry) else None
