"""The stage `report.closed_loop`: the chapter on what was required, planned and measured on the milled part."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import Chapter, Cloud, Edge, Engagement, Inspection, Rework, Toolpath
from workbench.errors import InputError, one_line
from workbench.report.along import deviation_chart
from workbench.report.planned import Compared, compared, duration, whole_run
from workbench.report.scenes import loop_scene
from workbench.report.tables import unit_of
from workbench.report.text import data_address, decimals, measured, render, signed, span
from workbench.stage import stage

PLACES = {"root_mm": 3, "bevel_deg": 2}  # of what is planned and of differences, which know more than a value's U


def asked(toolpath: Toolpath) -> dict[str, float]:
    """What the path was planned for, by the names of sizes."""
    return {"root_mm": toolpath.root_mm, "bevel_deg": toolpath.bevel_deg}


def closed_loop_summary(inspection: Inspection, toolpath: Toolpath, rework: Rework | None) -> str:
    """The loop in one line."""
    sizes = (
        f"{one.term.lower()} {span(one.quantity.value, PLACES[one.name], unit_of(one))} "
        f"(required {asked(toolpath)[one.name]:g}{unit_of(one)})"
        for one in inspection.characteristics
    )
    return ", ".join(sizes) + (f"; {one_line(rework.reason)}" if rework else "")


def contradictions(inspection: Inspection, toolpath: Toolpath) -> Iterator[str]:
    """Where the part was inspected against something else than was asked of the path."""
    for name, (nominal, _) in inspection.required.items():
        path, (term, _), unit = asked(toolpath)[name], inspection.terms[name], "°" if name.endswith("_deg") else " mm"
        if abs(path - nominal) > 1e-9:
            what = f"the path was planned for a {term.lower()} of {path:g}{unit}"
            yield f"{what}, the part inspected against {nominal:g}{unit}"


def _summary_rows(inspection: Inspection, toolpath: Toolpath, rows: list[Compared]) -> Iterator[tuple[str, ...]]:
    """Name, asked, planned, measured, measured less planned: mean and greatest."""
    for one in inspection.characteristics:
        places, unit, found = PLACES[one.name], unit_of(one), one.quantity.value
        planned = np.array([getattr(row, one.name) for row in rows], float)
        off = (found - planned)[np.isfinite(found - planned)]
        ends = (off.mean(), off[np.argmax(np.abs(off))]) if len(off) else ()
        texts = [signed(float(end), places) + unit for end in ends] or ["–", "–"]
        required = f"{asked(toolpath)[one.name]:g}{unit}"
        yield one.term, required, span(planned, places, unit), span(found, places, unit), *texts


def _section_rows(inspection: Inspection, rows: list[Compared]) -> Iterator[tuple[str, ...]]:
    """Section, arc length; planned, measured ± U and their difference, of root and of angle."""
    found = inspection.characteristics
    places = [decimals(pair and pair[1] for pair in one.pairs) for one in found]
    for k, row in enumerate(rows):
        cells = [f"{row.section.index}", f"{row.section.arc_length_mm:.1f}"]
        for one, digits in zip(found, places, strict=True):
            planned, value, pair = getattr(row, one.name), row.section.values[one.name], one.pairs[k]
            off = "–" if value is None or planned is None else signed(value - planned, PLACES[one.name])
            of_part = "–" if pair is None else measured(*pair, digits)
            cells += [measured(planned, None, PLACES[one.name]), of_part, off]
        yield tuple(cells)


def _stretches(rework: Rework) -> Iterator[tuple[str, str, str]]:
    for what, found in (
        ("Too much material: to be milled again", rework.too_much_material),
        ("Too little material: cannot be mended", rework.too_little_material),
    ):
        for one in found:
            yield what, f"{one.from_mm:.1f} to {one.to_mm:.1f} mm", one_line(one.reason)


def _rework_path(rework: Rework | None) -> str:
    """What the rework path is, in words."""
    if rework is None or rework.toolpath is None:
        return ""
    path, run = rework.toolpath, whole_run(rework.toolpath)
    count = len(path.layers)
    return (
        f"{count} layer{'s' if count > 1 else ''}, {int(run.cutting.sum()):,} cutting points, "
        f"{run.length_mm[run.cutting_step].sum():.1f} mm cut, {duration(float(run.time_s.sum()))}"
    )


def _engaged(engagement: Engagement) -> Iterator[tuple[str, ...]]:
    """One row per layer: greatest radial depth, axial depth and chip area, and the share of points that cut."""
    for layer in engagement.layers:
        greatest = (
            f"{np.nanmax(each, initial=0.0):.{places}f}"
            for each, places in ((layer.radial_depth_mm, 3), (layer.axial_depth_mm, 2), (layer.chip_area_mm2, 3))
        )
        yield f"{layer.index}", *greatest, f"{100.0 * np.mean(layer.chip_area_mm2 > 0.0):.0f} %"


@stage("report.closed_loop")
def closed_loop(
    inspection: Inspection,
    toolpath: Toolpath,
    rework: Rework | None = None,
    engagement: Engagement | None = None,
    cloud: Cloud | None = None,
    edge: Edge | None = None,
    *,
    title: str = "Closed loop",
) -> Chapter:
    """The closed loop as a chapter: root face and bevel angle as required, as planned, as measured; and the rework.

    Planned is what the plane of the final layer makes in each section: measured less planned is what milling and the
    two scans add.

    Args:
        inspection: of the milled part.
        toolpath: that it was milled along.
        rework: what the inspection asks to be milled again; without it the page says so.
        engagement: of the cutter along the path, from a simulation.
        cloud: of the milled part; without it the view in three dimensions shows sections and path alone.
        edge: the milled edge in that cloud.
        title: of the chapter, where a report has several.

    Raises:
        InputError: no section, or a path without layers.

    Example:
        >>> from workbench import edge, inspect, path, report, scan
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> points = scan.fuse(scan.read(recording="data/synthetic/paths/raw_arc_milled.h5"))
        >>> milled = edge.segment(points)
        >>> chapter = report.closed_loop(inspect.sections(milled), plan)
        >>> chapter.title, chapter.verdict
        ('Closed loop', 'pass')
    """
    if not inspection.sections:
        raise InputError("inspection", "expected at least one section to report")
    if not toolpath.layers:
        raise InputError(toolpath.source or "path", "expected at least one layer")
    rows = compared(inspection, toolpath)
    planned = {name: [getattr(row, name) for row in rows] for name in PLACES}
    return Chapter(
        title=title,
        html=render(
            "closed_loop.html.j2",
            summary=list(_summary_rows(inspection, toolpath, rows)),
            sections=list(_section_rows(inspection, rows)),
            chart=data_address(deviation_chart({"": inspection}, asked(toolpath), planned)),
            rework=rework,
            rework_reason=one_line(rework.reason) if rework else "",
            stretches=list(_stretches(rework)) if rework else [],
            rework_path=_rework_path(rework),
            engagement=list(_engaged(engagement)) if engagement else [],
        ),
        verdict=inspection.verdict,
        summary=closed_loop_summary(inspection, toolpath, rework),
        part=toolpath.part,
        warnings=tuple(map(one_line, [*contradictions(inspection, toolpath), *(rework.warnings if rework else ())])),
        scene=loop_scene(inspection, toolpath, rows, cloud, edge),
    )
