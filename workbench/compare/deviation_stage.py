"""`compare.deviation`: where and by how much a scan deviates from a scan, a mesh or a plan."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Annotated, NamedTuple

import numpy as np
import scipy
from pydantic import Field

from workbench.artefacts import Chapter, Document, Edge
from workbench.artefacts.evidence import UNSEEN
from workbench.compare.deviation_chapter import deviation_chapter
from workbench.compare.local_planes import SAME_SIDE, Surfels, Target, heights, surfels, target_of
from workbench.compare.statistics import Summary, median, path_error_u, summarise
from workbench.compare.surface_stage import Deviations, Registration, Surface
from workbench.errors import InputError
from workbench.geometry.poses import mapped
from workbench.result_files import result_file
from workbench.stage import stage
from workbench.units import Float, Shaped

LEAST_PLACES = 20
MUCH = 0.3  # share of the places that lie further off than was searched: no part is milled so far off
DETECTION = 1.959964  # two-sided 95 %
ROOT_2 = math.sqrt(2.0)  # two passes that err alike lie so many times their standard uncertainty apart
PATH = "errors of the path that all faces share"
ONE_FACE = (
    "one face is compared, faces at right angles, or less than 12 mm of the part: a change cannot be distinguished "
    "from a smooth error of the robot's path, so position_u_mm is in u"
)
INSIDE_OUT = (
    "most of the mesh faces away from where the scan is seen from: are its triangles clockwise? Signs are by the mesh, "
    "positive where its triangles turn counter-clockwise"
)


@stage("compare.deviation")
def deviation(
    scan: Surface,
    reference: Surface,
    registration: Registration | None = None,
    edge: Edge | None = None,
    *,
    position_u_mm: Annotated[
        float,
        Field(ge=0, le=100),
    ] = 0.1,
    spacing_mm: Annotated[float, Field(ge=1e-3, le=50)] = 1.0,
    normal_mm: Annotated[float, Field(gt=0, le=50)] = 2.0,
    projection_mm: Annotated[float, Field(gt=0, le=50)] = 2.0,
    depth_mm: Annotated[float, Field(gt=0, le=100)] = 1.0,
    sections: Annotated[int, Field(ge=1, le=999)] = 9,
    half_width_mm: Annotated[float, Field(gt=0, le=100)] = 3.0,
) -> tuple[Deviations, Document, Chapter]:
    """Measure signed distances along the normal, positive outside the reference, each with its level of detection.

    M3C2 with departures (docs/comparison.md). Below 1.96 u a distance is no significant change.

    Args:
        scan: from `compare.surface`, as recorded.
        reference: from `compare.surface`, `compare.mesh` or `compare.plan`.
        registration: moves the scan; without it, both are taken as they lie in the base.
        edge: gives arc lengths; without it the plan's path does, or the scan's longest direction.
        position_u_mm: standard uncertainty of the scan's place along a normal (docs/comparison.md).
        spacing_mm: between the places that are compared.
        normal_mm: D, diameter of the neighbourhood of a normal.
        projection_mm: d, diameter of the averaged cylinder.
        depth_mm: largest deviation measured: half the cylinder's length. Places that lie further off are counted.
        sections: count of sections along the part, as in `inspect.sections`.
        half_width_mm: half the width of a section along the part.

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
    target = target_of(reference, spacing_mm, 0.5 * normal_mm)
    places, reversed_share = places_of(laid, reference, target, scales)
    course = course_of(laid, reference, edge, places.normal.mean(axis=0))
    found = deviations(laid, reference, target, places, registration, position_u_mm, course, scales)
    told = (INSIDE_OUT,) if reversed_share > 0.5 else ()
    found = dataclasses.replace(found, warnings=(*scan.warnings, *reference.warnings, *told, *found.warnings))
    what = "change" if reference.triangles is None else "deviation"
    summary = summarise(found, sections, half_width_mm, course.name, what, spacing_mm)
    if summary.compared < LEAST_PLACES:
        words = f"only {summary.compared} of {len(found.distance_mm)} places find the reference within {depth_mm:g} mm"
        raise InputError(
            scan.source or "compare.deviation",
            f"{words}: expected surfaces that lie on each other, in one unit, and "
            "three frames or more in a cylinder (projection_mm)",
        )
    near_or_far = summary.compared + summary.beyond
    if summary.beyond > MUCH * near_or_far:
        far = f"{summary.beyond} of {near_or_far} places lie further off than depth_mm, {depth_mm:g} mm"
        words = f"{far}: a {kind_of(reference)} of another part or unit, or laid elsewhere?"
        found = dataclasses.replace(found, warnings=(*found.warnings, words))
    return (
        found,
        deviation_document(found, summary, scan, reference, registration, scales),
        deviation_chapter(found, summary, scan, reference, registration, position_u_mm),
    )


def kind_of(reference: Surface) -> str:
    """What a scan is compared with, in a word."""
    if reference.triangles is None:
        return "scan"
    return "mesh" if reference.course_mm is None else "plan"


def moved(scan: Surface, registration: Registration) -> Surface:
    """The scan where the registration puts it."""
    pose = registration.reference_from_scan
    axis = None if scan.range_axis is None else pose[:3, :3] @ scan.range_axis
    return dataclasses.replace(scan, points_mm=mapped(pose, scan.points_mm), range_axis=axis)


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
        "part": dataclasses.asdict(scan.part),
        "frame": "base",
        "scan": scan.source,
        "reference": reference.source,
        "reference_kind": kind_of(reference),
        "registered": registration is not None,
        "finding": summary.in_words,
        "changed": summary.is_changed,
        "compared": summary.compared,
        "beyond_depth": summary.beyond,
        "mean_mm": summary.mean_mm,
        "rms_mm": summary.rms_mm,
        "percentiles_mm": {f"{k}": value for k, value in summary.percentiles_mm.items()},
        "significant_share": summary.significant,
        "level_of_detection_mm": summary.detectable_mm,
        "uncertainty": {"median_u_mm": dict(found.sources), "not_included": list(UNSEEN)},
        "checks": {
            side: [dataclasses.asdict(check) for check in one.checks]
            for side, one in (("scan", scan), ("reference", reference))
        },
        "warnings": list(found.warnings),
        "scales": scales._asdict(),
        "arc_length_along": summary.along,
        "sections": [dataclasses.asdict(section) for section in summary.sections],
        "regions": [region._asdict() for region in summary.regions],
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
    return result_file("deviation.json", content)


# Deviations of a registered scan from a reference at evenly spread places.


class Scales(NamedTuple):
    """Of the comparison: between places; diameters of a normal's neighbourhood and of a cylinder; its reach."""

    spacing_mm: float
    normal_mm: float
    projection_mm: float
    depth_mm: float


def places_of(scan: Surface, reference: Surface, target: Target, scales: Scales) -> tuple[Surfels, float]:
    """Flat places of the scan; their normals point outwards as a mesh's do, and the share that was turned for that."""
    found = surfels(scan, scales.spacing_mm, 0.5 * scales.normal_mm)
    centre, normal, share = found.centre_mm[found.flat], found.normal[found.flat], 0.0
    if reference.triangles is not None and len(centre):
        is_reversed = (target(centre)[1] * normal).sum(axis=1) < 0
        normal, share = np.where(is_reversed[:, None], -normal, normal), float(is_reversed.mean())
    return Surfels(centre, normal, np.ones(len(centre), bool)), share


def deviations(
    scan: Surface,
    reference: Surface,
    target: Target,
    places: Surfels,
    registration: Registration | None,
    position_u_mm: float,
    course: Course,
    scales: Scales,
) -> Deviations:
    """M3C2 distances at places of a registered scan; NaN where one of the surfaces is missing or too far off.

    u^2 = noise^2 + registration^2 + path^2 + passes^2 of both sides.
    """
    position, normal, radius = places.centre_mm, places.normal, 0.5 * scales.projection_mm
    depth_mm = scales.depth_mm
    if reference.triangles is None:
        mine = heights(scan.points_mm, None, scan.frame, position, normal, radius, depth_mm)
        other = heights(reference.points_mm, None, reference.frame, position, normal, radius, depth_mm)
        distance, noise = mine.height_mm - other.height_mm, np.hypot(mine.u_mm, other.u_mm)
    else:
        foot, outward = target(scan.points_mm)
        off = ((scan.points_mm - foot) * outward).sum(axis=1)
        off[np.abs(off) > depth_mm] = np.nan
        mine = heights(scan.points_mm, off, scan.frame, position, normal, radius, depth_mm)
        distance, noise = mine.height_mm, mine.u_mm
    foot, outward = target(position)
    off, is_same_side = ((position - foot) * outward).sum(axis=1), (outward * normal).sum(axis=1) > SAME_SIDE
    is_beyond = np.isnan(distance) & (np.abs(off) > depth_mm) & is_same_side
    along, across = course.locate(position)
    place = position_u(registration, position, normal, position_u_mm)
    path = None if registration is None else path_error_u(position, distance, normal, along)
    passes = [
        position_u_mm if one.passes_apart_mm is None else one.passes_apart_mm / ROOT_2 for one in (scan, reference)
    ]
    unknown = registration is not None and path is None
    sources: dict[str, Float | float] = {
        "noise of both surfaces": noise,
        "position" if registration is None else "registration": place,
        PATH: 0.0 if registration is None else position_u_mm if path is None else path,
        "passes of a scan beside each other": math.hypot(*passes),
    }
    u = np.sqrt(sum(np.square(one) for one in sources.values()))
    return Deviations(
        position,
        normal,
        distance,
        u,
        DETECTION * u,
        along,
        across,
        is_beyond,
        tuple((name, median(np.ravel(one)[np.isfinite(np.ravel(one))])) for name, one in sources.items()),
        (ONE_FACE,) if unknown else (),
    )


def position_u(registration: Registration | None, position_mm: Float, normal: Float, position_u_mm: float) -> Float:
    """(c,) what the registration's covariance makes along each normal; without one, the uncertainty that is stated."""
    if registration is None:
        return np.full(len(position_mm), position_u_mm)
    rows = np.hstack([normal, np.cross(position_mm - registration.pivot_mm, normal)])
    return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", rows, registration.covariance, rows)))


# Where places lie along the part: arc length on a course, and across it as seen from outside.


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A polyline with arc length, and the direction from which the part is looked at."""

    points_mm: Shaped[Float, "m 3"]
    arc_length_mm: Shaped[Float, " m"]
    tangent: Shaped[Float, "m 3"]
    view: Shaped[Float, " 3"]  # unit, outwards
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
