"""Views of an inspection: the whole edge with its section planes, and a close-up of one section."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud, Edge, Inspection, Section
from workbench.report.colours import VERDICTS, face_shades, rgb
from workbench.report.sample import Points, around, overview
from workbench.report.scene import View, towards
from workbench.units import Float

CLOSE_UP_MM = 14.0  # half the stretch of edge in the close-up
SLAB_MM = 5.0  # a section plane is made as large as the faces are within this distance of it
MARGIN = 1.4  # of a section plane's size over the root and the bevel face


def section_views(cloud: Cloud, edge: Edge, inspection: Inspection, budget: int) -> dict[str, View]:
    """`overview`: the whole edge; `close_up`: the section that matters most; each of about `budget` points."""
    section = of_interest(inspection)
    whole = overview(cloud, edge, budget)
    near = around(cloud, edge, section.arc_length_mm, CLOSE_UP_MM, budget)
    length = float(np.ptp(edge.arc_length_mm))
    return {
        "overview": _view(whole, inspection.sections, section, look=(-0.5, 0.8, 0.45), plane_mm=length / 22),
        "close_up": _view(near, (section,), section, look=(-0.62, 0.75, 0.42), axes_length_mm=4.0),
    }


def of_interest(inspection: Inspection) -> Section:
    """The first measured section that fails, else the first that is undecided, else the middle one."""
    measured = [s for s in inspection.sections if s.root_mm is not None] or list(inspection.sections)
    for verdict in ("fail", "undecided"):
        for section in measured:
            if section.verdict == verdict:
                return section
    return measured[len(measured) // 2]


def _view(
    points: Points,
    sections: tuple[Section, ...],
    origin: Section,
    *,
    look: tuple[float, float, float],
    plane_mm: float = 0.0,
    axes_length_mm: float = 0.0,
) -> View:
    """`look`: towards the viewer in t, n, m; `plane_mm`: least size of a section plane, to be seen on a long edge."""
    axes = np.array([origin.tangent, origin.normal, origin.across])
    return View(
        points_mm=points.position_mm - origin.origin_mm,
        colour=face_shades()[points.label],
        planes_mm=plane_corners(points, sections, plane_mm) - origin.origin_mm,
        plane_colour=np.array([rgb(VERDICTS[s.verdict]) for s in sections], dtype=np.uint8),
        names=tuple(str(s.index) for s in sections),
        axes=axes,
        look=towards(axes, look),
        axes_length_mm=axes_length_mm,
    )


def plane_corners(points: Points, sections: tuple[Section, ...], least_mm: float = 0.0) -> Float:
    """(k, 4, 3) corners of the sections' planes in the base: a little larger than the faces, at least `least_mm`."""
    low, high = faces_extent(points, sections)
    half = np.maximum((high - low) / 2 * MARGIN, least_mm / 2)
    corners = (low + high) / 2 + half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return np.array([s.origin_mm + corners @ np.array([s.normal, s.across]) for s in sections])


def faces_extent(points: Points, sections: tuple[Section, ...]) -> Float:
    """(2, 2) lowest and highest (u, v) of root and bevel face, as most sections have them."""
    faces = points.position_mm[np.isin(points.label, (ROOT_FACE, BEVEL_FACE))]
    sizes = [size for size in (_faces_about(faces, section) for section in sections) if size is not None]
    return np.median(sizes, axis=0) if sizes else np.array([[-5.0, 0.0], [0.0, 5.0]])


def _faces_about(faces_mm: Float, section: Section) -> Float | None:
    """(2, 2) lowest and highest (u, v) of root and bevel face near a section plane; None where there are none."""
    at = faces_mm @ section.tangent - section.origin_mm @ section.tangent
    near = np.flatnonzero(np.abs(at) < SLAB_MM)
    if not len(near):
        return None
    uv = (faces_mm[near] - section.origin_mm) @ np.column_stack([section.normal, section.across])
    return np.array([uv.min(axis=0), uv.max(axis=0)])
