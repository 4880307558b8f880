"""An inspection in words: its certificate (ISO 14253-1), and the tables and sentences of its chapter."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from workbench.artefacts import (
    BEVEL_FACE,
    FACE_NAMES,
    ROOT_FACE,
    Cloud,
    Edge,
    Inspection,
    RawEdge,
    Section,
    Uncertainty,
    Verdict,
)
from workbench.errors import one_line
from workbench.report.along import PlanView
from workbench.report.colours import FACES, REJECTED, VERDICTS
from workbench.report.section_drawing import of_interest
from workbench.report.tables import check_rows, facts, plan_note, section_rows, set_aside
from workbench.report.text import COVERAGE, alike, data_address, decimals, measured, render, source

STATEMENTS: dict[Verdict, str] = {
    "pass": "Conformity with the specification is verified.",
    "fail": "Nonconformity with the specification is verified.",
    "undecided": "Neither conformity nor nonconformity with the specification is verified.",
}
MOST_ROWS = 12  # sections on the page
WORST_FIRST = ("fail", "undecided", "pass")


def certificate_html(inspection: Inspection) -> str:
    """What stands on the first page between who and what was measured and the signature."""
    shown = least_favourable(inspection)
    known = inspection.uncertainty
    sources, totals = budget(known, inspection.sections)
    return render(
        "certificate.html.j2",
        verdict=inspection.verdict,
        statement=STATEMENTS[inspection.verdict],
        reason=one_line(inspection.reason[:1].upper() + inspection.reason[1:]).rstrip("."),
        specification=specification(inspection),
        sections=[row for row in section_rows(inspection) if row["index"] in shown],
        left_out=len(inspection.sections) - len(shown),
        count=len(inspection.sections),
        budget=sources,
        totals=totals,
        correlations=known.correlations,
        not_included=known.not_included,
        decision_rule=decision_rule(inspection.guard_factor),
        terms=data_address(source("bevel_terms.svg").encode()),
    )


def least_favourable(inspection: Inspection) -> set[int]:
    """Indices of the sections that the page has room for, by verdict; all where they are few."""
    ranked = sorted(inspection.sections, key=lambda s: (WORST_FIRST.index(s.verdict), s.index))
    return {section.index for section in ranked[:MOST_ROWS]}


def specification(inspection: Inspection) -> list[tuple[str, ...]]:
    """A row a characteristic: name, symbol, nominal, limits, lowest and highest section, largest U."""
    needs, sections = inspection.requirements, inspection.sections
    rows = []
    for name, symbol, unit, nominal, (lower, upper), values, u in (
        (
            "Root face",
            "c",
            " mm",
            needs.root_nominal_mm,
            needs.root_tolerance_mm,
            [s.root_mm for s in sections],
            [s.root_u_mm for s in sections],
        ),
        (
            "Bevel angle",
            "β",
            "°",
            needs.bevel_nominal_deg,
            needs.bevel_tolerance_deg,
            [s.bevel_deg for s in sections],
            [s.bevel_u_deg for s in sections],
        ),
    ):
        places, known = decimals(u), [value for value in values if value is not None]
        ends = [measured(end(known), None, places) + unit if known else "–" for end in (min, max)]
        largest = max((one for one in u if one is not None), default=None)
        wide = "–" if largest is None else f"{COVERAGE * largest:.{places}f}{unit}"
        low, middle, high = alike(nominal + lower, nominal, nominal + upper)
        rows.append((name, symbol, f"{middle}{unit}", f"{low} to {high}{unit}", *ends, wide))
    rows.append(("Depth of preparation", "h", "t − c", "not specified", "–", "–", "–"))
    return rows


def budget(known: Uncertainty, sections: tuple[Section, ...]) -> tuple[list[tuple[str, ...]], list[tuple[str, ...]]]:
    """A row a source; and the combined and the expanded uncertainty of the section that has the largest."""
    largest = [
        max((u for s in sections if (u := getattr(s, name)) is not None), default=math.nan)
        for name in ("root_u_mm", "bevel_u_deg")
    ]
    root, bevel = (_places(u) for u in largest)
    k = known.coverage_factor
    return [(s.name, s.kind, small(s.root_u_mm, root), small(s.bevel_u_deg, bevel)) for s in known.sources], [
        ("Combined standard uncertainty u", "", small(largest[0], root), small(largest[1], bevel)),
        (f"Expanded U = k u, coverage factor k = {k:g}", "", small(k * largest[0], root), small(k * largest[1], bevel)),
    ]


def _places(u: float) -> int:
    """Decimals that show two significant digits of an uncertainty."""
    return min(6, max(1, 1 - math.floor(math.log10(u)))) if u > 0.0 and math.isfinite(u) else 3


def small(u: float, places: int) -> str:
    """An uncertainty; '–' for none, '< 0.001' where the decimals do not show it."""
    if not u > 0.0 or not math.isfinite(u):
        return "–"
    return f"{u:.{places}f}" if u >= 0.5 * 10.0**-places else f"< {10.0**-places:.{places}f}"


def decision_rule(guard_factor: float) -> str:
    """The decision rule of ISO 14253-1 in words, with the risk that its guard band leaves."""
    risk = 50.0 * math.erfc(guard_factor / math.sqrt(2.0))
    return (
        f"ISO 14253-1 with the guard band g = {guard_factor:g} u. Conformity of a value is verified inside the limits "
        "by at least g (pass), nonconformity outside by at least g (fail). In between, in the uncertainty zone, "
        f"neither is verified (undecided). The risk of a wrong statement is at most {risk:.2g} % for each value. "
        "A part fails if any section fails; it passes if all sections pass."
    )


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
