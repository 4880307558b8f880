"""The HTML of the chapter on a plan: its tables and sentences around its pictures."""

from __future__ import annotations

from collections.abc import Mapping

from workbench.artefacts import Cloud, Edge, Gate, Moves, RawEdge, Toolpath
from workbench.errors import one_line
from workbench.report.colours import FACES, LOWER_EDGE, TOOL_AXES, UPPER_EDGE
from workbench.report.inspection_text import faces_seen
from workbench.report.layer_section import Stepped
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
from workbench.report.procedure import AXIS_MM, TOOL_AXIS_MM, shown_stretch
from workbench.report.tables import facts
from workbench.report.template import data_address, render


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
