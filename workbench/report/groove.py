"""The stages `report.groove`, `report.preparation`: chapter and certificate of a joint as measured."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from workbench.artefacts import (
    Chapter,
    Characteristic,
    Cloud,
    Groove,
    GrooveInspection,
    GrooveSection,
    Preparation,
    PreparationInspection,
    u_name,
)
from workbench.artefacts.edges import ALL_TERMS, Joint, RecognisedInspection
from workbench.errors import one_line
from workbench.report.along import TEXT_SIZE, size_chart, svg
from workbench.report.marks import GREY, INK, MEASURED
from workbench.report.plot import Axes, Figure
from workbench.report.tables import NOT_JUDGED, certificate_html, check_rows, head, section_rows
from workbench.report.text import data_address, decimals, measured, render
from workbench.stage import stage
from workbench.units import DEG, Float


def groove_html(cloud: Cloud, groove: Joint, inspection: RecognisedInspection) -> str:
    """The chapter."""
    shown = of_interest(inspection)
    return render(
        "groove.html.j2",
        what=inspection.WHAT,
        section=shown.index,
        drawing=data_address(groove_drawing(cloud, groove, shown)),
        charts=[(one.term, data_address(_along(groove, inspection, one))) for one in _found(groove, inspection)],
        tables=list(section_tables(inspection)),
        guard_factor=inspection.guard_factor,
        failed_checks=check_rows(inspection.checks, passed=False),
        passed_checks=check_rows(inspection.checks, passed=True),
    )


def _found(groove: Joint, inspection: RecognisedInspection) -> list[Characteristic]:
    """The sizes that are known all along."""
    return [one for one in inspection.characteristics if one.name in groove.sizes]


def _along(groove: Joint, inspection: RecognisedInspection, what: Characteristic) -> bytes:
    """SVG of a size along the groove."""
    size = groove.sizes[what.name]
    return size_chart(groove.arc_length_mm, size, np.isfinite(size.value) & groove.seen, inspection, what)


def of_interest(inspection: RecognisedInspection) -> GrooveSection:
    """Of the sections with most corners the first that fails, else the middle one."""
    most = max(len(one.corners) for one in inspection.sections)
    full = [one for one in inspection.sections if len(one.corners) == most]
    return next((one for one in full if one.verdict == "fail"), full[len(full) // 2])


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


# A section of a weld groove as an engineering drawing, its dimensions with the letters of ISO 9692-1.

NEAR_MM, BESIDE_MM = 1.5, 9.0  # of a section: frames drawn; of the groove: plate drawn
MOST_POINTS = 12_000


def with_u(section: GrooveSection, size: str) -> str:
    """Value ± U with its unit; '–' where it was not measured."""
    value, u = section.values.get(size), section.values.get(u_name(size))
    text = measured(value, u, decimals([u]))
    if value is None or not size.endswith("_deg"):
        return text if value is None else f"{text} mm"
    return f"({text})°"


def groove_drawing(cloud: Cloud, groove: Joint, section: GrooveSection) -> bytes:
    """SVG of a section: returns near it, corners, dimensions."""
    corner = {one["name"]: np.array(one["section_mm"]) for one in section.corners}
    uv = _points(cloud, groove, section)
    places = np.array(list(corner.values()))
    left, right = places[:, 0].min() - BESIDE_MM, places[:, 0].max() + BESIDE_MM
    uv = uv[(uv[:, 0] > left) & (uv[:, 0] < right)]
    low, high = float(places[:, 1].min()), float(places[:, 1].max())
    size = max(high - low, 0.3 * (right - left))
    figure = Figure(figsize=(10, 5.0))
    axes = figure.add_axes((0.06, 0.12, 0.92, 0.86))
    axes.set(xlim=(left - 0.5 * size, right + 0.5 * size), ylim=(low - 0.42 * size, high + 0.42 * size), aspect="equal")
    axes.points(uv[:, 0], uv[:, 1], ".", color=MEASURED, markersize=3.2, alpha=0.5)
    straight = "root_radius_mm" not in section.values
    if isinstance(groove, Groove):
        _outline(axes, corner, straight, ends=(left, right))
        _dimensions(axes, section, corner, size)
        axes.set_xlabel("right, along the upper surfaces, mm")
    else:
        _plate_outline(axes, corner, straight, left)
        _plate_dimensions(axes, section, corner, size)
        axes.set_xlabel("out of the root face, mm")
    axes.set_ylabel("up, mm")
    return svg(figure)


def _points(cloud: Cloud, groove: Joint, section: GrooveSection) -> Float:
    """(n, 2) kept returns of the frames near a section, in its axes."""
    away = np.abs(groove.frame_arc_length_mm - section.arc_length_mm)
    frames = np.flatnonzero(away <= max(NEAR_MM, float(np.nanmin(away))))
    row, column = np.nonzero(cloud.keep[frames])
    every = max(1, len(row) // MOST_POINTS)
    off = cloud.placed(frames[row][::every], column[::every]) - section.origin_mm
    return np.column_stack([off @ section.normal, off @ section.across])


def _outline(axes: Axes, corner: dict[str, Float], straight: bool, ends: tuple[float, float]) -> None:
    """Upper surfaces, faces between the corners that were seen, the corners."""
    for side, end in zip(("left", "right"), ends, strict=True):
        names = [f"{side}_{which}" for which in ("upper", "root", "lower")]
        seen = [corner[name] for name in names if name in corner]
        if f"{side}_upper" not in corner:
            continue
        upper = seen[0]
        axes.plot([end, upper[0]], [upper[1], upper[1]], color=INK, linewidth=0.7)
        chain = np.array(seen if straight else seen[1:])
        if len(chain):
            axes.plot(chain[:, 0], chain[:, 1], color=INK, linewidth=0.7)
        axes.points([one[0] for one in seen], [one[1] for one in seen], "o", color=INK, markersize=2.4)


def _words(section: GrooveSection, name: str) -> str:
    term, letter = ALL_TERMS[name]
    return f"{letter if letter != '–' else term} = {with_u(section, name)}"


def _is_shown(section: GrooveSection, corner: dict[str, Float], name: str, *corners: str) -> bool:
    return section.values.get(name) is not None and all(one in corner for one in corners)


def _dimensions(axes: Axes, section: GrooveSection, corner: dict[str, Float], size: float) -> None:
    """What was measured in this section, each with its letter and U."""
    words, shown = partial(_words, section), partial(_is_shown, section, corner)
    high = max(float(place[1]) for place in corner.values())
    low = min(float(place[1]) for place in corner.values())
    if shown("width_mm", "left_upper", "right_upper"):
        _across(axes, corner["left_upper"], corner["right_upper"], high + 0.2 * size, words("width_mm"))
    if shown("gap_mm", "left_root", "right_root"):
        a, b = (corner.get(f"{side}_lower", corner[f"{side}_root"]) for side in ("left", "right"))
        _across(axes, a, b, low - 0.2 * size, words("gap_mm"))
    aside = {
        side: corner[f"{side}_upper"][0] + sign * 0.75 * BESIDE_MM
        for side, sign in (("left", -1), ("right", 1))
        if f"{side}_upper" in corner
    }
    if shown("depth_mm", "right_upper", "right_root"):
        _up(axes, corner["right_root"], corner["right_upper"], aside["right"], words("depth_mm"), 1.0)
    for side, sign in (("left", -1.0), ("right", 1.0)):
        if shown(f"root_face_{side}_mm", f"{side}_root", f"{side}_lower", f"{side}_upper"):
            _up(axes, corner[f"{side}_lower"], corner[f"{side}_root"], aside[side], words(f"root_face_{side}_mm"), sign)
        if shown(f"bevel_{side}_deg", f"{side}_root", f"{side}_upper"):
            angle = section.values[f"bevel_{side}_deg"] or 0.0
            _angle(axes, corner[f"{side}_root"], corner[f"{side}_upper"], angle, words(f"bevel_{side}_deg"), sign)
    middle = 0.5 * sum(float(place[0]) for name, place in corner.items() if name.endswith("_upper"))
    rows = [words(name) for name in ("included_deg", "root_radius_mm", "misalignment_mm") if shown(name)]
    _above(axes, rows, (middle, high + 0.2 * size), "center")


def _plate_outline(axes: Axes, corner: dict[str, Float], straight: bool, left: float) -> None:
    """Upper surface, faces between the corners, root face, lower surface; without the flank above a fillet."""
    names = [name for name in ("upper", "middle", "root", "lower") if name in corner]
    chain = np.array([corner[name] for name in names if straight or name != "upper"])
    axes.plot(chain[:, 0], chain[:, 1], color=INK, linewidth=0.7)
    for name in ("upper", "lower"):
        if name in corner:
            axes.plot([left, corner[name][0]], [corner[name][1]] * 2, color=INK, linewidth=0.7)
    axes.points(
        [corner[name][0] for name in names], [corner[name][1] for name in names], "o", color=INK, markersize=2.4
    )


def _plate_dimensions(axes: Axes, section: GrooveSection, corner: dict[str, Float], size: float) -> None:
    """What was measured of one plate in this section, each with its letter and U."""
    words, shown = partial(_words, section), partial(_is_shown, section, corner)
    high = max(float(place[1]) for place in corner.values())
    outside = max(float(place[0]) for place in corner.values()) + 0.25 * size
    if shown("width_mm", "upper", "root"):
        _across(axes, corner["upper"], corner["root"], high + 0.2 * size, words("width_mm"))
    if shown("depth_mm", "upper", "root"):
        _up(axes, corner["root"], corner["upper"], outside, words("depth_mm"), 1.0)
    if shown("root_face_mm", "lower", "root"):
        _up(axes, corner["lower"], corner["root"], outside, words("root_face_mm"), 1.0)
    if shown("lower_bevel_mm", "middle", "root"):
        _up(axes, corner["root"], corner["middle"], corner["upper"][0] - 0.3 * size, words("lower_bevel_mm"), -1.0)
    bevels = {"bevel_deg": ("root", "middle" if "upper_bevel_deg" in section.values else "upper")}
    bevels["upper_bevel_deg"] = ("middle", "upper")
    if shown("land_mm") and "middle" in corner:
        bevels["bevel_deg"] = ("middle", "upper")
    for name, (low, top) in bevels.items():
        if shown(name, low, top) and "root_radius_mm" not in section.values:
            _angle(axes, corner[low], corner[top], section.values[name] or 0.0, words(name), -1.0)
    rows = [name for name in ("land_mm", "root_radius_mm") if shown(name)]
    if "root_radius_mm" in section.values and shown("bevel_deg"):
        rows.append("bevel_deg")
    _above(axes, [words(name) for name in rows], (float(corner["upper"][0]), high + 0.2 * size), "right")


def _above(axes: Axes, rows: list[str], place: tuple[float, float], ha: str) -> None:
    """Texts above a place, which may be on the width's arrow."""
    for row, text in enumerate(reversed(rows)):
        axes.annotate(text, place, (0, 12 + 11 * row), ha=ha, va="center", fontsize=TEXT_SIZE)


def _across(axes: Axes, a: Float, b: Float, at: float, text: str) -> None:
    """A distance along the upper surfaces; the text beside it where it is short."""
    for place in (a, b):
        axes.plot([place[0], place[0]], [place[1], at], color=GREY, linewidth=0.5)
    axes.arrow((float(a[0]), at), (float(b[0]), at), both=True)
    axes.annotate(text, (float(max(a[0], b[0])), at), (5, 0), va="center", fontsize=TEXT_SIZE)


def _up(axes: Axes, low: Float, high: Float, at: float, text: str, sign: float) -> None:
    """A height, dimensioned beside the groove on its side."""
    for place in (low, high):
        axes.plot([place[0], at], [place[1], place[1]], color=GREY, linewidth=0.5)
    axes.arrow((at, float(low[1])), (at, float(high[1])), both=True)
    middle = 0.5 * float(low[1] + high[1])
    axes.annotate(
        text, (at, middle), (4 * sign, 0), ha="left" if sign > 0 else "right", va="center", fontsize=TEXT_SIZE
    )


def _angle(axes: Axes, root: Float, upper: Float, degrees: float, text: str, sign: float) -> None:
    """The arc from the normal of the upper surface to the bevel, with the value in the plate."""
    radius = 0.6 * float(np.hypot(*(upper - root)))
    turned = np.linspace(0.0, degrees * DEG, 31)
    axes.plot(
        [root[0], root[0]], [root[1], root[1] + 1.15 * radius], color=GREY, linewidth=0.5, dashes=(9, 2.5, 2, 2.5)
    )
    axes.plot(root[0] + sign * radius * np.sin(turned), root[1] + radius * np.cos(turned), color=GREY, linewidth=0.6)
    end = (float(root[0] + sign * radius * np.sin(turned[-1])), float(root[1] + radius * np.cos(turned[-1])))
    axes.annotate(text, end, (7 * sign, -3), ha="left" if sign > 0 else "right", va="center", fontsize=TEXT_SIZE)


@stage("report.groove")
def groove(cloud: Cloud, groove: Groove, inspection: GrooveInspection) -> Chapter:
    """The groove as a chapter of the report: certificate, dimensioned section, sizes along it, tables, checks.

    Terms and letters of ISO 9692-1 and ISO 17659; U = 2 u. The same input gives the same chapter.

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
    judged = bool(inspection.requirements)
    return Chapter(
        title=title,
        html=groove_html(cloud, joint, inspection),
        verdict=inspection.verdict if judged else "",
        summary=one_line(inspection.reason) if judged else NOT_JUDGED,
        part=inspection.part,
        warnings=inspection.warnings,
        certificate=certificate_html(inspection),
    )
