"""The stage `report.plan`: the chapter on a milling path and how it came from the scan."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from workbench.artefacts import Chapter, Cloud, Engagement, Gate, Moves, RawEdge, Toolpath
from workbench.errors import InputError, one_line
from workbench.stage import stage


@stage("report.plan")
def plan(
    cloud: Cloud,
    edge: RawEdge,
    toolpath: Toolpath,
    moves: Moves | None = None,
    gate: Gate | None = None,
    engagement: Engagement | None = None,
    *,
    points: Annotated[
        int, Field(ge=10_000, le=1_000_000, description="about how many points a view in space shows at most")
    ] = 150_000,
) -> Chapter:
    """The plan as a chapter of the report: from the scan to the path, all layers, feed, times, what was refused.

    The steps of the paper's Fig. 8 (a to f); a section with the layers stepped from the stock to the finished bevel,
    dimensioned; all layers on the part (Fig. 13); the feed on the path (Fig. 14: the darker the slower) and along the
    final layer; the cutter's engagement, if it was milled in simulation. Root face and bevel angle are those that the
    path's own points make with the scanned edge, not the required ones drawn again. Uncertainties are expanded,
    U = 2 u. The verdict is the gate's.

    Args:
        cloud: the cloud of the raw edge.
        edge: the raw edge that the path was planned on.
        toolpath: the path with its feeds.
        moves: what simplification made of it; without it the page says so.
        gate: the path's own checks; without them the page says so and gives no verdict.
        engagement: of the cutter along the path, from a simulation.
        points: about how many points a view in space shows at most.

    Raises:
        InputError: a milled edge, or a path without layers.

    Example:
        >>> from workbench import edge, path, report, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.feed(path.layers(raw, points), points, raw)
        >>> report.plan(points, raw, plan).title
        'Plan'
    """
    # jinja2 and pillow cost time to import: only where a report is made.
    from workbench.report.colour_scales import feed_scale, layer_scale
    from workbench.report.layer_section import stepped_section, stepping_drawing
    from workbench.report.path_charts import edges_in_plane, engagement_chart, feed_chart
    from workbench.report.path_views import path_views
    from workbench.report.picture import pictures
    from workbench.report.plan_text import plan_html, plan_summary
    from workbench.report.planned import whole_run
    from workbench.report.procedure import procedure_views
    from workbench.report.scenes import plan_scene

    if not toolpath.layers:
        raise InputError(toolpath.source or "path", "expected at least one layer")
    run = whole_run(toolpath)
    views = {**procedure_views(cloud, edge, toolpath, points), **path_views(cloud, edge, toolpath, run, points)}
    drawn = {
        **pictures(views),
        "d": edges_in_plane(cloud, edge),
        "layer_scale": layer_scale(toolpath),
        "feed_scale": feed_scale(run),
        "feed_chart": feed_chart(edge, toolpath),
    }
    if stepped := stepped_section(edge, toolpath):
        drawn["section"] = stepping_drawing(cloud, edge, toolpath, stepped)
    if engagement is not None:
        drawn["engagement"] = engagement_chart(edge, toolpath, engagement)
    scene = plan_scene(cloud, edge, toolpath, run, points)
    return Chapter(
        title="Plan",
        html=plan_html(cloud, edge, toolpath, run, moves, gate, stepped, drawn),
        verdict="" if gate is None else "pass" if gate.passed else "fail",
        summary=plan_summary(toolpath, run, gate),
        part=toolpath.part,
        warnings=tuple(dict.fromkeys(map(one_line, [*edge.warnings, *toolpath.warnings]))),
        scene=scene,
    )
