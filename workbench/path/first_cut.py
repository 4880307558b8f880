"""Where a path milled an edge, found on the edge as it was measured afterwards."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Edge, Toolpath
from workbench.errors import InputError
from workbench.geometry.stations import nearest_stations
from workbench.path.course import lower_course
from workbench.path.obstacles import sections_of
from workbench.path.plan import cut_stretches
from workbench.path.poses import poses_of
from workbench.units import Bool, Float


def thickness_before(edge: Edge, toolpath: Toolpath) -> tuple[Float, Float]:
    """Arc lengths (g,) and the stock's thickness there: where the plan's finished bevel met the upper surface."""
    final = toolpath.layers[-1]
    if not final.cutting.any():
        raise InputError("toolpath", "expected a path that cuts something")
    poses = poses_of(toolpath, final)
    top = (poses.origin_mm - 0.5 * final.width_mm[:, None] * poses.z)[final.cutting]
    arc, height = _along(edge, top, final.arc_length_mm[final.cutting])
    order = np.argsort(arc)
    return arc[order], height[order]


def _along(edge: Edge, points: Float, guess_mm: Float) -> tuple[Float, Float]:
    """Arc length (k,) and height (k,) over the lower edge, in the measured edge's sections, of points (k, 3)."""
    guess = np.clip(np.rint(guess_mm), 0, len(edge.arc_length_mm) - 1).astype(np.int64)
    _, arc, section = nearest_stations(points, guess, sections_of(lower_course(edge, edge.arc_length_mm)))
    return arc, section[:, 1]


def unmilled(edge: Edge, toolpath: Toolpath) -> Bool:
    """Stations (n,) within a cutter's radius of where the path did not cut: what is measured there is no bevel."""
    final, radius = toolpath.layers[-1], toolpath.cutter.diameter_mm / 2.0
    arc, _ = _along(edge, poses_of(toolpath, final).origin_mm, final.arc_length_mm)
    inside = (final.arc_length_mm >= 0.0) & (final.arc_length_mm <= toolpath.edge_length_mm)
    out = np.zeros(len(edge.arc_length_mm), bool)
    for a, b in cut_stretches(arc, inside & ~final.cutting):
        out |= (edge.arc_length_mm > a - radius) & (edge.arc_length_mm < b + radius)
    return out
