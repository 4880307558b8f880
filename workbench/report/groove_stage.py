"""The stages `report.groove`, `report.preparation`: chapter and certificate of a joint as measured."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np

from workbench.artefacts import (
    Chapter,
    Characteristic,
    Cloud,
    Groove,
    GrooveInspection,
    Preparation,
    PreparationInspection,
    Section,
    u_name,
)
from workbench.artefacts.edges import ALL_TERMS, Joint, RecognisedInspection
from workbench.errors import one_line
from workbench.marks import MEASURED
from workbench.pieces import INK
from workbench.plot import Axes, Figure
from workbench.report.along import size_chart
from workbench.report.dimensions import ACROSS, TEXT_SIZE, dimension, dimension_angle
from workbench.report.section_drawing import of_interest
from workbench.report.tables import NOT_JUDGED, certificate_html, check_rows, head, section_rows
from workbench.report.text import data_address, decimals, measured, render
from workbench.stage import stage
from workbench.units import Float


def _along(groove: Joint, inspection: RecognisedInspection, what: Characteristic) -> bytes:
    """SVG of a size along the groove."""
    size = groove.sizes[what.name]
    return size_chart(groove.arc_length_mm, size, np.isfinite(size.value) & groove.seen, inspection, what)


def section_tables(inspection: RecognisedInspection) -> Iterator[dict[str, Any]]:
    """The sections' values ± U: lengths and angles in tables of their own, so that they fit a page."""
    for caption, unit, angles in (("Lengths", "mm", False), ("Angles", "°", True)):
        found = [one for one in inspection.characteristics if one.is_angle is angles and any(one.pairs)]
        if found:
            yield {
                "caption": f"{caption} in the sections, value ± U, {unit}",
                "head": list(map(head, found)),
                "rows": section_rows(inspection, found),
                "judged": bool(inspection.required) and not angles,
            }


# A section of a joint as an engineering drawing, its dimensions with the letters of ISO 9692-1.

NEAR_MM, PLATE_MM = 1.5, 9.0  # of a section: frames drawn; of the joint: plate drawn
MOST_POINTS = 12_000
SURFACES = {"left_upper", "right_upper", "upper", "lower"}  # corners at which a plate's surface ends
LENGTHS = (  # a size, the corners that it lies between, and where its dimension stands; of grooves, of one plate
    ("width_mm", "left_upper", "right_upper", "above"),
    ("gap_mm", "left_root", "right_root", "below"),
    ("depth_mm", "right_root", "right_upper", "right"),
    ("root_face_left_mm", "left_lower", "left_root", "left"),
    ("root_face_right_mm", "right_lower", "right_root", "right"),
    ("width_mm", "upper", "root", "above"),
    ("depth_mm", "root", "upper", "right"),
    ("root_face_mm", "lower", "root", "right"),
    ("lower_bevel_mm", "root", "middle", "left"),
)
ANGLES = (  # an angle, the corner that it is about and the one that its face leads to
    ("bevel_left_deg", "left_root", "left_upper"),
    ("bevel_right_deg", "right_root", "right_upper"),
    ("upper_bevel_deg", "middle", "upper"),
)


def with_u(section: Section, size: str) -> str:
    """Letter or term, value ± U and unit of a size that was measured."""
    value, u = section.values[size], section.values[u_name(size)]
    text = measured(value, u, decimals([u]))
    term, letter = ALL_TERMS[size]
    return f"{letter if letter != '–' else term} = " + (f"({text})°" if size.endswith("_deg") else f"{text} mm")


def groove_drawing(cloud: Cloud, groove: Joint, section: Section) -> bytes:
    """SVG of a section: returns near it, corners, every size that was measured as a dimension or in words."""
    corner, uv = section.places, _points(cloud, groove, section)
    places = np.array(list(corner.values()))
    ends = places[:, 0].min() - PLATE_MM, places[:, 0].max() + PLATE_MM
    uv = uv[(uv[:, 0] > ends[0]) & (uv[:, 0] < ends[1])]
    low, high = float(places[:, 1].min()), float(places[:, 1].max())
    size = max(high - low, 0.3 * (ends[1] - ends[0]))
    figure = Figure(figsize=(10, 5.0))
    axes = figure.add_axes((0.06, 0.12, 0.92, 0.86))
    room = np.array([-0.5, 0.5]) * size
    axes.set(xlim=tuple(ends + room), ylim=(low - 0.42 * size, high + 0.42 * size), aspect="equal")
    axes.points(uv[:, 0], uv[:, 1], ".", color=MEASURED, markersize=3.2, alpha=0.5)
    sides = {name: ends[name.startswith("right")] for name in sorted(SURFACES & {*corner})}
    for line in (*section.chains, *(np.array([(far, corner[name][1]), corner[name]]) for name, far in sides.items())):
        axes.plot(*line.T, color=INK, linewidth=0.7)
    axes.points(places[:, 0], places[:, 1], "o", color=INK, markersize=2.4)
    drawn = {*_lengths(axes, section, size), *_angles(axes, section)}
    rows = [with_u(section, name) for name in ALL_TERMS if name not in drawn and section.values.get(name) is not None]
    middle = np.mean([at[0] for name, at in corner.items() if name.endswith("upper")] or places[:, 0])
    for row, text in enumerate(reversed(rows)):
        at = (float(middle), high + 0.2 * size)  # which may be on the width's arrow
        axes.annotate(text, at, (0, 12 + 11 * row), ha="center", va="center", fontsize=TEXT_SIZE)
    right = "right, along the upper surfaces, mm" if isinstance(groove, Groove) else "out of the root face, mm"
    axes.set(xlabel=right, ylabel="up, mm")
    return figure.svg()


def _points(cloud: Cloud, groove: Joint, section: Section) -> Float:
    """(n, 2) kept returns of the frames near a section, in its axes."""
    away = np.abs(groove.frame_arc_length_mm - section.arc_length_mm)
    frames = np.flatnonzero(away <= max(NEAR_MM, float(np.nanmin(away))))
    row, column = np.nonzero(cloud.keep[frames])
    every = max(1, len(row) // MOST_POINTS)
    off = cloud.placed(frames[row][::every], column[::every]) - section.origin_mm
    return np.column_stack([off @ section.normal, off @ section.across])


def _lengths(axes: Axes, section: Section, size: float) -> Iterator[str]:
    """Dimensions of the lengths that were measured; their names."""
    corner = section.places
    low, high = (end(np.array(list(corner.values())), axis=0) for end in (np.min, np.max))
    at = {
        "above": high + np.array([0.0, 0.2 * size]),
        "below": low - np.array([0.0, 0.2 * size]),
        "left": low - np.array([0.75 * PLATE_MM, 0.0]),
        "right": high + np.array([0.75 * PLATE_MM, 0.0]),
    }
    for name, first, last, where in LENGTHS:
        if section.values.get(name) is None or first not in corner or last not in corner:
            continue
        ends, text = (corner[first], corner[last]), with_u(section, name)
        if where in ("above", "below"):
            dimension(axes, ends, at[where], text, size, along=ACROSS, place="end")
        else:
            dimension(axes, ends, at[where], text, size, side="left" if where == "left" else "right")
        yield name


def _angles(axes: Axes, section: Section) -> Iterator[str]:
    """Dimensions of the angles of flat faces between corners; their names."""
    corner, values = section.places, section.values
    if values.get("root_radius_mm") is not None:
        return
    low = "middle" if values.get("land_mm") is not None and "middle" in corner else "root"
    top = "middle" if low == "root" and "upper_bevel_deg" in values else "upper"
    for name, about, to in (*ANGLES, ("bevel_deg", low, top)):
        if values.get(name) is not None and about in corner and to in corner:
            radius = 0.6 * float(np.hypot(*(corner[to] - corner[about])))
            text, right = with_u(section, name), about.startswith("right")
            dimension_angle(axes, corner[about], values[name] or 0.0, text, radius, to_right=right, inside=True)
            yield name


@stage("report.groove")
def groove(cloud: Cloud, groove: Groove, inspection: GrooveInspection) -> Chapter:
    """The groove as a chapter of the report: certificate, dimensioned section, sizes along it, tables, checks.

    Terms and letters of ISO 9692-1 and ISO 17659; U = 2 u.

    Args:
        cloud: the cloud in which the groove was found.
        groove: its sizes along it.
        inspection: its sections, what was required and decided.

    Example:
        >>> from workbench import edge, inspect, report, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/groove.h5"))
        >>> groove = edge.segment_groove(points)
        >>> report.groove(points, groove, inspect.groove(groove)).title
        'Groove'
    """
    return _chapter("Groove", cloud, groove, inspection)


@stage("report.preparation")
def preparation(cloud: Cloud, preparation: Preparation, inspection: PreparationInspection) -> Chapter:
    """The prepared edge of a plate as a chapter of the report, as `report.groove`.

    Args:
        cloud: the cloud in which the edge was found.
        preparation: its sizes along it.
        inspection: its sections, what was required and decided.

    Example:
        >>> from workbench import cloud, edge, inspect, report, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_nose.h5")))
        >>> found = edge.segment_preparation(points)
        >>> report.preparation(points, found, inspect.preparation(found)).title
        'Preparation'
    """
    return _chapter("Preparation", cloud, preparation, inspection)


def _chapter(title: str, cloud: Cloud, joint: Joint, inspection: RecognisedInspection) -> Chapter:
    judged, shown = bool(inspection.requirements), of_interest(inspection)
    along = [one for one in inspection.characteristics if one.name in joint.sizes]  # known all along
    return Chapter(
        title=title,
        html=render(
            "groove.html.j2",
            what=inspection.WHAT,
            section=shown.index,
            drawing=data_address(groove_drawing(cloud, joint, shown)),
            charts=[(one.term, data_address(_along(joint, inspection, one))) for one in along],
            tables=list(section_tables(inspection)),
            guard_factor=inspection.guard_factor,
            failed_checks=check_rows(inspection.checks, passed=False),
            passed_checks=check_rows(inspection.checks, passed=True),
        ),
        verdict=inspection.verdict if judged else "",
        summary=one_line(inspection.reason) if judged else NOT_JUDGED,
        part=inspection.part,
        warnings=inspection.warnings,
        certificate=certificate_html(inspection),
    )
