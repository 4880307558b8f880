"""What a section of a milled edge shows in its own plane: its points, the fitted faces, the corners."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import BEVEL_FACE, Cloud, Edge, Section
from workbench.export.points import PointTable, point_table
from workbench.units import DEG, Float

OBLIQUE = 0.3  # a laser plane leans against the section by at most this much, in mm a mm
BEVEL_FALLBACK = 2.0  # times the root face: length of the bevel's line where none of its points is in the section


@dataclass(frozen=True, slots=True, eq=False)
class SectionShape:
    """A section in its plane: (normal, across), mm, from the lower edge. Lines are None where it was not measured."""

    section: Section
    points: PointTable
    place_mm: Float  # (n, 2) of the points
    root_line_mm: Float | None  # (2, 2) root face, from its lower edge to its upper edge
    bevel_line_mm: Float | None  # (2, 2) bevel face, from the root face's upper edge upwards


def section_shape(cloud: Cloud, edge: Edge, section: Section, thickness_mm: float, reach_mm: float) -> SectionShape:
    """The points within half a thickness of the section plane and `reach_mm` of the lower edge, and the fitted lines.

    The lines are those that the section's values say: the root face lies along `across`, the bevel leans from it by the
    bevel angle.
    """
    window = 0.5 * thickness_mm + OBLIQUE * reach_mm
    frames = np.flatnonzero(np.abs(edge.frame_arc_length_mm - section.arc_length_mm) <= window)
    table = point_table(cloud, edge, frames)
    off = table.position_mm - section.origin_mm
    place = np.stack([off @ section.normal, off @ section.across], axis=1)
    here = (np.abs(off @ section.tangent) <= 0.5 * thickness_mm) & (np.hypot(*place.T) <= reach_mm)
    table = PointTable(table.position_mm[here], table.face[here], table.frame[here], table.column[here])
    return SectionShape(section, table, place[here], *_lines(section, table, place[here]))


def _lines(section: Section, table: PointTable, place: Float) -> tuple[Float | None, Float | None]:
    if section.root_mm is None or section.bevel_deg is None:
        return None, None
    corner = np.array([0.0, section.root_mm])
    up = np.array([-np.sin(section.bevel_deg * DEG), np.cos(section.bevel_deg * DEG)])
    on_bevel = (place[table.face == BEVEL_FACE] - corner) @ up
    length = float(on_bevel.max(initial=0.0)) or BEVEL_FALLBACK * section.root_mm
    return np.array([[0.0, 0.0], corner]), np.array([corner, corner + length * up])
