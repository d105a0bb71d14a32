"""Which effects are in a record: selected in short windows and in a part of them where that tells,
then in longer ones and in all."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from axistwin.diagnose import nameless
from axistwin.diagnose.effects import ExtraMode
from axistwin.diagnose.fit import NEARLY_RIGHT, RIGHT, Fit
from axistwin.diagnose.selection import (
    Search,
    addable,
    by_error,
    extended,
    preferred,
    settled,
    sure,
    way_to,
)
from axistwin.diagnose.state import State
from axistwin.diagnose.trials import MOST, Progress, Trials, significant
from axistwin.diagnose.windows import Windows

#: Of a record that is not understood, an effect that is named leaves such a part of what was more
#: than noise, and all that are named such a rest: else any of them may be another one's image.
_PART_LEFT = 0.5
_ALL_LEFT = 0.1

#: So often the errors are weighted anew, unless the corner is the same but for such a share.
_WEIGHINGS = 2
_SAME_CORNER = 0.1

#: Windows become so many times longer at once, at least: in much longer ones an axis may get lost
#: by what those half as long would show.
_LONGER = 3

#: Mean square of an error, in units of the noise, from which a search in long windows is no use.
_LOST = 1e3

#: What is left has a mean square this many times that of the noise, at least: then there is more.
UNEXPLAINED = 1.1


def look(bases: Sequence[State], windows: Windows, progress: Progress, parts: int = 1) -> Search:
    """All effects that held-out data speak for, in ``windows`` of which the bases have a part.

    Where what they leave is far more than the noise of the encoder, they are looked for once more,
    every error weighted as such errors are: then they are told by what they do to the torque.
    ``parts`` windows in a row are parts of a longer one, where the search goes on in the end; not
    where a form of no name does what all the catalogue cannot: nothing slow and small matters then.
    """
    found = _formed(_searched(bases, progress), progress)
    if found.form is None:
        near = found.states[-1].scale < NEARLY_RIGHT
        found = _in_longer(found, parts, progress) if near else _weighted(found, bases, progress)
    if found.form is None:
        found = _with_lone_window(_confirmed(found, windows, progress), progress)
    else:
        found = _in_all(found, windows, progress)
    return _understood(_ordered(found, progress), progress)


def _formed(search: Search, progress: Progress) -> Search:
    """With the form of no name that leaves next to nothing where the catalogue leaves more than
    noise, if there is one."""
    last = search.states[-1]
    if last.scale < UNEXPLAINED:
        return search
    found = nameless.find(search.states[0], last, progress)
    if found is None or found.state.scale - 1.0 >= _ALL_LEFT * (last.scale - 1.0):
        return search
    return replace(search, form=found.trial)


def _in_longer(search: Search, parts: int, progress: Progress) -> Search:
    """The search carried on in longer and longer windows, up to so many times as long."""
    while parts > 1 and search.form is None:
        times = next(n for n in range(min(_LONGER, parts), parts + 1) if parts % n == 0)
        longer = _lengthened(search, times, progress)
        if longer is search:
            break
        search, parts = _formed(longer, progress), parts // times
    return search


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
    """All effects with the weights that the errors of the bases have.

    Far off, a further mode may come nearest to anything: what it leaves unexplained may be nothing
    without one.
    """
    found = extended([bases[0]], [], progress)
    last = found.states[-1]
    ways = [(base, True) for base in bases[1:]]
    if last.scale > UNEXPLAINED and any(isinstance(one.kind, ExtraMode) for one in last.fit.found):
        ways.insert(0, (bases[0], False))
    for base, modes in ways:
        if found.states[-1].scale < RIGHT:
            break
        other = extended([base], [], progress, modes=modes)
        if preferred(other.states[-1], found.states[-1]):
            found = other
    found = settled(found, progress)
    noise = found.states[-1].fit.noise
    bases = [State(replace(base.fit, noise=noise), base.motion) for base in bases]
    honest = min([*bases, *(State.of(base.fit, base.motion) for base in bases)], key=by_error)
    return replace(found, states=(honest, *found.states[1:]))


def _lengthened(search: Search, times: int, progress: Progress) -> Search:
    """The search carried on in windows so many times longer, which show what is slow and small.

    As it was where those cannot be simulated down to noise, be it with a form of no name, or their
    effects not as they act, which is what short ones took: what is found in those holds.
    """
    progress("going on in longer windows")

    def longer(state: State) -> State:
        windows = state.fit.windows
        length = times * windows.length
        return State(replace(state.fit, windows=windows.recut(length)), state.motion.recut(length))

    known = search.states[-1].replay
    last = longer(search.states[-1]).replayed(known)
    if last.replay is None:
        last = State.of(last.fit, last.motion)
    bent = known is not None and last.replay is None and last.scale > RIGHT
    if bent or last.scale > _LOST:
        return search
    base = longer(search.states[0])
    base = min(base, State.of(base.fit, base.motion), key=by_error)
    found = settled(extended(way_to(base, last), list(search.trials[:-1]), progress), progress)
    if found.states[-1].scale < NEARLY_RIGHT:
        return found
    left = nameless.find(base, found.states[-1], progress)
    return found if left is not None and left.state.scale < NEARLY_RIGHT else search


def _confirmed(search: Search, windows: Windows, progress: Progress) -> Search:
    """The search carried on in all windows, where a part of them has told what there is so far."""
    whole = _in_all(search, windows, progress)
    if whole is search:
        return search
    found = extended(list(whole.states), list(whole.trials[:-1]), progress)
    return found if len(found.states) == len(whole.states) else settled(found, progress)


def _in_all(search: Search, windows: Windows, progress: Progress) -> Search:
    """What has been found in a part of the windows, as far as all of them speak for it."""
    first, last = search.states[0], search.states[-1]
    windows = windows.recut(last.fit.windows.length)
    if windows.count == last.fit.windows.count:
        return search
    progress("going on in the whole record")
    whole = _at_moments(replace(last.fit, windows=windows), progress)
    whole = whole.heard().replayed()
    base = State.along(replace(first.fit, windows=windows, noise=whole.fit.noise))
    states = way_to(base, whole)
    while len(states) > 1:
        *_, before, after = states
        if significant(after.against(before, after.fit.found[-1]), before):
            break
        del states[-1]
    return Search(tuple(states), search.trials[: len(states)])


def _at_moments(fit: Fit, progress: Progress) -> State:
    """The fit adjusted, each moment in it where these windows have it: those that it comes from may
    have none there."""
    found = list(fit.found)
    for i, one in enumerate(fit.found):
        if one.kind.moment:
            rest = replace(fit, found=(*found[:i], *found[i + 1 :]))
            trials = Trials(State(rest, rest.motion(None))).run([one.kind], progress)
            found[i] = trials[0].found if trials else one
    fits = [fit]
    if any(one is not known for one, known in zip(found, fit.found, strict=True)):
        fits.append(replace(fit, found=tuple(found)))
    return min(map(State.along, fits), key=by_error)


def _with_lone_window(search: Search, progress: Progress) -> Search:
    """The search carried on with other windows held out, where what is left is in one of them:
    nothing can be fitted to what happens there alone."""
    last = search.states[-1]
    beyond, held_out = last.errors - last.samples, last.fit.windows.held_out
    lone = int(np.argmax(beyond))
    if last.fit.corner > 0.0 or not held_out[lone] or last.scale < RIGHT:
        return search
    if beyond[lone] < MOST * np.sum(beyond):
        return search
    progress("fitting another part of the windows")
    windows = replace(last.fit.windows, held_out=np.roll(held_out, 1))
    states = [
        State.along(replace(state.fit, windows=windows), state.motion).simulated()
        for state in search.states
    ]
    return extended(states, list(search.trials[:-1]), progress)


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
    states = way_to(search.states[0], whole)
    tried = [tuple(Trials(state).run(addable(state.fit), progress)) for state in states[1:-1]]
    return Search(tuple(states), (search.trials[0], *tried, search.trials[-1]))


def _understood(search: Search, progress: Progress) -> Search:
    """Of a record that is not understood, only what is by far the most of it is named.

    Nor is anything named whose size may be none, nor what a form that has no name leaves nothing
    of.
    """
    states = list(search.states)
    last = states[-1]
    named = [one for i, one in enumerate(last.fit.found) if sure(last, i)]
    found = nameless.find(search.states[0], last, progress)
    if found is not None:
        still = [one.kind for one in nameless.still(found.state, last)]
        named = [one for one in named if one.kind in still]
    if len(named) < len(states) - 1:
        states = way_to(states[0], last.beside(replace(last.fit, found=tuple(named))))
    far = states[-1].scale > UNEXPLAINED and states[-1].fit.corner == 0.0
    if far or found is not None:
        excess = [state.scale - 1.0 for state in states]
        less = [after < _PART_LEFT * before for before, after in pairwise(excess)]
        states = states[: [*less, False].index(False) + 1]
        if excess[len(states) - 1] > _ALL_LEFT * excess[0]:
            states = states[:1]
    form = None if found is None else found.trial
    return Search(tuple(states), search.trials[: len(states)], form)
