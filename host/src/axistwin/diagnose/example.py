"""The worked example of docs/diagnosis.md: a worn axis, its record, the answer and the figures.

``python -m axistwin.diagnose.example`` makes all of it anew. The confusion matrix on that page is
what `make hidden` found last; without its results the page keeps the one that it has.
"""

from __future__ import annotations

import argparse
import io
import json
import re
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from axistwin import core, diagnose, model, readers
from axistwin.core import Axis, Effect
from axistwin.diagnose import figures, report, signatures, summary
from axistwin.diagnose.panels import Panel
from axistwin.diagnose.result import Diagnosis
from axistwin.model import Model
from axistwin.record import Record, write_csv

#: A screw drive with a worn nut: dry friction and play.
WORN = Model(
    Axis(I1=1e-3, I2=5e-4, B=5e-3, K=20.0),
    (
        Effect("friction_coulomb", "table", {"torque": 0.02}),
        Effect("backlash", "shaft", {"gap": 2e-3}),
    ),
    meta={"made_by": "axistwin.diagnose.example"},
)

#: Twenty seconds at 1 kHz, three after the start; noise of the encoders [rad].
_STEP, _SAMPLES, _RUN_UP, _NOISE = 1e-3, 20_000, 3000, 5e-4

#: A multisine up to 98 Hz, the resonance being at 39 Hz, and slow reversals [N m].
_LINES, _MULTISINE, _REVERSALS = 200, 0.08, 0.06

_PAGE = Path("docs") / "diagnosis.md"
_FIGURES = Path("docs") / "figures"
_DPI, _COLOURS = 110, 128

#: What the pages hold of the example and of the last run of `make hidden`, each between two lines.
_ANSWER = re.compile(r"(<!-- the example's answer -->\n).*?(<!-- end -->)", re.DOTALL)
_SCORE = re.compile(r"(<!-- the last `make hidden` -->\n).*?(<!-- end -->)", re.DOTALL)
_CONFUSION = "diagnosis-confusion.png"

_SCORES = (
    ("single_right", "one effect: cause and place right, nothing else named"),
    ("pair_right", "two effects: both right, nothing else named"),
    ("clean_right", "no effect: nothing named, nothing unexplained"),
    ("unknown_right", "an effect that is not in the catalogue: said to be unexplained"),
    ("coverage95", "95 % intervals that hold the truth"),
)


def record() -> Record:
    """What WORN does."""
    count = _RUN_UP + _SAMPLES
    time = _STEP * np.arange(count, dtype=np.float64)
    table = core.schroeder(2048, _LINES, _MULTISINE, seed=5)
    torque = np.resize(table, count) + _REVERSALS * np.sin(2.1 * time)
    angles = np.array(WORN.simulate(torque, _STEP, substeps=20))
    angles += _NOISE * np.random.default_rng(1).standard_normal(angles.shape)
    theta1, theta2 = angles[:, _RUN_UP:]
    return Record(time[:_SAMPLES], torque[_RUN_UP:], theta1, _STEP, theta2)


def answer(folder: Path) -> Diagnosis:
    """The diagnosis of the record as `axistwin diagnose` reads it from a file in ``folder``."""
    folder.mkdir(parents=True, exist_ok=True)
    model.write(WORN, folder / "worn.toml")
    write_csv(record(), folder / "worn.csv")
    return diagnose.diagnose(replace(readers.read_record(folder / "worn.csv"), source="worn.csv"))


def pictures(diagnosis: Diagnosis) -> dict[str, Sequence[Panel]]:
    """The figures of the page by name, each of panels side by side."""
    found: dict[str, Sequence[Panel]] = {"simulated": figures.simulations(diagnosis)[2:4]}
    for i, finding in enumerate(diagnosis.findings):
        found[finding.effect] = signatures.panels(diagnosis, i)
    return found


def update(repository: Path, build: Path) -> None:
    """Writes the files of the example to ``build`` and brings pages and figures up to date."""
    diagnosis = answer(build / "diagnosis")
    report.write(diagnosis, build / "diagnosis" / "worn.html")
    for name, panels in pictures(diagnosis).items():
        _save(panels, repository / _FIGURES / f"diagnosis-{name}.png")
    told = f"```\n{summary.text(diagnosis)}\n```\n"
    for page in (repository / _PAGE, repository / "README.md"):
        _put(page, _ANSWER, told)
    scores, confusion = build / "hidden.json", build / "hidden-confusion.png"
    if scores.exists() and confusion.exists():
        shutil.copyfile(confusion, repository / _FIGURES / _CONFUSION)
        _put(repository / _PAGE, _SCORE, score(json.loads(scores.read_text(encoding="utf-8"))))


def score(result: Mapping[str, Any]) -> str:
    """What a run of `make hidden` found, for the page."""
    rows = [
        f"| {text} | {'none drawn' if result[key] is None else f'{100.0 * result[key]:.1f} %'} |"
        for key, text in _SCORES
    ]
    head = f"| of {result['n']} records, SEED={result['seed']} | |"
    picture = f"![What was hidden, and what was answered]({_FIGURES.name}/{_CONFUSION})"
    return "\n".join([head, "|---|---|", *rows, "", picture, ""])


def _put(page: Path, place: re.Pattern[str], text: str) -> None:
    """Replaces what stands in a place of a page."""
    old = page.read_text(encoding="utf-8")
    new = place.sub(lambda found: f"{found[1]}{text}{found[2]}", old)
    page.write_text(new, encoding="utf-8")


def _save(panels: Sequence[Panel], path: Path) -> None:
    """Panels side by side as PNG with a palette."""
    images = []
    for panel in panels:
        drawn = io.BytesIO()
        panel.figure.savefig(drawn, format="png", dpi=_DPI)
        images.append(Image.open(drawn).convert("RGB"))
    whole = Image.new("RGB", (sum(one.width for one in images), images[0].height))
    at = 0
    for one in images:
        whole.paste(one, (at, 0))
        at += one.width
    whole.quantize(_COLOURS).save(path, optimize=True)


def main(arguments: Sequence[str] | None = None) -> int:
    """Command line of `python -m axistwin.diagnose.example`."""
    parser = argparse.ArgumentParser(
        prog="python -m axistwin.diagnose.example", description=__doc__
    )
    parser.add_argument("--repository", type=Path, default=Path(), metavar="DIR")
    parser.add_argument("--build", type=Path, default=Path("build"), metavar="DIR")
    options = parser.parse_args(arguments)
    update(options.repository, options.build)
    return 0


if __name__ == "__main__":
    sys.exit(main())
