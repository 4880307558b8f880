"""The stage `report.closed_loop`: the chapter on what was required, planned and measured on the milled part."""

from __future__ import annotations

from workbench.artefacts import Chapter, Cloud, Edge, Engagement, Inspection, Rework, Toolpath
from workbench.errors import InputError, one_line
from workbench.stage import stage

SCENE_POINTS = 150_000


@stage("report.closed_loop")
def closed_loop(
    inspection: Inspection,
    toolpath: Toolpath,
    rework: Rework | None = None,
    engagement: Engagement | None = None,
    cloud: Cloud | None = None,
    edge: Edge | None = None,
) -> Chapter:
    """The closed loop as a chapter: root face and bevel angle as required, as planned, as measured; and the rework.

    Planned is what the plane of the path's final layer makes in each inspected section, taken in that section's own
    axes as measured on the milled part; so measured less planned is what milling and the two scans have added.
    Uncertainties are expanded, U = 2 u. The verdict is the inspection's.

    Args:
        inspection: of the milled part.
        toolpath: that it was milled along.
        rework: what the inspection asks to be milled again; without it the page says so.
        engagement: of the cutter along the path, from a simulation.
        cloud: of the milled part; without it the view in three dimensions shows sections and path alone.
        edge: the milled edge in that cloud.

    Raises:
        InputError: no section, or a path without layers.

    Example:
        >>> from workbench import edge, inspect, path, report, scan
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> points = scan.fuse(scan.read(recording="data/synthetic/paths/raw_arc_milled.h5"))
        >>> milled = edge.segment(points)
        >>> chapter = report.closed_loop(inspect.sections(milled), plan)
        >>> chapter.title, chapter.verdict
        ('Closed loop', 'pass')
    """
    # jinja2 and pillow cost time to import: only where a report is made.
    from workbench.report.closed_loop_text import closed_loop_html, closed_loop_summary, contradictions
    from workbench.report.loop import compared, loop_chart
    from workbench.report.scenes import loop_scene

    if not inspection.sections:
        raise InputError("inspection", "expected at least one section to report")
    if not toolpath.layers:
        raise InputError(toolpath.source or "path", "expected at least one layer")
    rows = compared(inspection, toolpath)
    chart = loop_chart(inspection, toolpath, rows)
    return Chapter(
        title="Closed loop",
        html=closed_loop_html(inspection, toolpath, rework, engagement, rows, chart),
        verdict=inspection.verdict,
        summary=closed_loop_summary(inspection, toolpath, rework),
        part=toolpath.part,
        warnings=tuple(map(one_line, [*contradictions(inspection, toolpath), *(rework.warnings if rework else ())])),
        scene=loop_scene(inspection, toolpath, rows, cloud, edge, SCENE_POINTS),
    )
