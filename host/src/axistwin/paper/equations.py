"""The equations of the running axis as the C core makes them, and its estimators over them.

One set of equations ``y = theta phi`` (axt_regressor.h, short form) serves recursive least squares,
extended least squares and instrumental variables alike, so that they differ in nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from axistwin import core
from axistwin.core import Array, IdentSettings, Motion, Precision
from axistwin.errors import InputError, NotEnoughDataError
from axistwin.paper import native

#: Instrumental variables refuse an equation now and then before P has come down from its start.
_REFUSED_MAX = 0.001

_INPUTS, _OUTPUTS = 3, 2


@dataclass(frozen=True)
class Equations:
    """``phi`` (n, 3), scaled q, q', T, and ``y`` (n, 2), scaled q'', r''; ``sample`` (n,) is the
    index of the sample that completed each."""

    phi: Array
    y: Array
    sample: npt.NDArray[np.int64]
    precision: Precision
    regressor: Any = field(repr=False)

    @property
    def information(self) -> Array:
        """The information matrix of the scaled regressors, a sample's worth of it (3, 3)."""
        result: Array = self.phi.T @ self.phi / len(self.phi)
        return result

    def axes(self, theta: Array) -> Array:
        """I1, I2, B, K (k, 4) from scaled entries ``theta`` (k, 2, 3); nan for no axis."""
        c = core._load(self.precision)
        unit = [
            [c.lib.axt_regressor_unit(self.regressor, row, i) for i in range(_INPUTS)]
            for row in range(_OUTPUTS)
        ]
        found = np.full((len(theta), 4), np.nan)
        rows, axis = c.ffi.new("axt_rows *"), c.ffi.new("axt_axis *")
        for entries, answer in zip(theta * np.array(unit), found, strict=True):
            rows.twist, rows.body = entries.tolist()
            share = self.regressor.motor_share
            if c.lib.axt_axis_from_rows(rows, share, axis) == c.lib.AXT_OK:
                answer[:] = axis.I1, axis.I2, axis.B, axis.K
        return found


def from_motion(settings: IdentSettings, motion: Motion, torque: npt.ArrayLike) -> Equations:
    """Equations from motion with speeds and torque (n,) [N m].

    Raises InputError for settings or samples that the core refuses.
    """
    c = core._load(motion.precision)
    made = _Maker(c, settings, (0, 0), torque)
    made.expect(len(motion))
    samples = c.array("axt_motion", motion.samples)
    return made.finish(c.lib.axt_loop_equations_motion(made.regressor, samples, *made.arguments))


def from_counts(
    settings: IdentSettings,
    counts: npt.NDArray[np.int32],
    counts_per_turn: Sequence[int],
    torque: npt.ArrayLike,
    precision: Precision = "float64",
) -> Equations:
    """Equations from encoder counts (n, 2) of motor and table and torque (n,) [N m].

    They begin when the filter has settled, and there is none while the twist rests. Raises as
    from_motion().
    """
    c = core._load(precision)
    made = _Maker(c, settings, counts_per_turn, torque)
    made.expect(len(counts))
    motor, table = (c.array("int32_t", row) for row in np.ascontiguousarray(counts.T))
    status = c.lib.axt_loop_equations_counts(made.regressor, motor, table, *made.arguments)
    return made.finish(status)


def least_squares(
    equations: Equations, *, forgetting: float = 1.0, every: int | None = None
) -> Array:
    """I1, I2, B, K (k, 4) by axt_rls, after each ``every`` equations and the last.

    Its forgetting is directional: only what is renewed is forgotten.
    """
    found = native.recursive_least_squares(
        equations.phi,
        equations.y,
        prior=native.PRIOR[equations.precision],
        forgetting=forgetting,
        every=every,
        precision=equations.precision,
    )
    return equations.axes(found.theta)


def exponential(
    equations: Equations, *, forgetting: float = 1.0, every: int | None = None
) -> Array:
    """The same with exponential forgetting: axt_iv whose instruments are the regressors."""
    return _instrumental(equations, 0, forgetting, every)


def instrumental(
    equations: Equations, delay: int, *, forgetting: float = 1.0, every: int | None = None
) -> Array:
    """The same by axt_iv: the regressors ``delay`` equations earlier are the instruments.

    With a whole period of the excitation as delay their noise is another one. Raises InputError
    when there are fewer equations than that.
    """
    if not 0 < delay < len(equations.phi):
        raise InputError(f"{len(equations.phi)} equations hold no instruments {delay} earlier")
    return _instrumental(equations, delay, forgetting, every)


def extended(equations: Equations, *, forgetting: float = 1.0, every: int | None = None) -> Array:
    """The same by axt_els: extended least squares."""
    run = _Run(equations, every)
    function = run.core.lib.axt_loop_els
    return run.finish(function(forgetting, run.prior, *run.equations, run.every, *run.results))


def _instrumental(equations: Equations, delay: int, forgetting: float, every: int | None) -> Array:
    run = _Run(equations, every)
    function = run.core.lib.axt_loop_iv
    return run.finish(
        function(forgetting, run.prior, *run.equations, delay, run.every, *run.results)
    )


class _Maker:
    """Room for equations, and the regressor that makes them."""

    def __init__(
        self,
        c: core._Core,
        settings: IdentSettings,
        counts_per_turn: Sequence[int],
        torque: npt.ArrayLike,
    ) -> None:
        self._core = c
        self._settings = replace(settings, form="3x2")
        self._torque = core._reals(c, torque, "torque")
        n = len(self._torque)
        self._phi, self._y = np.zeros((n, _INPUTS), c.real), np.zeros((n, _OUTPUTS), c.real)
        self._sample = np.zeros(n, np.int64)
        self._count = c.ffi.new("size_t *")
        self.regressor = c.ffi.new("axt_regressor *")
        config = native._config(c, self._settings)
        config.counts_per_turn = tuple(counts_per_turn)
        status = c.lib.axt_regressor_init(self.regressor, config)
        core._check(c, status, f"regressors with {settings}")

    def expect(self, length: int) -> None:
        if length != len(self._torque):
            raise InputError(f"{length} samples of motion, {len(self._torque)} of torque")

    @property
    def arguments(self) -> tuple[Any, ...]:
        c = self._core
        return (
            c.array("axt_real", self._torque),
            len(self._torque),
            c.array("axt_real", self._phi.ravel()),
            c.array("axt_real", self._y.ravel()),
            c.array("int64_t", self._sample),
            self._count,
        )

    def finish(self, status: int) -> Equations:
        core._check(self._core, status, f"regressors with {self._settings}")
        n = self._count[0]
        if n == 0:
            raise NotEnoughDataError("too few samples for an equation")
        phi, y = self._phi[:n].astype(np.float64), self._y[:n].astype(np.float64)
        return Equations(phi, y, self._sample[:n], self._core.precision, self.regressor)


class _Run:
    """One run of an estimator over equations."""

    def __init__(self, equations: Equations, every: int | None) -> None:
        self._source = equations
        self.core = core._load(equations.precision)
        self.prior = native.PRIOR[equations.precision]
        n = len(equations.phi)
        self.every = every or n
        self._phi = np.ascontiguousarray(equations.phi, self.core.real).ravel()
        self._y = np.ascontiguousarray(equations.y, self.core.real).ravel()
        self._theta = np.zeros((-(-n // self.every), _OUTPUTS, _INPUTS), self.core.real)
        self._rejected = self.core.ffi.new("uint32_t *")

    @property
    def equations(self) -> tuple[Any, ...]:
        c = self.core
        return c.array("axt_real", self._phi), c.array("axt_real", self._y), len(self._source.phi)

    @property
    def results(self) -> tuple[Any, ...]:
        return self.core.array("axt_real", self._theta.ravel()), self._rejected

    def finish(self, status: int) -> Array:
        core._check(self.core, status, "estimator")
        if self._rejected[0] > _REFUSED_MAX * len(self._source.phi):
            raise InputError(f"the estimator refused {self._rejected[0]} equations")
        return self._source.axes(self._theta.astype(np.float64))
