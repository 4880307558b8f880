"""Sections of an inspection: their points and how far these lie off, engineering drawings.

In the section plane u is the root face's outward normal (to the right), v runs from the lower to the upper side. The
drawn lines are those of the reported values: the root face from (0, 0) to (0, root), the bevel face from there along
(-sin beta, cos beta); so a fit that is off shows against its points.
"""

from __future__ import annotations

import math
import textwrap
from typing import Any, NamedTuple

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud, Edge, Inspection, JointInspection, Section
from workbench.marks import FACES, SIGNS, VERDICTS, Lettering
from workbench.pieces import GREY, INK
from workbench.plot import Axes, Figure
from workbench.report.along import in_section
from workbench.report.dimensions import dimension, dimension_angle
from workbench.report.scene import frame_arc_length_mm, of_section
from workbench.report.text import decimals, measured
from workbench.units import DEG, AnyArray, Bool, Float, Shaped

STRIP = (0.13, 0.1, 0.27, 0.16)  # the strip's place in a section's panel, inside the material


class LaidOut(NamedTuple):
    """A section and its points in its own plane."""

    section: Section
    uv_mm: Shaped[Float, "n 2"]
    label: Shaped[AnyArray, " n"]


def laid_out(cloud: Cloud, edge: Edge, section: Section, budget: int) -> LaidOut:
    """About `budget` points of the frames that a section rests on."""
    points = of_section(cloud, edge, section, budget)
    start = frame_arc_length_mm(cloud, edge)[points.frame]
    uv = in_section(points.position_mm, start, edge, section)
    known = np.isfinite(uv).all(axis=1)
    return LaidOut(section, uv[known], points.label[known])


def deviations(drawn: LaidOut) -> tuple[Float, Float, AnyArray] | None:
    """Way along the outline from the lower edge, mm; distance from the lines, outward positive, mm; face."""
    if (sizes := drawn.section.root_and_bevel) is None:
        return None
    root, bevel = sizes
    beta = bevel * DEG
    on_bevel = drawn.label == BEVEL_FACE
    face = on_bevel | (drawn.label == ROOT_FACE)
    from_corner = drawn.uv_mm - np.array([0.0, root])
    up_the_bevel = np.array([-math.sin(beta), math.cos(beta)])
    along = np.where(on_bevel, root + from_corner @ up_the_bevel, drawn.uv_mm[:, 1])
    off = outside_mm(drawn.uv_mm, on_bevel, root, beta)
    return along[face], off[face], drawn.label[face]


def outside_mm(uv_mm: Float, on_bevel: Bool, root_mm: Float | float, bevel: Float | float) -> Float:
    """(n,) how far points (n, 2) lie outside the bevel face, or outside the root face where not `on_bevel`.

    `root_mm` and `bevel` (rad): of the faces that they are compared with, one value or one a point.
    """
    u, v = uv_mm.T
    off: Float = np.where(on_bevel, u * np.cos(bevel) + (v - root_mm) * np.sin(bevel), u)
    return off


def round_limit(distance_mm: Float) -> float:
    """1, 2 or 5 times a power of ten, mm: all but the farthest of the distances (n,) are less."""
    reach = max(1e-3, float(np.percentile(distance_mm, 99.5)))
    decade: float = 10.0 ** math.floor(math.log10(reach))
    return next(step * decade for step in (1.0, 2.0, 5.0, 10.0) if step * decade >= reach)


def draw_deviations(axes: Axes, drawn: LaidOut, limit: float) -> None:
    """The strip that shows the points' distances from the lines, magnified."""
    found = deviations(drawn)
    if found is None or not len(found[0]):
        return
    along, off, label = found
    strip = axes.inset_axes(STRIP)
    strip.set(
        ylim=(-limit, limit),
        xlim=(min(0.0, float(along.min())), float(along.max())),
        xticks=([], []),
        yticks=([-limit, 0.0, limit], [f"−{limit:g}", "0", f"{limit:g}"]),
    )
    strip.tick_params(labelsize=6.5, length=2, pad=1.5)
    strip.spine_hidden = True
    for face in (ROOT_FACE, BEVEL_FACE):
        of_face = label == face
        strip.points(
            along[of_face],
            off[of_face],
            ".",
            color=FACES[face],
            markersize=1.4,
            alpha=0.6,
        )
    strip.axhline(0.0, color=INK, linewidth=0.5)
    strip.annotate(
        "deviation, mm", (0, 1), (0, 2), xycoords="axes fraction", fontsize=6.5, va="bottom", look=Lettering(GREY)
    )


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
    places = [decimals(pair and pair[1] for pair in one.pairs) for one in inspection.characteristics]
    rows = math.ceil(len(all_drawn) / COLUMNS)
    figure = Figure(figsize=(COLUMNS * PANEL_IN[0], rows * PANEL_IN[1]))
    grid = figure.subplots(rows, COLUMNS, squeeze=False, sharex=True, sharey=True)
    figure.subplots_adjust(0.048, 0.18 / rows, 0.995, 1 - 0.09 / rows, wspace=0.05, hspace=0.14)
    off = [np.abs(found[1]) for found in map(deviations, all_drawn) if found is not None and len(found[1])]
    limit = round_limit(np.concatenate(off)) if off else 0.05  # half height of the strips, mm
    for axes, drawn in zip(grid.flat, all_drawn, strict=False):
        _draw(axes, drawn, window, places)
        draw_deviations(axes, drawn, limit)
    for axes in grid.flat[len(all_drawn) :]:
        axes.visible = False
    grid[-1, 0].set(xlabel="out of the root face, mm", ylabel="up, mm")
    return figure.svg()


def _window(all_drawn: list[LaidOut]) -> tuple[Float, Float]:
    """Lowest and highest (u, v): root and bevel face of all sections, with room for the dimensions on the right."""
    faces = [d.uv_mm[(d.label == ROOT_FACE) | (d.label == BEVEL_FACE)] for d in all_drawn]
    uv = np.vstack([*faces, np.array([[-2.0, 0.0], [0.0, 2.0]])])
    low, high = np.percentile(uv, 0.2, axis=0), np.percentile(uv, 99.8, axis=0)
    height = max(1.16 * (high[1] - low[1]), -1.1 * low[0] / FOR_THE_PART / PANEL_SHAPE)
    width = height * PANEL_SHAPE
    corner = np.array([-FOR_THE_PART * width, low[1] - 0.06 * height])
    return corner, corner + np.array([width, height])


def _draw(axes: Axes, drawn: LaidOut, window: tuple[Float, Float], places: list[int]) -> None:
    section, (low, high) = drawn.section, window
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    axes.tick_params(labelsize=8)
    axes.annotate(
        f"{section.index}",
        (0, 1),
        (0, 3),
        xycoords="axes fraction",
        fontsize=11,
        look=Lettering(weight="bold"),
    )
    axes.annotate(
        f"at {section.arc_length_mm:.1f} mm",
        (0, 1),
        (16, 3),
        xycoords="axes fraction",
        look=Lettering(GREY),
    )
    axes.annotate(
        f"{SIGNS[section.verdict]} {section.verdict}",
        (1, 1),
        (0, 3),
        xycoords="axes fraction",
        ha="right",
        look=Lettering(VERDICTS[section.verdict], weight="bold"),
    )
    if (sizes := section.root_and_bevel) is None:
        text = textwrap.fill(section.reason or "not measured", 24)
        axes.annotate(text, (0.97, 0.5), xycoords="axes fraction", ha="right", va="center", look=Lettering(GREY))
        return
    root, bevel = sizes
    for label in np.unique(drawn.label):
        uv = drawn.uv_mm[drawn.label == label]
        axes.points(uv[:, 0], uv[:, 1], ".", color=FACES[int(label)], markersize=3.2, alpha=0.6)
    size = float(high[1] - low[1])
    reach = max(0.0, 0.93 * (float(high[1]) - root))
    radius = min(0.4 * size, 0.7 * reach)
    _draw_lines(axes, root, bevel * DEG, reach)
    height, angle = (
        measured(float(one.value), float(one.u), digits)
        for one, digits in zip(section.sizes.values(), places, strict=True)
    )
    low, top = np.zeros(2), np.array([0.0, root])
    dimension(axes, (low, top), np.array([0.065 * size, 0.0]), f"{height} mm", size)
    dimension_angle(axes, top, bevel, f"({angle})°", radius)


def _draw_lines(axes: Axes, root: float, beta: float, reach: float) -> None:
    """Both fitted lines."""
    end = (-reach * math.tan(beta), root + reach)
    axes.plot([0, 0], [0, root], color=INK, linewidth=0.7)
    axes.plot([0, end[0]], [root, end[1]], color=INK, linewidth=0.7)
    axes.points([0, 0], [0, root], "o", color=INK, markersize=2.2)


def of_interest(inspection: JointInspection) -> Any:
    """Of the sections with most sizes measured the first with the worst verdict; the middle one where all are alike."""
    known = [sum(bool(np.isfinite(one.value)) for one in s.sizes.values()) for s in inspection.sections]
    full = [s for s, count in zip(inspection.sections, known, strict=True) if count == max(known)]
    several = len({s.verdict for s in full}) > 1
    worst = [s for verdict in ("fail", "undecided") for s in full if several and s.verdict == verdict]
    return worst[0] if worst else full[len(full) // 2]
