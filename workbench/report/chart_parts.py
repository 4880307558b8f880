"""What charts and drawings share: axes over arc length; dimensions as in an engineering drawing."""

from __future__ import annotations

import math

import numpy as np

from workbench.report.colours import GREY, INK, PALE
from workbench.report.plot import Axes, Figure, Lettering
from workbench.units import DEG, Float


def svg(figure: Figure) -> bytes:
    """The figure's bytes."""
    return figure.svg()


def mark_sections(axes: Axes, arc_length_mm: list[float], names: list[str]) -> None:
    """Numbered ticks along the top of a chart over arc length."""
    for s, name in zip(arc_length_mm, names, strict=True):
        axes.axvline(s, color=PALE, linewidth=0.7, zorder=0.5)
        axes.annotate(
            name,
            (s, 1.0),
            (0, 2),
            xycoords=("data", "axes fraction"),
            ha="center",
            va="bottom",
            fontsize=8,
            look=Lettering(GREY),
        )


def hatch_hidden(axes: Axes, stretches_mm: list[tuple[float, float]]) -> None:
    """Stretches of the edge where nothing was measured."""
    for start, end in stretches_mm:
        axes.axvspan(start, end, facecolor="white", zorder=0.6)
        axes.axvspan(start, end, hatch="////", zorder=0.6)
        if end - start > 0.05 * (axes.get_xlim()[1] - axes.get_xlim()[0]):
            axes.annotate(
                "hidden",
                ((start + end) / 2, 0.5),
                xycoords=("data", "axes fraction"),
                ha="center",
                va="center",
                fontsize=8,
                look=Lettering(GREY, rotation=90, box=True),
            )


TEXT_SIZE = 8.5
ARC_POINTS = 41


def dimension_height(axes: Axes, top: float, at: float, text: str, size: float) -> None:
    """From v = 0 to `top` at u = `at`; arrows from outside where it is short against the drawing's `size`."""
    gap = 0.012 * size
    for v in (0.0, top):
        axes.plot([gap, at + 0.015 * size], [v, v], color=INK, linewidth=0.6)
    if top > 0.09 * size:
        axes.arrow((at, 0.0), (at, top), both=True)
    else:
        for v, outside in ((0.0, -0.05 * size), (top, top + 0.05 * size)):
            axes.arrow((at, v), (at, outside))
    axes.annotate(text, (at, top / 2), (4, 0), va="center", fontsize=TEXT_SIZE)


def dimension_angle(axes: Axes, at: tuple[float, float], bevel_deg: float, text: str, radius: float) -> None:
    """The arc from the root face's direction to the bevel face's, about the place `at`; its value beside the part."""
    u, v = at
    turned = np.linspace(90.0, 90.0 + bevel_deg, ARC_POINTS) * DEG
    axes.plot(u + radius * np.cos(turned), v + radius * np.sin(turned), color=INK, linewidth=0.6)
    for degrees, turn in ((90.0, -1.0), (90.0 + bevel_deg, 1.0)):
        tip, tail = degrees * DEG, (degrees - turn * 6.0) * DEG
        to, start = ((u + radius * math.cos(angle), v + radius * math.sin(angle)) for angle in (tip, tail))
        axes.arrow(to, start, linewidth=0.0)
    if u < 0.0:
        axes.plot([u, 0.0], [v + radius, v + radius], color=INK, linewidth=0.4)
    axes.annotate(text, (0.0, v + radius), (5, -2), va="center", fontsize=TEXT_SIZE)


def dimension_radius(axes: Axes, centre: tuple[float, float], to: tuple[float, float], text: str) -> None:
    """An arrow from the centre of a fillet to its arc, with the value beside the centre."""
    axes.arrow(to, centre)
    axes.annotate(text, centre, (5, 0), va="center", fontsize=TEXT_SIZE)


def dimension_gap(axes: Axes, low: Float, high: Float, text: str, size: float) -> None:
    """The distance of two points (2,) on parallel lines, with arrows from outside and the value before `low`."""
    along = (high - low) / max(1e-9, float(np.linalg.norm(high - low)))
    for tip, turn in ((low, -1.0), (high, 1.0)):
        axes.arrow(tip, tip + turn * 0.045 * size * along)
    axes.plot(*np.array([low, high]).T, color=INK, linewidth=0.6)
    before = low - 0.05 * size * along
    axes.annotate(text, tuple(before), (-2, 0), ha="right", va="center", fontsize=TEXT_SIZE)
