"""How the points of a scene are coloured: by face, and by how far they lie outside the faces that they belong to."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Cloud, Edge, Shading
from workbench.report.colours import GREY, face_shades, rgb
from workbench.report.deviations import outside_mm, round_limit
from workbench.report.sample import Points, frame_arc_length_mm
from workbench.report.unrolled_edge import developed
from workbench.units import DEG, Float

BELOW, NONE, ABOVE = "#1f5fa8", "#e4e1d6", "#b3261e"  # too little material, as it should be, too much
UNKNOWN = 255  # the palette's last row: no deviation known here
STEPS = 127  # colours on each side of zero
GAP_MM = 3.0  # values along the edge are interpolated between places that are so close
Along = Callable[[Float], Float]  # a value by arc length, NaN where it is not known


def by_face(points: Points, names: list[tuple[str, str]]) -> Shading:
    """Each face in its colour; `names` and colours of the faces that are there."""
    return Shading("face", points.label.astype(np.uint8), face_shades(), tuple(names))


def by_deviation(name: str, points: Points, laid: Float, root_mm: Along, bevel_deg: Along) -> Shading:
    """How far root and bevel face lie outside faces of that root face and bevel angle, which go with the arc length."""
    off = deviation_mm(points, laid, root_mm, bevel_deg)
    known = np.isfinite(off)
    limit = round_limit(np.abs(off[known])) if known.any() else 0.05
    index = np.full(len(off), UNKNOWN, np.uint8)
    index[known] = np.round((np.clip(off[known] / limit, -1.0, 1.0) + 1.0) * STEPS)
    palette = np.vstack([_diverging(), [rgb(GREY)]])
    return Shading(name, index, palette.astype(np.uint8), _legend(limit, palette))


def laid_out_faces(points: Points, cloud: Cloud, edge: Edge) -> Float:
    """(n, 3) arc length, u and v of the points of root and bevel face; NaN for all others."""
    face = np.isin(points.label, (ROOT_FACE, BEVEL_FACE))
    laid = np.full((len(face), 3), np.nan)
    laid[face] = developed(points.position_mm[face], frame_arc_length_mm(cloud, edge)[points.frame[face]], edge)
    return laid


def deviation_mm(points: Points, laid: Float, root_mm: Along, bevel_deg: Along) -> Float:
    """(n,) distance outwards from the faces; NaN off root and bevel face, and where root or angle are not known.

    laid: from `laid_out_faces`.
    """
    off = np.full(len(points.label), np.nan)
    face = np.flatnonzero(np.isfinite(laid[:, 0]))
    s, uv = laid[face, 0], laid[face, 1:]
    off[face] = outside_mm(uv, points.label[face] == BEVEL_FACE, root_mm(s), bevel_deg(s) * DEG)
    return off


def along(arc_length_mm: Float, value: Float) -> Along:
    """Values (k,) interpolated between places near to each other; NaN in gaps and beyond the ends."""
    known = np.isfinite(arc_length_mm) & np.isfinite(value)
    order = np.argsort(arc_length_mm[known])
    s, values = arc_length_mm[known][order], value[known][order]
    gaps = np.flatnonzero(np.diff(s) > GAP_MM) + 1
    s_all, all_values = np.insert(s, gaps, s[gaps] - 1e-6), np.insert(values, gaps, np.nan)

    def at(where_mm: Float) -> Float:
        if not len(s):
            return np.full(len(where_mm), np.nan)
        near = np.clip(where_mm, s[0] - 1.0, s[-1] + 1.0) == where_mm  # the ends are not cut off to a hair
        found: Float = np.interp(where_mm, s_all, all_values)
        return np.where(near, found, np.nan)

    return at


def always(value: float) -> Along:
    """One value all along the edge."""
    return lambda where_mm: np.full(len(where_mm), value)


def _diverging() -> Float:
    """(2 STEPS + 1, 3) red, green, blue from below over none to above."""
    ends = np.array([rgb(BELOW), rgb(NONE), rgb(ABOVE)], float)
    at = np.linspace(0.0, 2.0, 2 * STEPS + 1)
    return np.stack([np.interp(at, np.arange(3.0), ends[:, k]) for k in range(3)], axis=1)


def _legend(limit_mm: float, palette: Float) -> tuple[tuple[str, str], ...]:
    texts = (f"−{limit_mm:g} mm or less", f"−{limit_mm / 2:g}", "0", f"+{limit_mm / 2:g}", f"+{limit_mm:g} mm or more")
    rows = np.linspace(0, 2 * STEPS, len(texts)).round().astype(int)
    shown = [
        (text, "#{:02x}{:02x}{:02x}".format(*palette[row].astype(int))) for text, row in zip(texts, rows, strict=True)
    ]
    return (*shown, ("not assessed", GREY))
