"""The search for effects: first in a part of the record, then in all of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from axistwin.core import Effect
from axistwin.diagnose import diagnose, resonance, search, selection, trials, windows
from axistwin.diagnose.effects import (
    MOTOR,
    TABLE,
    Backlash,
    Disturbance,
    ExtraMode,
    Found,
    Hardening,
    LoadChange,
    Offset,
    Viscous,
)
from axistwin.diagnose.fit import NEARLY_RIGHT, RIGHT, Fit
from axistwin.diagnose.linear import TwoInertias
from axistwin.diagnose.state import State, Trial
from axistwin.diagnose.trials import Trials
from axistwin.errors import InputError

from .diagnosis_records import AXIS, NOISE, STEP, record, shake

#: Of it a search begins with less than half.
TORQUE = shake(20_000)
WINDOW = 0.25


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """A search that begins with as few windows as it can."""
    monkeypatch.setattr("axistwin.diagnose._FIRST_SAMPLES", 1)


@pytest.mark.usefixtures("few")
def test_a_load_that_changes_where_the_search_did_not_look_is_found_to_the_moment() -> None:
    cut = windows.cut(record(torque=TORQUE), WINDOW)
    looked_at = cut.part(1).index[:, 0]
    gap = int(np.argmax(np.diff(looked_at)))
    middle = 0.5 * STEP * float(looked_at[gap] + looked_at[gap + 1])
    change = Effect("load_change", "table", {"ratio": 1.05, "time": middle})
    (found,) = diagnose(record(change, torque=TORQUE), window=WINDOW).findings
    assert found.effect == "load_change"
    assert found.params["time"] == pytest.approx(middle, abs=2.0 * STEP)
    assert found.params["ratio"] == pytest.approx(1.05, abs=1e-3)


def test_a_load_may_change_whenever_samples_are_missing() -> None:
    """A moment that lies between two windows is as likely all along from the one to the other."""
    missing = np.arange(9_030, 9_130)
    change = Effect("load_change", "table", {"ratio": 0.3, "time": 9.07})
    lossy = replace(record(change, torque=TORQUE), missing=missing)
    found = diagnose(lossy, window=WINDOW).findings[0]
    assert found.effect == "load_change"
    first, last = found.ci95["time"]
    assert first < STEP * missing[0] < STEP * missing[-1] < last


@pytest.mark.usefixtures("few")
def test_what_only_the_whole_record_shows_is_found() -> None:
    params = {"amplitude": 1.4e-6, "frequency": 31.7, "phase": 0.4}
    whole = record(Effect("disturbance", "motor", params), torque=TORQUE)
    (found,) = diagnose(whole, window=WINDOW).findings
    assert found.effect == "disturbance"
    assert found.params["frequency"] == pytest.approx(31.7, abs=0.05)
    assert whole.theta2 is not None
    part = slice(5_000)  # as much as the search begins with
    short = replace(
        whole,
        time=whole.time[part],
        torque=whole.torque[part],
        theta1=whole.theta1[part],
        theta2=whole.theta2[part],
    )
    assert diagnose(short, window=WINDOW).findings == ()


def test_a_command_that_is_clipped_in_a_window_held_out_is_found() -> None:
    torque, limit = TORQUE.copy(), 1.02 * float(np.max(np.abs(TORQUE)))
    cut = windows.cut(record(torque=torque), WINDOW)
    (lone,) = cut.index[cut.held_out][13:14]
    torque[lone[100:140]] = limit * (1.0 + 0.1 * np.sin(np.pi * np.arange(40) / 39.0))
    clipped = Effect("torque_saturation", "motor", {"limit": limit})
    diagnosis = diagnose(record(clipped, torque=torque), window=WINDOW)
    (found,) = diagnosis.findings
    assert found.effect == "torque_saturation"
    assert found.params["limit"] == pytest.approx(limit, rel=1e-4)
    assert not diagnosis.unexplained


@pytest.mark.parametrize("frequency", [3.0, 11.7, 41.3, 80.0])
def test_a_line_slower_than_a_window_is_found_where_samples_are_missing(frequency: float) -> None:
    params = {"amplitude": 4e-4, "frequency": frequency, "phase": 0.4}
    whole = record(Effect("disturbance", "motor", params), torque=TORQUE)
    lost = np.sort(np.random.default_rng(5).choice(len(TORQUE), 40, replace=False))
    cut = windows.cut(replace(whole, missing=lost), 0.1)
    assert np.any(np.diff(cut.index[:, 0]) % cut.length)
    assert frequency < 1.5 * 2.0 * np.pi / (STEP * cut.length)
    fit = Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE))
    (trial,) = Trials(State(fit, fit.motion(None))).run([Disturbance(0)], lambda _: None)
    assert trial.found.shape[0] == pytest.approx(frequency, abs=0.02)
    size, angle = float(np.hypot(*trial.found.sizes)), trial.found.params["phase"]
    assert size == pytest.approx(params["amplitude"], rel=0.1)
    assert angle == pytest.approx(params["phase"], abs=0.2)


def test_noise_that_further_initial_states_explain_is_no_gain() -> None:
    cut = windows.cut(record(torque=shake(16_000)), WINDOW)
    fit = Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE))
    mode = Found(ExtraMode(1), np.array([1e-6]), (600.0, 0.02))
    two, three = (State(one, one.motion(None)) for one in (fit, replace(fit, found=(mode,))))
    assert two.fitted - three.fitted > np.count_nonzero(~cut.held_out)
    for held_out in (True, False):
        spread = np.sqrt(4.0 * np.count_nonzero(cut.held_out == held_out))
        difference = two.excess(held_out=held_out) - three.excess(held_out=held_out)
        assert abs(difference) < 4.0 * spread


def test_nothing_is_added_near_the_noise_before_a_replay(monkeypatch: pytest.MonkeyPatch) -> None:
    change = Effect("load_change", "table", {"ratio": 0.3, "time": 3.0})
    cut = windows.cut(record(change, torque=shake(8_000)), WINDOW)
    load = Found(LoadChange(TABLE), np.array([0.3]), (3.0,))
    fit = Fit(cut, "zoh", TwoInertias(AXIS), found=(load,), noise=np.full(2, 1.1 * NOISE))
    state = State.along(fit)
    assert state.scale < RIGHT
    beside: list[bool] = []

    def best(state: State, *_: object) -> State | None:
        beside.append(state.replay is not None)
        return None if beside[-1] else state  # what a replay would show to be nothing

    monkeypatch.setattr(selection, "_best", best)
    monkeypatch.setattr(selection, "addable", lambda _: [])
    found = selection.extended([state], [], lambda _: None)
    assert beside == [False, True]
    assert [one.replay is not None for one in found.states] == [True]


def test_a_step_to_values_that_no_axis_has_is_shortened(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its frequency, which the motion is smoothed by, may be what has a limit."""
    frequency, least = vars(TwoInertias)["frequency"].fget, 1.1 * AXIS.I2

    def limited(plant: TwoInertias) -> float:
        if least > plant.axis.I2:
            raise InputError("out of range")
        return float(frequency(plant))

    monkeypatch.setattr(TwoInertias, "frequency", property(limited))
    start = Fit(
        windows.cut(record(torque=TORQUE[:6000]), WINDOW),
        "zoh",
        TwoInertias(replace(AXIS, I2=1.3 * AXIS.I2)),
    )
    adjusted = State.along(start).fit.plant.values
    assert least <= adjusted[1] < 1.15 * AXIS.I2


@pytest.mark.parametrize("place", [MOTOR, TABLE])
def test_the_end_of_a_friction_is_told_again_once_all_else_is_known(place: int) -> None:
    """By what it twists the shaft: else that would seem to be a delay of one of the encoders."""
    params = {"frequency": 300.0, "damping_ratio": 0.02, "mass_ratio": 0.1}
    effects = (
        Effect("friction_viscous", ("motor", "table")[place], {"coefficient": 1e-4}),
        Effect("extra_mode", "table", params),
    )
    cut = windows.cut(record(*effects, torque=TORQUE), WINDOW)
    at_wrong_end = Found(Viscous(1 - place), np.array([1e-4]), ())
    mode = Found(ExtraMode(TABLE), np.array([0.1]), (300.0, 0.02))
    fit = Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE))
    mistaken = State.along(replace(fit, found=(at_wrong_end, mode)))
    told = selection._at_better_end(mistaken)
    assert [one.kind for one in told.fit.found] == [Viscous(place), ExtraMode(TABLE)]
    assert selection._at_better_end(told) is told


def test_the_rounding_of_a_coarse_encoder_is_no_error_of_a_screw() -> None:
    whole = record(torque=TORQUE)
    assert whole.theta2 is not None
    step = 2.0 * np.pi / 90.0
    (found,) = diagnose(
        replace(whole, theta2=step * np.floor(whole.theta2 / step)), window=WINDOW
    ).findings
    assert (found.effect, found.params["counts"]) == ("quantisation", 90.0)


def test_a_mode_is_found_where_the_response_does_not_show_where_it_is(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(resonance, "find", lambda *_: [])
    params = {"frequency": 60.0, "damping_ratio": 0.02, "mass_ratio": 0.004}
    light = record(Effect("extra_mode", "table", params), torque=TORQUE)
    (found,) = diagnose(light, window=0.1).findings
    assert found.effect == "extra_mode"
    assert found.params["frequency"] == pytest.approx(60.0, rel=0.01)
    assert found.params["mass_ratio"] == pytest.approx(0.004, rel=0.2)


def test_far_from_noise_an_effect_may_be_significant_only_when_it_is_fitted_in_full() -> None:
    hardening = Effect("stiffness_hardening", "shaft", {"coefficient": 1e5})
    cut = windows.cut(record(hardening, torque=TORQUE), WINDOW)
    state = State.along(Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE)))
    assert state.scale > NEARLY_RIGHT
    found = Found(Hardening(), np.array([1e3]), ())
    no_gain = Trial(found, state.errors, state.errors, cut.held_out)
    better = selection._best(state, [no_gain], lambda _: None)
    assert better is not None
    assert better.fit.found[0].sizes == pytest.approx([1e5], rel=1e-3)


@pytest.mark.parametrize(
    ("found", "left", "significant_"),
    [
        (Found(Hardening(), np.array([1.0]), ()), 0.05, True),
        (Found(Hardening(), np.array([1.0]), ()), 0.2, False),
        (Found(ExtraMode(TABLE), np.array([0.1]), (30.0, 0.1)), 0.0005, True),
        (Found(ExtraMode(TABLE), np.array([0.1]), (30.0, 0.1)), 0.05, False),
    ],
)
def test_the_more_numbers_the_more_of_a_lone_window_they_have_to_explain(
    found: Found, left: float, significant_: bool
) -> None:
    """Held-out windows know nothing of a first transient."""
    cut = windows.cut(record(torque=TORQUE[:8000]), WINDOW)
    state = State.along(Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE)))
    samples = float(state.samples)
    first = np.arange(cut.count) == 0
    before, after = (samples * (1.0 + 300.0 * part * first) for part in (1.0, left))
    trial = Trial(found, before, after, cut.held_out)
    assert trials.significant(trial, state) == significant_


@pytest.mark.parametrize("explained", [True, False])
def test_what_a_mode_leaves_unexplained_is_looked_for_without_one(
    monkeypatch: pytest.MonkeyPatch, explained: bool
) -> None:
    """Far off, a mode may come nearest to anything at first."""
    cut = windows.cut(
        record(Effect("torque_offset", "motor", {"torque": 1e-3}), torque=TORQUE), WINDOW
    )
    base = State.along(Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE)))
    mode = Found(ExtraMode(TABLE), np.array([0.5]), (30.0, 0.1))
    false = State(replace(base.fit, found=(mode,)), base.motion)
    true = State.along(replace(base.fit, found=(Found(Offset(MOTOR), np.zeros(1), ()),)))
    assert false.scale > base.scale > true.scale
    asked = []

    def extended(states: list[State], *_: object, modes: bool = True) -> selection.Search:
        asked.append(modes)
        return selection.Search((states[0], false if modes and not explained else true), ((), ()))

    monkeypatch.setattr(search, "extended", extended)
    found = search._searched([base], lambda _: None)
    assert found.states[-1].fit.found[0].kind == Offset(MOTOR)
    assert asked == ([True] if explained else [True, False])


@pytest.mark.parametrize("there", [True, False])
def test_only_what_held_out_windows_do_as_well_without_is_dropped(
    monkeypatch: pytest.MonkeyPatch, there: bool
) -> None:
    """Though what it does in them be little against what it does in one that is fitted."""
    effects = [Effect("torque_offset", "motor", {"torque": 1e-3})]
    if there:
        effects.append(Effect("stiffness_hardening", "shaft", {"coefficient": 1e4}))
    cut = windows.cut(record(*effects, torque=TORQUE), WINDOW)
    fit = Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE))
    kinds = (Found(Hardening(), np.array([1e4]), ()), Found(Offset(MOTOR), np.array([1e-3]), ()))
    chain = [State.along(replace(fit, found=kinds[:k])) for k in range(3)]
    monkeypatch.setattr(selection, "_best", lambda *_: None)
    monkeypatch.setattr(selection, "significant", lambda *_: False)
    revised = selection._revised(selection.Search(tuple(chain), ((), (), ())), lambda _: None)
    if there:
        assert revised is None
    else:
        assert revised is not None
        assert [one.kind for one in revised.states[-1].fit.found] == [Offset(MOTOR)]


def test_windows_in_which_effects_cannot_be_simulated_are_too_long(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """As those of an axis are that rattles in its play: what it will do is soon anybody's guess."""
    gap = Effect("backlash", "shaft", {"gap": 1e-3})
    cut = windows.cut(record(gap, torque=shake(8_000)), WINDOW / 5.0)
    found = Found(Backlash(), np.array([]), (1e-3,))
    fit = Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE))
    short = State.of(replace(fit, found=(found,)))
    assert short.replay is not None
    searched = selection.Search((State.along(fit), short), ((), ()))
    monkeypatch.setattr(selection, "addable", lambda _: [])
    longer = search._lengthened(searched, 2, lambda _: None)
    assert longer.states[-1].fit.windows.length == 2 * cut.length
    monkeypatch.setattr(State, "replayed", lambda self, _=None: self)
    assert search._lengthened(searched, 2, lambda _: None) is searched


def test_a_light_mode_is_looked_for_where_what_is_left_has_a_colour() -> None:
    params = {"frequency": 100.0, "damping_ratio": 0.02, "mass_ratio": 2.5e-4}
    cut = windows.cut(record(Effect("extra_mode", "table", params), torque=TORQUE), WINDOW)
    state = State.along(Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, NOISE)))
    assert state.scale < RIGHT
    mode = Found(ExtraMode(TABLE), np.array([1e-3]), (50.0, 0.02))
    no_gain = Trial(mode, state.errors, state.errors, cut.held_out)
    better = selection._best(state, [no_gain], lambda _: None)
    assert better is not None
    assert better.fit.found[0].params["frequency"] == pytest.approx(100.0, rel=0.01)


def test_where_no_more_than_noise_is_left_no_mode_is_found_be_it_of_what_colour() -> None:
    params = {"frequency": 100.0, "damping_ratio": 0.02, "mass_ratio": 2.5e-4}
    cut = windows.cut(record(Effect("extra_mode", "table", params), torque=TORQUE), WINDOW)
    state = State.along(Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, 1.05 * NOISE)))
    assert state.scale == 1.0
    assert state.coloured
    mode = Found(ExtraMode(TABLE), np.array([1e-3]), (50.0, 0.02))
    no_gain = Trial(mode, state.errors, state.errors, cut.held_out)
    assert selection._best(state, [no_gain], lambda _: None) is None


def test_the_rounding_of_an_encoder_is_noise_be_it_of_what_colour() -> None:
    """A slow axis takes many samples from step to step, which leaves errors of low frequency; what
    else there was could not be named for them."""
    counts = 400.0
    step = 2.0 * np.pi / counts
    hard = record(Effect("stiffness_hardening", "shaft", {"coefficient": 1e5}), torque=TORQUE)
    assert hard.theta2 is not None
    coarse = replace(hard, theta2=step * np.round(hard.theta2 / step))
    cut = windows.cut(coarse, WINDOW)
    assert cut.steps[1] == pytest.approx(step)
    fit = Fit(cut, "zoh", TwoInertias(AXIS)).hearing(cut.angles - windows.cut(hard, WINDOW).angles)
    assert fit.noise is not None
    assert fit.noise[1] == pytest.approx(step / np.sqrt(12.0), rel=1e-3)


def test_the_noise_is_heard_again_once_the_axis_is_understood() -> None:
    """In the errors of an axis that is far off there may be more than noise at all frequencies."""
    friction = Effect("friction_coulomb", "table", {"torque": 0.01})
    cut = windows.cut(record(friction, torque=TORQUE), WINDOW)
    fit = Fit(cut, "zoh", TwoInertias(AXIS), noise=np.full(2, 1.2 * NOISE))
    found = search.look([State(fit, fit.motion(None))], cut, lambda _: None)
    assert [one.kind.effect for one in found.states[-1].fit.found] == ["friction_coulomb"]
    for state in found.states:
        assert state.fit.noise == pytest.approx(NOISE, rel=0.05)
