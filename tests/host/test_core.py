"""The C core called from Python, against closed forms and scipy."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
import pytest
import scipy.signal
from hypothesis import given
from hypothesis import strategies as st

from axistwin import core
from axistwin.errors import InputError, NotEnoughDataError

PAPER = core.paper_axis()
WN = core.modal(PAPER).wn
SETTINGS = [(512, 10), (2048, 146)]
PRECISIONS: list[core.Precision] = ["float32", "float64"]

inertias = st.floats(1e-6, 1e-2)
axes = st.builds(core.Axis, inertias, inertias, st.floats(0.0, 1e-2), st.floats(1.0, 1e4))


def state_space(axis: core.Axis) -> tuple[npt.NDArray[np.float64], npt.NDArray[np.float64]]:
    """A and B of Eq. 3 for the state theta1, theta2, omega1, omega2."""
    A = np.array(
        [
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
            [-axis.K / axis.I1, axis.K / axis.I1, -axis.B / axis.I1, axis.B / axis.I1],
            [axis.K / axis.I2, -axis.K / axis.I2, axis.B / axis.I2, -axis.B / axis.I2],
        ]
    )
    return A, np.array([[0.0], [0.0], [1.0 / axis.I1], [0.0]])


def excitation(N: int, k: int, periods: int = 1) -> npt.NDArray[np.float64]:
    return np.tile(core.schroeder(N, 2 * k, 0.2), periods)


@given(axes)
def test_modal_values_are_the_eigenvalues_of_the_equation_of_motion(axis: core.Axis) -> None:
    found = core.modal(axis)
    eigenvalues = np.linalg.eigvals(state_space(axis)[0])
    scale = np.max(np.abs(eigenvalues))
    # two of the four belong to the rigid body and are zero, to the square root of the rounding
    pair = sorted(eigenvalues, key=abs)[2:]
    if found.zeta < 1.0:
        assert found.wn == pytest.approx(abs(pair[0]), abs=1e-6 * scale)
        assert found.wd == pytest.approx(abs(pair[0].imag), abs=1e-6 * scale)
        assert found.zeta * found.wn == pytest.approx(-pair[0].real, abs=1e-6 * scale)
    else:
        assert found.wn**2 == pytest.approx((pair[0] * pair[1]).real, rel=1e-3)


@given(axes)
def test_an_axis_comes_back_from_its_modal_values(axis: core.Axis) -> None:
    modal = core.modal(axis)
    found = core.axis_from_modal(axis.I1, axis.I2, modal.wn, modal.zeta)
    assert pytest.approx(axis.K, rel=1e-12) == found.K
    assert pytest.approx(axis.B, rel=1e-12, abs=1e-18) == found.B


@pytest.mark.parametrize(("N", "k", "printed"), [(512, 10, 2.9481e-5), (2048, 146, 1.0761e-4)])
def test_the_time_step_is_the_papers(N: int, k: int, printed: float) -> None:
    assert core.time_step(N, k, WN) == pytest.approx(printed, abs=5e-9)


@pytest.mark.parametrize(("N", "k"), SETTINGS)
def test_the_plant_is_the_trapezoidal_rule(N: int, k: int) -> None:
    """Newmark with 1/4, 1/2 is the bilinear transform: scipy's discretisation of Eq. 3."""
    dt = core.time_step(N, k, WN)
    torque = np.concatenate([[0.0], excitation(N, k, 3)])
    A, B = state_space(PAPER)
    reference = scipy.signal.cont2discrete((A, B, np.eye(4), np.zeros((4, 1))), dt, "bilinear")
    # scipy's own output equation gives the trapezoidal state for the torque at the same instant
    _, expected, _ = scipy.signal.dlsim(reference, torque)
    motion = core.simulate(PAPER, dt, torque)
    found = np.column_stack([motion.theta1, motion.theta2, motion.omega1, motion.omega2])
    assert found == pytest.approx(expected, abs=1e-9 * np.max(np.abs(expected)))
    twist = expected[:, 0] - expected[:, 1]
    assert motion.twist == pytest.approx(twist, abs=1e-8 * np.max(np.abs(twist)))


@pytest.mark.parametrize(("method", "scipy_method"), [("exact_held", "zoh"), ("exact", "foh")])
@pytest.mark.parametrize("angle", [0.0, 1e3])
def test_the_exact_integrators_are_exact(
    method: core.Method, scipy_method: Literal["zoh", "foh"], angle: float
) -> None:
    """From any state, however many turns away, for a torque held or linear between samples."""
    dt = core.time_step(*SETTINGS[1], WN)
    state = core.State(twist=1e-3, twist_speed=-2.0, speed=30.0, angle=angle)
    start = np.array([angle, angle - 1e-3, 30.0, 32.0])
    torque = excitation(*SETTINGS[1], 1)
    A, B = state_space(PAPER)
    response, held, _, feedthrough, _ = scipy.signal.cont2discrete(
        (A, B, np.eye(4), np.zeros((4, 1))), dt, scipy_method
    )
    # scipy's first-order hold takes the torque at both ends of the step into its own state
    x, expected = start - feedthrough[:, 0] * torque[0], []
    for sample in torque:
        expected.append(x + feedthrough[:, 0] * sample)
        x = response @ x + held[:, 0] * sample
    motion = core.integrate(method, PAPER, dt, torque, state)
    found = np.column_stack([motion.theta1, motion.theta2, motion.omega1, motion.omega2])
    assert found == pytest.approx(np.array(expected), abs=1e-9 * (1.0 + angle))


@given(axes, st.integers(0, 2**32 - 1))
def test_momentum_is_the_integral_of_the_torque(axis: core.Axis, seed: int) -> None:
    dt = 0.1 / core.modal(axis).wn
    torque = np.random.default_rng(seed).normal(size=200)
    motion = core.simulate(axis, dt, torque)
    momentum = axis.I1 * motion.omega1 + axis.I2 * motion.omega2
    impulse = np.concatenate([[0.0], np.cumsum((torque[1:] + torque[:-1]) * dt / 2.0)])
    assert momentum == pytest.approx(impulse, abs=1e-12 * np.sum(np.abs(torque)) * dt)


@given(
    st.builds(
        core.State,
        twist=st.floats(-1.0, 1.0),
        twist_speed=st.floats(-1e3, 1e3),
        speed=st.floats(-1e3, 1e3),
        angle=st.floats(-1e6, 1e6),
    )
)
def test_a_simulation_starts_in_the_state_that_was_given(state: core.State) -> None:
    dt, torque = 1e-4, 0.1
    motion = core.simulate(PAPER, dt, [torque, 0.2], state)
    # the plant keeps the twist one step ahead: to the rounding of what moves in a step
    moved = abs(state.twist) + dt * abs(state.twist_speed) + dt**2 * torque / PAPER.I1
    assert motion.twist[0] == pytest.approx(state.twist, abs=1e-14 * moved)
    assert motion.twist_speed[0] == pytest.approx(state.twist_speed, abs=1e-14 * moved / dt)
    assert motion.omega1[0] == pytest.approx(state.speed, rel=1e-9, abs=1e-9)
    assert motion.theta1[0] == pytest.approx(state.angle, rel=1e-12, abs=1e-9)
    assert motion.theta2[0] == pytest.approx(state.angle - state.twist, rel=1e-12, abs=1e-9)


@pytest.mark.parametrize(("N", "k"), SETTINGS)
def test_single_precision_agrees_with_double(N: int, k: int) -> None:
    dt, torque = core.time_step(N, k, WN), excitation(N, k, 10)
    single = core.simulate(PAPER, dt, torque, precision="float32")
    double = core.simulate(PAPER, dt, torque.astype(np.float32))
    rms = np.sqrt(np.mean(double.twist**2))
    assert np.max(np.abs(single.twist - double.twist)) < 1e-5 * rms
    assert np.max(np.abs(single.theta1 - double.theta1)) < 1e-6 * np.ptp(double.theta1)


@pytest.mark.parametrize("precision", PRECISIONS)
@pytest.mark.parametrize("counts_per_turn", [(1 << 20, 10_000), (1, 1 << 24)])
def test_encoders_read_the_nearest_count_modulo_32_bits(
    precision: core.Precision, counts_per_turn: tuple[int, int]
) -> None:
    turns = np.array([0.0, 0.25, -0.3, 5.125, -1000.7, 2049.49, -4321.01])
    states = [core.State(angle=2.0 * np.pi * turn, twist=0.01) for turn in turns]
    motion = core.motion(states, precision)
    counts = core.read_encoders(motion, counts_per_turn)
    for column, angle in enumerate((motion.theta1, motion.theta2)):
        exact = angle / (2.0 * np.pi) * counts_per_turn[column]
        difference = counts[:, column].astype(np.int64) - exact
        wrapped = (difference + 2**31) % 2**32 - 2**31
        assert np.max(np.abs(wrapped)) <= 0.5 + 1e-3 * (precision == "float32")


@pytest.mark.parametrize("form", ["3x2", "5x4"])
@pytest.mark.parametrize(("N", "k"), SETTINGS)
@pytest.mark.parametrize(("precision", "tolerance"), [("float64", 1e-11), ("float32", 1e-6)])
def test_the_axis_is_identified_exactly_from_noise_free_motion(
    precision: core.Precision, tolerance: float, N: int, k: int, form: core.Form
) -> None:
    """1e-9 % in double and 1e-4 % in single precision, with what is expected a factor off."""
    dt, torque = core.time_step(N, k, WN), excitation(N, k, 5)
    motion = core.simulate(PAPER, dt, torque, precision=precision)
    expected = core.Axis(5e-5, 5e-6, 1e-3, 200.0)
    settings = core.IdentSettings(dt, expected, 0.2, form=form)
    found = core.identify_motion(settings, motion, torque).last
    assert found.valid == (True, True, True, True)
    for name in ("I1", "I2", "B", "K"):
        assert getattr(found.axis, name) == pytest.approx(getattr(PAPER, name), rel=tolerance)
    assert found.modal.wn == pytest.approx(WN, rel=tolerance)


def test_nothing_is_learned_across_a_gap() -> None:
    dt, torque = core.time_step(512, 10, WN), excitation(512, 10, 5)
    motion = core.simulate(PAPER, dt, torque)
    kept = np.delete(np.arange(len(torque)), np.arange(700, 900))
    cut = core.Motion(motion.precision, motion.samples[kept])
    settings = core.IdentSettings(dt, PAPER, 0.2)
    whole = core.identify_motion(settings, cut, torque[kept], gaps=[700]).last
    assert pytest.approx(PAPER.K, rel=1e-11) == whole.axis.K
    blind = core.identify_motion(settings, cut, torque[kept]).last
    assert pytest.approx(PAPER.K, rel=1e-6) != blind.axis.K


def test_estimates_are_collected_on_the_way() -> None:
    dt, torque = core.time_step(512, 10, WN), excitation(512, 10, 2)
    motion = core.simulate(PAPER, dt, torque)
    run = core.identify_motion(core.IdentSettings(dt, PAPER, 0.2), motion, torque, every=100)
    assert run.sample.tolist() == [*range(100, 1024, 100), 1024]
    assert run.axis.shape == (11, 4)
    assert run.modal.shape == (11, 3)
    assert run.axis[-1, 3] == run.last.axis.K
    assert run.rejected == 0


def test_counts_may_wrap_around() -> None:
    dt, torque = core.time_step(512, 10, WN), excitation(512, 10, 5)
    motion = core.simulate(PAPER, dt, torque)
    resolution = (1 << 20, 1 << 20)
    counts = core.read_encoders(motion, resolution).astype(np.int64)
    settings = core.IdentSettings(dt, PAPER, 0.2)
    plain = core.identify_counts(settings, counts, resolution, torque).last
    wrapped = core.identify_counts(settings, counts + 2**31 - 50, resolution, torque).last
    assert wrapped.axis == plain.axis
    assert pytest.approx(PAPER.K, rel=1e-3) == plain.axis.K


def test_an_estimate_without_excitation_is_not_valid() -> None:
    settings = core.IdentSettings(1e-4, PAPER, 0.2)
    still = core.simulate(PAPER, 1e-4, np.zeros(1000))
    found = core.identify_motion(settings, still, np.zeros(1000)).last
    assert found.valid == (False, False, False, False)
    assert np.all(np.isfinite([found.axis.I1, found.axis.K, found.modal.wn]))


@pytest.mark.parametrize("precision", PRECISIONS)
@given(data=st.data())
def test_a_multisine_has_the_lines_and_the_rms_that_were_asked_for(
    precision: core.Precision, data: st.DataObject
) -> None:
    length = data.draw(st.integers(16, 600))
    first = data.draw(st.integers(1, length // 4))
    stride = data.draw(st.integers(1, 3))
    lines = data.draw(st.integers(1, (length // 2 - 1 - first) // stride + 1))
    seed = data.draw(st.integers(0, 2**32 - 1))
    signal = core.schroeder(
        length, lines, 0.2, first=first, stride=stride, seed=seed, precision=precision
    )
    tolerance = 1e-4 if precision == "float32" else 1e-10
    assert np.sqrt(np.mean(signal**2)) == pytest.approx(0.2, rel=tolerance)
    spectrum = np.abs(np.fft.rfft(signal)) / length
    wanted = np.zeros_like(spectrum)
    wanted[first + stride * np.arange(lines)] = 0.2 / np.sqrt(2.0 * lines)
    assert spectrum == pytest.approx(wanted, abs=0.2 * tolerance)


@pytest.mark.parametrize(
    "axis",
    [
        core.Axis(-2.7e-5, 8.3e-6, 2.1e-3, 110.0),
        core.Axis(2.7e-5, 0.0, 2.1e-3, 110.0),
        core.Axis(2.7e-5, 8.3e-6, -1.0, 110.0),
        core.Axis(2.7e-5, 8.3e-6, 2.1e-3, float("nan")),
        core.Axis(2.7e-5, 8.3e-6, 2.1e-3, float("inf")),
    ],
)
@pytest.mark.parametrize("precision", PRECISIONS)
def test_an_impossible_axis_is_refused(axis: core.Axis, precision: core.Precision) -> None:
    with pytest.raises(InputError, match="Axis"):
        core.modal(axis, precision)
    with pytest.raises(InputError, match="Axis"):
        core.simulate(axis, 1e-4, [0.0, 0.1], precision=precision)


def test_arguments_that_make_no_sense_are_refused() -> None:
    good = core.IdentSettings(1e-4, PAPER, 0.2)
    motion = core.simulate(PAPER, 1e-4, np.zeros(10))
    counts = np.zeros((10, 2), np.int32)
    with pytest.raises(InputError, match="sample 3"):
        core.simulate(PAPER, 1e-4, [0.0, 0.1, 0.2, float("nan")])
    with pytest.raises(InputError, match="one or more numbers"):
        core.simulate(PAPER, 1e-4, [])
    with pytest.raises(InputError, match="stopped at sample 0"):
        core.simulate(PAPER, 0.0, [0.0, 1.0])
    with pytest.raises(InputError, match="not finite"):
        core.motion([core.State(twist=float("inf"))])
    with pytest.raises(InputError, match="positive"):
        core.read_encoders(motion, (0, 1024))
    with pytest.raises(InputError, match="counts a turn"):
        core.read_encoders(motion, (1024, 2**31))
    with pytest.raises(InputError, match="two columns"):
        core.identify_counts(good, counts[:, 0], (1024, 1024), np.zeros(10))
    with pytest.raises(InputError, match="10 samples, torque has 9"):
        core.identify_counts(good, counts, (1024, 1024), np.zeros(9))
    with pytest.raises(InputError, match="has to be 1 or more"):
        core.identify_motion(good, motion, np.zeros(10), every=0)
    with pytest.raises(InputError, match="forgetting=2"):
        core.identify_motion(
            core.IdentSettings(1e-4, PAPER, 0.2, forgetting=2.0), motion, [0.0] * 10
        )
    with pytest.raises(InputError, match="float16"):
        core.modal(PAPER, "float16")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="no time step"):
        core.time_step(0, 10, WN)
    with pytest.raises(InputError, match="excitation"):
        core.schroeder(100, 60, 0.2)


def test_errors_say_their_exit_status() -> None:
    assert InputError.exit_code == 2
    assert NotEnoughDataError.exit_code == 4
