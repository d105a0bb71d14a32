"""The answer of a diagnosis in the terminal: a paragraph, a table, and what to do next."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence

from axistwin.diagnose import words
from axistwin.diagnose.result import Diagnosis

_WIDTH = 100

_ADVICE = "Not told by this record: "


def text(diagnosis: Diagnosis) -> str:
    """The whole answer, lines of at most 100 characters where words can be parted."""
    blocks = [
        [f"{diagnosis.record.source}: {words.record_line(diagnosis)}"],
        _wrapped(words.paragraph(diagnosis)),
        list(_table(diagnosis)),
        list(_not_named(diagnosis)),
        [line for step in words.next_steps(diagnosis) for line in _wrapped(step, "Next: ")],
        [line for advice in diagnosis.advice for line in _wrapped(advice, _ADVICE)],
        [
            line
            for warning in dict.fromkeys((*diagnosis.record.warnings, *diagnosis.warnings))
            for line in _wrapped(warning, "Note: ")
        ],
    ]
    return "\n\n".join("\n".join(block) for block in blocks if block)


def _wrapped(sentence: str, label: str = "") -> list[str]:
    return textwrap.wrap(
        label + sentence,
        _WIDTH,
        subsequent_indent=" " * len(label),
        break_long_words=False,
        break_on_hyphens=False,
    )


def _table(diagnosis: Diagnosis) -> Iterator[str]:
    """A line for each parameter of each finding."""
    if not diagnosis.findings:
        return
    rows = [("cause", "where", "parameter", "value", "95 % interval", "explains")]
    for finding, share in zip(diagnosis.findings, words.explained(diagnosis), strict=True):
        first = (
            words.title(words.what(finding.effect)),
            words.where(finding.location),
            words.percent(share),
        )
        for name in finding.params:
            number = words.parameter(finding, name, diagnosis.record.linear)
            interval = words.joined(number.interval, number.unit) if number.interval else ""
            rows.append((*first[:2], name.replace("_", " "), number.with_unit, interval, first[2]))
            first = ("", "", "")
    yield from _columns(rows)
    if len(diagnosis.findings) > 1:
        yield "explains: of the squared error on unseen windows that the causes above it leave"


def _columns(rows: Sequence[Sequence[str]]) -> Iterator[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row[:-1], widths, strict=False)]
        yield "  ".join([*cells, row[-1].rjust(widths[-1])]).rstrip()


def _not_named(diagnosis: Diagnosis) -> Iterator[str]:
    """What the record cannot tell, and look-alikes of what was named."""
    for reason, effects in words.rejected(diagnosis).items():
        names = words.listed([words.cause(one.effect, one.location) for one in effects])
        yield from _wrapped(f"{reason}: {names}.", "Not named, ")
