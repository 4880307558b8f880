"""The stage `report.inspection`: the chapter on a milled bevel as measured."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Chapter, Cloud, Edge, Inspection
from workbench.errors import InputError, one_line
from workbench.marks import FACES, REJECTED
from workbench.report.along import plan_view, size_chart, u_chart
from workbench.report.scene import pictures
from workbench.report.scenes import inspection_scene
from workbench.report.section_drawing import of_interest, section_drawings
from workbench.report.tables import (
    MOST_ROWS,
    certificate_html,
    check_rows,
    exclusions,
    faces_seen,
    facts,
    head,
    plan_note,
    section_rows,
    verdicts_found,
)
from workbench.report.text import data_address, render
from workbench.report.views import section_views
from workbench.stage import InputFile, stage

TILTS = {"whole edge": "once for the whole edge", "per section": "section by section"}


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
    plan_drawing = plan_view(cloud, edge, inspection)
    sizes = inspection.characteristics
    return Chapter(
        title="Inspection",
        html=render(
            "inspection.html.j2",
            facts=list(facts(cloud, edge)),
            pictures={name: data_address(content) for name, content in {**drawn, "plan": plan_drawing.svg}.items()},
            of_interest=of_interest(inspection).index,
            heads=list(map(head, sizes)),
            sections=section_rows(inspection, sizes) if len(inspection.sections) > MOST_ROWS else [],
            failed_checks=check_rows(inspection.checks, passed=False),
            passed_checks=check_rows(inspection.checks, passed=True),
            exclusions=list(exclusions(cloud, edge)),
            plan_note=plan_note(plan_drawing),
            tilt=TILTS.get(inspection.root_face_tilt, inspection.root_face_tilt),
            guard_factor=inspection.guard_factor,
            faces=faces_seen(edge),
            verdicts=verdicts_found(inspection),
            root_colour=FACES[ROOT_FACE],
            bevel_colour=FACES[BEVEL_FACE],
            rejected_colour=REJECTED,
        ),
        verdict=inspection.verdict,
        summary=one_line(inspection.reason),
        part=inspection.part,
        warnings=tuple(dict.fromkeys([*inspection.warnings, *edge.warnings])),
        scene=inspection_scene(cloud, edge, inspection, points),
        certificate=certificate_html(inspection),
    )
