"""The stage `report.groove`: the chapter and the certificate of a weld groove as measured."""

from __future__ import annotations

from workbench.artefacts import Chapter, Cloud, Groove, GrooveInspection
from workbench.errors import one_line
from workbench.stage import stage


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
    from workbench.report.groove_text import NOT_JUDGED, groove_certificate, groove_html  # only where a report is made

    judged = bool(inspection.requirements)
    return Chapter(
        title="Groove",
        html=groove_html(cloud, groove, inspection),
        verdict=inspection.verdict if judged else "",
        summary=one_line(inspection.reason) if judged else NOT_JUDGED,
        part=inspection.part,
        warnings=inspection.warnings,
        certificate=groove_certificate(inspection),
    )
