"""The simulator that hides effects against closed forms, scipy, and the C core for each effect."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import scipy.integrate
import scipy.signal
from catalogue import DRAWERS, UNKNOWN, Hidden, Probe
from truth import STATES, Array, Friction, Run, Truth, simulate

from axistwin.core import Axis, Effect
from axistwin.model import Model

#: 95 Hz, 0.3 rad a sample.
AXIS = (2.7e-5, 8.3e-6, 2e-4, 2.3)
STEP = 5e-4
N = 2000


def torque(seed: int) -> Array:
    """A slow swing of some turns and a random binary signal (N,) [N m]."""
    rng = np.random.default_rng(seed)
    t = STEP * np.arange(N)
    swing = 0.02 * np.cos(2 * np.pi * rng.uniform(1.0, 2.0) * t)
    return np.asarray(swing + 0.02 * rng.choice([-1.0, 1.0], N // 4).repeat(4), np.float64)


def axis(hidden: Sequence[Hidden] = ()) -> Truth:
    truth = Truth(*AXIS)
    for effect in hidden:
        truth = effect.into(truth)
    return truth


def probe(run: Run) -> Probe:
    speed, twist = run.states[:, 2], run.states[:, 0] - run.states[:, 1]
    return Probe(
        Truth(*AXIS),
        STEP,
        N * STEP,
        float(np.std(run.command)),
        float(np.max(np.abs(run.command))),
        float(np.std(speed)),
        float(np.max(np.abs(speed))),
        float(np.std(twist)),
        (1e-5, 1e-5),
    )


KNOWN = [name for name in DRAWERS if name not in UNKNOWN]

# The core's rule is of second order in its step, of which there are this many a sample.
SUBSTEPS = 64
SHARE = 4e-3

# An axis in play bounces, and any difference doubles with every bounce.
HORIZON = {"backlash": 300}


@pytest.mark.parametrize("name", KNOWN)
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_c_core_makes_the_same_of_an_effect(name: str, seed: int) -> None:
    """To a share of what the effect changes."""
    rng = np.random.default_rng(seed)
    u = torque(seed)
    ideal = simulate(axis(), STEP, u)
    draft = DRAWERS[name](rng, probe(ideal))
    hidden = [draft.at(0.3 * draft.most)]
    if name == "friction_drift":
        hidden.append(Hidden("friction_coulomb", draft.location, {"torque": 0.005}))
    found = simulate(axis(hidden), STEP, u).readings
    effects = tuple(Effect(h.effect, h.location, h.params) for h in hidden)
    core = Model(Axis(*AXIS), effects).simulate(u, STEP, substeps=SUBSTEPS)
    until = HORIZON.get(name, N)
    change = np.max(np.abs(found - ideal.readings)[:until])
    assert change > 1e-4
    assert np.max(np.abs(found - np.column_stack(core))[:until]) < SHARE * change


def test_an_ideal_axis_is_the_matrix_exponential() -> None:
    I1, I2, B, K = AXIS
    per = np.diag([1 / I1, 1 / I2])
    shaft = np.array([[1.0, -1.0], [-1.0, 1.0]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-per @ shaft * K, -per @ shaft * B]])
    b = np.array([[0.0], [0.0], [1 / I1], [0.0]])
    held = scipy.signal.cont2discrete((A, b, np.eye(4), np.zeros((4, 1))), STEP, "zoh")
    expected = scipy.signal.dlsim(held, torque(1))[2]
    found = simulate(axis(), STEP, torque(1)).states[:, :4]
    assert np.max(np.abs(found - expected)[:, :2]) < 1e-8
    assert np.max(np.abs(found - expected)[:, 2:]) < 1e-6


def test_what_sticks_does_not_move_at_all() -> None:
    """A torque below the motor's limit moves neither end by the last bit."""
    both = Friction(coulomb=0.05), Friction(coulomb=0.01)
    truth = axis()._replace(friction1=both[0], friction2=both[1])
    assert not np.any(simulate(truth, STEP, np.full(N, 0.049)).states)
    assert np.any(simulate(truth, STEP, np.full(N, 0.051)).states)


def test_coulomb_friction_stops_a_rigid_axis_after_the_closed_form() -> None:
    """From w the way to rest is J w^2 / 2F, and there it stays."""
    start = np.zeros(STATES)
    start[2:4] = 20.0
    stiff = Truth(2.7e-5, 8.3e-6, 1e-2, 400.0, friction2=Friction(coulomb=0.01))
    rest = simulate(stiff, STEP, np.zeros(N), start=start).states[-1]
    assert rest[0] == pytest.approx(3.53e-5 * 20.0**2 / (2 * 0.01), rel=1e-3)
    assert rest[3] == 0.0


def energy(p: Truth, y: Array) -> Array:
    twist = y[:, 0] - y[:, 1]
    z = np.sign(twist) * np.maximum(np.abs(twist) - p.gap / 2, 0.0)
    mass = p.mode_mass * p.I2
    return np.asarray(
        0.5 * (p.I1 * y[:, 2] ** 2 + p.I2 * y[:, 3] ** 2 + mass * y[:, 5] ** 2)
        + 0.5 * p.K * z**2
        + 0.25 * p.hardening * z**4
        + 0.5 * mass * p.mode_frequency**2 * (y[:, 1] - y[:, 4]) ** 2
        + 0.5 * p.hysteresis * y[:, 8] ** 2
    )


@pytest.mark.parametrize(
    "kept", [{"hardening": 1e3}, {"gap": 0.01}, {"mode_mass": 0.3, "mode_frequency": 300.0}]
)
def test_without_damping_energy_is_kept(kept: dict[str, Any]) -> None:
    truth = axis()._replace(B=0.0, **kept)
    start = np.zeros(STATES)
    start[[0, 2, 3]] = 0.02, 10.0, -5.0
    start[5] = start[3]
    energies = energy(truth, simulate(truth, STEP, np.zeros(N), start=start).states)
    assert np.max(np.abs(energies / energies[0] - 1.0)) < 1e-7


def smooth(p: Truth) -> Callable[[float, Array, float], list[float]]:
    """The equations for the truths that are no part of the catalogue, as scipy wants them."""

    def rates(_t: float, y: Array, u: float) -> list[float]:
        q1, q2, w1, w2, z, h = y
        f = p.friction2
        shaft = p.K * (q1 - q2) + p.B * (w1 - w2) + p.hysteresis * h
        bend, table = 0.0, f.square * w2 * abs(w2)
        if f.bristles:
            level = f.coulomb + f.stribeck * np.exp(-((w2 / f.stribeck_speed) ** 2))
            bend = w2 - f.bristles * abs(w2) / level * z
            table += f.bristles * z + f.bristle_damping * bend
        motor = u * (1.0 - p.torque_fall * u * u) - shaft
        slip = (w1 - w2) - abs(w1 - w2) * h / p.hysteresis_reach
        return [w1, w2, motor / p.I1, (shaft - table) / p.I2, bend, slip if p.hysteresis else 0.0]

    return rates


@pytest.mark.parametrize(
    "truth",
    [
        axis()._replace(
            friction2=Friction(
                0.01, stribeck=0.005, stribeck_speed=2.0, bristles=5.0, bristle_damping=1e-3
            )
        ),
        axis()._replace(friction2=Friction(square=1e-6)),
        axis()._replace(hysteresis=0.5, hysteresis_reach=3e-3),
        axis()._replace(torque_fall=100.0),
    ],
    ids=["LuGre", "square drag", "hysteresis", "torque that falls"],
)
def test_what_is_not_in_the_catalogue_is_what_scipy_says(truth: Truth) -> None:
    u = torque(4)[:400]
    found = simulate(truth, STEP, u).states
    state = np.zeros(6)
    rates = smooth(truth)
    for k in range(len(u) - 1):
        result: Any = scipy.integrate.solve_ivp(
            rates, (0.0, STEP), state, method="DOP853", rtol=1e-9, atol=1e-12, args=(u[k],)
        )
        state = result.y[:, -1]
        assert np.max(np.abs(found[k + 1, :2] - state[:2])) < 1e-7


def test_friction_of_an_uneven_guide_is_that_of_the_place() -> None:
    """A slow pull through a turn: the table's friction is what the shaft's twist says."""
    truth = Truth(2.7e-5, 8.3e-6, 5e-3, 400.0, friction2=Friction(0.01, uneven=0.5, periods=2.0))
    start = np.zeros(STATES)
    start[2:4] = 6.3
    level = 0.01 * (1.0 + 0.5 * np.sin(2.0 * 6.3 * STEP * np.arange(N)))
    states = simulate(truth, STEP, level, start=start).states
    turn = slice(50, 1500)  # once the first jolt has decayed
    assert np.ptp(states[turn, 1]) > 4.0
    assert np.min(states[turn, 3]) > 0.0
    accelerating = np.gradient(states[:, 3], STEP) * truth.I2
    dragged = truth.K * (states[:, 0] - states[:, 1]) + truth.B * (states[:, 2] - states[:, 3])
    expected = 0.01 * (1.0 + 0.5 * np.sin(2.0 * states[:, 1]))
    assert np.max(np.abs(dragged - accelerating - expected)[turn]) < 2e-4


def shaft(p: Truth, y: Array, contact: int) -> float:
    twist = y[0] - y[1] - contact * p.gap / 2
    return float(p.K * twist + p.B * (y[2] - y[3])) if contact else 0.0


class Way:
    """One way to move, with play in the shaft and friction at the table, and what ends it."""

    def __init__(self, p: Truth, slide: int, contact: int) -> None:
        self.p, self.slide, self.contact = p, slide, contact

    def rates(self, _t: float, y: Array, u: float) -> list[float]:
        through = shaft(self.p, y, self.contact)
        table = (through - self.slide * self.p.friction2.coulomb) / self.p.I2
        return [y[2], y[3], (u - through) / self.p.I1, table if self.slide else 0.0]

    def events(self) -> list[Any]:
        def rest(_t: float, y: Array, _u: float) -> float:
            if self.slide:
                return float(self.slide * y[3])
            return self.p.friction2.coulomb - abs(shaft(self.p, y, self.contact))

        def flank(_t: float, y: Array, _u: float) -> float:
            twist = float(y[0] - y[1])
            inside = self.p.gap / 2 - abs(twist)
            return self.contact * twist - self.p.gap / 2 if self.contact else inside

        events: list[Any] = [rest, flank]
        for event in events:
            event.terminal, event.direction = True, -1
        return events


def test_sticking_and_play_are_what_scipy_finds_with_events() -> None:
    """The way of moving is chosen here once more, from the state, whenever an event stops scipy."""
    p = axis()._replace(gap=4e-3, friction2=Friction(coulomb=0.008))
    u = torque(5)[:400]
    found = simulate(p, STEP, u).states[:, :4]
    state, slide, contact = np.zeros(4), 0, 0
    stops = contacts = 0
    for k in range(len(u) - 1):
        t = 0.0
        while t < STEP:
            if slide == 0 and abs(shaft(p, state, contact)) > p.friction2.coulomb:
                slide = int(np.sign(shaft(p, state, contact)))
            way = Way(p, slide, contact)
            result: Any = scipy.integrate.solve_ivp(
                way.rates,
                (t, STEP),
                state,
                method="DOP853",
                rtol=1e-10,
                atol=1e-13,
                max_step=STEP / 8,
                events=way.events(),
                args=(u[k],),
            )
            t, state = float(result.t[-1]), result.y[:, -1]
            rested, met = (len(times) > 0 for times in result.t_events)
            if met:
                side = int(np.sign(state[0] - state[1]))
                contact = 0 if contact else side
                state[0] += side * (1e-14 if contact else -1e-14)  # beyond the flank
                contacts += abs(contact)
            if rested:
                state[3] = 0.0 if slide else state[3]
                stops += abs(slide)
                slide = 0 if slide else int(np.sign(shaft(p, state, contact)))
        assert np.max(np.abs(found[k + 1, :2] - state[:2])) < 1e-6
    assert stops > 1
    assert contacts > 3
