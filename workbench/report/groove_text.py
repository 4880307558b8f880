"""The HTML of a groove's chapter and of its certificate: tables and sentences. Terms of ISO 9692-1 and ISO 17659."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from workbench.artefacts import Cloud, Groove, GrooveInspection, GrooveSection, u_name
from workbench.artefacts.grooves import TERMS
from workbench.errors import one_line
from workbench.report.certificate import STATEMENTS, decision_rule, small
from workbench.report.groove_drawing import groove_charts, groove_drawing, unit_of
from workbench.report.tables import check_rows
from workbench.report.template import data_address, render
from workbench.report.values import COVERAGE, alike, decimals, measured

NOT_JUDGED = "No specification was stated: the groove was measured, conformity was not assessed."


def groove_html(cloud: Cloud, groove: Groove, inspection: GrooveInspection) -> str:
    """The chapter."""
    shown = of_interest(inspection)
    return render(
        "groove.html.j2",
        section=shown.index,
        drawing=data_address(groove_drawing(cloud, groove, shown)),
        charts=data_address(groove_charts(groove, inspection.sections, limits(inspection.requirements))),
        tables=list(section_tables(inspection)),
        failed_checks=check_rows(inspection.checks, passed=False),
        passed_checks=check_rows(inspection.checks, passed=True),
    )


def groove_certificate(inspection: GrooveInspection) -> str:
    """What stands on the first page between who and what was measured and the signature."""
    judged = bool(inspection.requirements)
    names = sizes_of(inspection)
    return render(
        "groove_certificate.html.j2",
        verdict=inspection.verdict if judged else "",
        statement=STATEMENTS[inspection.verdict] if judged else NOT_JUDGED,
        reason=one_line(inspection.reason[:1].upper() + inspection.reason[1:]).rstrip(".") if judged else "",
        type=inspection.type,
        how="as declared" if inspection.declared else "as recognised",
        alternatives=", ".join(inspection.alternatives),
        specification=list(specification(inspection)),
        letters=[TERMS[name][1] if TERMS[name][1] != "–" else TERMS[name][0].lower() for name in names],
        budget=list(budget(inspection, names)),
        not_included=inspection.uncertainty.not_included,
        decision_rule=decision_rule(inspection.guard_factor) if judged else "",
    )


def of_interest(inspection: GrooveInspection) -> GrooveSection:
    """Of the sections with most corners the first that fails, else the middle one."""
    most = max(len(one.corners) for one in inspection.sections)
    full = [one for one in inspection.sections if len(one.corners) == most]
    return next((one for one in full if one.verdict == "fail"), full[len(full) // 2])


def sizes_of(inspection: GrooveInspection) -> list[str]:
    """Names of the sizes that some section has."""
    return [name for name in TERMS if any(one.values.get(name) is not None for one in inspection.sections)]


def limits(requirements: Mapping[str, Any]) -> dict[str, tuple[float, float]]:
    """Lower and upper limit of every size that is required."""
    found = {}
    for name, nominal in requirements.items():
        stem, _, unit = name.rpartition("_")
        if pair := requirements.get(f"{stem}_tolerance_{unit}"):
            found[name] = (nominal + pair[0], nominal + pair[1])
    return found


def specification(inspection: GrooveInspection) -> Iterator[tuple[str, ...]]:
    """A row a size: name, letter, nominal, limits, lowest and highest section, largest U."""
    required = limits(inspection.requirements)
    for name in dict.fromkeys([*required, *sizes_of(inspection)]):
        values = [value for one in inspection.sections if (value := one.values.get(name)) is not None]
        u = [value for one in inspection.sections if (value := one.values.get(u_name(name))) is not None]
        places, unit = decimals(u), unit_of(name)
        ends = [measured(end(values), None, places) + unit if values else "–" for end in (min, max)]
        wide = f"{COVERAGE * max(u):.{places}f}{unit}" if u else "–"
        nominal, zone = "–", "not specified"
        if name in required:
            low, middle, high = alike(required[name][0], inspection.requirements[name], required[name][1])
            nominal, zone = f"{middle}{unit}", f"{low} to {high}{unit}"
        yield *TERMS[name], nominal, zone, *ends, wide


def budget(inspection: GrooveInspection, names: list[str]) -> Iterator[tuple[str, ...]]:
    """A row a source: name, type, u of every size."""
    for row in inspection.size_sources:
        cells = []
        for name in names:
            largest = max(
                (u for one in inspection.sections if (u := one.values.get(u_name(name))) is not None), default=0
            )
            cells.append(small(float(row.get(u_name(name)) or 0.0), decimals([largest]) + 1))
        yield str(row["name"]), str(row["kind"]), *cells


def section_tables(inspection: GrooveInspection) -> Iterator[dict[str, Any]]:
    """The sections' values ± U: lengths and angles in tables of their own, so that they fit a page."""
    for caption, ending, unit in (("Lengths", "_mm", "mm"), ("Angles", "_deg", "°")):
        names = [name for name in sizes_of(inspection) if name.endswith(ending)]
        if not names:
            continue
        places = {name: decimals(one.values.get(u_name(name)) for one in inspection.sections) for name in names}
        yield {
            "caption": f"{caption} in the sections, value ± U, {unit}",
            "head": [TERMS[name][1] if TERMS[name][1] != "–" else TERMS[name][0] for name in names],
            "rows": [
                (one, [measured(one.values.get(name), one.values.get(u_name(name)), places[name]) for name in names])
                for one in inspection.sections
            ],
            "judged": bool(inspection.requirements) and ending == "_mm",
        }
