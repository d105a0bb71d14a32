"""Figures as parts of a page: matplotlib draws them, the page's style sheet colours them.

Each panel is an SVG of its own, small enough to be read on a phone. Its colours are those of a
light page, which the style sheet exchanges in the dark; clouds of points are pictures inside it,
in colours that suit both.
"""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.figure import Figure

#: Colours by the name that the style sheet knows them by, as on a light page.
COLOURS: Mapping[str, str] = {
    "ink": "#1f2933",
    "grid": "#d9dee3",
    "measured": "#9fabb7",
    "before": "#d55e00",
    "after": "#0072b2",
    "curve": "#b5006b",
    "band": "#e1e7ed",
}

#: Of points, readable on light and dark.
CLOUD, CLOUD_AFTER = "#8894a0", "#3d8fc6"

#: How panels look, as matplotlib's settings; for matplotlib.rc_context().
STYLE: dict[Any, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 9.0,
    "axes.grid": True,
    "axes.axisbelow": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": COLOURS["ink"],
    "axes.labelcolor": COLOURS["ink"],
    "axes.formatter.useoffset": False,
    "axes.xmargin": 0.01,
    "text.color": COLOURS["ink"],
    "xtick.color": COLOURS["ink"],
    "ytick.color": COLOURS["ink"],
    "grid.color": COLOURS["grid"],
    "grid.linewidth": 0.6,
    "lines.linewidth": 1.3,
    "legend.fontsize": 8.0,
    "legend.frameon": False,
    "legend.handlelength": 1.4,
    "path.simplify_threshold": 0.5,
    "savefig.dpi": 130,
    "svg.fonttype": "none",
    "svg.hashsalt": "axistwin",
}

#: Height and width of a panel [inch].
_HEIGHT, _WIDTH, _WIDE = 2.7, 4.5, 9.2


@dataclass(frozen=True)
class Panel:
    """A figure and what a reader is to see in it. A ``wide`` one takes the whole line."""

    figure: Figure
    caption: str
    wide: bool = False


def axes(
    title: str, xlabel: str, ylabel: str, *, wide: bool = False, height: float = _HEIGHT
) -> tuple[Figure, Axes]:
    """An empty panel."""
    figure = Figure(figsize=(_WIDE if wide else _WIDTH, height), layout="constrained")
    drawn = figure.subplots()
    drawn.set(title=title, xlabel=xlabel, ylabel=ylabel)
    return figure, drawn


def svg(figure: Figure, name: str, label: str) -> str:
    """A figure as an SVG element for the middle of a page; identifiers in it begin with ``name``.

    ``label`` has to be escaped; it is what those hear who cannot see it.
    """
    drawn = io.StringIO()
    with matplotlib.rc_context(STYLE):
        figure.savefig(drawn, format="svg", transparent=True)
    element = drawn.getvalue()
    element = element[element.index("<svg") :].strip()
    element = re.sub(r"<metadata>.*?</metadata>", "", element, flags=re.DOTALL)
    element = re.sub(r' xmlns(:xlink)?="[^"]*"', "", element)
    element = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{name}-", element)
    element = re.sub(r"font-family: [^;\"]*;? ?", "", element)  # the page's
    for colour, value in COLOURS.items():
        element = element.replace(value, f"var(--{colour})")
    size = re.search(r'viewBox="[^"]*"', element)
    assert size is not None
    end = element.index(">")
    return f'<svg {size[0]} role="img" aria-label="{label}"{element[end:]}'
