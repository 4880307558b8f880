"""The stage `report.plan`: the chapter on a milling path and how it came from the scan."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated

from pydantic import Field

from workbench.artefacts import Chapter, Cloud, Edge, Engagement, Gate, Moves, RawEdge, Toolpath
from workbench.errors import InputError, one_line
from workbench.report.colours import FACES, LOWER_EDGE, TOOL_AXES, UPPER_EDGE
from workbench.report.inspection_text import faces_seen
from workbench.report.layer_section import Stepped
from workbench.report.path_charts import AXIS_MM, TOOL_AXIS_MM, shown_stretch
from workbench.report.plan_tables import (
    duration,
    layer_rows,
    move_rows,
    plan_rows,
    refused,
    required,
    thickness,
)
from workbench.report.planned import LOCAL_MM, Run, local_turn_deg
from workbench.report.tables import facts
from workbench.report.text import data_address, render
from workbench.stage import stage


def plan_html(
    cloud: Cloud,
    edge: Edge,
    toolpath: Toolpath,
    run: Run,
    moves: Moves | None,
    gate: Gate | None,
    stepped: Stepped | None,
    drawn: Mapping[str, bytes],
) -> str:
    """The chapter; `drawn`: PNG or SVG by name, `engagement` and `section` only where there is something to show."""
    stretch = shown_stretch(edge)
    return render(
        "plan.html.j2",
        facts=[*facts(cloud, edge), ("Thickness", thickness(edge))],
        required=list(required(edge, toolpath)),
        plan=[*plan_rows(toolpath, run), *move_rows(moves)],
        layers=list(layer_rows(toolpath, run)),
        refused=list(refused(edge, toolpath, gate)),
        from_scan=isinstance(edge, RawEdge),
        turn=None if (turn := local_turn_deg(edge)) is None else f"{turn:.2g}",
        calibrated=isinstance(edge, RawEdge) and edge.hand_eye_u_mm is not None,
        pictures={name: data_address(content) for name, content in drawn.items()},
        stretch=f"{stretch.from_mm:.0f} to {stretch.to_mm:.0f} mm",
        whole=stretch.to_mm - stretch.from_mm >= float(edge.arc_length_mm[-1]),
        local_mm=f"{LOCAL_MM:g}",
        axis_mm=f"{AXIS_MM:g}",
        tool_axis_mm=f"{TOOL_AXIS_MM:g}",
        tool_axes=list(zip("xyz", TOOL_AXES, strict=True)),
        edge_colours=(("lower edge", LOWER_EDGE), ("upper edge", UPPER_EDGE)),
        faces=[(name, colour) for name, colour in faces_seen(edge)],
        face_colours=FACES,
        section_at=f"{stepped.arc_length_mm:.1f}" if stepped else "",
        final=toolpath.layers[-1].index,
        gate=gate,
    )


def plan_summary(toolpath: Toolpath, run: Run, gate: Gate | None) -> str:
    """The plan in one line."""
    if gate is not None and not gate.passed:
        return one_line(f"not released: {gate.reason}")
    count, saved = len(toolpath.layers), 1.0 - run.time_s.sum() / toolpath.time_at_v_slow_s
    less = f", {100.0 * saved:.0f} % less than at {toolpath.v_slow_mm_s:g} mm/s throughout" if saved > 0.005 else ""
    return f"{count} layer{'s' if count > 1 else ''} in {duration(float(run.time_s.sum()))}{less}"


@stage("report.plan")
def plan(
    cloud: Cloud,
    edge: RawEdge,
    toolpath: Toolpath,
    moves: Moves | None = None,
    gate: Gate | None = None,
    engagement: Engagement | None = None,
    *,
    points: Annotated[int, Field(ge=10_000, le=1_000_000)] = 150_000,
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
    from workbench.report.layer_section import stepped_section, stepping_drawing
    from workbench.report.path_charts import edges_in_plane, engagement_chart, feed_chart, path_views, procedure_views
    from workbench.report.plan import plan_html, plan_summary
    from workbench.report.planned import feed_scale, layer_scale, whole_run
    from workbench.report.scene import pictures
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
        verdict="" if gate is None else gate.verdict,
        summary=plan_summary(toolpath, run, gate),
        part=toolpath.part,
        warnings=tuple(dict.fromkeys(map(one_line, [*edge.warnings, *toolpath.warnings]))),
        scene=scene,
        not_checked=gate.left_open if gate is not None and gate.passed else (),
    )
