"""What a simulation gets wrong, and why: the causes in a record, named and measured.

The method is told in docs/diagnosis.md. The modules: ``intake`` looks whether a record can answer,
``windows`` cuts it, ``linear`` is the axis that answers any torque, ``effects`` what each effect of
the catalogue adds along a motion, ``fit`` adjusts all their parameters, ``replay`` once more to a
simulation of axis and effects: a ``state`` of the search. ``beginning``, ``spectrum`` and
``resonance`` tell where to begin, ``trials`` what each effect would gain, ``selection`` decides
which of them there are and ``search`` in which windows, ``nameless`` whether it is none of them,
``answer`` puts it into numbers, ``report`` into words and figures.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from axistwin.diagnose import answer, beginning, intake, search, windows
from axistwin.diagnose.fit import Fit
from axistwin.diagnose.linear import Plant, Rigid, TwoInertias
from axistwin.diagnose.parallel import quiet
from axistwin.diagnose.result import Diagnosis
from axistwin.diagnose.selection import Search
from axistwin.diagnose.windows import LENGTH_MIN, Windows
from axistwin.errors import NotEnoughDataError
from axistwin.identify import output_error, rigid
from axistwin.identify.samples import Hold, longest_stretch, whole
from axistwin.record import Record

Progress = Callable[[str], None]

#: An axis whose error is so many times the noise (squared) soon does something else than its
#: simulation, in a time that effects change a lot. Then windows are so many times shorter at first,
#: but as long as some periods of the vibration; by such numbers because they become longer by two,
#: three or four times at once. A rigid axis only drifts: its errors are weighted.
_FAR = 100.0
_SHORTER = (1, 2, 3, 4, 6, 8, 9, 12, 16)
_PERIODS = 3.0

#: Samples that effects are looked for in first: those that are large need no more.
_FIRST_SAMPLES = 20_000

#: Samples that a first guess of the axis is made from.
_START_SAMPLES = 20_000

#: Up to this share of missing samples, they may be interpolated for that.
_MISSING_MAX = 0.1


def diagnose(
    record: Record,
    *,
    hold: Hold = "zoh",
    window: float | None = None,
    progress: Progress = lambda _: None,
) -> Diagnosis:
    """Name what moves the axis of a record beyond the model of Eq. 3, or beyond a rigid axis.

    ``hold`` is what the torque does between samples, ``window`` [s] the length of a simulation.
    Raises NotEnoughDataError when the record cannot answer, InputError when it cannot be right.
    """
    examined = intake.examine(record)
    with quiet():  # a trial may run away: it is none then
        found = _searched(record, windows.cut(record, window), hold, progress)
        progress("final fit")
        return answer.of(record, found, examined)


def _searched(record: Record, cut: Windows, hold: Hold, progress: Progress) -> Search:
    progress("looking for the axis")
    start = _start(record, cut, hold, progress)
    bases = beginning.bases(Fit(cut.part(_FIRST_SAMPLES), hold, start), _FAR)
    parts = 1
    if all(base.scale > _FAR for base in bases) and isinstance(start, TwoInertias):
        parts = _parts(start, cut)
        length = cut.length // parts
        cut = windows.cut(record, parts * length * record.time_step)
        bases = beginning.bases(Fit(cut.part(_FIRST_SAMPLES).recut(length), hold, start))
    return search.look(bases, cut, progress, parts)


def _parts(start: TwoInertias, cut: Windows) -> int:
    """Into how many parts windows go that are short, and still show the shaft vibrate."""
    length = _PERIODS * 2.0 * np.pi / start.frequency / cut.time_step
    most = max(1, cut.length // max(int(np.ceil(length)), LENGTH_MIN))
    return max(parts for parts in _SHORTER if parts <= most)


def _start(record: Record, cut: Windows, hold: Hold, progress: Progress) -> Plant:
    """The first guess of the axis: two inertias with both encoders, else one."""
    samples = longest_stretch(record)
    if record.theta2 is None:
        try:
            found = rigid.identify(record, samples).estimate.params
        except NotEnoughDataError:
            return beginning.rigid_start(cut, hold)
        return Rigid(found["I"].value, max(found["viscous"].value, 0.0))
    if samples.count < _START_SAMPLES and len(record.missing) < _MISSING_MAX * len(record):
        samples = whole(record)
    first = slice(_START_SAMPLES)
    part = replace(
        samples,
        torque=samples.torque[first],
        theta1=samples.theta1[first],
        theta2=samples.table[first],
        omega1=None,
        omega2=None,
    )
    return TwoInertias(output_error.find_start(part, progress))
