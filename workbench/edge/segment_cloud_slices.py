"""A cloud without a grid as an organised one: sliced across its edge, seen from where its faces show best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import make_interp_spline
from scipy.spatial import cKDTree

from workbench.artefacts import Cloud, PointSet
from workbench.edge.faces import key_readings
from workbench.edge.identify import WORST_SCORE, Candidate
from workbench.errors import InputError
from workbench.geometry.chains import noise_sigma
from workbench.geometry.curves import Curve, with_frame
from workbench.geometry.outliers import reject_outliers
from workbench.geometry.slices import cut, lay_out
from workbench.units import Float, Float32, Int

NEIGHBOURS = 16
SAMPLE = 4000  # points whose neighbours tell how densely they lie
VIEWS = 24  # directions of sight that are tried, around the edge
TRIAL_SLICES, COARSE_SLICES = 24, 240
MOST_COLUMNS, MOST_FRAMES = 4000, 200_000
REACH_MM = 25.0  # of the cloud only this much on each side of the edge is sliced
NOISE_SIGMAS, LEAST_TOLERANCE_MM, JUMP_MM, WINDOW = 9.0, 0.06, 1.0, 5  # of stray points, as cloud.denoise has them


@dataclass(frozen=True, slots=True)
class Spacing:
    """How densely points lie on a surface."""

    width_mm: float  # between nearest neighbours: of a column
    thickness_mm: float  # of a slice that has one point a column


def spacing(points_mm: Float, at_mm: Float | None = None) -> Spacing:
    """Median distance between neighbours, and what that leaves to the other direction by the density in the surface.

    On scan lines the neighbours are those of the line, and the slices are as thick as the lines are apart. at_mm (k, 3):
    where to look; everywhere if None.
    """
    at = points_mm if at_mm is None else at_mm
    chosen = at[:: max(1, len(at) // SAMPLE)]
    distance = cKDTree(points_mm).query(chosen, k=NEIGHBOURS + 1)[0]
    width = float(np.median(distance[:, 1]))
    area = float(np.median(np.pi * distance[:, -1] ** 2)) / NEIGHBOURS  # of the surface, a point
    return Spacing(width, max(area / width, width))


def straight_course(points_mm: Float, along: Float) -> Curve:
    """The straight line through the middle of the points (n, 3), as a course in direction `along` (3,)."""
    middle = points_mm.mean(axis=0)
    s = (points_mm - middle) @ along
    at = np.linspace(s.min(), s.max(), 8)
    spline = make_interp_spline(at, middle + at[:, None] * along, k=3)
    return with_frame(spline, at, np.inf, 0.0)


def sliced(points: PointSet, near: Float, s: Float, course: Curve, view: Float, step: Spacing, most: int) -> Cloud:
    """An organised cloud of at most `most` slices of points (k, 3) `near` the course, stray ones rejected."""
    laid = lay_out(near, course, s, view)
    count = int(np.ptp(laid.s) / step.thickness_mm)
    if count < 3:
        raise InputError(points.source, "expected a cloud along an edge, found "
                         f"{np.ptp(laid.s):.3g} mm of it with points {step.width_mm:.3g} mm apart")  # fmt: skip
    at = laid.s.min() + step.thickness_mm * (0.5 + np.unique(np.linspace(0, count - 1, min(count, most)).astype(int)))
    width = max(step.width_mm, float(np.ptp(laid.x)) / MOST_COLUMNS)
    slices = cut(laid, course, at, step.thickness_mm, width)
    return organised(points, slices.x_mm, slices.z_mm, slices.base_from_profiler, np.zeros(len(at), np.int64))


def organised(points: PointSet, x_mm: Float32, z_mm: Float32, base_from_profiler: Float, pass_index: Int) -> Cloud:
    """An organised cloud with the stray returns rejected as `cloud.denoise` does."""
    keep = np.isfinite(x_mm)
    frames = len(keep)
    some = np.unique(np.linspace(0, frames - 1, 60).astype(int))
    noise = [noise_sigma(z_mm[i][keep[i]].astype(np.float64)) for i in some if keep[i].sum() > 12]
    tolerance = max(LEAST_TOLERANCE_MM, NOISE_SIGMAS * float(np.median(noise)) if noise else 0.0)
    keep, isolated, streaks = reject_outliers(z_mm, keep, pass_index, tolerance, WINDOW, JUMP_MM)
    return Cloud(x_mm, z_mm, keep, base_from_profiler, np.arange(frames, dtype=np.float64), pass_index,
                 source=points.source, part_id=points.part_id,
                 rejected={"isolated returns": isolated, "short streaks": streaks})  # fmt: skip


def views(along: Float) -> Float:
    """Directions (VIEWS, 3) square to `along`, evenly around it."""
    a = np.cross(along, np.eye(3)[np.argmin(np.abs(along))])
    a /= np.linalg.norm(a)
    angle = np.arange(VIEWS) * 2.0 * np.pi / VIEWS
    return np.asarray(np.cos(angle)[:, None] * a + np.sin(angle)[:, None] * np.cross(along, a))


def best_view(points: PointSet, course: Curve, along: Float, step: Spacing, root_nominal_mm: float,
              bevel_nominal: float) -> Float:  # fmt: skip
    """Direction of sight (3,) from which the slices read best as a milled edge: between its two faces."""
    s = (points.points_mm - course.position(np.zeros(1))) @ along
    best, score = None, 0.0
    for view in views(along):
        cloud = sliced(points, points.points_mm, s, course, view, step, TRIAL_SLICES)
        readings = key_readings(cloud, slice(None), root_nominal_mm, bevel_nominal)[1]
        found = [
            min(those, key=lambda c: c.score) for frame in readings if (those := [c for c in frame if c.sense > 0])
        ]
        total = sum(WORST_SCORE - c.score for c in found)
        if total > score:
            best, score = _between(found, cloud), total
    if best is None:
        raise InputError(points.source, "no edge in view: expected a root face next to a bevel face")
    return best


def _between(found: list[Candidate], cloud: Cloud) -> Float:
    """The direction against the bisector of both faces' outward normals."""
    slope = np.arctan(np.median([(c.root[0], c.bevel[0]) for c in found], axis=0)).mean()
    pose = cloud.base_from_profiler[len(cloud.base_from_profiler) // 2, :3]
    return np.asarray(np.cos(slope) * pose[:, 2] - np.sin(slope) * pose[:, 0])
