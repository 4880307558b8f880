"""A section's points in its own plane, and how far they lie from the two lines that the reported values make."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud, Edge, Section
from workbench.report.colours import FACES, GREY, INK
from workbench.report.plot import Axes
from workbench.report.sample import frame_arc_length_mm, of_section
from workbench.report.unrolled_edge import in_section
from workbench.units import DEG, AnyArray, Bool, Float, Shaped

STRIP = (0.13, 0.1, 0.27, 0.16)  # the strip's place in a section's panel, inside the material


@dataclass(frozen=True, slots=True, eq=False)
class LaidOut:
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
    section = drawn.section
    if section.root_mm is None or section.bevel_deg is None:
        return None
    root, beta = section.root_mm, section.bevel_deg * DEG
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


def deviation_limit(all_drawn: list[LaidOut]) -> float:
    """Half height of the strips, mm: all but the farthest points, to the next 1, 2 or 5."""
    found = [np.abs(d[1]) for d in map(deviations, all_drawn) if d is not None and len(d[1])]
    return round_limit(np.concatenate(found)) if found else 0.05


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
    strip.set(ylim=(-limit, limit), xlim=(min(0.0, float(along.min())), float(along.max())), xticks=[])
    strip.set_yticks([-limit, 0.0, limit], [f"−{limit:g}", "0", f"{limit:g}"])
    strip.tick_params(labelsize=6.5, length=2, pad=1.5)
    strip.spine_hidden = True
    for face in (ROOT_FACE, BEVEL_FACE):
        of_face = label == face
        strip.plot(
            along[of_face],
            off[of_face],
            ".",
            color=FACES[face],
            markersize=1.4,
            alpha=0.6,
        )
    strip.axhline(0.0, color=INK, linewidth=0.5)
    strip.set_title("deviation, mm", fontsize=6.5, color=GREY, pad=2)
