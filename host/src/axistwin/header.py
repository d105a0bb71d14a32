"""A model as a C header: the axis and its effects as constants of a firmware."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import astuple, fields
from pathlib import Path

from axistwin import core
from axistwin.core import Axis, Effect
from axistwin.model import AXIS_UNITS, Model
from axistwin.output import atomic_write


def write(model: Model, path: str | Path, source: str = "") -> None:
    """Writes a header that names its constants after itself: axis_model.h has axis_model.

    Compiled with lib/ in the same precision, axt_machine_init() makes of them the axis that
    Model.simulate() has. ``source`` says where the model comes from. Raises FileError.
    """
    text = "\n".join(_lines(model, Path(path).name, source)) + "\n"
    with atomic_write(path) as partial:
        partial.write_text(text, encoding="utf-8")


def _lines(model: Model, file: str, source: str) -> Iterator[str]:
    name = _identifier(Path(file).stem)
    axis, effects = model.rotary()
    yield f"/* {_comment(file)} - the axis of {_comment(source) or 'a model'} with its effects."
    yield " *"
    yield f" *     axt_machine_init(&machine, &{name}, time_step, AXT_TORQUE_HELD, &{name}_effects)"
    yield " *"
    yield from _notes(model)
    yield " * Made by `axistwin model header`: change the model, not this. */"
    yield f"#ifndef {name.upper()}_H"
    yield f"#define {name.upper()}_H"
    yield ""
    yield '#include "axt_axis.h"'
    yield '#include "axt_effects.h"'
    yield ""
    yield f"static const axt_axis {name} = {{"
    for entry, value in zip(fields(Axis), astuple(axis), strict=True):
        yield f"    .{entry.name} = {_number(value)}, /* {AXIS_UNITS[entry.name]} */"
    yield "};"
    yield ""
    yield f"static const axt_effects {name}_effects = {{"
    yield from _effects(effects)
    yield "};"
    yield ""
    yield "#endif"


def _notes(model: Model) -> Iterator[str]:
    """What a reader of the header has to know of the model beside its numbers."""
    if model.linear:
        yield " * The axis is a linear one, and a metre of it a turn in here: angles are positions"
        yield " * times 2 pi, torques are forces divided by 2 pi."
        yield " *"
    for key, value in model.meta.items():
        yield f" * {_comment(f'{key}: {value}')}"
    if model.meta:
        yield " *"
    if model.sample_loss > 0.0:
        yield f" * {100.0 * model.sample_loss:g} % of the record's samples were missing."
        yield " *"


def _effects(effects: tuple[Effect, ...]) -> Iterator[str]:
    if not effects:
        yield "    .backlash = 0 /* and nothing else: an ideal axis */"
    for effect, (instance, entries) in zip(effects, core.place_effects(effects), strict=True):
        yield f"    /* {effect.effect} at {effect.location} */"
        for name, entry in entries.items():
            member = core.effect_member(entry, instance)
            value = _number(effect.params[name])
            yield f"    .{member} = {value}, /* {name} [{entry.unit}] */"


def _number(value: float) -> str:
    """A constant that is this double, or the float nearest to it."""
    return f"(axt_real){float(value)!r}"


def _identifier(text: str) -> str:
    name = re.sub(r"\W", "_", text, flags=re.ASCII)
    return f"_{name}" if name[:1].isdigit() else name


def _comment(text: str) -> str:
    """On one line, and nothing that ends a comment or begins another."""
    return " ".join(text.split()).replace("*/", "* /").replace("/*", "/ *")
