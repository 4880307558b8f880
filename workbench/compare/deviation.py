"""`compare.deviation`: where and by how much a scan deviates from a scan, a mesh or a plan."""

from __future__ import annotations

import dataclasses
from typing import Annotated

from pydantic import Field

from workbench.artefacts import Chapter, Document, Edge
from workbench.compare.course import course_of
from workbench.compare.deviation_chapter import deviation_chapter
from workbench.compare.deviation_document import deviation_document
from workbench.compare.distances import Scales, deviations, places_of
from workbench.compare.statistics import summarise
from workbench.compare.surface_values import Deviations, Registration, Surface
from workbench.errors import InputError
from workbench.stage import stage

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
