"""The confusion matrix: what is hidden against what is answered, as a picture."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from score import judge

NOTHING, UNEXPLAINED, NO_ANSWER = "nothing", "unexplained", "no answer"


def pairs(results: Sequence[Mapping[str, Any]]) -> list[tuple[str, str]]:
    """(hidden, answered) for every hidden effect, and for every record in which nothing is.

    An effect that is named is answered by itself; one that is missed by the first that was accused
    in its place, or by "unexplained" or "nothing".
    """
    found = []
    for result in results:
        truth = result["truth"]
        hidden = [_label((e["effect"], e["location"])) for e in truth["hidden"]] or [NOTHING]
        if "answer" not in result:
            found += [(name, NO_ANSWER) for name in hidden]
            continue
        verdict = judge(truth, result["answer"])
        accused = [_label(name) for name in verdict.accused]
        silence = UNEXPLAINED if result["answer"]["unexplained"] else NOTHING
        if not accused and not verdict.named and truth["kind"] == "unknown":
            found += [(name, silence) for name in hidden]
            continue
        named = {_label(name) for name in verdict.named}
        for name in hidden:
            answered = name if name in named else (accused.pop(0) if accused else silence)
            found.append((name, answered))
    return found


def _label(name: tuple[str, str]) -> str:
    return f"{name[0]} {name[1]}"


def draw_confusion(results: Sequence[Mapping[str, Any]], path: Path) -> None:
    """Draws the matrix: rows are what is hidden, a row's numbers are counts, its colours shares."""
    counted = pairs(results)
    last = [UNEXPLAINED, NOTHING, NO_ANSWER]
    rows = sorted({hidden for hidden, _ in counted}, key=lambda name: (name in last, name))
    answers = {answered for _, answered in counted}
    columns = sorted(answers, key=lambda name: (name in last, name))
    table = np.zeros((len(rows), len(columns)), int)
    for hidden, answered in counted:
        table[rows.index(hidden), columns.index(answered)] += 1
    share = table / np.sum(table, axis=1, keepdims=True)
    with mpl.rc_context({"font.size": 7.0}):
        figure = Figure(
            figsize=(2.2 + 0.24 * len(columns), 1.9 + 0.2 * len(rows)), layout="constrained"
        )
        axes = figure.add_subplot()
        axes.imshow(share, cmap="Blues", vmin=0.0, vmax=1.0, aspect="auto")
        for i, j in zip(*np.nonzero(table), strict=True):
            colour = "white" if share[i, j] > 0.6 else "black"
            axes.text(j, i, str(table[i, j]), ha="center", va="center", color=colour)
        axes.set_xticks(range(len(columns)), columns, rotation=90)
        axes.set_yticks(range(len(rows)), rows)
        axes.set_xlabel("answered")
        axes.set_ylabel("hidden")
        figure.savefig(path, dpi=150)
