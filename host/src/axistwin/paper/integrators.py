"""The integrators that the paper names as future work, beside Newmark's and the exact map.

A method applied to the free vibration x'' + 2 zeta wn x' + wn^2 x = 0 multiplies it by the same
complex number in every step, the principal root of its characteristic polynomial. The root's angle
is the method's frequency and its modulus the method's damping, so both errors have a closed form
(K.-J. Bathe, Finite Element Procedures, chapter 9). It stands here beside what the C core does, and
beside what each method's samples do to the parameters identified from them by the bias-free form,
which is made for Newmark's.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from axistwin import core
from axistwin.core import Array, Axis, IdentSettings, State
from axistwin.paper import native
from axistwin.paper.report import Report, Value
from axistwin.paper.settings import AXIS, MODAL, NAMES, RMS, SETTINGS, Setting, errors
from axistwin.paper.style import BLUE, GREEN, GREY, ORANGE, RED, SKY, panels

WILSON_THETA = 1.4

#: Samples of a free vibration from which a root is measured.
_FREE_SAMPLES = 400
_FREE_TWIST = 1e-3

#: Samples of a record to identify, and a period of its excitation.
_RECORD = 10240
_PERIOD = 2048

#: Where the curves are taken: wn Dt, and harmonics of the period at the natural frequency.
_STEPS = np.geomspace(0.03, 2.0, 55)
_HARMONICS = np.unique(np.geomspace(10, 500, 25).astype(int))

#: Smaller errors are rounding.
_NOTHING = 1e-9


@dataclass(frozen=True)
class Integrator:
    """A method of axt_integrator.h; its samples obey a recurrence of this ``order``."""

    method: native.Method
    title: str
    order: int
    colour: str

    def root(self, x: float, zeta: float = 0.0) -> complex:
        """Closed form of the factor per step of a free vibration, x = wn Dt."""
        return _principal(_characteristic(self.method, x, zeta))

    def measured_root(self, x: float, zeta: float = 0.0) -> complex:
        """The same from samples of the C core, by the recurrence that they obey.

        The axis is the paper's with another damping, let go from a twist.
        """
        axis = replace(AXIS, B=2.0 * zeta * AXIS.K / MODAL.wn)
        rest = np.zeros(_FREE_SAMPLES)
        motion = native.integrate(self.method, axis, x / MODAL.wn, rest, State(_FREE_TWIST))
        return _principal(_recurrence(motion.twist[self.order :], self.order))

    def identified(self, x: float, torque: Array) -> Axis:
        """What the bias-free form makes of this method's samples under a torque (n,) [N m]."""
        time_step = x / MODAL.wn
        motion = native.integrate(self.method, AXIS, time_step, torque)
        settings = IdentSettings(time_step, AXIS, RMS)
        return core.identify_motion(settings, motion, torque).last.axis


NEWMARK = Integrator("newmark", "Newmark", 2, GREY)
HOUBOLT = Integrator("houbolt", "Houbolt", 3, RED)
WILSON = Integrator("wilson", "Wilson, theta = 1.4", 3, ORANGE)
RUNGE_KUTTA = Integrator("runge_kutta", "Runge-Kutta 4", 2, GREEN)
EXACT = Integrator("exact", "exact, torque linear", 2, BLUE)
EXACT_HELD = Integrator("exact_held", "exact, torque held", 2, SKY)
INTEGRATORS = (NEWMARK, HOUBOLT, WILSON, RUNGE_KUTTA, EXACT, EXACT_HELD)


def period_error(root: complex, x: float, zeta: float = 0.0) -> float:
    """How much longer than it is the period of the vibration becomes [%]."""
    return 100.0 * (x * math.sqrt(1.0 - zeta**2) / cmath.phase(root) - 1.0)


def damping_error(root: complex, zeta: float = 0.0) -> float:
    """Damping ratio that the method adds: -ln|root| / sqrt(ln|root|^2 + angle^2) - zeta."""
    decay, angle = -math.log(abs(root)), cmath.phase(root)
    return decay / math.hypot(decay, angle) - zeta


def run(report: Report) -> None:
    """Table and figure of the integrators."""
    for setting in SETTINGS:
        report.progress(f"integrators: {setting.title}")
        torque = setting.torque(_RECORD // setting.N)
        values = [
            value
            for integrator in INTEGRATORS
            for value in _rows(integrator, setting.x, integrator.identified(setting.x, torque))
        ]
        report.study(f"Integrators, {setting.title}", values)
    report.progress("integrators: over the time step")
    _figure(report)


def _rows(integrator: Integrator, x: float, found: Axis) -> list[Value]:
    closed, measured = integrator.root(x), integrator.measured_root(x)
    row = integrator.title
    return [
        Value(row, "period, closed form", period_error(closed, x), "%"),
        Value(row, "period, measured", period_error(measured, x), "%"),
        Value(row, "damping, closed form", damping_error(closed), ""),
        Value(row, "damping, measured", damping_error(measured), ""),
        *(
            Value(row, f"{name} identified", float(error), "%")
            for name, error in zip(NAMES, errors(found), strict=True)
        ),
    ]


def _characteristic(method: native.Method, x: float, zeta: float) -> Array:
    """Characteristic polynomial of a free step, highest power first."""
    if method == "houbolt":
        # (2, -5, 4, -1) / h^2 and (11, -18, 9, -2) / 6 h are x'' and x' at the end of the step
        acceleration, speed = np.array([[2.0, -5.0, 4.0, -1.0], [11.0, -18.0, 9.0, -2.0]])
        result: Array = acceleration + zeta * x / 3.0 * speed + [x**2, 0.0, 0.0, 0.0]
        return result
    if method == "wilson":
        return np.real(np.poly(_wilson_matrix(x, zeta)))
    pole = x * complex(-zeta, np.sqrt(1.0 - zeta**2))
    root = {
        "newmark": (1.0 + pole / 2.0) / (1.0 - pole / 2.0),
        "runge_kutta": 1.0 + pole + pole**2 / 2.0 + pole**3 / 6.0 + pole**4 / 24.0,
        "exact": np.exp(pole),
        "exact_held": np.exp(pole),
    }[method]
    return np.array([1.0, -2.0 * np.real(root), abs(root) ** 2])


def _wilson_matrix(x: float, zeta: float) -> Array:
    """Wilson's amplification matrix of h^2 x'', h x', x, as Bathe gives it."""
    theta = WILSON_THETA
    beta = 1.0 / (theta / x**2 + zeta * theta**2 / x + theta**3 / 6.0)
    kappa = zeta * beta / x
    return np.array(
        [
            [
                1.0 - beta * theta**2 / 3.0 - 1.0 / theta - kappa * theta,
                -beta * theta - 2.0 * kappa,
                -beta,
            ],
            [
                1.0 - 1.0 / (2.0 * theta) - beta * theta**2 / 6.0 - kappa * theta / 2.0,
                1.0 - beta * theta / 2.0 - kappa,
                -beta / 2.0,
            ],
            [
                0.5 - 1.0 / (6.0 * theta) - beta * theta**2 / 18.0 - kappa * theta / 6.0,
                1.0 - beta * theta / 6.0 - kappa / 3.0,
                1.0 - beta / 6.0,
            ],
        ]
    )


def _recurrence(samples: Array, order: int) -> Array:
    """Characteristic polynomial of the recurrence of this order that the samples (n,) obey."""
    past = np.column_stack([samples[order - i - 1 : -i - 1] for i in range(order)])
    coefficients = np.linalg.lstsq(past, samples[order:], rcond=None)[0]
    return np.append(1.0, -coefficients)


def _principal(polynomial: Array) -> complex:
    """The root of the vibration: that with the positive angle."""
    roots = np.roots(polynomial)
    return complex(roots[np.argmax(roots.imag)])


def _stable(integrator: Integrator, steps: Array) -> Array:
    """Those of the steps at which the method is stable."""
    result: Array = steps[[abs(integrator.root(x)) <= 1.0 + 1e-9 for x in steps]]
    return result


def _figure(report: Report) -> None:
    figure, axes = panels(3, 2, height=2.6)
    figure.suptitle("Integrators: free vibration (line: closed form, dot: C core), identification")
    data: dict[str, npt.ArrayLike] = {}
    for integrator in INTEGRATORS[:-1]:  # how torque varies is of no account in a free vibration
        _plot_free(axes[0], axes[1], integrator, data)
    for integrator in INTEGRATORS[1:]:  # Newmark's own errors are zero
        _plot_identified(axes[2:], integrator, data)
    labels = ("|period error| [%]", "numerical damping ratio [1]")
    for panel, label in zip(axes, labels, strict=False):
        panel.set_ylabel(label)
    for panel, name in zip(axes[2:], NAMES, strict=True):
        panel.set_ylabel(f"|error of {name}| identified [%]")
        panel.set_ylim(1e-4 if name != "K" else 1e-7, 1e3)
    axes[0].lines[0].set_label(NEWMARK.title)
    handles = [axes[0].lines[0], *axes[2].lines[: len(INTEGRATORS) - 1]]
    figure.legend(handles=handles, loc="outside lower center", ncols=6)
    for panel in axes:
        panel.set_xlabel("wn Dt [rad] (dotted: the paper's two settings)")
        for setting in SETTINGS:
            panel.axvline(setting.x, color=GREY, lw=0.9, ls=":")
    report.figure("integrators", figure, data)


def _plot_free(
    period: Axes, damping: Axes, integrator: Integrator, data: dict[str, npt.ArrayLike]
) -> None:
    steps = _stable(integrator, _STEPS)
    dots = steps[::6]
    for panel, name, error in (
        (period, "period error [%]", period_error),
        (damping, "damping [1]", lambda root, _: damping_error(root)),
    ):
        closed = np.array([error(integrator.root(x), x) for x in steps])
        measured = np.array([error(integrator.measured_root(x), x) for x in dots])
        data[f"wn Dt, {integrator.title}, {name}"] = steps
        data[f"{integrator.title}, {name}, closed form"] = closed
        data[f"wn Dt, {integrator.title}, {name}, dots"] = dots
        data[f"{integrator.title}, {name}, measured"] = measured
        if np.max(np.abs(closed)) > _NOTHING:
            panel.loglog(steps, np.abs(closed), color=integrator.colour)
            panel.loglog(dots, np.abs(measured), "o", ms=3.5, color=integrator.colour)


def _plot_identified(
    axes: Sequence[Axes], integrator: Integrator, data: dict[str, npt.ArrayLike]
) -> None:
    settings = [Setting("", _PERIOD, int(k)) for k in _HARMONICS]
    settings = [s for s in settings if _stable(integrator, np.array([s.x])).size]
    found = np.array(
        [errors(integrator.identified(s.x, s.torque(_RECORD // _PERIOD))) for s in settings]
    )
    steps = np.array([s.x for s in settings])
    data[f"wn Dt, {integrator.title}, identified"] = steps
    for panel, name, values in zip(axes, NAMES, found.T, strict=True):
        data[f"{integrator.title}, {name} [%]"] = values
        style = "--" if integrator is EXACT else "-"  # it lies on Runge-Kutta's line
        panel.loglog(steps, np.abs(values), style, color=integrator.colour, label=integrator.title)
