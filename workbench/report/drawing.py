"""The sections as engineering drawings: points, the two fitted lines, root and angle dimensioned, all to one scale.

In the section plane u is the root face's outward normal (to the right), v runs from the lower to the upper side. The
lines are those of the reported values: the root face from (0, 0) to (0, root), the bevel face from there along
(-sin beta, cos beta); so a fit that is off shows against its points.
"""

from __future__ import annotations

import math
import textwrap

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud, Edge, Inspection
from workbench.report.colours import FACES, GREY, INK, SIGNS, VERDICTS
from workbench.report.deviations import LaidOut, deviation_limit, draw_deviations, laid_out
from workbench.report.dimensions import dimension_angle, dimension_height
from workbench.report.figures import svg
from workbench.report.plot import Axes, Figure
from workbench.report.values import decimals, measured
from workbench.units import DEG, Float

POINTS = 60_000  # drawn in all sections together at most
COLUMNS = 3
PANEL_IN = (3.3, 2.4)
PANEL_SHAPE = 1.5  # width over height inside a panel's axes
FOR_THE_PART = 0.52  # of a panel's width; the rest is for the dimensions


def section_drawings(cloud: Cloud, edge: Edge, inspection: Inspection) -> bytes:
    """SVG of all sections side by side."""
    budget = POINTS // len(inspection.sections)
    all_drawn = [laid_out(cloud, edge, section, budget) for section in inspection.sections]
    window = _window(all_drawn)
    places = (
        decimals(s.root_u_mm for s in inspection.sections),
        decimals(s.bevel_u_deg for s in inspection.sections),
    )
    rows = math.ceil(len(all_drawn) / COLUMNS)
    figure = Figure(figsize=(COLUMNS * PANEL_IN[0], rows * PANEL_IN[1]))
    grid = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True)
    figure.subplots_adjust(0.048, 0.16 / rows, 0.995, 1 - 0.09 / rows, wspace=0.05, hspace=0.14)
    limit = deviation_limit(all_drawn)
    for axes, drawn in zip(grid.flat, all_drawn, strict=False):
        _draw(axes, drawn, window, places)
        draw_deviations(axes, drawn, limit)
    for axes in grid.flat[len(all_drawn) :]:
        axes.set_visible(False)
    figure.supxlabel("u along the root face's outward normal, mm", fontsize=9)
    figure.supylabel("v from the lower to the upper side, mm", fontsize=9, x=0.004)
    return svg(figure)


def _window(all_drawn: list[LaidOut]) -> tuple[Float, Float]:
    """Lowest and highest (u, v): root and bevel face of all sections, with room for the dimensions on the right."""
    faces = [d.uv_mm[(d.label == ROOT_FACE) | (d.label == BEVEL_FACE)] for d in all_drawn]
    uv = np.vstack([*faces, np.array([[-2.0, 0.0], [0.0, 2.0]])])
    low, high = np.percentile(uv, 0.2, axis=0), np.percentile(uv, 99.8, axis=0)
    height = max(1.16 * (high[1] - low[1]), -1.1 * low[0] / FOR_THE_PART / PANEL_SHAPE)
    width = height * PANEL_SHAPE
    corner = np.array([-FOR_THE_PART * width, low[1] - 0.06 * height])
    return corner, corner + np.array([width, height])


def _draw(axes: Axes, drawn: LaidOut, window: tuple[Float, Float], places: tuple[int, int]) -> None:
    section, (low, high) = drawn.section, window
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.tick_params(labelsize=8)
    axes.annotate(
        f"{section.index}",
        (0, 1),
        (0, 3),
        xycoords="axes fraction",
        fontsize=11,
        fontweight="bold",
    )
    axes.annotate(
        f"at {section.arc_length_mm:.1f} mm",
        (0, 1),
        (16, 3),
        xycoords="axes fraction",
        color=GREY,
    )
    axes.annotate(
        f"{SIGNS[section.verdict]} {section.verdict}",
        (1, 1),
        (0, 3),
        xycoords="axes fraction",
        ha="right",
        color=VERDICTS[section.verdict],
        fontweight="bold",
    )
    if section.root_mm is None or section.bevel_deg is None:
        text = textwrap.fill(section.reason or "not measured", 24)
        axes.annotate(text, (0.97, 0.5), xycoords="axes fraction", ha="right", va="center", color=GREY)
        return
    for label in np.unique(drawn.label):
        uv = drawn.uv_mm[drawn.label == label]
        axes.plot(uv[:, 0], uv[:, 1], ".", color=FACES[int(label)], markersize=3.2, alpha=0.6)
    size = float(high[1] - low[1])
    reach = max(0.0, 0.93 * (float(high[1]) - section.root_mm))
    radius = min(0.4 * size, 0.7 * reach)
    _draw_lines(axes, section.root_mm, section.bevel_deg * DEG, reach, radius)
    dimension_height(
        axes, section.root_mm, 0.065 * size, f"{measured(section.root_mm, section.root_u_mm, places[0])} mm", size
    )
    angle = measured(section.bevel_deg, section.bevel_u_deg, places[1])
    dimension_angle(axes, (0.0, section.root_mm), section.bevel_deg, f"({angle})°", radius)


def _draw_lines(axes: Axes, root: float, beta: float, reach: float, radius: float) -> None:
    """Both fitted lines, and the root face's continuation, from which the angle is measured."""
    end = (-reach * math.tan(beta), root + reach)
    axes.plot([0, 0], [0, root], color=INK, linewidth=0.7)
    axes.plot([0, end[0]], [root, end[1]], color=INK, linewidth=0.7)
    axes.plot([0, 0], [root, root + 1.15 * radius], color=INK, linewidth=0.6, dashes=(9, 2.5, 2, 2.5))
    axes.plot([0, 0], [0, root], "o", color=INK, markersize=2.2)
