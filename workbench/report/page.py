"""The page around the figures and tables: a jinja2 template with autoescape.

Names out of files (part, paths, causes) are data: they reach the page as text only.
"""

from __future__ import annotations

import base64
from dataclasses import dataclass

import numpy as np
from jinja2 import Environment, PackageLoader, StrictUndefined, select_autoescape
from markupsafe import Markup

from workbench.artefacts import BEVEL_FACE, FACE_NAMES, ROOT_FACE, Cloud, Edge, Inspection, Provenance
from workbench.errors import one_line
from workbench.report.colours import FACES, REJECTED, SIGNS, VERDICTS
from workbench.report.plan import Plan
from workbench.report.rendering import Pictures
from workbench.report.scene import of_interest
from workbench.report.tables import decision_rule, facts, one_line_a_stage, plan_note, section_rows, set_aside, summary
from workbench.report.values import COVERAGE


@dataclass(frozen=True, slots=True, eq=False)
class Figures:
    """All figures of the page: PNG views in space and SVG charts."""

    in_space: Pictures
    sections: bytes
    root: bytes
    angle: bytes
    plan: Plan


def page(cloud: Cloud, edge: Edge, inspection: Inspection, provenance: Provenance | None, figures: Figures) -> str:
    """The whole page."""
    loader = PackageLoader("workbench.report", "")
    environment = Environment(
        loader=loader,
        autoescape=select_autoescape(default=True, default_for_string=True),
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    style = Markup(loader.get_source(environment, "page.css")[0])
    return environment.get_template("page.html.j2").render(
        style=style,
        part=one_line(cloud.part_id or ""),
        title=provenance.title if provenance else "",
        verdict=inspection.verdict,
        reason=inspection.reason,
        warnings=list(dict.fromkeys([*inspection.warnings, *edge.warnings])),
        facts=list(facts(cloud, edge)),
        summary=summary(inspection),
        decision_rule=decision_rule(inspection.guard_factor),
        pictures=_embedded(figures),
        problem=figures.in_space.problem,
        of_interest=of_interest(inspection).index,
        sections=section_rows(inspection),
        set_aside=list(set_aside(cloud, edge)),
        plan_note=plan_note(figures.plan),
        tilt={"whole edge": "once for the whole edge", "per section": "section by section"}.get(
            inspection.root_face_tilt, inspection.root_face_tilt
        ),
        guard_factor=inspection.guard_factor,
        coverage=f"{COVERAGE:g}",
        signs=SIGNS,
        faces=[(FACE_NAMES[k], FACES[k]) for k in FACES if k in np.unique(edge.labels[:: _some(edge)])],
        verdicts=[(name, VERDICTS[name]) for name in VERDICTS if any(s.verdict == name for s in inspection.sections)],
        root_colour=FACES[ROOT_FACE],
        bevel_colour=FACES[BEVEL_FACE],
        rejected_colour=REJECTED,
        provenance=provenance,
        versions=sorted(provenance.versions.items()) if provenance else [],
        pipeline=one_line_a_stage(provenance.pipeline) if provenance else "",
    )


def _embedded(figures: Figures) -> dict[str, str]:
    """Data addresses of all pictures."""
    png = {"overview": figures.in_space.overview, "close_up": figures.in_space.close_up}
    svg = {"sections": figures.sections, "root": figures.root, "angle": figures.angle, "plan": figures.plan.svg}
    sorts = (("image/png", png), ("image/svg+xml", svg))
    return {k: f"data:{sort};base64,{base64.b64encode(v).decode()}" for sort, each in sorts for k, v in each.items()}


def _some(edge: Edge) -> int:
    """A step that leaves a few hundred frames."""
    return max(1, len(edge.labels) // 300)
