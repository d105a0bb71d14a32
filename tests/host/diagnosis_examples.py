"""Diagnoses of a known axis, to test how they are told: the numbers are the truth with noise."""

from __future__ import annotations

import functools
from dataclasses import astuple, replace

import numpy as np

from axistwin import core
from axistwin.core import Array, Axis, Effect
from axistwin.diagnose.result import (
    Autocorrelation,
    Considered,
    Contribution,
    Diagnosis,
    ErrorSummary,
    Evidence,
    Finding,
    Residual,
    Shown,
    Signals,
    Track,
)
from axistwin.identify.result import Quantity, quantity
from axistwin.model import Model
from axistwin.record import Record

AXIS = Axis(1e-3, 5e-4, 5e-3, 20.0)
FRICTION = Effect("friction_coulomb", "table", {"torque": 0.03})
RIPPLE = Effect("torque_ripple", "motor", {"amplitude": 0.01, "periods": 12.0, "phase": 0.7})
MODEL = Model(AXIS, (FRICTION, RIPPLE))

STEP, WINDOWS, LENGTH = 1e-3, 40, 500
NOISE = 2e-5
_SAMPLES = WINDOWS * LENGTH


@functools.cache
def found() -> Diagnosis:
    """Dry friction and ripple are named, and nothing is left."""
    time, torque = _time(), _torque()
    motion = core.simulate_effects(AXIS, MODEL.effects, STEP, torque, substeps=4)
    random = np.random.default_rng(3)
    measured = [
        angle + NOISE * random.standard_normal(len(time))
        for angle in (motion.theta1, motion.theta2)
    ]
    record = Record(time, torque, measured[0], STEP, measured[1], source="axis <1> & co.csv")
    ideal = _simulated_anew(motion, torque)
    shown = (
        _shown("theta1", measured[0], ideal[0], motion.theta1),
        _shown("theta2", measured[1], ideal[1], motion.theta2),
    )
    return Diagnosis(
        record=record,
        base=_axis(1.06),
        base_valid=True,
        axis=_axis(1.0),
        findings=(
            Finding(
                "friction_coulomb", "table", {"torque": 0.03002}, {"torque": (0.0296, 0.0304)}, 0.86
            ),
            Finding(
                "torque_ripple",
                "motor",
                {"amplitude": 0.0101, "periods": 12.0, "phase": 0.69},
                {"amplitude": (0.0098, 0.0104), "periods": (12.0, 12.0), "phase": (0.66, 0.72)},
                0.138,
            ),
        ),
        considered=(
            Considered("backlash", "shaft", 0.0004, "no"),
            Considered("friction_stribeck", "table", 0.0009, "no"),
            Considered("delay", "torque", 0.002, "look-alike of friction_viscous at motor"),
        ),
        unexplained=False,
        error=ErrorSummary("held-out rms simulation error of theta1", "rad", 1.3e-3, 2.1e-5, NOISE),
        model=MODEL,
        hold="zoh",
        window=STEP * LENGTH,
        evidence=_evidence(motion, torque, shown),
        warnings=("one line that has to be known",),
    )


def healthy() -> Diagnosis:
    """Nothing is wrong."""
    error = replace(found().error, base=2.02e-5, extended=2.02e-5)
    return replace(_unnamed(), error=error)


def unknown() -> Diagnosis:
    """Something is wrong that is not in the catalogue."""
    nothing = _unnamed()
    error = replace(nothing.error, extended=nothing.error.base)
    return replace(nothing, unexplained=True, error=error)


def one_encoder() -> Diagnosis:
    """The same with the motor encoder alone, where ripple is all that is named."""
    full = found()
    evidence = full.evidence
    signals = replace(evidence.signals, theta2=None, omega2=None, twist=None)
    return replace(
        full,
        record=replace(full.record, theta2=None),
        base={"I": full.base["I1"]},
        axis={"I": full.axis["I1"]},
        findings=full.findings[1:],
        evidence=replace(
            evidence,
            signals=signals,
            residuals={"motor": evidence.residuals["motor"]},
            contributions=evidence.contributions[1:],
            shown=evidence.shown[:1],
            whiteness=evidence.whiteness[:1],
            tracks=(),
        ),
    )


def _unnamed() -> Diagnosis:
    full = found()
    evidence = replace(full.evidence, contributions=())
    return replace(full, findings=(), model=Model(AXIS), evidence=evidence)


def _shown(name: str, measured: Array, before: Array, after: Array) -> Shown:
    def windows(values: Array) -> Array:
        return values.reshape(WINDOWS, LENGTH)

    return Shown(
        name,
        windows(_time()),
        windows(measured),
        windows(before),
        windows(after),
        np.arange(WINDOWS) % 3 == 2,
    )


def _time() -> Array:
    return STEP * np.arange(WINDOWS * LENGTH, dtype=np.float64)


def _torque() -> Array:
    time = _time()
    return 0.12 * np.sin(2.7 * time) + 0.06 * np.sin(45.0 * time + 1.0)


def _simulated_anew(motion: core.Motion, torque: Array) -> tuple[Array, Array]:
    """The ideal axis from the state at the start of each window."""
    columns = np.stack([motion.twist, motion.twist_speed, motion.omega1, motion.theta1], axis=1)
    parts = [
        core.simulate_effects(
            AXIS,
            (),
            STEP,
            torque[start : start + LENGTH],
            core.State(*columns[start].tolist()),
            substeps=4,
        )
        for start in range(0, len(torque), LENGTH)
    ]
    return (
        np.concatenate([part.theta1 for part in parts]),
        np.concatenate([part.theta2 for part in parts]),
    )


def _evidence(motion: core.Motion, torque: Array, shown: tuple[Shown, ...]) -> Evidence:
    """Equation 18 along the motion, with some noise, and what the effects have of it."""
    random = np.random.default_rng(4)
    shaft = AXIS.B * motion.twist_speed + AXIS.K * motion.twist
    accelerations = [np.gradient(speed, STEP) for speed in (motion.omega1, motion.omega2)]
    noise = 0.003 * random.standard_normal((2, len(torque)))
    lacking = {
        "motor": AXIS.I1 * accelerations[0] + shaft - torque + noise[0],
        "table": AXIS.I2 * accelerations[1] - shaft + noise[1],
    }
    wave = RIPPLE.params
    own = (
        Contribution("table", -FRICTION.params["torque"] * np.sign(motion.omega2)),
        Contribution(
            "motor",
            wave["amplitude"] * np.sin(wave["periods"] * motion.theta1 + wave["phase"]),
        ),
    )
    lag = STEP * np.arange(60, dtype=np.float64)
    before = np.exp(-lag / 0.04) * np.cos(60.0 * lag)
    after = np.where(lag == 0.0, 1.0, 0.01 * random.standard_normal(len(lag)))
    return Evidence(
        Signals(
            _time(),
            torque,
            motion.theta1,
            motion.omega1,
            motion.theta2,
            motion.omega2,
            motion.twist,
        ),
        {one.place: Residual(lacking[one.place], lacking[one.place] - one.values) for one in own},
        own,
        shown,
        tuple(Autocorrelation(name, lag, before, after, 0.024) for name in ("theta1", "theta2")),
        tuple(
            Track(
                name,
                item.unit,
                np.linspace(1.0, 19.0, 10),
                item.value * (1.0 + 0.01 * random.standard_normal(10)),
                np.full(10, 0.01 * item.value),
            )
            for name, item in _axis(1.0).items()
        ),
    )


def _axis(factor: float) -> dict[str, Quantity]:
    """The parameters of the axis, off by a factor."""
    return {
        name: quantity(name, factor * value, 0.01 * value, 2.0, linear=False)
        for name, value in zip(("I1", "I2", "B", "K"), astuple(AXIS), strict=True)
    }
