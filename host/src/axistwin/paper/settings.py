"""The paper's two settings, and the axis of Table 1 in them."""

from __future__ import annotations

from dataclasses import astuple, dataclass

import numpy as np

from axistwin import core
from axistwin.core import Array, Axis, Modal

AXIS: Axis = core.paper_axis()
MODAL: Modal = core.modal(AXIS)

#: The parameters in the order of Axis.
NAMES = ("I1", "I2", "B", "K")

#: Size of the excitation where the paper gives none [N m].
RMS = 0.2


@dataclass(frozen=True)
class Setting:
    """A column of Table 2: N samples a period, the natural frequency at harmonic k."""

    key: str
    N: int
    k: int

    @property
    def title(self) -> str:
        """As the paper's tables head their columns."""
        return f"N = {self.N}, k = {self.k}"

    @property
    def time_step(self) -> float:
        """Dt = 2 pi k / (N wn) [s]."""
        return core.time_step(self.N, self.k, MODAL.wn)

    @property
    def x(self) -> float:
        """wn Dt, on which everything depends."""
        return MODAL.wn * self.time_step

    @property
    def closed_form_divisor(self) -> float:
        """D = 1 + zeta x + x^2/4: Eq. 9 finds K / D on samples of Newmark's method."""
        return 1.0 + MODAL.zeta * self.x + self.x**2 / 4.0

    def torque(self, periods: int = 1, seed: int = 0) -> Array:
        """Schroeder's signal with 2k lines from the first harmonic on [N m], ``periods`` times."""
        return np.tile(core.schroeder(self.N, 2 * self.k, RMS, seed=seed), periods)


A = Setting("a", 512, 10)
B = Setting("b", 2048, 146)
SETTINGS = (A, B)


def errors(found: Axis | Array) -> Array:
    """Errors of I1, I2, B, K [%], (4,) or (k, 4), against Table 1."""
    values = np.array(astuple(found)) if isinstance(found, Axis) else found
    result: Array = 100.0 * (values / np.array(astuple(AXIS)) - 1.0)
    return result
