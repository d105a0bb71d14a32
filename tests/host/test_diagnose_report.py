"""How a diagnosis is told: as JSON, in words, and as a page that needs nothing else."""

from __future__ import annotations

import functools
import json
import math
import re
from collections.abc import Callable
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from axistwin import core
from axistwin.diagnose import drawing, report, signatures, summary, words
from axistwin.diagnose.result import Contribution, Diagnosis, Finding, Residual
from axistwin.errors import FileError
from axistwin.model import SAMPLE_LOSS

from . import diagnosis_examples as examples

ANSWERS = (examples.found, examples.healthy, examples.unknown, examples.one_encoder)


# ---- As JSON


@pytest.mark.parametrize("example", ANSWERS)
def test_the_json_has_everything_that_the_schema_says(example: Callable[[], Diagnosis]) -> None:
    diagnosis = example()
    content = json.loads(json.dumps(diagnosis.to_json("model.toml"), allow_nan=False))
    assert content["schema"] == "axistwin.diagnosis/1"
    assert content["extended_model"] == "model.toml"
    record = content["record"]
    assert (record["samples"], record["rate_hz"]) == (20000, 1000.0)
    assert record["duration_s"] == pytest.approx(19.999)
    assert record["channels"][:2] == ["torque", "theta1"]
    assert record["warnings"] == ["one line that has to be known"]
    base = content["base_model"]
    assert base["valid"] is True
    assert set(base["params"]) == set(base["stderr"]) == set(diagnosis.base)
    assert content["unexplained"] is diagnosis.unexplained
    assert set(content["error"]) == {"what", "unit", "base", "extended", "noise_floor"}
    for found, finding in zip(content["findings"], diagnosis.findings, strict=True):
        assert found["params"] == dict(finding.params)
        assert found["ci95"] == {name: list(ends) for name, ends in finding.ci95.items()}
        assert (found["effect"], found["location"]) == (finding.effect, finding.location)
    assert all(
        set(one) == {"effect", "location", "gain", "verdict"} for one in content["considered"]
    )


def test_what_is_not_finite_is_null_in_json() -> None:
    diagnosis = examples.found()
    finding = replace(
        diagnosis.findings[0],
        params={"torque": math.nan},
        ci95={"torque": (-math.inf, math.inf)},
        gain=math.nan,
    )
    content = replace(diagnosis, findings=(finding,)).to_json()
    text = json.dumps(content, allow_nan=False)
    found = json.loads(text)["findings"][0]
    assert found["params"] == {"torque": None}
    assert found["ci95"] == {"torque": [None, None]}
    assert found["gain"] is None


# ---- In words


def test_causes_are_named_with_numbers_and_what_to_do() -> None:
    text = summary.text(examples.found())
    assert "Dry friction at the table and torque ripple at the motor explain 99.8 %" in text
    assert "What is left is noise." in text
    row = next(line for line in text.splitlines() if line.startswith("Dry friction   "))
    assert re.search(r"at the table +torque +30\.02 mN m +29\.60 \.\. 30\.40 mN m +86 %", row)
    assert re.search(r"periods +12 a turn$", text, re.MULTILINE)
    assert re.search(r"phase +39\.5° +37\.8 \.\. 41\.3°$", text, re.MULTILINE)
    assert "Next: Compensate: feed 30.02 mN m forward" in text
    assert "Next: Compensate: subtract 10.10 mN m at 12 a turn" in text
    assert "Not named, look-alike of viscous friction at the motor: a delay of the torque." in text
    assert text.endswith("Note: one line that has to be known")
    assert max(map(len, text.splitlines())) <= 100


def test_nothing_wrong_is_said_plainly() -> None:
    text = summary.text(examples.healthy())
    assert "Nothing is wrong" in text
    assert "explains" not in text
    assert words.verdict(examples.healthy()) == "Nothing wrong"


def test_none_of_these_is_said_plainly() -> None:
    text = summary.text(examples.unknown())
    assert "Something is wrong that is none of the 3 effects known here" in text
    assert "Next: Measure again" in text


def test_a_cause_that_is_not_the_whole_story_says_so() -> None:
    diagnosis = replace(examples.found(), unexplained=True)
    told = words.paragraph(diagnosis)
    assert told.endswith("Something is left that is none of the effects known here.")
    assert words.verdict(diagnosis) == "Two causes named, and something is left"


def test_a_record_that_does_not_tell_gets_advice() -> None:
    diagnosis = replace(examples.healthy(), base_valid=False)
    assert "Measure again with more excitation" in summary.text(diagnosis)
    advised = replace(diagnosis, advice=("one direction only; let the axis reverse",))
    assert words.next_steps(advised) == []
    told = "Not told by this record: one direction only; let the axis reverse"
    assert told in summary.text(advised)


@given(
    st.floats(1e-12, 1e12).flatmap(lambda x: st.sampled_from([x, -x])),
    st.floats(1e-5, 10.0),
    st.sampled_from(["N m", "rad", "s", "kg m2", "N m/rad3", "1"]),
)
def test_a_number_is_rounded_by_less_than_a_twentieth_of_its_interval(
    value: float, spread: float, unit: str
) -> None:
    half = spread * abs(value)
    number = words.shown(value, unit, (value - half, value + half))
    power = {"k": 3, "m": -3, "µ": -6, "n": -9}.get(number.unit[:1], 0)
    if number.unit in ("", "rad", "s", "N m", "kg m²", "N m/rad³"):
        power = 0
    assert float(number.value) * 10.0**power == pytest.approx(value, abs=half / 20.0)
    low, high = (float(end) * 10.0**power for end in number.interval.split(" .. "))
    assert low == pytest.approx(value - half, abs=half / 20.0)
    assert high == pytest.approx(value + half, abs=half / 20.0)


@pytest.mark.parametrize(
    ("share", "text"),
    [
        (0.86, "86 %"),
        (0.998, "99.8 %"),
        (0.9997, "99.97 %"),
        (0.0004, "0.04 %"),
        (0.000001, "0 %"),
        (1.0, "100 %"),
        (math.nan, "-"),
    ],
)
def test_a_share_shows_how_far_it_is_from_none_and_all(share: float, text: str) -> None:
    assert words.percent(share) == text


def test_what_a_cause_explains_is_of_what_those_before_it_leave() -> None:
    diagnosis = examples.found()
    first, second = words.explained(diagnosis)
    assert first == pytest.approx(0.86)
    assert (1.0 - first) * (1.0 - second) == pytest.approx(1.0 - 0.998)
    backlash = diagnosis.considered[0]
    assert words.would_explain(diagnosis, backlash) == pytest.approx(0.0004 / 0.002)


# ---- What every effect of the catalogue needs


def every_effect() -> list[Finding]:
    """Each effect at each place, of size 1."""
    found: dict[tuple[str, str], dict[str, float]] = {}
    for entry in core.effect_parameters():
        found.setdefault((entry.effect, entry.location), {})[entry.parameter] = 1.0
    found[SAMPLE_LOSS, "record"] = {"fraction": 0.01}
    return [
        Finding(*key, params, dict.fromkeys(params, (0.9, 1.1)), 0.5)
        for key, params in found.items()
    ]


@pytest.mark.parametrize("finding", every_effect(), ids=lambda one: f"{one.effect}-{one.location}")
def test_every_effect_has_words_and_a_picture(finding: Finding) -> None:
    diagnosis = examples.found()
    count = len(diagnosis.evidence.signals.time)
    place = finding.location if finding.location in ("table", "encoder1", "encoder2") else "motor"
    noise = np.random.default_rng(1).standard_normal(count)
    evidence = replace(
        diagnosis.evidence,
        residuals={place: Residual(noise, noise)},
        contributions=(Contribution(place, np.zeros(count)),),
    )
    alone = replace(diagnosis, findings=(finding,), evidence=evidence)
    text = summary.text(alone)
    assert words.title(words.what(finding.effect)) in text
    assert "Next: " in text
    panels = signatures.panels(alone, 0)
    assert panels
    assert all(panel.figure.axes[0].has_data() for panel in panels)


def test_a_stiffness_that_drifts_is_shown_as_it_drifts() -> None:
    diagnosis = examples.found()
    signals = diagnosis.evidence.signals
    assert signals.twist is not None
    rate, stiffness = 0.02, 20.0
    own = -stiffness * rate * signals.time * signals.twist
    noise = 1e-4 * np.random.default_rng(1).standard_normal(len(own))
    drift = Finding("stiffness_drift", "shaft", {"rate": rate}, {"rate": (0.019, 0.021)}, 0.9)
    evidence = replace(
        diagnosis.evidence,
        residuals={"motor": Residual(own + noise, noise)},
        contributions=(Contribution("motor", own),),
    )
    (panel,) = signatures.panels(replace(diagnosis, findings=(drift,), evidence=evidence), 0)
    time, strength = panel.figure.axes[0].lines[0].get_data()
    assert np.asarray(strength) == pytest.approx(
        stiffness * rate * np.asarray(time), rel=0.05, abs=0.03
    )


def test_the_spectrum_of_samples_with_gaps_keeps_their_power() -> None:
    time = 1e-3 * np.arange(20000, dtype=np.float64)
    time[8000:] += 5.0
    values = np.random.default_rng(1).standard_normal(len(time)) + 2.0 * np.sin(628.0 * time)
    frequency, density = drawing.spectrum(time, values)
    power = float(np.sum(density**2) * (frequency[1] - frequency[0]))
    assert power == pytest.approx(3.0, rel=0.03)
    assert frequency[np.argmax(density)] == pytest.approx(99.95, abs=frequency[0])


# ---- As a page


class Page(HTMLParser):
    """What a page refers to, and whether its elements are closed in order."""

    EMPTY = ("meta", "br", "hr", "img", "link")

    def __init__(self, text: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.ids: list[str] = []
        self.references: list[str] = []
        self.text: list[str] = []
        self._open: list[str] = []
        self.feed(text)
        self.close()
        assert self._open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_startendtag(tag, attrs)
        if tag not in self.EMPTY:
            self._open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        for name, value in attrs:
            if name == "id":
                self.ids.append(value or "")
            if name in ("href", "xlink:href", "src", "data", "action"):
                self.references.append(value or "")
            self.references += re.findall(r"url\(([^)]*)\)", value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self._open.pop() == tag

    def handle_data(self, data: str) -> None:
        self.text.append(data)


@functools.cache
def page_of(example: Callable[[], Diagnosis]) -> str:
    """The report of an example."""
    return report.html(example())


@pytest.mark.parametrize("example", ANSWERS)
def test_the_page_needs_nothing_else(example: Callable[[], Diagnosis]) -> None:
    text = page_of(example)
    page = Page(text)
    assert not {"script", "link", "iframe", "img", "object", "base"} & set(page.tags)
    assert "svg" in page.tags
    assert "http" not in text
    assert "@import" not in text
    assert len(page.ids) == len(set(page.ids))
    inside = {reference for reference in page.references if reference.startswith("#")}
    assert inside
    assert inside <= {f"#{name}" for name in page.ids}
    assert all(r.startswith(("#", "data:image/png;base64,")) for r in page.references)


def test_the_page_says_what_the_terminal_says() -> None:
    diagnosis = examples.found()
    text = " ".join(Page(page_of(examples.found)).text)
    for part in (
        words.verdict(diagnosis),
        words.paragraph(diagnosis),
        "29.60 .. 30.40 mN m",
        "look-alike of viscous friction at the motor",
        "one line that has to be known",
    ):
        assert part in text


def test_names_from_outside_are_escaped() -> None:
    evil = '<script src="1"> & \'"'
    diagnosis = examples.one_encoder()
    warned = replace(
        diagnosis,
        record=replace(diagnosis.record, source=f"{evil}.csv"),
        warnings=(evil,),
        advice=(evil,),
    )
    page = Page(report.html(warned))
    assert "script" not in page.tags
    shown = "\n".join(page.text)
    assert shown.count(f"{evil}.csv") == 3  # title, headline, file
    assert shown.count(evil) == 5
    assert "What this record cannot tell" in shown


def test_a_report_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="cannot write"):
        report.write(examples.healthy(), tmp_path / "nowhere" / "report.html")
