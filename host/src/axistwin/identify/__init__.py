"""Identification of an axis from a record: parameters with uncertainty and validity."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeAlias

import numpy as np

from axistwin.errors import NotEnoughDataError
from axistwin.identify import rigid, two_inertia
from axistwin.identify.output_error import Progress
from axistwin.identify.result import (
    RIGID,
    TWO_INERTIA,
    Comparison,
    Convergence,
    Estimate,
    Identification,
    Quantity,
    Validation,
    axis_truth,
    table,
)
from axistwin.identify.samples import HOLDS, Hold, Samples, check_excitation, longest_stretch
from axistwin.record import Record

__all__ = [
    "Comparison",
    "Convergence",
    "Estimate",
    "Identification",
    "Model",
    "Quantity",
    "Validation",
    "axis_truth",
    "identify",
    "table",
    "validate",
]

Model: TypeAlias = Literal["auto", "two-inertia", "rigid"]


def identify(
    record: Record,
    model: Model = "auto",
    *,
    hold: Hold | Literal["auto"] = "auto",
    bandwidth: float | None = None,
    progress: Progress = lambda _: None,
) -> Identification:
    """Identify the axis that a record shows.

    With both encoders the axis of Eq. 3, two inertias; with one, or where ``auto`` finds that the
    record cannot tell more, the rigid axis with friction. ``hold`` says how the torque went on
    between samples; ``auto`` finds out. ``bandwidth`` [Hz] of the fastest motion
    that the rigid axis shall explain, a fiftieth of the record's rate unless given. ``progress``
    is called with a line now and then.

    Raises NotEnoughDataError, saying what to do, when the record cannot answer.
    """
    samples = longest_stretch(record)
    check_excitation(samples)
    holds = HOLDS if hold == "auto" else (hold,)
    with np.errstate(all="ignore"):  # what overflows is noticed, and refused, further down
        found = _identify(record, samples, model, holds, bandwidth, progress)
    if samples.count < len(record):
        gaps = f"the longest stretch without a missing sample is used, {samples.count} samples"
        found = replace(found, notes=(*found.notes, gaps))
    return found


def _identify(
    record: Record,
    samples: Samples,
    model: Model,
    holds: tuple[Hold, ...],
    bandwidth: float | None,
    progress: Progress,
) -> Identification:
    if model == RIGID or (model == "auto" and samples.theta2 is None):
        return rigid.identify(record, samples, bandwidth)
    if model == TWO_INERTIA:
        return two_inertia.identify(record, samples, holds, progress)
    return _as_far_as_possible(record, samples, holds, bandwidth, progress)


def validate(
    result: Identification, record: Record, *, bandwidth: float | None = None
) -> Identification:
    """The result with its errors on another record: of the torque for the rigid axis, of twist and
    angles for two inertias.

    Raises NotEnoughDataError when the record is too short or lacks an encoder.
    """
    samples = longest_stretch(record)
    check_excitation(samples)
    comparisons: tuple[Comparison, ...]
    with np.errstate(all="ignore"):
        if result.model == RIGID:
            comparisons = (rigid.predict(samples, result.estimate, bandwidth),)
        else:
            comparisons = two_inertia.predict(samples, result.estimate, result.hold or HOLDS[0])
    errors = {channel.name: channel.relative_error for channel in comparisons}
    return replace(result, validation=Validation(record.source, errors))


def _as_far_as_possible(
    record: Record,
    samples: Samples,
    holds: tuple[Hold, ...],
    bandwidth: float | None,
    progress: Progress,
) -> Identification:
    try:
        return two_inertia.identify(record, samples, holds, progress)
    except NotEnoughDataError as reason:
        try:
            found = rigid.identify(record, samples, bandwidth)
        except NotEnoughDataError:
            raise reason from None
        return replace(found, notes=(*found.notes, f"the rigid axis only: {reason}"))
