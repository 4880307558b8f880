"""Dimensions as in an engineering drawing: extension lines, arrows, the value beside them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc

from workbench.report.colours import INK
from workbench.units import DEG, Float

HEAD = "|-|>,head_width=0.13,head_length=0.32"
ARROW: dict[str, Any] = {"arrowstyle": HEAD[1:], "color": INK, "linewidth": 0.6, "shrinkA": 0, "shrinkB": 0}
TEXT_SIZE = 8.5


def dimension_height(axes: Axes, top: float, at: float, text: str, size: float) -> None:
    """From v = 0 to `top` at u = `at`; arrows from outside where it is short against the drawing's `size`."""
    gap = 0.012 * size
    for v in (0.0, top):
        axes.plot([gap, at + 0.015 * size], [v, v], color=INK, linewidth=0.6)
    if top > 0.09 * size:
        axes.annotate("", (at, 0.0), (at, top), arrowprops={**ARROW, "arrowstyle": f"<{HEAD}"})
    else:
        for v, outside in ((0.0, -0.05 * size), (top, top + 0.05 * size)):
            axes.annotate("", (at, v), (at, outside), arrowprops=ARROW)
    axes.annotate(text, (at, top / 2), (4, 0), textcoords="offset points", va="center", fontsize=TEXT_SIZE)


def dimension_angle(axes: Axes, root: float, bevel_deg: float, text: str, radius: float) -> None:
    """The arc from the root face's continuation to the bevel face, with the value beside it."""
    across = 2 * radius
    axes.add_patch(Arc((0.0, root), across, across, theta1=90.0, theta2=90.0 + bevel_deg, color=INK, linewidth=0.6))
    for degrees, turn in ((90.0, -1.0), (90.0 + bevel_deg, 1.0)):
        tip, tail = degrees * DEG, (degrees - turn * 6.0) * DEG
        to, start = ((radius * math.cos(angle), root + radius * math.sin(angle)) for angle in (tip, tail))
        axes.annotate("", to, start, arrowprops={**ARROW, "linewidth": 0.0})
    axes.annotate(text, (0.0, root + radius), (5, -2), textcoords="offset points", va="center", fontsize=TEXT_SIZE)


def dimension_gap(axes: Axes, low: Float, high: Float, text: str, size: float) -> None:
    """The distance of two points (2,) on parallel lines, with arrows from outside and the value before `low`."""
    along = (high - low) / max(1e-9, float(np.linalg.norm(high - low)))
    for tip, turn in ((low, -1.0), (high, 1.0)):
        axes.annotate("", tuple(tip), tuple(tip + turn * 0.045 * size * along), arrowprops=ARROW)
    axes.plot(*np.array([low, high]).T, color=INK, linewidth=0.6)
    before = low - 0.05 * size * along
    axes.annotate(text, tuple(before), (-2, 0), textcoords="offset points", ha="right", va="center", fontsize=TEXT_SIZE)
