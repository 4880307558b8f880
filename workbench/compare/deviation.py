"""`compare.deviation`: where and by how much a scan deviates from a scan, a mesh or a plan."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import scipy
from pydantic import Field

from workbench.artefacts import Chapter, Document, Edge
from workbench.compare.deviation_chapter import deviation_chapter
from workbench.compare.statistics import Summary, summarise
from workbench.compare.surface_values import Deviations, Registration, Surface
from workbench.compare.surfels import Surfels, neighbours, surfels
from workbench.compare.target import on_mesh
from workbench.errors import InputError
from workbench.geometry.fits_steps import across
from workbench.stage import stage
from workbench.strict_json import strict_json
from workbench.units import Float, Int

LEAST_PLACES = 20


@stage("compare.deviation")
def deviation(
    scan: Surface,
    reference: Surface,
    registration: Registration | None = None,
    edge: Edge | None = None,
    *,
    position_u_mm: Annotated[
        float,
        Field(
            ge=0, le=100, description="standard uncertainty of the scan's place along a normal, where none is fitted"
        ),
    ] = 0.1,
    spacing_mm: Annotated[float, Field(gt=0, le=50, description="between the places that are compared")] = 1.0,
    normal_mm: Annotated[float, Field(gt=0, le=50, description="diameter of what a normal is taken from")] = 2.0,
    projection_mm: Annotated[float, Field(gt=0, le=50, description="diameter of the cylinder that is averaged")] = 2.0,
    depth_mm: Annotated[float, Field(gt=0, le=100, description="largest deviation that is looked for")] = 1.0,
    sections: Annotated[int, Field(ge=1, le=999, description="count of sections along the part")] = 9,
    half_width_mm: Annotated[
        float, Field(gt=0, le=100, description="on each side of a section what counts for it")
    ] = 3.0,
) -> tuple[Deviations, Document, Chapter]:
    """Measure signed distances along the normal, positive outside the reference, each with its level of detection.

    M3C2 (Lague, Brodu and Leroux 2013): both surfaces are averaged in cylinders along the normal; a distance below the
    level of detection, 1.96 standard uncertainties, is no significant change. The uncertainty holds the noise of both
    scans, frames as a whole, and the registration. Whether anything changed at all is decided with 5 % false
    discoveries among all that is reported (Benjamini and Hochberg 1995).

    Args:
        scan: from `compare.surface`, as recorded.
        reference: from `compare.surface`, `compare.mesh` or `compare.plan`.
        registration: moves the scan; without it, both are taken as they lie in the base.
        edge: gives arc lengths; without it the plan's path does, or the scan's longest direction.
        position_u_mm: without a registration: what robot and fixture leave open (two scans of 0.07 mm an axis).
        spacing_mm: of the places.
        normal_mm: the normal's scale, D.
        projection_mm: the projection's scale, d.
        depth_mm: half the cylinder's length.
        sections: equidistant, as in `inspect.sections`.
        half_width_mm: of a section.

    Raises:
        InputError: hardly any place of the scan lies at the reference.

    Example:
        >>> from workbench import compare, path, scan
        >>> plan = compare.plan(path.read(toolpath="data/synthetic/paths/raw_arc.json"))
        >>> points = scan.fuse(scan.read(recording="data/synthetic/paths/raw_arc_milled.h5"))
        >>> *values, chapter = compare.deviation(compare.surface(points), plan)
        >>> chapter.title
        'Deviation from the reference'
    """
    scales = Scales(spacing_mm, normal_mm, projection_mm, depth_mm)
    laid = scan if registration is None else moved(scan, registration)
    places = places_of(laid, reference, scales)
    course = course_of(laid, reference, edge, places.normal.mean(axis=0))
    found = deviations(laid, reference, places, registration, position_u_mm, course, scales)
    what = "change" if reference.triangles is None else "deviation"
    summary = summarise(found, sections, half_width_mm, course.name, what, spacing_mm)
    if summary.compared < LEAST_PLACES:
        words = f"only {summary.compared} of {len(found.distance_mm)} places find the reference within {depth_mm:g} mm"
        raise InputError(
            scan.source or "compare.deviation",
            f"{words}: expected surfaces that lie on each other, and "
            "three frames or more in a cylinder (projection_mm)",
        )
    return (
        found,
        deviation_document(found, summary, scan, reference, registration, scales),
        deviation_chapter(found, summary, scan, reference, registration, position_u_mm),
    )


def moved(scan: Surface, registration: Registration) -> Surface:
    """The scan where the registration puts it."""
    pose = registration.reference_from_scan
    axis = None if scan.range_axis is None else pose[:3, :3] @ scan.range_axis
    return dataclasses.replace(scan, points_mm=scan.points_mm @ pose[:3, :3].T + pose[:3, 3], range_axis=axis)


# `deviation.json` (docs/comparison.md): strict JSON, mm.


def deviation_document(
    found: Deviations,
    summary: Summary,
    scan: Surface,
    reference: Surface,
    registration: Registration | None,
    scales: Scales,
) -> Document:
    """The file: the finding, statistics, sections, histogram, and every place."""
    content = {
        "format": "bevel-deviation",
        "version": 1,
        "frame": "base",
        "scan": scan.source,
        "reference": reference.source,
        "reference_kind": "scan"
        if reference.triangles is None
        else "plan"
        if reference.course_mm is not None
        else "mesh",
        "registered": registration is not None,
        "finding": summary.in_words,
        "changed": bool(summary.changed.any()),
        "compared": summary.compared,
        "mean_mm": summary.mean_mm,
        "rms_mm": summary.rms_mm,
        "percentiles_mm": {f"{k}": value for k, value in summary.percentiles_mm.items()},
        "significant_share": summary.significant,
        "level_of_detection_mm": summary.detectable_mm,
        "scales": dataclasses.asdict(scales),
        "arc_length_along": summary.along,
        "sections": [dataclasses.asdict(section) for section in summary.sections],
        "regions": [dataclasses.asdict(region) for region in summary.regions],
        "histogram": {"edges_mm": summary.edges_mm, "counts": summary.counts},
        "places": {
            "position_mm": found.position_mm.round(4),
            "normal": found.normal.round(6),
            "arc_length_mm": found.arc_length_mm.round(3),
            "distance_mm": found.distance_mm.round(5),
            "u_mm": found.u_mm.round(5),
            "level_of_detection_mm": found.detectable_mm.round(5),
            "changed": summary.changed,
        },
    }
    return Document("deviation.json", strict_json(content))


# Deviations of a registered scan from a reference at evenly spread places.


@dataclass(frozen=True, slots=True)
class Scales:
    """Of the comparison: between places; diameters of a normal's neighbourhood and of a cylinder; its reach."""

    spacing_mm: float
    normal_mm: float
    projection_mm: float
    depth_mm: float


def places_of(scan: Surface, reference: Surface, scales: Scales) -> Surfels:
    """Flat places of the scan; their normals point outwards as the reference's do where it is a mesh."""
    found = surfels(scan, scales.spacing_mm, 0.5 * scales.normal_mm)
    centre, normal = found.centre_mm[found.flat], found.normal[found.flat]
    if reference.triangles is not None and len(centre):
        turned = (on_mesh(reference)(centre)[1] * normal).sum(axis=1) < 0
        normal = np.where(turned[:, None], -normal, normal)
    return Surfels(centre, normal, np.ones(len(centre), bool))


def deviations(
    scan: Surface,
    reference: Surface,
    places: Surfels,
    registration: Registration | None,
    position_u_mm: float,
    course: Course,
    scales: Scales,
) -> Deviations:
    """M3C2 distances at places of a registered scan; NaN where one of the surfaces is missing."""
    position, normal, radius = places.centre_mm, places.normal, 0.5 * scales.projection_mm
    depth_mm = scales.depth_mm
    if reference.triangles is None:
        mine = heights(scan.points_mm, None, scan.frame, position, normal, radius, depth_mm)
        other = heights(reference.points_mm, None, reference.frame, position, normal, radius, depth_mm)
        distance, noise = mine.height_mm - other.height_mm, np.hypot(mine.u_mm, other.u_mm)
    else:
        foot, outward = on_mesh(reference)(scan.points_mm)
        off = ((scan.points_mm - foot) * outward).sum(axis=1)
        off[np.abs(off) > depth_mm] = np.nan
        mine = heights(scan.points_mm, off, scan.frame, position, normal, radius, depth_mm)
        distance, noise = mine.height_mm, mine.u_mm
    u = np.hypot(noise, position_u(registration, position, normal, position_u_mm))
    along, aside = course.locate(position)
    return Deviations(position, normal, distance, u, DETECTION * u, along, aside)


def position_u(registration: Registration | None, position_mm: Float, normal: Float, position_u_mm: float) -> Float:
    """(c,) what the registration's covariance makes along each normal; without one, the uncertainty that is stated."""
    if registration is None:
        return np.full(len(position_mm), position_u_mm)
    rows = np.hstack([normal, np.cross(position_mm - registration.pivot_mm, normal)])
    return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", rows, registration.covariance, rows)))


# Signed distances between a scan and a reference along normals, with their uncertainty.
#
# Multiscale model to model cloud comparison (Lague, Brodu and Leroux, "Accurate 3D comparison of complex topography
# with
# terrestrial laser scanner", ISPRS J. Photogramm. 82, 2013): the normal at one scale, the mean of each surface in a
# cylinder along it at another. Departures: the surface at the axis is that of a plane fitted in the cylinder, so
# that
# unequal sampling of a slope is no distance; points of one frame share the robot's error, so the noise of a mean is
# enlarged by what residuals of a frame have in common; and the registration's covariance at the place is added in
# quadrature (the paper adds one number linearly).

DETECTION = 1.959964  # two-sided 95 %
LEAST_POINTS = 8  # in a cylinder
LEAST_FRAMES = 3  # or single points: the plane takes up two of them along the motion
LEAST_LEVERAGE = 0.5  # of the intercept: beyond, points lie all to one side of the axis
BATCH = 2_000


@dataclass(frozen=True, slots=True, eq=False)
class Heights:
    """Where a surface meets the axes of c cylinders, along their normals; NaN: it does not."""

    height_mm: Float  # (c,)
    variance_mm2: Float  # (c,) of the height, as if all points were independent
    shared_mm2: Float  # (c,) the same by the frames' sums
    leverage: Float  # (c,) variance of the height for an error of unit variance that each frame has as a whole

    @property
    def u_mm(self) -> Float:
        """(c,) standard uncertainty; the variance of what a frame's points share is one for the whole surface."""
        good = np.isfinite(self.variance_mm2)
        excess = float((self.shared_mm2 - self.variance_mm2)[good].sum())
        of_frame = max(0.0, excess / float(self.leverage[good].sum())) if good.any() else 0.0
        return np.asarray(np.sqrt(self.variance_mm2 + of_frame * self.leverage))


def heights(
    points_mm: Float,
    values: Float | None,
    frame: Int | None,
    position_mm: Float,
    normal: Float,
    radius_mm: float,
    depth_mm: float,
) -> Heights:
    """The surface of points (n, 3) in cylinders about axes through `position_mm` along `normal`, both (c, 3).

    `values` (n,): what to average instead of the height over the position, such as distances from a mesh (NaN: none).
    `frame` (n,) in which each point was measured.
    """
    tree = scipy.spatial.cKDTree(points_mm)
    parts = [
        _batch(points_mm, values, frame, tree, position_mm[k : k + BATCH], normal[k : k + BATCH], radius_mm, depth_mm)
        for k in range(0, len(position_mm), BATCH)
    ]
    return Heights(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _batch(
    points: Float,
    values: Float | None,
    frame: Int | None,
    tree: scipy.spatial.cKDTree,
    position: Float,
    normal: Float,
    radius: float,
    depth: float,
) -> tuple[Float, ...]:
    index, start = neighbours(tree, position, float(np.hypot(radius, depth)))
    owner = np.repeat(np.arange(len(position)), np.diff(start))
    off = points[index] - position[owner]
    height = (off * normal[owner]).sum(axis=1)
    aside = off - height[:, None] * normal[owner]
    what = height if values is None else values[index]
    inside = ((aside**2).sum(axis=1) <= radius**2) & (np.abs(height) <= depth) & np.isfinite(what)
    index, owner, aside, what = index[inside], owner[inside], aside[inside], what[inside]
    across_axes = across(normal)[owner] / radius
    design = np.column_stack([np.ones(len(owner)), np.einsum("nij,nj->ni", across_axes, aside)])
    return _intercepts(design, what, owner, index if frame is None else frame[index], len(position))


def _intercepts(design: Float, what: Float, owner: Int, cluster: Int, count: int) -> tuple[Float, ...]:
    """Planes (1, u, v) through `what` of each owner: the intercept, and what `Heights` says of it."""
    moments = np.empty((count, 3, 3))
    side = np.empty((count, 3))
    for i in range(3):
        side[:, i] = np.bincount(owner, design[:, i] * what, count)
        for j in range(3):
            moments[:, i, j] = np.bincount(owner, design[:, i] * design[:, j], count)
    number = np.bincount(owner, minlength=count)
    good = (number >= LEAST_POINTS) & (np.linalg.det(moments) > 1e-6 * np.maximum(number, 1.0) ** 3)
    moments[~good] = np.eye(3)
    inverse = np.linalg.inv(moments)
    plane = np.einsum("kij,kj->ki", inverse, side)
    residual = what - (design * plane[owner]).sum(axis=1)
    spread = np.bincount(owner, residual**2, count) / np.maximum(number - 3, 1)
    pull = (inverse[owner, 0] * design).sum(axis=1)
    group, first = _groups(owner, cluster)
    frames = np.bincount(owner[first], minlength=count)
    shared = (
        np.bincount(owner[first], np.bincount(group, pull * residual) ** 2, count) * frames / np.maximum(frames - 2, 1)
    )
    good &= (inverse[:, 0, 0] <= LEAST_LEVERAGE) & (frames >= LEAST_FRAMES)
    leverage = np.bincount(owner[first], np.bincount(group, pull) ** 2, count)
    found = plane[:, 0], spread * inverse[:, 0, 0], shared, leverage
    return tuple(np.where(good, one, np.nan) for one in found)


def _groups(owner: Int, cluster: Int) -> tuple[Int, Int]:
    """A number for every pair of owner and cluster, and where each first occurs."""
    key = owner * (int(cluster.max(initial=0)) + 1) + cluster
    _, first, group = np.unique(key, return_index=True, return_inverse=True)
    return group, first


# Where places lie along the part: arc length on a course, and across it as seen from outside.


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
