"""From an edge and its scan to what all layers of a path share, and what cannot be planned, in one clear line each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from workbench.artefacts import ChainU, Cloud, Cutter, Edge, Layer, RawEdge, Travel
from workbench.errors import InputError
from workbench.path.course import LEAST_DEPTH_MM, Bevel, Course
from workbench.path.obstacles import (
    Lift,
    clearance_heights,
    find_foreign,
    find_lifts,
    hold_at_ends,
    lifted_heights,
    merged,
    sections_of,
)
from workbench.path.plan import Air, Plan, cut_stretches, make_travels, origins, stretch_factor, tool_frames
from workbench.units import DEG, Bool, Float

LEAST_STRETCH = 0.02  # of the axis' course per length of edge
GUARD = 1.645  # times u that a value must lie within its limits (ISO 14253-1), as an inspection judges it
LEAST_ROOT_MM = 0.05  # to which good robots repeat
MOST_KNOWN_MM = 1.0  # no edge is milled that is known to less
SMALL_ROOT = 3.0  # expanded uncertainties of the lower edge across it
FILLET_MM = 0.002  # by which a cutter's radius may differ from the fillet's: what is read as one number
LEAST_SLOPE = 0.1  # sine of the angle between upper surface and bevel


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
    root_mm = GUARD * bevel.root_u_mm(u)
    oblique = (GUARD * edge.tangent_u) ** 2 * np.sin(2.0 * bevel.angle) / 4.0
    angle_deg = (GUARD * np.hypot(edge.normal_u, turn) + oblique) / DEG
    known = edge.seen & (root_mm <= root_tolerance_mm) & (angle_deg <= bevel_tolerance_deg)
    share = float(np.mean(known))
    if share < least_seen_share:
        raise InputError(
            edge.source or "edge",
            f"known well enough on {100 * share:.0f} % of its length only, expected at least "
            f"{100 * least_seen_share:.0f} % (least_seen_share): typically to "
            f"{np.median(root_mm[edge.seen]):.2g} mm of root and {np.median(angle_deg[edge.seen]):.2g} deg of bevel "
            f"(1.645 u), where root_tolerance_mm is {root_tolerance_mm:g} and "
            f"bevel_tolerance_deg {bevel_tolerance_deg:g}" + (f"; with {_named(chain)}" if chain is not None else ""),
        )
    told = tuple(
        f"arc length {a:.0f} to {b:.0f} mm: not cut, the scan does not tell the edge well enough: "
        f"to {np.max(root_mm[on]):.2g} mm of root and {np.max(angle_deg[on]):.2g} deg of bevel (1.645 u)"
        for a, b in cut_stretches(edge.arc_length_mm, edge.seen & ~known)
        for on in [(edge.arc_length_mm >= a - 1e-6) & (edge.arc_length_mm <= b + 1e-6) & edge.seen & ~known]
    )
    return replace(edge, seen=known, warnings=edge.warnings + told)


def _named(chain: ChainU) -> str:
    return f"{' and '.join(chain.rests_on)} known to {chain.place_mm:.2g} mm and {chain.turn / DEG:.2g} deg (u)"


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


def refuse_fillet(course: Course, at: Bool, bevel: Bevel, cutter_mm: float, beside: str) -> None:
    """A J preparation that a ball end cannot make in one sweep, or whose fillet leaves no bevel face.

    `cutter_mm`: the cutter's diameter; `beside`: a parameter that is given and that it cannot have, or nothing.
    """
    if beside:
        raise InputError(beside, "expected none beside root_radius_mm: a J preparation is milled by one path, at once")
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
    """A root no larger than what its place is known to, or a robot repeats to: a length in another unit."""
    known_mm = max(LEAST_ROOT_MM, SMALL_ROOT * 2.0 * float(np.nanmedian(edge.position_u_mm[edge.seen, 1])))
    if known_mm > MOST_KNOWN_MM:
        told = (
            f"the edge is known to {known_mm:.3g} mm only: do its passes disagree, are poses or hand-eye pose wrong, "
            "is its lower end lost over a long way, blurred by a filter of the sensor, or a rounding of it out of view "
            "(edge.segment_raw.most_radius_mm declares its radius)?"
        )
        raise InputError(edge.source or "edge", told)
    if bevel.root_mm < known_mm:
        raise InputError(
            "root_mm",
            f"{bevel.root_mm:g} mm of root is less than the {known_mm:.3g} mm to which edge "
            "and robot are known: is it in another unit?",
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
    """A concave edge that bends more tightly than the cutter's course, at heights (k,) above the finished face."""
    stretch = stretch_factor(course, bevel, height_mm, cutter.radius_mm)
    worst = int(np.argmin(stretch))
    if stretch[worst] < LEAST_STRETCH:
        radius = 1.0 / float(np.linalg.norm(course.curvature[worst]))
        where = f"arc length {course.arc_length_mm[worst]:.1f} mm: concave with a radius of {radius:.1f} mm"
        raise InputError(
            "edge",
            f"{where}, too tight: a cutter of {cutter.diameter_mm:g} mm, "
            f"{height_mm[worst]:.1f} mm above the finished bevel, would cross its path",
        )


def make_plan(
    edge: Edge,
    cloud: Cloud,
    course: Course,
    table: Course,
    bevel: Bevel,
    cutter: Cutter,
    air: Air,
    v_slow_mm_s: float,
    leave: Sequence[Lift] = (),
) -> Plan:
    """Tool frames along the course, and what must be passed above.

    Args:
        edge: the edge, raw or milled.
        cloud: its scan.
        course: at the key points, with the stock.
        table: at the stations of the edge, with the stock.
        bevel: required.
        cutter: that mills it.
        air: clearances, and how the cutter rises.
        v_slow_mm_s: feed while cutting.
        leave: stretches to pass above besides, since nothing is to be milled there.
    """
    s, length, beside = course.arc_length_mm, float(edge.arc_length_mm[-1]), min(air.over_mm, air.beside_mm)
    outward, quaternion = tool_frames(course, bevel)
    foreign = find_foreign(cloud, edge, sections_of(table))
    reach = (cutter.diameter_mm / 2.0, beside, cutter.flute_length_mm / 2.0)
    needed = clearance_heights(foreign, course, origins(course, bevel, 0.0), quaternion, reach)
    stock = bevel.height_mm(course.upper_mm)
    clear = float(stock.max()) + air.over_mm
    found = find_lifts(s, course.seen, needed, clear, air.over_mm - beside, air.ramp_mm)
    lifts = hold_at_ends(merged([*found, *leave]), length, air.ramp_mm)
    refuse_tight_curve(course, bevel, lifted_heights(s, lifts, 0.0), cutter)
    return Plan(course, bevel, stock, outward, quaternion, lifts, clear, air, length, v_slow_mm_s)


def travels_of(plan: Plan, cut: tuple[Layer, ...], cutter: Cutter) -> tuple[Travel, ...]:
    """Travel moves, a clearance above all that the layers pass above."""
    high = max([plan.clear_mm, *(lift.height_mm for lift in plan.lifts)]) + plan.air.over_mm
    refuse_tight_curve(plan.course, plan.bevel, np.full(plan.stock_mm.shape, high), cutter)
    return make_travels(plan, cut, high)
