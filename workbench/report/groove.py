"""The stages `report.groove`, `report.preparation`: chapter and certificate of a joint as measured."""

from __future__ import annotations

from workbench.artefacts import Chapter, Cloud, Groove, GrooveInspection, Preparation, PreparationInspection
from workbench.artefacts.grooves import Joint, JointInspection
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
    return _chapter("Groove", cloud, groove, inspection)


@stage("report.preparation")
def preparation(cloud: Cloud, preparation: Preparation, inspection: PreparationInspection) -> Chapter:
    """The prepared edge of a plate as a chapter of the report, as `report.groove`.

    Args:
        cloud: the cloud in which the edge was found.
        preparation: its sizes along it.
        inspection: its sections, what was required and decided.

    Example:
        >>> from workbench import cloud, edge, inspect, report, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_nose.h5")))
        >>> found = edge.segment_preparation(points)
        >>> report.preparation(points, found, inspect.preparation(found)).title
        'Preparation'
    """
    return _chapter("Preparation", cloud, preparation, inspection)


def _chapter(title: str, cloud: Cloud, joint: Joint, inspection: JointInspection) -> Chapter:
    from workbench.report.groove_text import NOT_JUDGED, groove_certificate, groove_html  # only where a report is made

    judged = bool(inspection.requirements)
    return Chapter(
        title=title,
        html=groove_html(cloud, joint, inspection),
        verdict=inspection.verdict if judged else "",
        summary=one_line(inspection.reason) if judged else NOT_JUDGED,
        part=inspection.part,
        warnings=inspection.warnings,
        certificate=groove_certificate(inspection),
    )
