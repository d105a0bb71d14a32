"""What no effect of the catalogue is: told by forms that none of them has."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from axistwin.core import Effect
from axistwin.diagnose import diagnose, nameless, windows, words
from axistwin.diagnose.effects import TABLE, ExtraMode, Found
from axistwin.diagnose.fit import Fit
from axistwin.diagnose.forms import Form, TorqueCurve, forms, slipping
from axistwin.diagnose.linear import TwoInertias
from axistwin.diagnose.result import Resemblance
from axistwin.diagnose.state import State
from axistwin.diagnose.trials import Trials, significant

from . import diagnosis_examples as examples
from .diagnosis_records import AXIS, NOISE, record, shake

TORQUE = shake(12_000)


def test_a_spring_that_slips_remembers_where_it_turned_back() -> None:
    """The loop of Prandtl's element: after a reversal it takes two reaches to slip again."""
    reach, steps = 1.0, np.concatenate([np.full(40, 0.1), np.full(40, -0.1), np.full(40, 0.1)])
    way = np.cumsum(steps)
    (carried,) = slipping(way[None, :], np.array([reach]))
    since = way[39] - way[40:80]
    assert carried[0, 40:80] == pytest.approx(np.maximum(reach - since, -reach))
    since = way[80:] - way[79]
    assert carried[0, 80:] == pytest.approx(np.minimum(since - reach, reach))


def test_a_spring_goes_on_from_window_to_window() -> None:
    way = np.cumsum(np.random.default_rng(1).standard_normal(600))
    (whole,) = slipping(way[None, :], np.array([2.0]))
    (parts,) = slipping(way.reshape(6, 100), np.array([2.0]))
    assert parts.ravel()[100:] == pytest.approx(whole[0, 100:])


@pytest.mark.parametrize(
    ("share", "beside"),
    [(0.005, None), (0.05, Effect("friction_coulomb", "motor", {"torque": 0.02}))],
)
def test_a_drive_that_falls_off_at_its_peaks_is_none_of_the_catalogue(
    share: float, beside: Effect | None
) -> None:
    """The axis gets less than the record says, the more the larger the torque."""
    effects = () if beside is None else (beside,)
    less = share * (TORQUE / np.max(np.abs(TORQUE))) ** 2
    delivered = record(*effects, torque=TORQUE * (1.0 - less))
    steps: list[str] = []
    found = diagnose(replace(delivered, torque=TORQUE), progress=steps.append)
    assert "going on in longer windows" not in steps  # no use, which is clear by then
    assert found.unexplained
    assert found.resembles is not None
    assert (found.resembles.form, found.resembles.location) == ("torque_curve", "motor")
    assert found.resembles.share > 0.9
    assert {one.effect for one in found.findings} <= {one.effect for one in effects}


@pytest.mark.parametrize("true", [False, True])
def test_only_what_a_form_does_not_explain_as_well_is_named_beside_it(true: bool) -> None:
    """A further mode can take up part of what a drive does that no form fits exactly."""
    params = {"frequency": 300.0, "damping_ratio": 0.02, "mass_ratio": 0.1}
    effects = (Effect("extra_mode", "table", params),) if true else ()
    less = 0.05 * np.abs(TORQUE) / np.max(np.abs(TORQUE))
    delivered = record(*effects, torque=TORQUE * (1.0 - less))
    cut = windows.cut(replace(delivered, torque=TORQUE), 0.25)
    base = State.along(Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE)))
    if true:
        mode = Found(ExtraMode(TABLE), np.array([0.1]), (300.0, 0.02))
    else:
        (trial,) = Trials(base).run([ExtraMode(TABLE)], lambda _: None)
        mode = trial.found
    last = State.along(replace(base.fit, found=(mode,)))
    (trial,) = Trials(last).run([TorqueCurve()], lambda _: None)
    beside, alone = (
        State.along(replace(base.fit, found=found))
        for found in ((mode, trial.found), (trial.found,))
    )
    assert significant(beside.against(alone, mode), alone)  # it takes up something
    named = [one.kind.effect for one in nameless.still(beside, last)]
    assert named == (["extra_mode"] if true else [])


def test_what_the_catalogue_has_resembles_nothing_else() -> None:
    found = diagnose(
        record(Effect("stiffness_hardening", "shaft", {"coefficient": 1e5}), torque=TORQUE)
    )
    assert [one.effect for one in found.findings] == ["stiffness_hardening"]
    assert found.resembles is None
    assert not found.unexplained


@pytest.mark.parametrize("form", forms(2), ids=lambda form: form.name)
def test_every_form_is_told_in_words(form: Form) -> None:
    like = Resemblance(form.effect, form.location, 0.97)
    diagnosis = replace(examples.unknown(), resembles=like)
    assert "It goes with" in words.paragraph(diagnosis)
    assert "97 %" in words.paragraph(diagnosis)
    assert "{" not in " ".join([words.paragraph(diagnosis), *words.next_steps(diagnosis)])
    assert diagnosis.to_json()["resembles"] == {
        "form": form.effect,
        "location": form.location,
        "share": 0.97,
    }
