"""Dimensions of a drawing in a section's plane (ISO 129-1): lengths, angles, radii, each with its value beside it."""

from __future__ import annotations

import math
from typing import Literal

import numpy as np

from workbench.pieces import GREY, INK
from workbench.plot import Axes
from workbench.units import DEG, Float

TEXT_SIZE = 8.5
ARC_POINTS, HEAD_DEG = 41, 6.0  # of an arc: places, and length of the heads at its ends
SHORT = 0.09  # of the drawing's size: arrows stand outside of what is shorter
UP, ACROSS = np.eye(2)[::-1]
THIN, OFF_PT, LOWER_PT = 0.5, 5.0, -2.5  # width of extension lines; of a text from its arrow, and below an arc


def dimension(
    axes: Axes,
    ends: tuple[Float, Float],
    at: Float,
    text: str,
    size: float,
    *,
    along: Float = UP,
    place: Literal["middle", "end", "start"] = "middle",
    side: Literal["left", "right"] = "right",
) -> None:
    """The distance of two points (2,) each along a direction.

    Args:
        axes: the drawing.
        ends: what is dimensioned, in the order of `along`.
        at: a place (2,) that the dimension line runs through.
        text: the value.
        size: of the drawing, in the unit of its axes: where the distance is short beside it, arrows stand outside.
        along: unit vector.
        place: where on the dimension line the text stands.
        side: of the line, on which the text stands.
    """
    low, high = (at + ((end - at) @ along) * along for end in ends)
    for end, foot in zip(ends, (low, high), strict=True):
        axes.plot(*np.array([end, foot]).T, color=GREY, linewidth=THIN)
    tail = 0.0
    if float((high - low) @ along) > SHORT * size:
        axes.arrow(high, low, both=True)
    else:
        tail = 0.05 * size
        axes.arrow(low, low - tail * along)
        axes.arrow(high, high + tail * along)
        axes.plot(*np.array([low, high]).T, color=INK, linewidth=THIN)
    where = {"middle": (low + high) / 2, "end": high + tail * along, "start": low - tail * along}[place]
    _label(axes, text, where, side)


def dimension_angle(
    axes: Axes, at: Float, degrees: float, text: str, radius: float, *, to_right: bool = False, inside: bool = False
) -> None:
    """The arc about a place (2,) from the direction upwards to that of a face, with what the angle counts from.

    The text stands on the other side of that direction, beside the part, or `inside` at the arc's end.

    Args:
        axes: the drawing.
        at: where both directions meet.
        degrees: the angle.
        text: its value.
        radius: of the arc.
        to_right: the side to which the face leans.
        inside: where the text stands.
    """
    angles, to = np.linspace(0.0, degrees * DEG, ARC_POINTS), 1.0 if to_right else -1.0
    arc = at + radius * np.column_stack([to * np.sin(angles), np.cos(angles)])
    axes.plot([at[0], at[0]], [at[1], at[1] + 1.15 * radius], color=GREY, linewidth=THIN, dashes=(9, 2.5, 2, 2.5))
    axes.plot(*arc.T, color=INK, linewidth=THIN)
    for tip, before in ((0, HEAD_DEG), (-1, -HEAD_DEG)):  # along the arc
        angle = angles[tip] + before * DEG
        axes.arrow(arc[tip], at + radius * np.array([to * math.sin(angle), math.cos(angle)]), linewidth=0.0)
    if inside:
        _label(axes, text, arc[-1], "right" if to_right else "left", LOWER_PT)
        return
    if at[0] < 0.0:
        axes.plot([at[0], 0.0], [arc[0, 1]] * 2, color=INK, linewidth=THIN)
    _label(axes, text, np.array([max(at[0], 0.0), arc[0, 1]]), "right", LOWER_PT)


def dimension_radius(axes: Axes, centre: Float, to: Float, text: str) -> None:
    """An arrow from the centre of a fillet to its arc, with the value beside the centre."""
    axes.arrow(to, centre)
    _label(axes, text, centre, "right")


def _label(axes: Axes, text: str, at: Float, side: str, up: float = 0.0) -> None:
    ha, off = ("left", OFF_PT) if side == "right" else ("right", -OFF_PT)
    axes.annotate(text, tuple(at), (off, up), ha=ha, va="center", fontsize=TEXT_SIZE)
