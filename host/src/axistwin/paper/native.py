"""The loops of native/axt_paper_loops.c over arrays; what axistwin.core has is not repeated."""

from __future__ import annotations

from dataclasses import astuple, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from axistwin import core
from axistwin.core import Array, Axis, IdentSettings, Motion, Precision
from axistwin.core import Method as Method
from axistwin.core import integrate as integrate
from axistwin.errors import InputError

#: Start of P for equations scaled to about 1, as in axt_ident.c: forgotten soon.
PRIOR: dict[Precision, float] = {"float32": 1e9, "float64": 1e13}


@dataclass(frozen=True)
class Regression:
    """Recursive least squares as it went on: k states of it.

    ``theta`` (k, outputs, inputs); ``definite`` (k,) whether P has been positive definite after
    every equation so far.
    """

    theta: Array
    definite: npt.NDArray[np.bool_]


def recursive_least_squares(
    phi: Array,
    y: Array,
    *,
    prior: float,
    forgetting: float = 1.0,
    every: int | None = None,
    precision: Precision = "float64",
) -> Regression:
    """Eqs. 14-16 over the equations y (n, outputs) = phi (n, inputs) theta', scaled to about 1.

    P starts as ``prior`` x identity. A state is taken every ``every`` equations and at the end
    (only there by default).
    """
    c = core._load(precision)
    (n, inputs), outputs = phi.shape, y.shape[1]
    if len(y) != n:
        raise InputError(f"{n} rows of regressors, {len(y)} of outputs")
    every = every or n
    states = -(-n // every)
    theta = np.zeros((states, outputs, inputs), c.real)
    definite = np.zeros(states, np.uint8)
    done = c.ffi.new("size_t *")
    status = c.lib.axt_loop_rls(
        inputs,
        outputs,
        forgetting,
        prior,
        c.array("axt_real", np.ascontiguousarray(phi, c.real).ravel()),
        c.array("axt_real", np.ascontiguousarray(y, c.real).ravel()),
        n,
        every,
        c.array("axt_real", theta.ravel()),
        c.array("uint8_t", definite),
        done,
    )
    core._check(c, status, f"recursive least squares stopped at equation {done[0]}")
    return Regression(theta.astype(np.float64), definite.astype(np.bool_))


def identified_torque(axis: Axis, time_step: float, motion: Motion) -> Array:
    """The excitation identified back (Eq. 18): mean torque (n - 1,) [N m] over each step."""
    c = core._load(motion.precision)
    mean = np.zeros(max(len(motion) - 1, 0), c.real)
    done = c.ffi.new("size_t *")
    status = c.lib.axt_loop_torque(
        core._axis(c, axis),
        time_step,
        c.array("axt_motion", motion.samples),
        len(motion),
        c.array("axt_real", mean),
        done,
    )
    core._check(c, status, f"identified torque stopped at sample {done[0]}")
    return mean.astype(np.float64)


def _config(c: Any, settings: IdentSettings) -> Any:
    return c.ffi.new(
        "axt_ident_config *",
        {
            "form": getattr(c.lib, f"AXT_IDENT_{settings.form.upper()}"),
            "time_step": settings.time_step,
            "forgetting": settings.forgetting,
            "expected": astuple(settings.expected),
            "torque": settings.torque,
            "counts_per_turn": (0, 0),
        },
    )
