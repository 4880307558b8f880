"""Is this the end face of a raw plate at all? What it must satisfy before a path rests on it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from workbench.artefacts import ROOT_FACE, UPPER_SURFACE, Check, Cloud
from workbench.checks.corners import LEAST_FRAMES
from workbench.checks.faces import LEAST_POINTS, SAMPLE, direction, rising
from workbench.checks.judge import refuse_failed
from workbench.checks.levels import step_share
from workbench.checks.limits import Bound, check
from workbench.checks.sensor import some
from workbench.checks.straightness import straight_checks, straightness
from workbench.units import DEG, AnyArray

STEP_FROM_MM = 0.15  # beside the end face, from which on a return is not its own
# A second face behind the first: how much of it is looked at, and by how much it may lean to the first.
WALL_MM, WALL_LEAN = 1.5, 20.0 * DEG


def require_end_face(
    cloud: Cloud,
    labels: AnyArray,
    upper_side: Sequence[float],
    goes_on_share: float,
    limits: Mapping[str, Bound] | None = None,
) -> tuple[Check, ...]:
    """Checks of what was found as the end face (labels (N, M), ROOT_FACE) of a raw plate.

    A plate's end runs along `upper_side`, no further surface leads on from it, and it is straight but for its
    roughness. Root face and bevel of an edge that is prepared already are none of these.

    Args:
        cloud: organised.
        labels: faces of its points.
        upper_side: from the lower to the upper side, in the base.
        goes_on_share: of the frames, in which a further surface leads on from one of its ends.
        limits: limits to set by name.

    Raises:
        InputError: what was found is no end face of a raw plate.
    """
    rows = np.flatnonzero((labels == ROOT_FACE).any(axis=1))
    rows = some(rows, SAMPLE) if len(rows) else rows
    wished = np.asarray(upper_side, dtype=float)
    seen = [_lean(cloud, labels[i], int(i), wished / np.linalg.norm(wished)) for i in rows]
    leans = [lean for lean in seen if lean is not None]
    lean = float(np.median(leans)) / DEG if len(leans) >= LEAST_FRAMES else None
    shape = {ROOT_FACE: straightness(cloud, labels, ROOT_FACE)}
    stepped, step_mm = max((step_share(cloud, labels, rows, way) for way in (1, -1)), key=lambda one: one[0] or 0.0)
    further = f"in {100 * goes_on_share:.0f} % of the frames a further surface begins where what would be the end face "
    further += "ends, and leads on for more than its rounded edge would: a bevel above or below it?"
    prepared = "are axes mirrored or orientations wrong, or is this an edge that is prepared already (edge.segment)?"
    behind = float(np.mean([_behind(cloud, labels[i], int(i)) for i in rows])) if len(rows) >= LEAST_FRAMES else None
    finding = f"in {100 * (behind or 0.0):.0f} % of the frames a second face rises behind what would be the end face, "
    finding += "where the surface above it ends: a plate that lies on a strip, whose own end face stands in front?"
    checks = (
        check(
            "end_face_lean_deg",
            lean,
            f"what would be the end face leans by {lean or 0.0:.0f} deg from upper_side: {prepared}",
            given=limits,
        ),
        *straight_checks(shape, {}, prepared.rstrip("?"), limits),
        check(
            "step_share",
            stepped,
            f"in {100 * (stepped or 0.0):.0f} % of the frames returns run parallel to what would be the end face, "
            f"{step_mm:.2f} mm beside it, beyond one of its ends: a step, an undercut, a second plate, a backing "
            "strip?",
            given=limits,
        ),
        check("goes_on_share", goes_on_share, further, given=limits),
        check("face_behind_share", behind, finding, given=limits),
    )
    refuse_failed(checks, f"{cloud.source}: no raw edge", "edge.segment_raw.limits")
    return checks


def edge_break_check(size_mm: float, limits: Mapping[str, Bound] | None = None) -> Check:
    """The check that what ends a face is its rounded or chamfered edge, of this size, and no further face."""
    finding = (
        f"beyond its end the face is rounded or chamfered by {size_mm:.2g} mm: a bevel below it, a face of its own?"
    )
    return check("edge_break_mm", size_mm, finding, given=limits)


def _behind(cloud: Cloud, labels: AnyArray, i: int) -> bool:
    """Does a second face rise where the surface above frame i's end face ends, along the first?"""
    x, z = cloud.x_mm[i].astype(np.float64), cloud.z_mm[i].astype(np.float64)
    kept = np.flatnonzero(cloud.keep[i])
    on, upper = (np.flatnonzero((labels == label) & cloud.keep[i]) for label in (ROOT_FACE, UPPER_SURFACE))
    if min(len(on), len(upper)) < LEAST_POINTS:
        return False
    sign = rising(x[kept])
    at, along = direction(x[on], z[on], sign), direction(x[upper], z[upper], sign)
    turn = np.array([-np.sin(along) * sign, np.cos(along)])  # square to the upper surface
    height = (x - np.median(x[upper])) * turn[0] + (z - np.median(z[upper])) * turn[1]
    height *= -np.sign(np.median(height[on]))
    beyond = kept[kept > upper[-1]] if upper[0] > on[0] else kept[kept < upper[0]][::-1]
    wall = beyond[height[beyond] > STEP_FROM_MM]
    wall = wall[np.hypot(x[wall] - x[wall[:1]], z[wall] - z[wall[:1]]) < WALL_MM]
    if len(wall) < LEAST_POINTS:
        return False
    wall = np.sort(wall)
    return bool(abs(direction(x[wall], z[wall], sign) - at) < WALL_LEAN)


def _lean(cloud: Cloud, labels: AnyArray, i: int, upper_side: AnyArray) -> float | None:
    """Angle (rad) between a frame's end face and `upper_side` in the laser plane."""
    x, z = cloud.x_mm[i].astype(np.float64), cloud.z_mm[i].astype(np.float64)
    on = np.flatnonzero((labels == ROOT_FACE) & cloud.keep[i])
    if len(on) < LEAST_POINTS:
        return None
    sign = rising(x[cloud.keep[i]])
    at = direction(x[on], z[on], sign)
    wished = upper_side @ cloud.base_from_profiler[i, :3, [0, 2]].T
    size = float(np.linalg.norm(wished))
    along = abs(float(wished @ np.array([sign * np.cos(at), np.sin(at)]))) / size if size > 0 else 0.0
    return float(np.arccos(min(along, 1.0)))
