"""How the figures look: one style for all, readable in print and on a screen."""

from __future__ import annotations

from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: Okabe and Ito's colours, told apart by everyone.
BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#777777",
)

_STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dddddd",
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.2,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "savefig.dpi": 110,
}


def use_style() -> None:
    """Makes this style matplotlib's default in this process."""
    matplotlib.rcParams.update(_STYLE)


def panels(
    rows: int, columns: int, *, height: float = 2.6, sharex: bool = False
) -> tuple[Figure, list[Axes]]:
    """A figure 8 inches wide with rows x columns axes, row by row; ``height`` of a row [inch]."""
    figure = Figure(figsize=(8.0, height * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False, sharex=sharex)
    return figure, list(axes.ravel())
