"""The stage `report.csv`: the sections as a table for a spreadsheet."""

from __future__ import annotations

import csv as comma_separated
import io

from workbench.artefacts import Document, Inspection
from workbench.stage import stage
from workbench.storage import as_text

HEADER = (
    "section",
    "arc_length_mm",
    "x_mm",
    "y_mm",
    "z_mm",
    "root_mm",
    "root_u_mm",
    "bevel_deg",
    "bevel_u_deg",
    "verdict",
    "reason",
)


@stage("report.csv")
def csv(inspection: Inspection) -> Document:
    """The sections as `sections.csv`: one row a section, standard uncertainties, empty where not measured.

    x, y, z: the section's origin on the lower edge in the base, mm. UTF-8, a comma between fields, lines end in CR LF
    (RFC 4180).

    Example:
        >>> from workbench import cloud, edge, inspect, report, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> report.csv(found).name
        'sections.csv'
    """
    out = io.StringIO(newline="")
    table = comma_separated.writer(out)
    table.writerow(HEADER)
    for s in inspection.sections:
        place = (s.arc_length_mm, *s.origin_mm)
        values = (s.root_mm, s.root_u_mm, s.bevel_deg, s.bevel_u_deg)
        table.writerow([s.index, *map(_number, place), *map(_number, values), s.verdict, as_text(s.reason)])
    return Document("sections.csv", out.getvalue().encode())


def _number(value: float | None) -> str:
    return "" if value is None else f"{value:.6f}"
