"""Where places lie along the part: arc length on a course, and across it as seen from outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.artefacts import Edge
from workbench.compare.surface_values import Surface
from workbench.units import Float


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A polyline with arc length, and the direction from which the part is looked at."""

    points_mm: Float  # (m, 3)
    arc_length_mm: Float  # (m,)
    tangent: Float  # (m, 3)
    view: Float  # (3,) unit, outwards
    name: str  # what it is, in words

    def locate(self, position_mm: Float) -> tuple[Float, Float]:
        """Arc length and distance across (c,) of places (c, 3)."""
        near = scipy.spatial.cKDTree(self.points_mm).query(position_mm)[1]
        off, t = position_mm - self.points_mm[near], self.tangent[near]
        side = np.cross(t, self.view)
        side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
        return self.arc_length_mm[near] + (off * t).sum(axis=1), (off * side).sum(axis=1)


def course_of(scan: Surface, reference: Surface, edge: Edge | None, view: Float) -> Course:
    """The measured lower edge if there is one, else the plan's, else the longest direction of the scan."""
    if edge is not None:
        seen = np.isfinite(edge.position_mm).all(axis=1)
        return Course(edge.position_mm[seen], edge.arc_length_mm[seen], edge.tangent[seen], view, "the lower edge")
    points, name = reference.course_mm, "the planned path"
    if points is None or len(points) < 2:
        points, name = _longest(scan.points_mm), "the scan's longest direction"
    step = np.diff(points, axis=0)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(step, axis=1))])
    tangent = np.gradient(points, axis=0)
    return Course(points, arc, tangent / np.linalg.norm(tangent, axis=1, keepdims=True), view, name)


def _longest(points_mm: Float) -> Float:
    """A straight course through points (n, 3), from end to end in steps of about 1 mm."""
    middle = points_mm.mean(axis=0)
    direction = np.linalg.svd(points_mm[:: max(1, len(points_mm) // 5000)] - middle, full_matrices=False)[2][0]
    along = (points_mm - middle) @ direction
    at = np.linspace(along.min(), along.max(), max(2, int(np.ptp(along)) + 1))
    return np.asarray(middle + at[:, None] * direction)
