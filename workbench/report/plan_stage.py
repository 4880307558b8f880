"""The stage `report.plan`: the chapter on a milling path and how it came from the scan."""

from __future__ import annotations

from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import Chapter, Cloud, Edge, Engagement, Gate, Layer, Moves, RawEdge, Toolpath
from workbench.errors import InputError, one_line
from workbench.marks import FACES, LOWER_EDGE, TOOL_AXES, UPPER_EDGE, Lettering
from workbench.pieces import GREY, INK
from workbench.plot import Axes, Figure
from workbench.report.along import axes_at, developed, laid_out
from workbench.report.dimensions import dimension, dimension_angle, dimension_radius
from workbench.report.path_charts import edges_in_plane, engagement_chart, feed_chart
from workbench.report.planned import (
    LOCAL_MM,
    Run,
    duration,
    feed_key,
    frames_in_base,
    layer_ink,
    layer_key,
    layer_rows,
    local_turn_deg,
    middle_of_cut_mm,
    move_rows,
    plan_rows,
    planned_bevel,
    planned_u,
    refused,
    required,
    thickness,
    thickness_mm,
    whole_run,
)
from workbench.report.scene import around, pictures
from workbench.report.scenes import TOOL_AXIS_MM, plan_scene
from workbench.report.tables import faces_seen, facts
from workbench.report.text import data_address, decimals, measured, render
from workbench.report.views import AXIS_MM, path_views, procedure_views, shown_stretch
from workbench.stage import stage
from workbench.units import Float, Shaped

ARC_POINTS = 40  # of a fillet
POINTS, REACH_MM = 6_000, 0.5  # scanned points drawn; from so far along the edge
EXTENDED = 0.11  # of the drawing's size: layers are drawn on beyond the stock, for their numbers
SIZE_IN, LEFT_IN, RIGHT_IN, BELOW_IN, ABOVE_IN = 3.6, 3.8, 3.2, 0.35, 0.95  # of the drawing on paper


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
    """The plan as a chapter of the report: scan, path, layers, feed, times, refusals.

    Root face and bevel angle are those of the path against the scanned edge, with U = 2 u.

    Args:
        cloud: the cloud of the raw edge.
        edge: the raw edge that the path was planned on.
        toolpath: the path with its feeds.
        moves: what simplification made of it; without it the page says so.
        gate: the path's own checks; without them the page says so and gives no verdict.
        engagement: of the cutter along the path, from a simulation.
        points: about the largest number of points in a view.

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
    if not toolpath.layers:
        raise InputError(toolpath.source or "path", "expected at least one layer")
    run = whole_run(toolpath)
    views = {**procedure_views(cloud, edge, toolpath, points), **path_views(cloud, edge, toolpath, run, points)}
    drawn = {
        **pictures(views),
        "d": edges_in_plane(cloud, edge),
        "feed_chart": feed_chart(edge, toolpath),
    }
    if stepped := stepped_section(edge, toolpath):
        drawn["section"] = stepping_drawing(cloud, edge, toolpath, stepped)
    if engagement is not None:
        drawn["engagement"] = engagement_chart(edge, toolpath, engagement)
    stretch, turn = shown_stretch(edge), local_turn_deg(edge)
    return Chapter(
        title="Plan",
        html=render(
            "plan.html.j2",
            facts=[*facts(cloud, edge), ("Thickness", thickness(edge))],
            required=list(required(edge, toolpath)),
            plan=[*plan_rows(toolpath, run), *move_rows(moves)],
            layers=list(layer_rows(toolpath, run)),
            refused=list(refused(edge, toolpath, gate)),
            from_scan=isinstance(edge, RawEdge),
            turn=None if turn is None else f"{turn:.2g}",
            calibrated=isinstance(edge, RawEdge) and edge.hand_eye_u_mm is not None,
            pictures={name: data_address(content) for name, content in drawn.items()},
            stretch=f"{stretch.from_mm:.0f} to {stretch.to_mm:.0f} mm",
            whole=stretch.to_mm - stretch.from_mm >= float(edge.arc_length_mm[-1]),
            local_mm=f"{LOCAL_MM:g}",
            layer_key=layer_key(toolpath),
            feed_key=feed_key(run),
            axis_mm=f"{AXIS_MM:g}",
            tool_axis_mm=f"{TOOL_AXIS_MM:g}",
            tool_axes=list(zip("xyz", TOOL_AXES, strict=True)),
            edge_colours=(("lower edge", LOWER_EDGE), ("upper edge", UPPER_EDGE)),
            faces=faces_seen(edge),
            face_colours=FACES,
            section_at=f"{stepped.arc_length_mm:.1f}" if stepped else "",
            final=toolpath.layers[-1].index,
            gate=gate,
        ),
        verdict="" if gate is None else gate.verdict,
        summary=plan_summary(toolpath, run, gate),
        part=toolpath.part,
        warnings=tuple(dict.fromkeys(map(one_line, [*edge.warnings, *toolpath.warnings]))),
        scene=plan_scene(cloud, edge, toolpath, run, points),
        not_checked=gate.left_open if gate is not None and gate.passed else (),
    )


class Cut(NamedTuple):
    """A layer in a section: where its bevel face starts (at the upper side) and ends, (2,) each, in mm."""

    layer: Layer
    upper: Float
    lower: Float
    fillet: Shaped[Float, "f 2"]  # below it, made by a ball end; a flat end's has no extent


class Stepped(NamedTuple):
    """The section at an arc length: stock and layers."""

    arc_length_mm: float
    thickness_mm: float
    upper_edge: Shaped[Float, " 2"]
    inward: Shaped[Float, " 2"]  # unit, along the upper surface into the plate
    cuts: list[Cut]  # layers that cut here, first to last
    root_mm: float
    bevel_deg: float


def stepped_section(edge: RawEdge, toolpath: Toolpath) -> Stepped | None:
    """The section at the middle of the longest stretch that is cut; None without one, or where the stock is unknown."""
    middle, high = middle_of_cut_mm(toolpath), thickness_mm(edge)
    bevel = planned_bevel(toolpath, edge)
    s = bevel.arc_length_mm
    known = np.isfinite(np.interp(s, edge.arc_length_mm, high))
    if middle is None or not known.any():
        return None
    k = int(np.argmin(np.where(known, np.abs(s - middle), np.inf)))
    station = int(np.nanargmin(np.where(np.isfinite(high), np.abs(edge.arc_length_mm - s[k]), np.nan)))
    axes = np.array([edge.normal[station], edge.across[station]])
    inward = edge.upper_inward[station]
    return Stepped(
        arc_length_mm=float(s[k]),
        thickness_mm=float(high[station]),
        inward=axes @ inward,
        upper_edge=axes @ (edge.upper_position_mm[station] - edge.position_mm[station]),
        cuts=[cut for layer in toolpath.layers if (cut := _cut(edge, toolpath, layer, float(s[k])))],
        root_mm=float(bevel.root_mm[k]),
        bevel_deg=float(bevel.bevel_deg[k]),
    )


def stepping_drawing(cloud: Cloud, edge: Edge, toolpath: Toolpath, stepped: Stepped) -> bytes:
    """SVG of the section."""
    top, left = stepped.thickness_mm, -float(stepped.cuts[-1].upper[0])
    inch = max(left / 1.8, top / 3.2)  # mm of the part in an inch of the drawing: dimensions and texts have their room
    size, width, height = SIZE_IN * inch, LEFT_IN + RIGHT_IN, top / inch + BELOW_IN + ABOVE_IN
    figure = Figure(figsize=(width + 0.65, height + 0.5))
    axes = figure.add_axes(
        (0.6 / (width + 0.65), 0.45 / (height + 0.5), width / (width + 0.65), height / (height + 0.5))
    )
    axes.set(xlim=(-LEFT_IN * inch, RIGHT_IN * inch), ylim=(-BELOW_IN * inch, top + ABOVE_IN * inch))
    axes.integer = "xy"
    _draw_stock(axes, stepped, LEFT_IN * inch)
    _draw_points(axes, cloud, edge, stepped)
    _draw_layers(axes, toolpath, stepped, size)
    _draw_dimensions(axes, edge, toolpath, stepped, size)
    axes.set(xlabel="u along the end face's outward normal, mm", ylabel="v from the lower to the upper side, mm")
    return figure.svg()


def _cut(edge: Edge, toolpath: Toolpath, layer: Layer, at_mm: float) -> Cut | None:
    """The layer's face at its point nearest to an arc length; None where it does not cut there."""
    k = int(np.argmin(np.abs(layer.arc_length_mm - at_mm)))
    if not layer.cutting[k]:
        return None
    middle = toolpath.in_base(toolpath.face_middle_mm(layer)[k : k + 1])
    s, u, v = developed(middle, layer.arc_length_mm[k : k + 1], edge)[0]
    axis = frames_in_base(toolpath, layer)[k][:, 2]  # from shank to tip: down to the lower side
    here = np.array([s])
    along = np.array([axis @ axes_at(here, edge, each)[0] for each in (edge.normal, edge.across)])
    half = along * layer.width_mm[k] / 2.0
    upper, lower = np.array([u, v]) - half, np.array([u, v]) + half
    return Cut(layer, upper, lower, _fillet(toolpath.root_radius_mm, lower, along))


def _fillet(radius: float, lower: Float, along: Float) -> Float:
    """The part (f, 2) of a ball end's outline that cuts below the bevel face, from the face to the end face."""
    off = np.array([-along[1], along[0]])  # the bevel's outward normal: `along` turned to the left
    beyond = np.clip((off * radius + lower)[0] / max(radius, 1e-9), -1.0, 1.0)  # the centre's place before the end face
    end = np.arctan2(off[0], off[1]) - np.arcsin(beyond)  # from the bevel face to where it meets the end face
    angle = np.linspace(0.0, max(float(end), 0.0), ARC_POINTS)[:, None]
    return np.asarray(lower + radius * (off - np.cos(angle) * off + np.sin(angle) * along))


def _draw_stock(axes: Axes, stepped: Stepped, width: float) -> None:
    """The plate, and on it what is to be milled away."""
    corner, final = stepped.upper_edge, stepped.cuts[-1]
    reach = 1.2 * width
    plate = np.array([[0.0, 0.0], corner, corner + reach * stepped.inward, reach * stepped.inward])
    axes.fill(*plate.T, facecolor="#eef0f2", zorder=0.2)
    waste = np.array([*final.fillet, corner, final.upper])
    axes.fill(*waste.T, facecolor="white", zorder=0.3)
    axes.fill(*waste.T, hatch="////", zorder=0.3)
    axes.plot(*np.array([[0.0, 0.0], corner, corner + reach * stepped.inward]).T, color=GREY, linewidth=0.9, zorder=1.5)
    lower = np.array([[0.0, 0.0], reach * stepped.inward])
    axes.plot(*lower.T, color=GREY, linewidth=0.7, dashes=(6, 3), zorder=1.5)  # not scanned: parallel to the upper one


def _draw_points(axes: Axes, cloud: Cloud, edge: Edge, stepped: Stepped) -> None:
    points = around(cloud, edge, stepped.arc_length_mm, REACH_MM, POINTS)
    suv = laid_out(points, cloud, edge)
    for face in np.unique(points.label):
        _, u, v = suv[points.label == face].T
        axes.points(u, v, ".", color=FACES[int(face)], markersize=2.6, alpha=0.6, zorder=2)


def _draw_layers(axes: Axes, toolpath: Toolpath, stepped: Stepped, size: float) -> None:
    """Each layer's face, drawn on beyond the upper surface, where its number stands."""
    count, named = len(toolpath.layers), _named(stepped, size)
    for cut in stepped.cuts:
        colour, final = layer_ink(cut.layer.index, count), cut is stepped.cuts[-1]
        face = np.array([*cut.fillet[::-1], cut.lower, cut.upper])
        axes.plot(*face.T, color=colour, linewidth=2.2 if final else 1.4, zorder=3)
        beyond = _beyond(cut, size)
        end = _beyond(cut, 1.75 * size) if cut in stepped.cuts[-2:] else beyond  # for the depth of cut
        axes.plot(*np.array([cut.upper, end]).T, color=colour, linewidth=0.6, zorder=1)
        if cut.layer.index in named:
            axes.annotate(
                f"{cut.layer.index}",
                tuple(beyond),
                (-5, -1),
                ha="right",
                va="center",
                fontsize=8,
                look=Lettering(INK, weight="bold" if final else "normal"),
            )


def _named(stepped: Stepped, size: float) -> set[int]:
    """Layers whose numbers have room beside each other, the final one first."""
    named, last = set(), -np.inf
    for cut in reversed(stepped.cuts):
        if cut.upper[0] - last > 0.08 * size:
            named.add(cut.layer.index)
            last = cut.upper[0]
    return named


def _draw_dimensions(axes: Axes, edge: Edge, toolpath: Toolpath, stepped: Stepped, size: float) -> None:
    root_u, bevel_u = planned_u(edge, toolpath)
    root = measured(stepped.root_mm, root_u, decimals([root_u]))
    low, top = np.zeros(2), np.array([0.0, stepped.root_mm])
    dimension(axes, (low, top), np.array([0.05 * size, 0.0]), f"root face {root} mm", size)
    text, high = f"thickness\n{stepped.thickness_mm:.2f} mm", np.array([0.0, stepped.thickness_mm])
    dimension(axes, (low, high), np.array([0.6 * size, 0.0]), text, size)
    angle = measured(stepped.bevel_deg, bevel_u, decimals([bevel_u]))
    fillet, corner, final = toolpath.root_radius_mm, top, stepped.cuts[-1]
    along = (final.lower - final.upper) / np.linalg.norm(final.lower - final.upper)
    off = np.array([-along[1], along[0]])  # the bevel's outward normal: `along` turned to the left
    if fillet:
        middle = final.fillet[len(final.fillet) // 2]
        dimension_radius(axes, final.lower + fillet * off, middle, f"root radius {fillet:g} mm")
        corner = final.lower
    radius = min(0.3 * size, 0.5 * (stepped.thickness_mm - corner[1]))
    dimension_angle(axes, corner, stepped.bevel_deg, f"({angle})°", radius)
    if len(stepped.cuts) > 1:
        low = _beyond(final, 1.6 * size)
        depth = abs(float((stepped.cuts[-2].upper - final.upper) @ off))
        text = f"depth of cut {depth:.3g} mm"
        dimension(axes, (low, low + depth * off), low, text, size, along=off, place="start", side="left")


def _beyond(cut: Cut, size: float) -> Float:
    """A point on a layer's line beyond the upper surface."""
    along = cut.upper - cut.lower
    on: Float = cut.upper + EXTENDED * size * along / np.linalg.norm(along)
    return on
