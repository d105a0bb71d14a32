"""The worked example: docs/diagnosis.md and the README show what the tool says today."""

from __future__ import annotations

import functools
import re
from pathlib import Path

import numpy as np
import pytest

from axistwin.diagnose import example, signatures, summary, words
from axistwin.diagnose.result import Diagnosis

REPOSITORY = Path(__file__).resolve().parents[2]
DOCS = REPOSITORY / "docs"
PAGES = (DOCS / "diagnosis.md", REPOSITORY / "README.md")

ANSWER = re.compile(r"<!-- the example's answer -->\n```\n(.*?)\n```\n<!-- end -->", re.DOTALL)
SCORE = re.compile(r"<!-- the last `make hidden` -->\n(.*?)<!-- end -->", re.DOTALL)


@functools.cache
def diagnosis(folder: Path) -> Diagnosis:
    return example.answer(folder)


@pytest.fixture
def answered(tmp_path_factory: pytest.TempPathFactory) -> Diagnosis:
    """What the tool says of the example."""
    return diagnosis(tmp_path_factory.getbasetemp() / "example")


def said(text: str) -> list[str]:
    """The paragraph and the table without their numbers."""
    _, paragraph, table, *_ = text.split("\n\n")
    return re.sub(r"[-\d.]+", "#", f"{paragraph} {table}").split()


def test_the_causes_that_made_the_record_are_found(answered: Diagnosis) -> None:
    truth = {(one.effect, one.location): one.params for one in example.WORN.effects}
    assert {(one.effect, one.location) for one in answered.findings} == set(truth)
    assert not answered.unexplained
    for finding in answered.findings:
        for name, value in truth[finding.effect, finding.location].items():
            low, high = finding.ci95[name]
            assert abs(finding.params[name] - value) < high - low
            assert high - low < 0.1 * value


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_a_page_shows_what_the_tool_says(page: Path, answered: Diagnosis) -> None:
    shown = ANSWER.search(page.read_text(encoding="utf-8"))
    assert shown
    assert said(shown[1]) == said(summary.text(answered)), "run `make paper`"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_the_numbers_of_a_page_are_still_those_of_the_tool(page: Path, answered: Diagnosis) -> None:
    shown = ANSWER.search(page.read_text(encoding="utf-8"))
    assert shown
    for finding in answered.findings:
        for name in finding.params:
            now = words.parameter(finding, name, linear=False)
            printed = re.search(rf" {name} +([-\d.]+) ?{now.unit} +([-\d.]+) \.\. ", shown[1])
            assert printed, "run `make paper`"
            value, low = (float(number) for number in printed.groups())
            assert value - low > 0.0
            assert abs(float(now.value) - value) < value - low, "run `make paper`"


def test_the_figures_have_the_curve_in_the_cloud(answered: Diagnosis) -> None:
    """Dots, the means of the residual, lie on the line, which is what the effect adds."""
    for i in range(len(answered.findings)):
        axes = signatures.panels(answered, i)[0].figure.axes[0]
        _, dots, line = (np.array(drawn.get_data(), np.float64) for drawn in axes.lines)
        apart = np.abs(dots[1] - np.interp(dots[0], *line))
        assert np.median(apart) < 0.03 * np.ptp(line[1])


def test_the_figures_of_the_page_are_there(answered: Diagnosis) -> None:
    page = PAGES[0].read_text(encoding="utf-8")
    for name in example.pictures(answered):
        assert f"(figures/diagnosis-{name}.png)" in page
        assert (DOCS / "figures" / f"diagnosis-{name}.png").exists(), "run `make paper`"


def test_the_score_of_hidden_effects_has_its_place_on_the_page() -> None:
    result = {
        "single_right": 0.985,
        "pair_right": None,
        "clean_right": 1.0,
        "unknown_right": 0.9,
        "coverage95": 0.947,
        "n": 500,
        "seed": 77,
    }
    text = example.score(result)
    assert "of 500 records, SEED=77" in text
    for part in ("98.5 %", "none drawn", "100.0 %", "90.0 %", "94.7 %"):
        assert part in text
    assert "(figures/diagnosis-confusion.png)" in text
    assert SCORE.search(PAGES[0].read_text(encoding="utf-8"))
