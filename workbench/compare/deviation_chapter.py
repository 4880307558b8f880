"""Deviations as a chapter of the report."""

from __future__ import annotations

import math
from pathlib import PurePath

import numpy as np

from workbench import pieces
from workbench.artefacts import Chapter
from workbench.compare.statistics import Summary
from workbench.compare.surface_stage import Deviations, Registration, Surface
from workbench.geometry.poses import inverse, mapped, vector_from_rotation
from workbench.marks import DIVERGING, Colour, ramp
from workbench.pieces import BLUE, GREY, ORANGE, PALE, number
from workbench.plot import Axes, Figure, nice_ticks
from workbench.units import Bool

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
            ((BAND, "5 % to 95 % of the places"), (BLUE, "median"), (ORANGE, "level of detection of a place, 95 %")),
        ),
        *_regions(summary),
        pieces.heading("Sections"),
        _sections(summary),
        pieces.heading("Percentiles"),
        _percentiles(summary),
        pieces.heading("Uncertainty"),
        pieces.table_html(
            ("Source", "Standard uncertainty, median, mm"),
            [(name[:1].upper() + name[1:], f"{u_mm:.4f}") for name, u_mm in found.sources],
            "Of a single place, by source",
        ),
        pieces.note(
            "A motion that all faces of a stretch share counts as an error of the robot's path; a part that is bent, "
            "or faces that were machined together, move so too."
        ),
        *(pieces.note(words) for words in (*_not_shown(scan), *_not_shown(reference))),
        pieces.heading("Registration"),
        *_registration(registration, position_u_mm),
    ]
    unknown = [one for one in (scan, reference) if one.triangles is None and one.frame is None]
    registered = registration.warnings if registration else ()  # of both surfaces too
    warnings = tuple(dict.fromkeys((*found.warnings, *registered, *((NO_FRAMES,) if unknown else ()))))
    return Chapter(
        "Deviation from the reference",
        "\n".join(parts),
        summary=f"{summary.in_words}.",
        part=scan.part,
        warnings=warnings,
    )


def _not_shown(surface: Surface) -> list[str]:
    """What the recording could not tell about its own poses."""
    findings = [one.finding for one in surface.checks if one.name == "flange_turn_deg" and one.passed and one.finding]
    return [f"{PurePath(surface.source).name}: {finding}." for finding in findings]


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
            number(one.mean_mm, "+.4f"),
            number(one.u_mm, ".4f"),
            number(one.extreme_mm, "+.4f"),
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
            *(number(value, "+.4f") for value in (one.mean_mm, one.least_mm, one.most_mm)),
            number(one.detectable_mm, ".4f"),
            number(100 * one.significant, ".0f"),
        )
        for one in summary.sections
    ]
    return pieces.table_html(head, rows, f"Arc length along {summary.along}")


def _percentiles(summary: Summary) -> str:
    head = ("", *(f"{k} %" for k in summary.percentiles_mm))
    found = (number(value, "+.4f") for value in summary.percentiles_mm.values())
    return pieces.table_html(head, [("Distance, mm", *found)])


def _registration(found: Registration | None, position_u_mm: float) -> list[str]:
    if found is None:
        return [
            pieces.paragraph(
                "None: both are compared in the base; standard uncertainty of the scan's position "
                f"along a normal: {position_u_mm:g} mm."
            )
        ]
    back = inverse(found.reference_from_scan)
    shift = found.pivot_mm - mapped(back, found.pivot_mm)
    turn = math.degrees(np.linalg.norm(vector_from_rotation(back[:3, :3])))
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
        pieces.note(
            "± one standard uncertainty. A direction that the surfaces do not determine is not fitted. Distances are "
            "from the best fit: it takes up what a change shares with a displacement, and other faces show that."
        ),
    ]


# Pictures of deviations: maps as seen from outside, along the part, histogram.

NOT_COMPARED, BAND = "#f0e0c0", "#cce3f0"
LEVELS = 10  # of colour, of either sign


def map_picture(found: Deviations, summary: Summary) -> bytes:
    """Distances over arc length and across the part; below, what of them is significant."""
    seen = np.isfinite(found.distance_mm)
    reach = max(float(np.percentile(np.abs(found.distance_mm[seen]), 99)), 1e-4)
    size = 2.0 * math.sqrt(float(np.clip(5e4 / seen.sum(), 1.5, 22.0)))
    figure = Figure(figsize=(10, 5.2))
    above, below = figure.subplots(2, 1, sharex=True, sharey=True)

    def dots(axes: Axes, mask: Bool, ink: Colour) -> None:
        axes.points(found.arc_length_mm[mask], found.across_mm[mask], ".", color=ink, markersize=size)

    dots(below, ~seen, NOT_COMPARED)
    dots(below, seen & ~summary.changed, PALE)
    level = np.rint(LEVELS * np.clip(found.distance_mm / reach, -1.0, 1.0))
    for one in sorted(range(-LEVELS, LEVELS + 1), key=abs):  # the largest above the others
        ink = ramp(np.array(0.5 + 0.5 * one / LEVELS), DIVERGING) / 255.0
        dots(above, level == one, ink)
        dots(below, (level == one) & summary.changed, ink)
    for axes in (above, below):
        axes.scale((-reach, reach), DIVERGING)
        axes.set(ylabel="across, mm")
    above.set(title="Signed distance along the normal, mm (red: outside the reference, blue: inside)")
    below.set(title=f"Significant {summary.what}s alone", xlabel="arc length, mm")
    return figure.svg()


def course_picture(found: Deviations, summary: Summary) -> bytes:
    """Left: median, middle 90 % and level of detection along the part; right: the histogram."""
    figure = Figure(figsize=(10, 3.0))
    _along(figure.add_axes((0.07, 0.16, 0.58, 0.74)), found)
    histogram = figure.add_axes((0.73, 0.16, 0.245, 0.74))
    histogram.fill(np.repeat(summary.edges_mm, 2), [0, *np.repeat(summary.counts, 2), 0], facecolor=BLUE)
    histogram.axvline(0.0, color=GREY, linewidth=0.8)
    for place in (-summary.detectable_mm, summary.detectable_mm):
        histogram.plot([place] * 2, [0, max(summary.counts)], color=ORANGE, linewidth=0.9, dashes=(4.0, 2.0))
    histogram.integer = "y"
    histogram.set(xticks=nice_ticks(histogram.get_xlim(), 4))
    histogram.set(ylim=(0.0, None), title="Histogram; dashed: level of detection", xlabel="mm", ylabel="places")
    return figure.svg()


def _along(axes: Axes, found: Deviations) -> None:
    seen = np.isfinite(found.distance_mm)
    arc, distance, limit = found.arc_length_mm[seen], found.distance_mm[seen], found.detectable_mm[seen]
    edges = np.linspace(arc.min(), arc.max() + 1e-9, int(np.clip(np.ptp(arc) / 2.0, 5, 200)))
    bin_of = np.digitize(arc, edges) - 1
    rows = [
        (
            0.5 * (edges[k] + edges[k + 1]),
            *np.percentile(distance[bin_of == k], [5, 50, 95]),
            np.median(limit[bin_of == k]),
        )
        for k in range(len(edges) - 1)
        if (bin_of == k).any()
    ]
    s, low, middle, high, detectable = np.array(rows).T
    axes.axhline(0.0, color=GREY, linewidth=0.8)
    axes.fill_between(s, low, high, color=BAND)
    axes.plot(s, middle, color=BLUE, linewidth=1.3)
    for limit in (-detectable, detectable):
        axes.plot(s, limit, color=ORANGE, linewidth=0.9, dashes=(4.0, 2.0))
    axes.set(title="Along the part", xlabel="arc length, mm", ylabel="distance, mm")
