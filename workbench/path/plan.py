"""A milling path over a course: from an edge and its scan to layers and travel moves, or why it cannot be planned."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from workbench.artefacts import ChainU, Cloud, Cutter, Edge, Layer, RawEdge, Toolpath, Travel
from workbench.errors import InputError
from workbench.geometry.moves import chords_mm, runs
from workbench.geometry.poses import pose_from, quaternion_from_rotation, rotation_from_quaternion
from workbench.geometry.stations import needed_heights
from workbench.path.course import LEAST_DEPTH_MM, Bevel, Course, bevel_normal, cutter_axis, same_sign
from workbench.path.obstacles import (
    Lift,
    find_lifts,
    foreign,
    hold_at_ends,
    lifted_heights,
    merged,
    scan_of,
    sections_of,
)
from workbench.units import DEG, Bool, Float, Int, Shaped

KEY_POINT_MM = 1.0
MOST_TRAVEL_MM = 50.0  # between points of travel moves
CUTTING_LIFT_MM = 1e-9  # above its layer by more than this the cutter is being lifted
LEAST_STRETCH = 0.02  # of the axis' course per length of edge
GUARD = 1.645  # times u that a value must lie within its limits (ISO 14253-1), as an inspection judges it
LEAST_ROOT_MM = 0.05  # to which good robots repeat
MOST_KNOWN_MM = 0.6  # U (k = 2) of a lower edge that is milled: what 0.5 mm of root_tolerance_mm allow at GUARD
SMALL_ROOT = 2.0  # U of the lower edge across it
FILLET_MM = 0.002  # by which a cutter's radius may differ from the fillet's: what is read as one number
LEAST_SLOPE = 0.1  # sine of the angle between upper surface and bevel


class Air(NamedTuple):
    """How the cutter passes above what it does not cut, mm."""

    over_mm: float  # clearance above stock and clamps
    lateral_mm: float  # clearance beside a clamp
    ramp_mm: float  # edge along which it rises
    lead_mm: float  # length of lead-in and lead-out


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """What all layers of a path share: places along the edge, tool frames, lifts."""

    course: Course  # at the k points of every layer, lead-in and lead-out included
    bevel: Bevel
    stock_mm: Shaped[Float, " k"]  # height of the stock above the finished face
    outward: Shaped[Float, "k 3"]  # b
    quaternion_wxyz: Shaped[Float, "k 4"]
    lifts: tuple[Lift, ...]
    clear_mm: float  # height above the finished face that clears the stock
    air: Air
    length_mm: float  # of the edge
    v_slow_mm_s: float


def key_points(length_mm: float, lead_mm: float) -> Float:
    """Arc lengths (k,) of a layer's points: one every mm from 0, the last at the end of the edge, and both leads.

    The last interval may be shorter, but no shorter than a hundredth of a mm.
    """
    inner = np.arange(0.0, length_mm - 0.01 * KEY_POINT_MM, KEY_POINT_MM)
    lead = np.arange(1, max(1, round(lead_mm / KEY_POINT_MM)) + 1) * KEY_POINT_MM
    return np.concatenate([-lead[::-1], inner, [length_mm], length_mm + lead])


def origins(course: Course, bevel: Bevel, height_mm: float) -> Float:
    """Middle (k, 3) of the face at a height, in the base."""
    return np.asarray(course.position_mm + course.in_base(bevel.middle(course, height_mm)))


def make_layer(plan: Plan, index: int, height_mm: float) -> Layer:
    """The layer at a height above the finished face; `index` from 1, in cutting order."""
    course, s = plan.course, plan.course.arc_length_mm
    lifted = lifted_heights(s, plan.lifts, height_mm)
    lift = np.maximum(
        lifted - height_mm,
        lead_heights(np.maximum(-s, s - plan.length_mm), plan.air.lead_mm, plan.clear_mm - height_mm),
    )
    inside = (s > -1e-6) & (s < plan.length_mm + 1e-6)
    cutting = course.seen & inside & (lift < CUTTING_LIFT_MM) & (plan.stock_mm - height_mm > LEAST_DEPTH_MM)
    return Layer(
        index=index,
        height_mm=float(height_mm),
        arc_length_mm=s,
        position_mm=origins(course, plan.bevel, height_mm) + lift[:, None] * plan.outward,
        quaternion_wxyz=plan.quaternion_wxyz,
        feed_mm_s=np.full(s.shape, plan.v_slow_mm_s),
        cutting=cutting,
        measured=course.seen,
        width_mm=np.where(cutting, plan.bevel.width_mm(course, height_mm), 0.0),
    )


def make_layers(plan: Plan, heights: Float) -> tuple[Layer, ...]:
    """The layers at heights (l,), in cutting order."""
    return tuple(make_layer(plan, k, height) for k, height in enumerate(heights.tolist(), 1))


def lead_heights(beyond_mm: Float, lead_mm: float, clear_mm: float) -> Float:
    """Height (k,) above the layer at places `beyond_mm` (k,) its end: a circle that leaves it tangentially.

    It reaches `clear_mm` at the end of the lead, or a quarter of a circle where that is higher.
    """
    rise = min(clear_mm, lead_mm)
    radius = (lead_mm**2 + rise**2) / (2.0 * rise)
    return np.asarray(radius - np.sqrt(radius**2 - np.clip(beyond_mm, 0.0, lead_mm) ** 2))


def make_travels(plan: Plan, layers: Sequence[Layer], high_mm: float) -> tuple[Travel, ...]:
    """Travel moves: up, back along the edge and down before each layer; up after the last.

    A straight line back would pass through the plate on a convex arc.
    """
    high = [
        origins(plan.course, plan.bevel, layer.height_mm) + (high_mm - layer.height_mm) * plan.outward
        for layer in layers
    ]
    stops = sparse(plan.course, high_mm)
    last, travels = len(plan.course.arc_length_mm) - 1, []
    for k, way in enumerate(high):
        back = stops[::-1] if k else stops[:1]
        points = np.concatenate([high[k - 1][last:], way[back]]) if k else way[back]
        turns = np.concatenate([[last], back]) if k else back
        travels.append(_travel(plan, points, turns))
    travels.append(_travel(plan, high[-1][last:], np.array([last])))
    return tuple(travels)


def sparse(course: Course, high_mm: float) -> Int:
    """Indices of places far apart, near enough that the chords between them stay within half a mm of the curve."""
    bend = float(np.abs(course.curvature).max())
    step = MOST_TRAVEL_MM if bend < 1e-9 else math.sqrt(8.0 * 0.5 * max(1.0 / bend - high_mm, 1.0))
    count = len(course.arc_length_mm)
    return np.unique(np.append(np.arange(0, count, max(int(min(step, MOST_TRAVEL_MM)), 1)), count - 1))


def _travel(plan: Plan, points: Float, at: Int) -> Travel:
    keep = np.concatenate([[True], chords_mm(points) > 1e-6])
    feed = np.full(int(keep.sum()), plan.v_slow_mm_s)
    return Travel(points[keep], plan.quaternion_wxyz[at][keep], feed)


def cut_stretches(s: Float, mask: Bool) -> list[tuple[float, float]]:
    """Arc lengths (from, to) of each run of True."""
    return [(float(s[first]), float(s[last])) for first, last in runs(mask)]


def refuse_partial_view(edge: Edge, least_seen_share: float) -> None:
    """An edge of which too little was seen."""
    share = float(np.mean(edge.seen))
    if share < least_seen_share:
        raise InputError(
            edge.source or "edge",
            f"seen on {100 * share:.0f} % of its length only, expected at least "
            f"{100 * least_seen_share:.0f} % (least_seen_share)",
        )


def known_well(
    edge: RawEdge,
    bevel: Bevel,
    root_tolerance_mm: float,
    bevel_tolerance_deg: float,
    least_seen_share: float,
    chain: ChainU | None = None,
) -> RawEdge:
    """The edge without the stations at which a bevel cut right on its nominal values could not be told to pass.

    Place: along the bevel's normal, as a change of the root face. Angle: the end face's turn about the edge; a heading
    that is off by d shows the angle in an oblique section, which changes it by d^2 sin(2 angle) / 4.

    Raises:
        InputError: too little of the edge is left.
    """
    place_mm, turn = (0.0, 0.0) if chain is None else (chain.place_mm, chain.turn)
    u = np.hypot(np.hypot(edge.position_u_mm, 0.0 if edge.hand_eye_u_mm is None else edge.hand_eye_u_mm), place_mm)
    root_mm = GUARD * bevel.u_of_root(u)
    oblique = (GUARD * edge.tangent_u) ** 2 * np.sin(2.0 * bevel.angle) / 4.0
    angle_deg = (GUARD * np.hypot(edge.normal_u, turn) + oblique) / DEG
    known = edge.seen & (root_mm <= root_tolerance_mm) & (angle_deg <= bevel_tolerance_deg)
    share = float(np.mean(known))
    if share < least_seen_share:
        raise InputError(
            edge.source or "edge",
            f"known well enough on {100 * share:.0f} % of its length only, expected at least "
            f"{100 * least_seen_share:.0f} % (least_seen_share): typically to "
            f"{np.median(root_mm[edge.seen]):.2g} of {root_tolerance_mm:g} mm (root_tolerance_mm) and "
            f"{np.median(angle_deg[edge.seen]):.2g} of {bevel_tolerance_deg:g} deg (1.645 u)"
            + ("" if chain is None else f"; with {' and '.join(chain.rests_on)} known to {place_mm:.2g} mm and ")
            + ("" if chain is None else f"{turn / DEG:.2g} deg (u)"),
        )
    notes = tuple(
        f"arc length {a:.0f} to {b:.0f} mm: not cut, the scan does not determine the edge well enough: "
        f"to {np.max(root_mm[on]):.2g} mm of root and {np.max(angle_deg[on]):.2g} deg of bevel (1.645 u)"
        for a, b in cut_stretches(edge.arc_length_mm, edge.seen & ~known)
        for on in [(edge.arc_length_mm >= a - 1e-6) & (edge.arc_length_mm <= b + 1e-6) & edge.seen & ~known]
    )
    return replace(edge, seen=known, warnings=edge.warnings + notes)


def refuse_requirement(course: Course, at: Bool, bevel: Bevel) -> None:
    """A root, or an angle, that the stock cannot satisfy. `at` (k,): measured places of the edge."""
    thickness, s = course.upper_mm[at, 1], course.arc_length_mm[at]
    least = int(np.argmin(thickness))
    if bevel.root_mm >= thickness[least]:
        raise InputError(
            "root_mm",
            f"{bevel.root_mm:g} mm of root leave nothing to mill: the stock is "
            f"{thickness[least]:.2f} mm thick at arc length {s[least]:.1f} mm",
        )
    slope = -(course.inward[at] @ bevel.normal)
    flat = int(np.argmin(slope))
    if slope[flat] < LEAST_SLOPE:
        raise InputError(
            "bevel_deg",
            f"{np.degrees(bevel.angle):g} deg lies along the stock's upper surface at arc length {s[flat]:.1f} mm",
        )
    if bevel.height_mm(course.upper_mm)[at].max() <= LEAST_DEPTH_MM:
        raise InputError("edge", "nothing to cut: no stock stands above the finished bevel")


def refuse_fillet(course: Course, at: Bool, bevel: Bevel, cutter_mm: float, conflict: str) -> None:
    """A J preparation that a ball end cannot make in one sweep, or whose fillet leaves no bevel face.

    `cutter_mm`: the cutter's diameter; `conflict`: a parameter that is given and that it cannot have, or nothing.
    """
    if conflict:
        raise InputError(
            conflict, "expected none beside root_radius_mm: a J preparation is milled by one path, at once"
        )
    if abs(cutter_mm - 2.0 * bevel.fillet_mm) > FILLET_MM:
        raise InputError(
            "cutter_diameter_mm",
            f"expected {2.0 * bevel.fillet_mm:g} mm, twice root_radius_mm, found {cutter_mm:g} mm: the fillet of a J "
            "preparation is milled by a ball end of its own radius",
        )
    width = bevel.width_mm(course, 0.0)[at]
    least = int(np.argmin(width))
    if width[least] <= LEAST_DEPTH_MM:
        raise InputError(
            "root_radius_mm",
            f"{bevel.fillet_mm:g} mm reach to the stock's upper surface at arc length "
            f"{course.arc_length_mm[at][least]:.1f} mm: no bevel face is left above the fillet",
        )


def refuse_compound(course: Course, upper: Bevel) -> None:
    """A compound bevel whose lower bevel would reach the stock's upper surface."""
    thickness = float(course.upper_mm[course.seen, 1].min())
    if upper.root_mm >= thickness:
        raise InputError(
            "lower_bevel_mm",
            f"leaves nothing to the upper bevel: its plane meets the end face {upper.root_mm:.2f} mm above the lower "
            f"edge, the stock is {thickness:.2f} mm thick",
        )


def refuse_small_root(edge: RawEdge, bevel: Bevel) -> None:
    """A root below twice the U of its place, or below what a robot repeats to: a length in another unit."""
    known_mm = 2.0 * float(np.nanmedian(edge.position_u_mm[edge.seen, 1]))
    if known_mm > MOST_KNOWN_MM:
        message = (
            f"the edge is known to {known_mm:.3g} mm (U, k = 2) only: do passes disagree, are poses or hand-eye pose "
            "wrong, or is its lower end lost, blurred by a filter, or rounded out of view (edge_condition)?"
        )
        raise InputError(edge.source or "edge", message)
    least_mm = max(LEAST_ROOT_MM, SMALL_ROOT * known_mm)
    if bevel.root_mm < least_mm:
        raise InputError(
            "root_mm",
            f"{bevel.root_mm:g} mm of root is less than {least_mm:.3g} mm, twice the U of the edge or what a robot "
            "repeats to: is it in another unit?",
        )


def refuse_allowance(course: Course, at: Bool, bevel: Bevel, allowance_mm: float, depth_of_cut_mm: float) -> None:
    """An allowance that one pass cannot take, or that leaves nothing to the first cut, or too little to correct."""
    if allowance_mm == 0.0:
        return
    if not 2.0 * LEAST_DEPTH_MM <= allowance_mm <= depth_of_cut_mm:
        raise InputError(
            "finish_allowance_mm",
            f"expected {2.0 * LEAST_DEPTH_MM:g} mm to the depth of cut "
            f"({depth_of_cut_mm:g} mm), found {allowance_mm:g} mm",
        )
    stock = float(bevel.height_mm(course.upper_mm)[at].max())
    if stock - allowance_mm <= LEAST_DEPTH_MM:
        raise InputError(
            "finish_allowance_mm",
            f"{allowance_mm:g} mm leave the first cut nothing: the stock stands "
            f"{stock:.2f} mm above the finished bevel",
        )


def refuse_cutter(course: Course, at: Bool, bevel: Bevel, cutter: Cutter, depth_of_cut_mm: float) -> None:
    """A cutter that cannot make this bevel in such layers."""
    if depth_of_cut_mm > cutter.radius_mm:
        raise InputError(
            "depth_of_cut_mm",
            f"{depth_of_cut_mm:g} mm is more than the cutter's radius of {cutter.radius_mm:g} mm",
        )
    width = bevel.width_mm(course, 0.0) + (bevel.fillet_mm if cutter.ball_end else 0.0)
    widest = int(np.argmax(np.where(at, width, -1.0)))
    if width[widest] > cutter.flute_length_mm:
        where = f"{width[widest]:.2f} mm wide at arc length {course.arc_length_mm[widest]:.1f} mm"
        raise InputError("flute_length_mm", f"{cutter.flute_length_mm:g} mm do not reach over the bevel face, {where}")


def refuse_tight_curve(course: Course, bevel: Bevel, height_mm: Float, cutter: Cutter) -> None:
    """A concave edge that bends more tightly than the cutter's course, at heights (k,) above the finished face.

    The length of the cutter's axis per length of the lower edge is 1 - curvature . offset. Where it is not above 0 the
    path would cross itself and the cutter would cut into its neighbourhood.
    """
    offset = bevel.middle(course, 0.0) + (height_mm + cutter.radius_mm)[:, None] * bevel.normal
    stretch = 1.0 - (course.curvature * offset).sum(axis=1)
    worst = int(np.argmin(stretch))
    if stretch[worst] < LEAST_STRETCH:
        radius = 1.0 / float(np.linalg.norm(course.curvature[worst]))
        where = f"arc length {course.arc_length_mm[worst]:.1f} mm: concave with a radius of {radius:.1f} mm"
        raise InputError(
            "edge",
            f"{where}, too tight: a cutter of {cutter.diameter_mm:g} mm, "
            f"{height_mm[worst]:.1f} mm above the finished bevel, would cross its path",
        )


class Scanned(NamedTuple):
    """An edge that is to be milled, and what its scan tells."""

    edge: Edge  # raw or milled
    cloud: Cloud
    table: Course  # at the stations of the edge, with the stock


def make_plan(
    scanned: Scanned,
    course: Course,
    bevel: Bevel,
    cutter: Cutter,
    air: Air,
    v_slow_mm_s: float,
    leave: Sequence[Lift] = (),
) -> Plan:
    """Tool frames along the course, and what must be passed above.

    Args:
        scanned: the edge and its scan.
        course: at the key points, with the stock.
        bevel: required.
        cutter: that mills it.
        air: clearances, and how the cutter rises.
        v_slow_mm_s: feed while cutting.
        leave: stretches to pass above besides, since nothing is to be milled there.
    """
    edge = scanned.edge
    s, length, lateral = course.arc_length_mm, float(edge.arc_length_mm[-1]), min(air.over_mm, air.lateral_mm)
    outward = bevel_normal(course.normal, course.across, bevel.angle)
    axes = [-outward, course.tangent, cutter_axis(course.normal, course.across, bevel.angle)]  # x = y x z
    quaternion = same_sign(quaternion_from_rotation(np.stack(axes, axis=-1)))
    final = pose_from(rotation_from_quaternion(quaternion), origins(course, bevel, 0.0))
    reach = (cutter.diameter_mm / 2.0, lateral, cutter.flute_length_mm / 2.0)
    scan = scan_of(scanned.cloud, edge, sections_of(scanned.table))
    needed = needed_heights(scan, foreign(scan, scanned.cloud, edge), s, final, reach)
    stock = bevel.height_mm(course.upper_mm)
    clear = float(stock.max()) + air.over_mm
    found = find_lifts(s, course.seen, needed, clear, air.over_mm - lateral, air.ramp_mm)
    lifts = hold_at_ends(merged([*found, *leave]), length, air.ramp_mm)
    refuse_tight_curve(course, bevel, lifted_heights(s, lifts, 0.0), cutter)
    return Plan(course, bevel, stock, outward, quaternion, lifts, clear, air, length, v_slow_mm_s)


def path_of(plan: Plan, cut: tuple[Layer, ...], cutter: Cutter, depth_of_cut_mm: float, cloud: Cloud) -> Toolpath:
    """The path of layers, with travel moves a clearance above all that these pass above."""
    high = max([plan.clear_mm, *(lift.height_mm for lift in plan.lifts)]) + plan.air.over_mm
    refuse_tight_curve(plan.course, plan.bevel, np.full(plan.stock_mm.shape, high), cutter)
    return Toolpath(
        cutter=cutter,
        layers=cut,
        travels=make_travels(plan, cut, high),
        root_mm=plan.bevel.root_mm,
        bevel_deg=plan.bevel.angle / DEG,
        depth_of_cut_mm=depth_of_cut_mm,
        v_slow_mm_s=plan.v_slow_mm_s,
        edge_length_mm=plan.length_mm,
        part=cloud.part,
        source=cloud.source,
    )
