"""The stage `report.inspection`: the chapter on a milled bevel as measured."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Chapter, Cloud, Edge, Inspection
from workbench.errors import InputError, one_line
from workbench.report.along import plan_view, size_chart, u_chart
from workbench.report.scene import pictures
from workbench.report.scenes import inspection_scene
from workbench.report.section_drawing import section_drawings
from workbench.report.tables import certificate_html, inspection_html
from workbench.report.views import section_views
from workbench.stage import InputFile, stage


@stage("report.inspection")
def inspection(
    cloud: Cloud,
    edge: Edge,
    inspection: Inspection,
    *,
    points: Annotated[int, Field(ge=10_000, le=1_000_000)] = 300_000,
    scan_plan: InputFile | None = None,
) -> Chapter:
    """The inspection as a chapter of the report: verdict, drawings, charts, tables.

    Sizes along the edge have tolerance, guard and uncertainty bands (U = 2 u).

    Args:
        cloud: the cloud that was inspected; it is thinned before it is drawn, never copied.
        edge: its faces, and the lower edge along which everything is laid out.
        inspection: what was measured, required and decided.
        points: about the largest number of points in a view.
        scan_plan: the `scan-plan.json` that the scan followed: U along the edge is drawn as wanted, predicted and
            achieved.

    Raises:
        InputError: no section, or an edge of which nothing was measured.

    Example:
        >>> from workbench import cloud, edge, inspect, report, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> chapter = report.inspection(points, milled, found)
        >>> chapter.title, chapter.verdict
        ('Inspection', 'pass')
    """
    if not inspection.sections:
        raise InputError(cloud.source or "inspection", "expected at least one section to report")
    if not np.isfinite(edge.position_mm).all(axis=1).any():
        raise InputError(cloud.source or "edge", "expected an edge of which something was measured")
    s = inspection.profile.arc_length_mm
    drawn = {
        **pictures(section_views(cloud, edge, inspection, points)),
        "sections": section_drawings(cloud, edge, inspection),
        **{
            one.name: size_chart(s, inspection.profile.sizes[one.name], edge.seen, inspection, one)
            for one in inspection.characteristics
        },
    }
    if scan_plan is not None:
        from workbench.result_files.scan_plan import ScanPlanFile, plan_id  # pydantic: loaded when there is a plan

        plan = ScanPlanFile.read(scan_plan)
        if cloud.part.scan_plan == plan_id(scan_plan.read_bytes()):
            drawn["planned"] = u_chart(plan, inspection)
    aside = plan_view(cloud, edge, inspection)
    scene = inspection_scene(cloud, edge, inspection, points)
    return Chapter(
        title="Inspection",
        html=inspection_html(cloud, edge, inspection, drawn, aside),
        verdict=inspection.verdict,
        summary=one_line(inspection.reason),
        part=inspection.part,
        warnings=tuple(dict.fromkeys([*inspection.warnings, *edge.warnings])),
        scene=scene,
        certificate=certificate_html(inspection),
    )
