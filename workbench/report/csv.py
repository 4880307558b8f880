"""The stage `report.csv`: the sections as a table for a spreadsheet."""

from __future__ import annotations

from workbench.artefacts import Document, JointInspection
from workbench.stage import stage
from workbench.storage import csv_bytes


@stage("report.csv")
def csv(inspection: JointInspection) -> Document:
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
    rows = inspection.rows()
    names = list(dict.fromkeys(name for row in rows for name in row))
    told = [{name: _text(value) for name, value in row.items()} for row in rows]
    return Document("sections.csv", csv_bytes(told, names))


def _text(value: float | str | None) -> str | None:
    return f"{value:.6f}" if isinstance(value, float) else value
