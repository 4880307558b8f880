"""Deviations as a chapter of the report."""

from __future__ import annotations

import math
from pathlib import PurePath

import numpy as np

from workbench import pieces
from workbench.artefacts import Chapter
from workbench.compare.deviation_pictures import course_picture, map_picture
from workbench.compare.statistics import Summary
from workbench.compare.surface_values import Deviations, Registration, Surface

MOST_REGIONS = 10
NO_FRAMES = "the points' frames are not known: errors that a frame's points share count as independent noise"


def deviation_chapter(
    found: Deviations,
    summary: Summary,
    scan: Surface,
    reference: Surface,
    registration: Registration | None,
    position_u_mm: float,
) -> Chapter:
    """Finding, maps, course, sections, registration."""
    parts = [
        pieces.facts_html(_facts(summary, found, scan, reference)),
        pieces.figure_html(
            map_picture(found, summary),
            "Map of the deviations",
            f"Seen from outside. Lower map: places with a significant {summary.what}; at most 5 % of them "
            "are false, on average. Grey: not significant; beige: not compared.",
        ),
        pieces.figure_html(
            course_picture(found, summary),
            "Deviations along the part, and their histogram",
            "Level of detection: 1.96 standard uncertainties of a single place.",
        ),
        *_regions(summary),
        pieces.heading("Sections"),
        _sections(summary),
        pieces.heading("Percentiles"),
        _percentiles(summary),
        pieces.heading("Registration"),
        *_registration(registration, position_u_mm),
    ]
    unknown = [one for one in (scan, reference) if one.triangles is None and one.frame is None]
    warnings = (*(registration.warnings if registration else ()), *((NO_FRAMES,) if unknown else ()))
    return Chapter(
        "Deviation from the reference",
        "\n".join(parts),
        summary=f"{summary.in_words}.",
        part=scan.part,
        warnings=warnings,
    )


def _facts(summary: Summary, found: Deviations, scan: Surface, reference: Surface) -> list[tuple[str, str]]:
    return [
        ("Scan", PurePath(scan.source).name),
        ("Reference", PurePath(reference.source).name),
        ("Places compared", f"{summary.compared} of {len(found.distance_mm)}"),
        ("Mean", f"{summary.mean_mm:+.4f} mm"),
        ("Root mean square", f"{summary.rms_mm:.4f} mm"),
        ("Level of detection (95 %), median", f"{summary.detectable_mm:.4f} mm"),
        ("Places beyond the level of detection", f"{100 * summary.significant:.1f} % (5 % expected by chance)"),
    ]


def _regions(summary: Summary) -> list[str]:
    """The largest regions of change, if anything changed."""
    if not summary.regions:
        return []
    head = ("Region", "Arc length, mm", "Across, mm", "Area, mm²", "Mean, mm", "u, mm", "Extreme, mm")
    rows = [
        (
            f"{k}",
            f"{one.from_mm:.1f} to {one.to_mm:.1f}",
            f"{one.across_from_mm:.1f} to {one.across_to_mm:.1f}",
            f"{one.area_mm2:.0f}",
            _signed(one.mean_mm),
            _number(one.u_mm),
            _signed(one.extreme_mm),
        )
        for k, one in enumerate(summary.regions[:MOST_REGIONS], start=1)
    ]
    more = len(summary.regions) - len(rows)
    caption = f"Connected regions of significant {summary.what}, by area"
    caption += f"; {more} smaller regions not shown" if more else ""
    return [pieces.heading("Regions"), pieces.table_html(head, rows, caption)]


def _sections(summary: Summary) -> str:
    head = (
        "Section",
        "Arc length, mm",
        "Places",
        "Mean, mm",
        "Lowest, mm",
        "Highest, mm",
        "Level of detection, mm",
        "Places beyond it, %",
    )
    rows = [
        (
            f"{one.index}",
            f"{one.arc_length_mm:.1f}",
            f"{one.places}",
            *(_signed(value) for value in (one.mean_mm, one.least_mm, one.most_mm)),
            _number(one.detectable_mm),
            "–" if math.isnan(one.significant) else f"{100 * one.significant:.0f}",
        )
        for one in summary.sections
    ]
    return pieces.table_html(head, rows, f"Arc length along {summary.along}")


def _percentiles(summary: Summary) -> str:
    head = ("", *(f"{k} %" for k in summary.percentiles_mm))
    return pieces.table_html(head, [("Distance, mm", *(_signed(value) for value in summary.percentiles_mm.values()))])


def _registration(found: Registration | None, position_u_mm: float) -> list[str]:
    if found is None:
        return [
            pieces.paragraph(
                "None: both are compared in the base; standard uncertainty of the scan's position "
                f"along a normal: {position_u_mm:g} mm."
            )
        ]
    back = np.linalg.inv(found.reference_from_scan)
    shift = found.pivot_mm - (back[:3, :3] @ found.pivot_mm + back[:3, 3])
    turn = math.degrees(math.acos(float(np.clip((np.trace(back[:3, :3]) - 1) / 2, -1.0, 1.0))))
    u = np.sqrt(np.diagonal(found.covariance))
    facts = [
        ("Shift of the scan's centre, mm", ", ".join(f"{x:+.3f} ± {s:.3f}" for x, s in zip(shift, u, strict=False))),
        ("Rotation", f"{turn:.4f}° ± {math.degrees(float(np.linalg.norm(u[3:]))):.4f}°"),
        ("Overlap", f"{100 * found.overlap:.0f} % of the scan"),
        ("RMS of matched places", f"{found.rms_mm:.4f} mm"),
        ("Directions not determined", "; ".join(found.held) or "none"),
    ]
    return [
        pieces.facts_html(facts),
        pieces.note("± one standard uncertainty. A direction that the surfaces do not determine is not fitted."),
    ]


def _signed(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:+.4f}"


def _number(value: float) -> str:
    return "–" if math.isnan(value) else f"{value:.4f}"
