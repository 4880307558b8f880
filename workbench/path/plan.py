"""A milling path over a course: its layers, and the travel moves between them."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Layer, Travel
from workbench.geometry.tool_frames import bevel_normal, tool_quaternions
from workbench.path.course import LEAST_DEPTH_MM, Bevel, Course
from workbench.path.obstacles import Lift, lifted_heights
from workbench.units import Bool, Float, Int, Shaped

KEY_POINT_MM = 1.0
MOST_TRAVEL_MM = 50.0  # between points of travel moves
CUTTING_LIFT_MM = 1e-9  # above its layer by more than this the cutter is being lifted


@dataclass(frozen=True, slots=True, eq=False)
class Air:
    """How the cutter passes above what it does not cut, mm."""

    over_mm: float  # clearance above stock and clamps
    beside_mm: float  # clearance beside a clamp
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


def tool_frames(course: Course, bevel: Bevel) -> tuple[Float, Float]:
    """b (k, 3) and the orientation (k, 4) of the tool at each place."""
    outward = bevel_normal(course.normal, course.across, bevel.angle)
    return outward, tool_quaternions(course.tangent, course.normal, course.across, bevel.angle)


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
    high = [_raised(plan, layer, high_mm) for layer in layers]
    stops = sparse(plan.course, high_mm)
    last, travels = len(plan.course.arc_length_mm) - 1, []
    for k, way in enumerate(high):
        back = stops[::-1] if k else stops[:1]
        points = np.concatenate([high[k - 1][last:], way[back]]) if k else way[back]
        turns = np.concatenate([[last], back]) if k else back
        travels.append(_travel(plan, points, turns))
    travels.append(_travel(plan, high[-1][last:], np.array([last])))
    return tuple(travels)


def _raised(plan: Plan, layer: Layer, high_mm: float) -> Float:
    """The layer's places (k, 3) at a height above the finished face."""
    flat = origins(plan.course, plan.bevel, layer.height_mm)
    return np.asarray(flat + (high_mm - layer.height_mm) * plan.outward)


def sparse(course: Course, high_mm: float) -> Int:
    """Indices of places far apart, near enough that the chords between them stay within half a mm of the curve."""
    bend = float(np.abs(course.curvature).max())
    step = MOST_TRAVEL_MM if bend < 1e-9 else math.sqrt(8.0 * 0.5 * max(1.0 / bend - high_mm, 1.0))
    count = len(course.arc_length_mm)
    return np.unique(np.append(np.arange(0, count, max(int(min(step, MOST_TRAVEL_MM)), 1)), count - 1))


def _travel(plan: Plan, points: Float, at: Int) -> Travel:
    keep = np.concatenate([[True], np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6])
    feed = np.full(int(keep.sum()), plan.v_slow_mm_s)
    return Travel(points[keep], plan.quaternion_wxyz[at][keep], feed)


def stretch_factor(course: Course, bevel: Bevel, height_mm: Float | float, radius_mm: float) -> Float:
    """Length (k,) of the cutter's axis per length of the lower edge: 1 - curvature . offset.

    Where it is not above 0, the edge is concave and bends more tightly than the cutter's course can follow: the path
    would cross itself and the cutter would cut into its neighbourhood.
    """
    offset = bevel.middle(course, 0.0) + (np.zeros(1) + height_mm + radius_mm)[:, None] * bevel.normal
    return np.asarray(1.0 - (course.curvature * offset).sum(axis=1))


def cut_stretches(s: Float, mask: Bool) -> list[tuple[float, float]]:
    """Arc lengths (from, to) of each run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8)))
    return [(float(s[a]), float(s[b - 1])) for a, b in zip(edges[::2], edges[1::2], strict=True)]
