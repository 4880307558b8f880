"""What the cutter must be lifted over: clamps, and stretches of the edge that were not measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import ROOT_FACE, UNLABELLED, Cloud, Edge
from workbench.geometry.moves import runs, within
from workbench.geometry.stations import (
    Scan,
    SectionTable,
    frame_stations,
    section_table,
    standing_out,
)
from workbench.path.course import Course, smoothstep
from workbench.units import Bool, Float, Shaped

BURR_MM = 3.0  # what stands out of the stock by less is its own: burrs, roughness, the ends of the plate
CLAMP_MM = 0.5  # over a hidden stretch, where a clamp may lie close
IN_THE_WAY = "clamp or other material in the way"
LEAST_CUT_MM = 2.0  # for less the cutter does not come down
ENDED = 3  # frames beyond an edge that do not see it, that show that it has ended
NEAR_MM = 5.0  # points of a clamp lie up to this far from the stretch that it hides


@dataclass(frozen=True, slots=True, eq=False)
class Lift:
    """A stretch that the cutter passes above: at full height from `from_mm` to `to_mm`, with a ramp on each side."""

    from_mm: float
    to_mm: float
    height_mm: float  # of the cutter above the finished face
    reason: str
    ramp_mm: float
    share: float = 1.0  # of the way up to that height: a short gap leaves no room for more


def sections_of(course: Course) -> SectionTable:
    """The stock's sections at the places of `course`, which are at even distances from arc length 0."""
    step = float(course.arc_length_mm[-1]) / (len(course.arc_length_mm) - 1)
    arrays = (course.position_mm, course.tangent, course.normal, course.across, course.upper_mm, course.inward)
    return section_table(step, *arrays)


def open_ends(edge: Edge, cloud: Cloud) -> tuple[bool, bool]:
    """Whether the scan stops on the edge at its start, and at its end: what stands beyond was not measured."""
    s, within = edge.frame_arc_length_mm, float(edge.arc_length_mm[-1])
    ended = [False, False]
    for number in np.unique(cloud.pass_index):
        mine = s[cloud.pass_index == number]
        on = np.flatnonzero(np.isfinite(mine))
        if not on.size:
            continue
        outer = {mine[on[0]]: on[0], mine[on[-1]]: mine.size - 1 - on[-1]}  # frames beyond, at either end
        for place, frames in outer.items():
            ended[int(place >= within / 2.0)] |= bool(frames >= ENDED)
    return not ended[0], not ended[1]


def scan_of(cloud: Cloud, edge: Edge, sections: SectionTable) -> Scan:
    """The cloud's grid beside sections of the edge's stock."""
    count = len(sections.axes)
    start = frame_stations(edge.frame_arc_length_mm, cloud.pass_index, sections.step, count)
    return Scan(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, start, sections)


def foreign(scan: Scan, cloud: Cloud, edge: Edge) -> Bool:
    """Which kept points (N, M) of no face stand out of the stock: clamps, the table, streaks."""
    hidden = within(edge.arc_length_mm, edge.arc_length_mm[~edge.seen], NEAR_MM)
    tolerance = np.where(hidden, CLAMP_MM, BURR_MM)
    tolerance[[0, -1]] = BURR_MM  # beyond the ends of the edge
    usable = cloud.keep & ~((edge.labels >= ROOT_FACE) & (edge.labels != UNLABELLED))
    return standing_out(scan, usable, tolerance)


def find_lifts(
    s: Shaped[Float, " k"],
    seen: Shaped[Bool, " k"],
    needed_mm: Shaped[Float, " k"],
    clear_mm: float,
    over_mm: float,
    ramp_mm: float,
) -> list[Lift]:
    """Stretches to pass above, in order.

    A ramp lies over what is hidden, as far as there is room; where the cutter would meet something it begins earlier.

    Args:
        s, seen, needed_mm: (k,) arc length, measured or not, and the height that clears what stands in the way.
        clear_mm: height that clears the stock.
        over_mm: clearance over what stands in the way.
        ramp_mm: length of a ramp.
    """
    blocked = needed_mm > 0.0
    lifts: list[Lift] = []
    for first, last in runs(~seen | blocked):
        here, in_way = slice(first, last + 1), np.flatnonzero(blocked[first : last + 1]) + first
        gap = np.flatnonzero(~seen[here]) + first
        low, high = np.inf, -np.inf
        if gap.size:  # between the last place that was seen and the next one, or an end of the path
            low = float(s[gap[0] - 1]) + ramp_mm if gap[0] > 0 else -np.inf
            high = float(s[gap[-1] + 1]) - ramp_mm if gap[-1] < s.size - 1 else np.inf
        height, share, ramp = clear_mm, 1.0, ramp_mm
        if in_way.size:
            low, high = min(low, float(s[in_way[0]])), max(high, float(s[in_way[-1]]))
            height = max(clear_mm, float(needed_mm[in_way].max()) + over_mm)
        elif low > high:  # a short gap: up and down again over it
            middle, half = (low + high) / 2.0, (high - low) / 2.0 + ramp_mm
            low = high = middle
            share, ramp = float(smoothstep(np.array(half / ramp_mm))), half
        reason = IN_THE_WAY if in_way.size else "not measured"
        lifts.append(Lift(low, high, height, reason, ramp, share))
    return merged(lifts)


def hold_at_ends(lifts: Sequence[Lift], length_mm: float, ramp_mm: float) -> tuple[Lift, ...]:
    """The lifts, gone on with beyond an end of the edge if there is no room to come down before it."""
    out = list(lifts)
    if out and out[0].from_mm - out[0].ramp_mm < LEAST_CUT_MM:
        out[0] = replace(out[0], from_mm=-math.inf, ramp_mm=ramp_mm, share=1.0)
    if out and out[-1].to_mm + out[-1].ramp_mm > length_mm - LEAST_CUT_MM:
        out[-1] = replace(out[-1], to_mm=math.inf, ramp_mm=ramp_mm, share=1.0)
    return tuple(out)


def merged(lifts: Sequence[Lift]) -> list[Lift]:
    """Lifts in order; those between which there is no room to come down are one."""
    out: list[Lift] = []
    for lift in sorted(lifts, key=lambda x: x.from_mm):
        if out and lift.from_mm - lift.ramp_mm < out[-1].to_mm + out[-1].ramp_mm + LEAST_CUT_MM:
            before = out.pop()
            lift = Lift(
                before.from_mm,
                max(before.to_mm, lift.to_mm),
                max(before.height_mm, lift.height_mm),
                IN_THE_WAY if IN_THE_WAY in (before.reason, lift.reason) else before.reason,
                max(before.ramp_mm, lift.ramp_mm),
                max(before.share, lift.share),
            )
        out.append(lift)
    return out


def lifted_heights(s: Float, lifts: Sequence[Lift], base_mm: float) -> Float:
    """Height (k,) above the finished face of a layer at `base_mm`, lifted smoothly where it must be."""
    height = np.full(s.shape, base_mm)
    for lift in lifts:
        away = np.maximum(np.maximum(lift.from_mm - s, s - lift.to_mm), 0.0)
        rise = lift.share * (lift.height_mm - base_mm) * smoothstep(1.0 - away / lift.ramp_mm)
        height = np.maximum(height, base_mm + rise)
    return height
