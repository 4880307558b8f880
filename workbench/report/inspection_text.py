"""The HTML of the chapter on an inspection: its tables and sentences around its pictures."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.artefacts import BEVEL_FACE, FACE_NAMES, ROOT_FACE, Cloud, Edge, Inspection, RawEdge
from workbench.report.along import PlanView
from workbench.report.certificate import MOST_ROWS
from workbench.report.colours import FACES, REJECTED, VERDICTS
from workbench.report.section_drawing import of_interest
from workbench.report.tables import check_rows, facts, plan_note, section_rows, set_aside
from workbench.report.text import data_address, render


def inspection_html(
    cloud: Cloud, edge: Edge, inspection: Inspection, drawn: Mapping[str, bytes], aside: PlanView
) -> str:
    """The chapter; `drawn`: PNG or SVG of `overview`, `close_up`, `sections`, `root` and `angle`."""
    return render(
        "inspection.html.j2",
        facts=list(facts(cloud, edge)),
        pictures={name: data_address(content) for name, content in {**drawn, "plan": aside.svg}.items()},
        of_interest=of_interest(inspection).index,
        sections=section_rows(inspection) if len(inspection.sections) > MOST_ROWS else [],
        failed_checks=check_rows(inspection.checks, passed=False),
        passed_checks=check_rows(inspection.checks, passed=True),
        set_aside=list(set_aside(cloud, edge)),
        plan_note=plan_note(aside),
        tilt={"whole edge": "once for the whole edge", "per section": "section by section"}.get(
            inspection.root_face_tilt, inspection.root_face_tilt
        ),
        guard_factor=inspection.guard_factor,
        faces=faces_seen(edge),
        verdicts=[(name, VERDICTS[name]) for name in VERDICTS if any(s.verdict == name for s in inspection.sections)],
        root_colour=FACES[ROOT_FACE],
        bevel_colour=FACES[BEVEL_FACE],
        rejected_colour=REJECTED,
    )


def faces_seen(edge: Edge) -> list[tuple[str, str]]:
    """Name and colour of each face that some of a few hundred frames show."""
    labels = np.unique(edge.labels[:: max(1, len(edge.labels) // 300)])
    names = {ROOT_FACE: "end face"} if isinstance(edge, RawEdge) else {}
    return [(names.get(face, FACE_NAMES[face]), FACES[face]) for face in FACES if face in labels]
