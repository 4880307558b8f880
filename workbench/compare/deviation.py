"""`compare.deviation`: where and by how much a scan deviates from a scan, a mesh or a plan."""

from __future__ import annotations

import dataclasses
from typing import Annotated

from pydantic import Field

from workbench.artefacts import Chapter, Document, Edge
from workbench.compare.course import course_of
from workbench.compare.deviation_chapter import deviation_chapter
from workbench.compare.distances import Scales, deviations, places_of
from workbench.compare.statistics import Summary, summarise
from workbench.compare.surface_values import Deviations, Registration, Surface
from workbench.errors import InputError
from workbench.stage import stage
from workbench.strict_json import strict_json

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
