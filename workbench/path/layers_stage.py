"""`path.layers`: the milling path from the stock to the finished bevel, layer by layer."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts import ChainU, Cloud, Cutter, Layer, MeasuredAxis, Part, RawEdge, Toolpath
from workbench.errors import InputError
from workbench.path.course import Bevel, Course, bevel_of, edge_course, layer_heights, raised, under, upper_bevel
from workbench.path.obstacles import Lift
from workbench.path.plan import (
    Air,
    Plan,
    Scanned,
    cut_stretches,
    key_points,
    known_well,
    make_layer,
    make_layers,
    make_plan,
    path_of,
    refuse_allowance,
    refuse_compound,
    refuse_cutter,
    refuse_fillet,
    refuse_partial_view,
    refuse_requirement,
    refuse_small_root,
)
from workbench.result_files import RobotFile, ToolFile, TurntableFile
from workbench.stage import InputFile, stage
from workbench.units import DEG, Float

AFTER_UPPER = "that the upper bevel of {:g} deg has been milled, by the path planned for it with the same parameters"
FLUTE_SPARE_MM = 2.0  # at each end of the widest face, where the flute's length is not given


@stage("path.layers")
def layers(
    edge: RawEdge,
    cloud: Cloud,
    *,
    root_mm: Annotated[float, Field(gt=0, le=50)] = 1.5,
    bevel_deg: Annotated[float, Field(ge=10, le=75)] = 40.0,
    depth_of_cut_mm: Annotated[float, Field(ge=0.05, le=20)] = 1.0,
    finish_allowance_mm: Annotated[float, Field(ge=0, le=5)] = 0.0,
    cutter_diameter_mm: Annotated[float, Field(ge=1, le=100)] = 10.0,
    flutes: Annotated[int, Field(ge=1, le=20)] = 4,
    flute_length_mm: Annotated[float | None, Field(gt=0, le=200)] = None,
    v_slow_mm_s: Annotated[float, Field(gt=0, le=1000)] = 1.0,
    clearance_mm: Annotated[float, Field(ge=0.5, le=100)] = 5.0,
    side_clearance_mm: Annotated[float, Field(ge=0.1, le=50)] = 2.0,
    ramp_mm: Annotated[float, Field(ge=1, le=100)] = 5.0,
    lead_mm: Annotated[float, Field(ge=1, le=200)] = 12.0,
    root_radius_mm: Annotated[float, Field(ge=0, le=50)] = 0.0,
    smoothing_mm: Annotated[float, Field(ge=0, le=100)] = 10.0,
    tool: InputFile | None = None,
    turntable: InputFile | None = None,
    robot_accuracy_mm: Annotated[float, Field(ge=0, le=100)] = 0.0,
    robot_calibration: InputFile | None = None,
    least_seen_share: Annotated[float, Field(ge=0, le=1)] = 0.5,
    root_tolerance_mm: Annotated[float, Field(gt=0, le=10)] = 0.5,
    bevel_tolerance_deg: Annotated[float, Field(gt=0, le=30)] = 1.0,
    upper_bevel_deg: Annotated[float | None, Field(gt=10, le=75)] = None,
    lower_bevel_mm: Annotated[float | None, Field(gt=0, le=50)] = None,
    mill: Literal["upper", "lower"] = "lower",
) -> Toolpath:
    """Plan the milling of a bevel in layers, from the stock to the finished face (the paper's 4.3 and 6.1, Fig. 13).

    Key points lie every 1 mm of the lower edge, in the middle of the layer's bevel face (docs/conventions.md). What was
    not measured is not cut (docs/planning.md).

    Args:
        edge: the measured raw edge.
        cloud: the scan, for clamps and all else that the cutter must not meet.
        root_mm: required root face.
        bevel_deg: required bevel angle.
        depth_of_cut_mm: height of a layer; the first takes the remainder.
        finish_allowance_mm: left on the bevel face for a pass that `path.correct` corrects, along its normal; at most
            the depth of cut.
        cutter_diameter_mm: of the cylindrical end mill.
        flutes: count of its flutes.
        flute_length_mm: of the cutter, centred on the tool frame; null: 2 mm over the widest face at each end.
        v_slow_mm_s: feed while cutting (`path.feed` makes the rest faster).
        clearance_mm: height above stock and clamps in travel moves.
        side_clearance_mm: distance that the cutter keeps to a clamp beside it.
        ramp_mm: length of edge in which the cutter rises or falls.
        lead_mm: length of lead-in and lead-out.
        root_radius_mm: of a J preparation, milled by a ball end of this radius, half of `cutter_diameter_mm`; 0: a
            bevel.
        smoothing_mm: over which the stock's upper edge is smoothed, to each side.
        tool: a tcp.json of `calibrate.tcp`: its u counts.
        turntable: a turntable.json of `calibrate.turntable`, likewise.
        robot_accuracy_mm: u of the robot's place between scan and cut, each axis; 0: not stated.
        robot_calibration: a robot.json by which the controller was corrected: its u instead of robot_accuracy_mm.
        least_seen_share: least share of the edge that is seen and known well enough.
        root_tolerance_mm: of the root face: where the guard band of its place (1.645 u) is larger, nothing is cut.
        bevel_tolerance_deg: of the bevel angle: likewise, by the end face's direction.
        upper_bevel_deg: of a compound bevel: its flatter upper bevel (root_mm and bevel_deg are the lower one's); null:
            none.
        lower_bevel_mm: of a compound bevel: height of the lower bevel.
        mill: the upper bevel, or the lower one after it (NOT CHECKED until `rests_milled`).

    Raises:
        InputError: a milled edge; too little of it seen; a requirement that stock or cutter cannot meet.

    Example:
        >>> from workbench import edge, path, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.layers(raw, points)
        >>> len(plan.layers), plan.depth_of_cut_mm
        (5, 1.0)
    """
    refuse_partial_view(edge, least_seen_share)
    lower, length = bevel_of(root_mm, bevel_deg, root_radius_mm), float(edge.arc_length_mm[-1])
    refuse_small_root(edge, lower)
    upper = upper_bevel(lower, upper_bevel_deg, lower_bevel_mm)
    if upper is None and mill == "upper":
        raise InputError("mill", "'upper' expects upper_bevel_deg and lower_bevel_mm: a compound bevel has both")
    bevel = lower if upper is None or mill == "lower" else upper
    chain = chain_u(edge.part, tool, turntable, robot_calibration, robot_accuracy_mm)
    counts = None if finish_allowance_mm > 0.0 else chain  # a measured cut shows what these do
    air, points = Air(clearance_mm, side_clearance_mm, ramp_mm, lead_mm), key_points(length, lead_mm)

    def setting(to: Bevel, beneath: Bevel | None) -> tuple[RawEdge, Course, Cutter]:
        """The edge as far as it is known well enough, its course with the stock, and the cutter."""
        known = known_well(edge, to, root_tolerance_mm, bevel_tolerance_deg, least_seen_share, counts)
        course = edge_course(known, points, smoothing_mm)
        if upper is not None:
            refuse_compound(course, upper)
        course = course if beneath is None else under(course, beneath)
        at = course.seen & (points >= 0.0) & (points <= length)
        refuse_requirement(course, at, to)
        if to.fillet_mm:
            conflict = "finish_allowance_mm" if finish_allowance_mm else ""
            refuse_fillet(course, at, to, cutter_diameter_mm, conflict if upper is None else "upper_bevel_deg")
        refuse_allowance(course, at, to, finish_allowance_mm, depth_of_cut_mm)
        widest = to.width_mm(course, 0.0)[at].max() + to.fillet_mm
        flute_mm = flute_length_mm or float(math.ceil(widest + 2.0 * FLUTE_SPARE_MM))
        cutter = Cutter(cutter_diameter_mm, flutes, flute_mm, ball_end=to.fillet_mm > 0.0)
        refuse_cutter(course, at, to, cutter, depth_of_cut_mm)
        return known, course, cutter

    def plan_of(to: Bevel, of: tuple[RawEdge, Course, Cutter], leave: Sequence[Lift] = ()) -> Plan:
        known, course, cutter = of
        table = edge_course(known, known.arc_length_mm, 0.0)
        to = replace(to, to_ball_mm=cutter.cylinder_end_mm)
        return make_plan(Scanned(known, cloud, table), course, to, cutter, air, v_slow_mm_s, leave)

    beneath = upper if bevel is lower else None
    of = setting(bevel, beneath)
    raw = None if upper is None or beneath is None else setting(upper, None)
    milled = None if upper is None or raw is None else make_layer(plan_of(upper, raw), 1, 0.0).cutting

    def path(to: Bevel, heights_of: Callable[[Float], Float]) -> Toolpath:
        leave: tuple[Lift, ...] = ()
        if milled is not None and raw is not None:
            # the lower bevel's passes go above the stock where the upper bevel's path leaves it
            height_mm = float(to.height_mm(raw[1].upper_mm).max()) + clearance_mm
            inside = (points > -1e-6) & (points < length + 1e-6)
            leave = tuple(
                Lift(a, b, height_mm, "the upper bevel is not milled", ramp_mm)
                for a, b in cut_stretches(points, inside & ~milled)
            )
        plan = plan_of(to, of, leave)
        cut = _cut_layers(plan, heights_of)
        before: tuple[Layer, ...] = ()
        if milled is not None:  # nothing stands there so high above this bevel
            before = (replace(make_layer(plan, 1, float(plan.stock_mm.max())), cutting=milled),)
        return replace(
            path_of(plan, cut, of[2], depth_of_cut_mm, cloud),
            refused=_refused(plan, cut[-1]),
            warnings=of[0].warnings,
            evidence=edge.checks,
            before=before,
            rests_on="" if milled is None else AFTER_UPPER.format(upper_bevel_deg),
            chain=chain,
            root_radius_mm=to.fillet_mm,
        )

    if finish_allowance_mm == 0.0:
        return path(bevel, lambda stock: layer_heights(stock, depth_of_cut_mm))
    first = path(
        raised(bevel, finish_allowance_mm), lambda stock: layer_heights(stock, depth_of_cut_mm, finish_allowance_mm)
    )
    earlier = (*first.before, *first.layers)
    before = tuple(replace(layer, height_mm=layer.height_mm + finish_allowance_mm) for layer in earlier)
    finishing = replace(path(bevel, lambda _: np.array([finish_allowance_mm, 0.0])), before=before)
    return replace(first, finish_allowance_mm=finish_allowance_mm, finishing=finishing)


def _cut_layers(plan: Plan, heights_of: Callable[[Float], Float]) -> tuple[Layer, ...]:
    """The layers that cut somewhere, in cutting order, at the heights that the stock asks for."""
    reachable = make_layer(plan, 1, 0.0).cutting
    if not reachable.any():
        reasons = {lift.reason for lift in plan.lifts} or {"no stock"}
        raise InputError(
            "edge",
            f"nothing of it can be milled: {', '.join(sorted(reasons))} along its whole length; or is upper_side "
            "reversed, or an axis mirrored?",
        )
    return make_layers(plan, heights_of(plan.stock_mm[reachable]))


def _refused(plan: Plan, final: Layer) -> tuple[str, ...]:
    """Stretches of the edge that the final layer does not cut, and why."""
    s = plan.course.arc_length_mm
    inside = (s >= -1e-6) & (s <= plan.length_mm + 1e-6)
    return tuple(
        f"arc length {a:.1f} to {b:.1f} mm: {_reason(plan, a, b)}" for a, b in cut_stretches(s, inside & ~final.cutting)
    )


def _reason(plan: Plan, a: float, b: float) -> str:
    near = [x.reason for x in plan.lifts if x.to_mm + x.ramp_mm >= a and x.from_mm - x.ramp_mm <= b]
    return ", ".join(dict.fromkeys(near)) or "no stock above the finished bevel"


# The links of the chain that a plan rests on beside edge and hand-eye pose: tool, turntable, robot.

UNKNOWN_AXIS_DEG = 0.05  # u of a tool's axis that was not measured: a spindle's mounting, as in report.sensitivity


def chain_u(
    part: Part, tool: Path | None, turntable: Path | None, robot: Path | None, robot_mm: float
) -> ChainU | None:
    """What the files of tool, turntable and robot state, or else the robot's accuracy; None: nothing.

    Raises:
        InputError: a file that is none of its kind, or of another robot than the part's recording.
    """
    axes = {}
    if tool is not None:
        declared = ToolFile.read_for(tool, part)
        tip, axis = declared.points[0], declared.axis
        along, turn_deg = (None, UNKNOWN_AXIS_DEG) if axis is None else (axis.direction, axis.u_deg)
        axes["tool"] = MeasuredAxis(tip.position_mm, along, tip.u_mm, turn_deg)
    if turntable is not None:
        table = TurntableFile.read_for(turntable, part)
        axes["turntable"] = MeasuredAxis(table.axis_point_mm, table.axis_direction, table.u_mm, table.direction_u_deg)
    parts = {name: (one.u_mm, one.u_deg) for name, one in axes.items()}
    if robot is not None:
        parts["robot"] = RobotFile.read_for(robot, part).u_mm, 0.0
    elif robot_mm > 0.0:
        parts["robot"] = robot_mm, 0.0
    if not parts:
        return None
    mm, deg = (math.hypot(*each) for each in zip(*parts.values(), strict=True))
    return ChainU(mm, deg * DEG, (*parts,), axes)
