"""A cloud without scan lines as an organised one: sliced across its edge, seen from where its faces show best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from workbench.artefacts import ROOT_FACE, Cloud, PointSet
from workbench.edge.faces import find_faces, key_readings
from workbench.edge.identify import WORST_SCORE, Candidate
from workbench.edge.measure import measure_edge
from workbench.edge.segment_cloud_direction import edge_direction
from workbench.edge.segment_cloud_grid import organised
from workbench.edge.segment_cloud_passes import passes_shown
from workbench.edge.segment_cloud_sheets import check_one_sheet
from workbench.errors import InputError
from workbench.geometry.curves import Curve, with_frame
from workbench.geometry.scan_traces import Traces
from workbench.geometry.slices import MOST_COLUMNS, Laid, cut, lay_out
from workbench.geometry.splines import Spline
from workbench.units import DEG, Bool, Float, Int

SAMPLE = 4000  # points whose neighbours tell how densely they lie
NEIGHBOURS = 16
THICKER = 1.5  # than one point a cell asks for: points on lines do not spread evenly over the slices
VIEWS = 24  # directions of sight that are tried, around the edge
TRIAL_SLICES, COARSE_SLICES, MOST_SLICES = 60, 240, 200_000
LEAST_SLICES, LEAST_CELLS, MOST_CELLS = 3, 10_000_000, 20  # a slicing's; a point's, beyond that
HIDDEN_MM, MOST_LOST = 5.0, 0.15  # a longer gap is a hidden stretch; share of slices lost in shorter ones
REACH_MM = 25.0  # of the cloud only this much on each side of the edge is sliced
PATH_STEP_MM = 0.5


@dataclass(frozen=True, slots=True)
class Nominal:
    """What the faces are told apart by."""

    root_mm: float
    bevel_deg: float


@dataclass(frozen=True, slots=True)
class Spacing:
    """How densely points lie on a surface."""

    width_mm: float  # between nearest neighbours: of a column
    thickness_mm: float  # of a slice that has one point a column


def slice_cloud(points: PointSet, nominal: Nominal) -> tuple[Cloud, Traces]:
    """The cloud sliced across its edge, and of which scanning passes its points show lines.

    First square to one direction, from the side that reads best as a milled edge; that gives the edge's course. Then
    square to that course, in slices and columns as wide as the points on the root face lie apart.
    """
    straight = _straight(points)
    step = spacing(points)
    view = best_view(points, straight, step, nominal)
    coarse = _sliced(points, straight, view, step, COARSE_SLICES)
    found = find_faces(coarse, nominal.root_mm, nominal.bevel_deg)
    check_agreement(coarse, found.seen)
    course = measure_edge(coarse, found).curve
    near = _near(points.points_mm, course)
    frame, column = np.nonzero(found.labels == ROOT_FACE)
    cloud = _sliced(points, near, view, spacing(points, _placed(coarse, frame, column)), MOST_SLICES)
    found = find_faces(cloud, nominal.root_mm, nominal.bevel_deg)
    check_one_sheet(cloud, found)
    check_agreement(cloud, found.seen)
    return cloud, passes_shown(near, view, cloud, found)


def check_agreement(cloud: Cloud, seen: Bool) -> None:
    """Refuse slices that lose the edge here and there: what they hold is no one surface.

    seen (N,): slices that show root face and bevel. Where a clamp hides the edge, they lack in one long stretch.
    """
    place = cloud.base_from_profiler[:, :3, 3]
    s = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1))])
    known = np.flatnonzero(seen)
    gap = np.diff(known)
    short = (gap > 1) & (np.diff(s[known]) < HIDDEN_MM)
    lost = float((gap[short] - 1).sum()) / max(1.0, float(known.size + (gap[short] - 1).sum()))
    if lost > MOST_LOST:
        words = f"{100 * lost:.0f} % of its slices lose the edge here and there: expected one surface"
        raise InputError(cloud.source, f"{words}; do its passes disagree? Give points in scan order or each pass alone")


def _straight(points: PointSet) -> Laid:
    """The points laid out along a straight line through their middle, in the direction of the edge."""
    along = edge_direction(points.points_mm, points.source)
    middle = points.points_mm.mean(axis=0)
    s = (points.points_mm - middle) @ along
    at = np.linspace(s.min(), s.max(), 8)
    spline = scipy.interpolate.make_interp_spline(at, middle + at[:, None] * along, k=3)
    course = with_frame(Spline(spline.t, spline.c), at)
    return lay_out(points.points_mm, course, s)


def _near(points_mm: Float, course: Curve) -> Laid:
    """The points within REACH_MM of the course, laid out along it."""
    at = np.arange(course.stations_mm[0], course.stations_mm[-1], PATH_STEP_MM)
    off, nearest = scipy.spatial.cKDTree(course.position(at)).query(points_mm, distance_upper_bound=REACH_MM)
    here = np.isfinite(off)
    return lay_out(points_mm[here], course, at[nearest[here]])


def spacing(points: PointSet, at_mm: Float | None = None) -> Spacing:
    """Median distance between neighbours, and what that leaves to the other direction by the density in the surface.

    Where points lie on lines the neighbours are those of the line, and the slices are as thick as the lines are apart.
    at_mm (k, 3): where to look; everywhere if None. Raises InputError where points repeat each other.
    """
    at = points.points_mm if at_mm is None else at_mm
    distance = scipy.spatial.cKDTree(points.points_mm).query(at[:: max(1, len(at) // SAMPLE)], k=NEIGHBOURS + 1)[0]
    width = float(np.median(distance[:, 1]))
    if not width > 0.0:
        raise InputError(points.source, "most points stand in the cloud more than once: expected each point once")
    area = float(np.median(np.pi * distance[:, -1] ** 2)) / NEIGHBOURS  # of the surface, a point
    return Spacing(width, max(THICKER * area / width, width))


def _sliced(points: PointSet, laid: Laid, view: Float, step: Spacing, most: int) -> Cloud:
    """At most `most` slices, evenly along the course."""
    first, length = float(laid.s.min()), float(np.ptp(laid.s))
    count = int(length / step.thickness_mm)
    if count < LEAST_SLICES:
        raise InputError(
            points.source,
            f"expected a cloud along an edge, found {length:.3g} mm of it with points "
            f"about {step.width_mm:.3g} x {step.thickness_mm:.3g} mm apart",
        )
    chosen = np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))
    at = np.asarray(first + step.thickness_mm * (chosen + 0.5), dtype=np.float64)
    columns = min(float(np.hypot(*np.ptp(laid.place, axis=0))) / step.width_mm, MOST_COLUMNS)
    if len(at) * columns > LEAST_CELLS + MOST_CELLS * len(laid.s):
        raise InputError(
            points.source,
            "points are too unevenly dense to be sliced: expected one scanned edge, about "
            f"evenly covered; most lie {step.width_mm:.3g} mm apart",
        )
    x, z, pose = cut(laid, view, at, step.thickness_mm, step.width_mm)
    return organised(points, x, z, pose, np.zeros(len(at), np.int64))


def best_view(points: PointSet, laid: Laid, step: Spacing, nominal: Nominal) -> Float:
    """Direction of sight (3,) from which slices read best as a milled edge: against the bisector of its two faces.

    Raises InputError where they do not from any.
    """
    _, a, b = laid.course.frame(np.zeros(1))
    best, score = None, 0.0
    for angle in np.arange(VIEWS) * 2.0 * np.pi / VIEWS:
        cloud = _sliced(points, laid, np.cos(angle) * a[0] + np.sin(angle) * b[0], step, TRIAL_SLICES)
        readings = key_readings(cloud, slice(None), nominal.root_mm, nominal.bevel_deg * DEG)[1]
        away = [[c for c in frame if c.sense > 0] for frame in readings]
        found = [min(those, key=lambda c: c.score) for those in away if those]
        total = sum(WORST_SCORE - c.score for c in found)
        if total > score:
            best, score = _between(found, cloud), total
    if best is None:
        raise InputError(
            points.source,
            "no edge in view: expected a root face next to a bevel face of "
            f"{nominal.bevel_deg:g} deg (a raw edge has none)",
        )
    return best


def _between(found: list[Candidate], cloud: Cloud) -> Float:
    """The direction (3,) against the bisector of both faces' outward normals."""
    slope = float(np.arctan(np.median([(c.root[0], c.bevel[0]) for c in found], axis=0)).mean())
    pose = cloud.base_from_profiler[len(cloud.base_from_profiler) // 2, :3]
    return np.asarray(np.cos(slope) * pose[:, 2] - np.sin(slope) * pose[:, 0])


def _placed(cloud: Cloud, frame: Int, column: Int) -> Float:
    """Grid points (k, 3) in the base."""
    pose = cloud.base_from_profiler[frame, :3]
    x, z = cloud.x_mm[frame, column, None], cloud.z_mm[frame, column, None]
    return pose[:, :, 3] + x * pose[:, :, 0] + z * pose[:, :, 2]
