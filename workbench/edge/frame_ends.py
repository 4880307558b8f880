"""Where the root face ends in every frame, counted from its corner with the bevel face.

`broken_end` says how far the edge lies beyond, by its prior; `measure` and `steps` make one course of all frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import LOWER_SURFACE, ROOT_FACE, Cloud
from workbench.edge.directions import near_slope, wrapped
from workbench.edge.faces import TrackedFaces
from workbench.geometry.along import by_pass
from workbench.geometry.chains import FaceLines
from workbench.geometry.course import fit_course
from workbench.geometry.curves import Curve
from workbench.geometry.grids import columns_to_next
from workbench.geometry.poses import in_planes
from workbench.geometry.sections import SectionLines, crossing, in_section, section_lines
from workbench.units import Bool, Float, Int, Shaped

MIXED = 0.5  # probability that a mixed pixel stands in the place of the face's last return


@dataclass(frozen=True, slots=True, eq=False)
class RootEnds:
    """The end of the root face in N frames, counted from the frame's corner with the bevel face; NaN: not seen."""

    low: Shaped[Float, " N"]  # the face reaches at least to here, mm
    step: Shaped[Float, " N"]  # the next column would meet it this much further; 0: a corner with the lower surface, mm
    sigma: Shaped[Float, " N"]  # noise of `low`, mm
    missing: Shaped[Float, " N"]  # probability that a column at the end of the root face has no return on it


@dataclass(frozen=True, slots=True, eq=False)
class FaceCorner:
    """The corner of both faces in N frames, and their angles there."""

    tilt: Shaped[Float, " N"]  # direction of the root face, rad
    beta: Shaped[Float, " N"]  # bevel angle, rad
    up: Shaped[Float, " N"]  # distance along the root face to the corner, mm
    upper_s: Shaped[Float, " N"]  # arc length of the corner, mm
    lever: Shaped[Float, " N"]  # distance of the bevel's measured points from it, mm
    turns: Shaped[Float, "2 N"]  # what obliquity adds to the directions of root face and bevel face, rad


def root_ends(
    cloud: Cloud,
    tracked: TrackedFaces,
    curve: Curve,
    root: SectionLines,
    bevel: SectionLines,
    corner: FaceCorner,
    s: Float,
) -> RootEnds:
    """The end of the root face in every frame, counted from its corner with the bevel face.

    Where the lower surface is seen, the end is the corner with it, and the step 0.
    """
    tilt, beta = corner.tilt, corner.beta
    end = tracked.root_end
    point = in_planes(cloud.base_from_profiler, end[:, 0], end[:, 1])
    place = np.full((len(end), 2), np.nan)
    seen = np.isfinite(root.s) & np.isfinite(end[:, 0])
    _, place[seen] = in_section(point[seen], curve, root.s[seen])
    cosine, sine = np.cos(tilt), np.sin(tilt)
    (ray_m, ray_n), (off_m, off_n) = (
        (a * cosine + b * sine, b * cosine - a * sine) for a, b in (root.ray.T, (place - root.place).T)
    )
    down = off_m - off_n / ray_n * ray_m  # along the ray onto the line of all the face's points
    step = columns_to_next(cloud.z_mm, tracked.end_column) * end[:, 2] / np.hypot(1.0, root.run)
    down[tracked.end_is_cut] = np.nan
    root_share = (1.0 / np.tan(beta) + ray_m / ray_n) ** 2
    if tracked.end_is_corner.any():
        lower, lean = _lower_corner(cloud, tracked, curve, root, tilt, s)
        at_corner = tracked.end_is_corner & np.isfinite(lower)
        down, step = np.where(at_corner, lower, down), np.where(at_corner, 0.0, step)
        root_share = np.where(at_corner, (1.0 / np.tan(beta) - 1.0 / np.tan(lean)) ** 2, root_share)
    variance = root_share * root.offset_variance + bevel.offset_variance / np.sin(beta) ** 2
    return RootEnds(
        corner.up - down,
        step,
        np.sqrt(variance),
        missing_share(tracked.faces[ROOT_FACE], tracked.end_is_mixed, cloud.pass_index),
    )


def _lower_corner(
    cloud: Cloud, tracked: TrackedFaces, curve: Curve, root: SectionLines, tilt: Float, s: Float
) -> tuple[Float, Float]:
    """Distance along the root face to the corner with the lower surface (N,), mm; and the angle between both, rad."""
    slope = near_slope(tracked.faces[LOWER_SURFACE], s, cloud.pass_index)
    lower = section_lines(
        tracked.faces[LOWER_SURFACE],
        slope,
        cloud.base_from_profiler,
        tracked.side,
        tracked.range_sigma_mm[:, 3],
        curve,
        root.s,
    )
    apparent = wrapped(lower.angle - tilt)
    if not np.isfinite(lower.s + apparent + lower.angle_variance).any():
        return np.full(s.size, np.nan), np.full(s.size, np.nan)  # corners of a few frames, whose neighbours show none
    course = fit_course(lower.s, apparent, lower.angle_variance, cloud.pass_index)
    lean = course.value(np.where(np.isfinite(lower.s), lower.s, 0.0))
    return crossing(root.place, tilt, lower.place, tilt + lean), lean


def missing_share(face: FaceLines, mixed: Bool, pass_index: Int) -> Float:
    """Probability that a column of a face has no return on it (N,).

    The share inside the face, one value a pass; at its end MIXED in frames whose next column saw a `mixed` pixel (N,),
    which may have taken the place of the face's last return as well as of the first one behind it.
    """
    share = np.full(face.count.shape, np.nan)
    for of_pass in by_pass(pass_index):
        mine = of_pass[face.count[of_pass] > 2]
        inner = (face.columns[mine, 1] - face.columns[mine, 0] - 1).sum()
        if inner > 0:
            share[of_pass] = 1.0 - (face.count[mine] - 2).sum() / inner
    return np.where(mixed, MIXED, np.clip(share, 0.02, 0.6))
