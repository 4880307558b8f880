"""From an edge and its scan to what all layers of a path share."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.artefacts import Cloud, Cutter, Edge, Layer, Travel
from workbench.path.course import Course
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
from workbench.path.plan import Air, Plan, make_travels, origins, tool_frames
from workbench.path.refusals import refuse_tight_curve
from workbench.path.section import Bevel


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
