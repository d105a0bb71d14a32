"""From named columns of numbers to a record: what CSV and MAT files have in common."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from axistwin.errors import InputError
from axistwin.record import CHANNELS, REQUIRED, Record, from_samples
from axistwin.sampling import Array


@dataclass(frozen=True)
class ColumnOptions:
    """How to read columns: which one holds a channel, and what 1 in it means.

    ``columns`` maps channel to column, ``scales`` channel to a factor (text: a number, or the name
    of one in the file). ``time_step`` [s] where there is no time, ``counts_per_turn`` of the
    encoders, ``linear`` axis.
    """

    columns: Mapping[str, str] = field(default_factory=dict)
    scales: Mapping[str, str] = field(default_factory=dict)
    time_step: float | None = None
    counts_per_turn: tuple[int | None, int | None] = (None, None)
    linear: bool = False


def wanted(options: ColumnOptions, available: list[str], source: str) -> dict[str, str]:
    """The column of each channel (and of ``t``) that is to be read.

    Raises InputError when one that is needed or asked for is not there.
    """
    known = ("t", *CHANNELS)
    for name in (*options.columns, *options.scales):
        if name not in known:
            raise InputError(f"{name!r} is no channel; channels are {', '.join(known)}")
    found = {name: options.columns.get(name, name) for name in known}
    needed = {*options.columns, *REQUIRED}
    if options.time_step is None:
        needed.add("t")
    for name in known:
        if found[name] not in available:
            if name in needed:
                listed = ", ".join(available[:20])
                raise InputError(
                    f"{source}: no column {found[name]!r} for {name} (there are: {listed}); "
                    f"say which one with --map {name}=COLUMN"
                )
            del found[name]
    for name in options.scales:
        if name not in found:
            raise InputError(f"--scale {name}: {source} has no such channel")
    return found


def make_record(
    channels: dict[str, Array],
    options: ColumnOptions,
    source: str,
    number: Callable[[str], float] = float,
) -> Record:
    """A record from raw columns by channel name, ``t`` among them unless a time step is given.

    ``number`` says what a scale's text means; ValueError when it is no number.
    """
    for name, text in options.scales.items():
        try:
            channels[name] = channels[name] * number(text)
        except ValueError:
            raise InputError(f"--scale {name}={text}: {text!r} is no number") from None
    time = channels.pop("t", None)
    if options.time_step is not None:
        time = options.time_step * np.arange(len(channels["torque"]), dtype=np.float64)
    assert time is not None  # wanted() has seen to it
    return from_samples(
        time,
        channels,
        source=source,
        counts_per_turn=options.counts_per_turn,
        linear=options.linear,
    )
