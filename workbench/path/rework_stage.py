"""`path.rework`: a path for the stretches of an inspected edge with too much material; too little is reported."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud, Edge, Inspection, MilledEdge, Rework, Stretch, Toolpath
from workbench.errors import InputError
from workbench.path.check_stage import check
from workbench.path.course import (
    Bevel,
    Course,
    along_edge,
    bevel_of,
    layer_heights,
    lower_course,
    poses_of,
    stocked_course,
    with_thickness,
)
from workbench.path.feed_stage import feed
from workbench.path.obstacles import LEAST_CUT_MM, Lift
from workbench.path.plan import (
    Air,
    Scanned,
    cut_stretches,
    key_points,
    make_layer,
    make_layers,
    make_plan,
    path_of,
    refuse_cutter,
)
from workbench.stage import stage
from workbench.units import DEG, Bool, Float, Shaped

# How much material stands above the required bevel, or lacks, along an inspected edge.

LEAST_MM = 0.02  # no less than this is milled, or missed


class Excess(NamedTuple):
    """What the face as measured has above the required one, along its normal, at n stations; NaN where not measured."""

    root_end_mm: Shaped[Float, " n"]  # at the root face
    upper_end_mm: Shaped[Float, " n"]  # at the upper surface
    fails: Shaped[Bool, " n"]  # out of tolerance by the guard band
    # of those: too small a root, or an angle that leaves part of the face below the required one
    lacks: Shaped[Bool, " n"]

    @property
    def height_mm(self) -> Float:
        """(n,) of the most that stands above."""
        return np.asarray(np.fmax(self.root_end_mm, self.upper_end_mm))

    @property
    def lack_mm(self) -> Float:
        """(n,) of the most that lacks."""
        return np.asarray(np.fmax(-np.fmin(self.root_end_mm, self.upper_end_mm), 0.0))


def excess_of(inspection: Inspection, bevel: Bevel, thickness_mm: Float) -> Excess:
    """Excess along the inspection's profile; `thickness_mm` (n,) of the stock there.

    The measured face goes up from root face r at its own angle b: over the required face (R, B) it has
    (r - R) sin B at the root face and (T - R) sin B - (T - r) tan b cos B at the upper surface, T the thickness.
    """
    profile, required = inspection.profile, inspection.requirements
    sizes, angle = profile.sizes, profile.bevel_deg * DEG
    root, root_u = sizes["root_mm"].value, sizes["root_mm"].u
    sine, cosine = np.sin(bevel.angle), np.cos(bevel.angle)
    low = (root - bevel.root_mm) * sine
    high = (thickness_mm - bevel.root_mm) * sine - (thickness_mm - root) * np.tan(angle) * cosine
    guard = inspection.guard_factor
    low_u = root_u * sine
    high_u = np.hypot(
        root_u * np.tan(angle) * cosine,
        (thickness_mm - root) * profile.bevel_u_deg * DEG * cosine / np.cos(angle) ** 2,
    )
    small, large = _outside(root - required.root_nominal_mm, required.root_tolerance_mm, guard * root_u)
    steep, flat = _outside(
        profile.bevel_deg - required.bevel_nominal_deg, required.bevel_tolerance_deg, guard * profile.bevel_u_deg
    )
    below = (low < -np.maximum(guard * low_u, LEAST_MM)) | (high < -np.maximum(guard * high_u, LEAST_MM))
    return Excess(low, high, small | large | steep | flat, small | ((steep | flat) & below))


def _outside(deviation: Float, tolerance: tuple[float, float], guard: Float) -> tuple[Bool, Bool]:
    """Whether deviations (n,) lie below, or above, the tolerance by at least the guard band."""
    return np.asarray(deviation <= tolerance[0] - guard), np.asarray(deviation >= tolerance[1] + guard)


LEAVE = "nothing to rework"


@stage("path.rework")
def rework(
    edge: MilledEdge,
    inspection: Inspection,
    toolpath: Toolpath,
    cloud: Cloud,
    *,
    overlap_mm: Annotated[float, Field(ge=0, le=50)] = 3.0,
    clearance_mm: Annotated[float, Field(ge=0.5, le=100)] = 5.0,
    side_clearance_mm: Annotated[float, Field(ge=0.1, le=50)] = 2.0,
    ramp_mm: Annotated[float, Field(ge=1, le=100)] = 5.0,
    lead_mm: Annotated[float, Field(ge=1, le=200)] = 12.0,
    v_fast_mm_s: Annotated[float, Field(gt=0, le=5000)] = 20.0,
    acceleration_mm_s2: Annotated[float, Field(gt=0, le=1e5)] = 50.0,
) -> Rework:
    """Plan to mill again where an inspection fails by too much material.

    A place that fails (ISO 14253-1) is milled in layers of the first plan's depth of cut. Where too much is gone, place
    and amount are reported. A path that fails its checks is left out with a warning.

    Args:
        edge: the milled edge as measured.
        inspection: of that edge.
        toolpath: that it was milled with: its cutter and depth of cut hold again; required is what was inspected for.
        cloud: the scan of the milled edge.
        overlap_mm: milled beyond each end of a failing stretch.
        clearance_mm: as in `path.layers`.
        side_clearance_mm: as in `path.layers`.
        ramp_mm: as in `path.layers`.
        lead_mm: as in `path.layers`.
        v_fast_mm_s: as in `path.feed`.
        acceleration_mm_s2: as in `path.feed`.

    Raises:
        InputError: a raw edge, an inspection of another edge.

    Example:
        >>> from workbench import edge, inspect, path, scan
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> points = scan.fuse(scan.read(recording="data/synthetic/paths/raw_arc_milled.h5"))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled, root_nominal_mm=1.0, root_tolerance_mm=[-0.2, 0.2])
        >>> again = path.rework(milled, found, plan, points)
        >>> len(again.too_much_material), len(again.toolpath.layers)
        (1, 1)
    """
    if len(inspection.profile.root_mm) != len(edge.arc_length_mm):
        raise InputError("edge", "expected the milled edge that was inspected")
    asked = inspection.requirements
    bevel = bevel_of(asked.root_nominal_mm, asked.bevel_nominal_deg)
    if not toolpath.layers[-1].cutting.any():
        raise InputError("toolpath", "expected a path that cuts something")
    table = stocked_course(edge, edge.arc_length_mm, toolpath)
    excess = excess_of(inspection, bevel, table.upper_mm[:, 1])
    raw = unmilled(edge, toolpath)
    too_much, too_little = excess.fails & ~excess.lacks & ~raw, excess.lacks & ~raw
    stretches = _stretches(table, excess, too_much), _stretches(table, excess, too_little)
    left_out = (
        f"arc length {a:.1f} to {b:.1f} mm was not milled: not judged here"
        for a, b in cut_stretches(edge.arc_length_mm, excess.fails & raw)
    )
    path, warnings = None, (*edge.warnings, *left_out)
    if too_much.any():
        s = edge.arc_length_mm
        wanted = [(max(a - overlap_mm, 0.0), min(b + overlap_mm, float(s[-1]))) for a, b in cut_stretches(s, too_much)]
        air = Air(clearance_mm, side_clearance_mm, ramp_mm, lead_mm)
        try:
            path = _path(edge, cloud, toolpath, table, bevel, excess, wanted, air)
            path = feed(path, cloud, edge, v_fast_mm_s=v_fast_mm_s, acceleration_mm_s2=acceleration_mm_s2)
            gate = check(path, edge, cloud, v_fast_mm_s=v_fast_mm_s, acceleration_mm_s2=acceleration_mm_s2)
            path, warnings = (path, warnings) if gate.passed else (None, (*warnings, gate.reason))
        except InputError as refused:  # the rest of the answer holds
            path, warnings = None, (*warnings, f"no path for the rework: {refused}")
    return Rework(path, *stretches, _reason(*stretches), warnings, inspection.part)


def _path(
    edge: MilledEdge,
    cloud: Cloud,
    before: Toolpath,
    table: Course,
    bevel: Bevel,
    excess: Excess,
    wanted: list[tuple[float, float]],
    air: Air,
) -> Toolpath:
    """The path over the whole edge that comes down on the wanted stretches only."""
    s = key_points(float(edge.arc_length_mm[-1]), air.lead_mm)
    course = with_thickness(lower_course(edge, s), table.arc_length_mm, table.upper_mm[:, 1])
    at = course.seen & (s >= 0.0) & (s <= edge.arc_length_mm[-1])
    refuse_cutter(course, at, bevel, before.cutter, before.depth_of_cut_mm)
    clear = float(bevel.height_mm(course.upper_mm).max()) + air.over_mm
    leave = _between(wanted, clear, air.ramp_mm)
    plan = make_plan(Scanned(edge, cloud, table), course, bevel, before.cutter, air, before.v_slow_mm_s, leave)
    good = np.isfinite(excess.height_mm)
    stock = np.interp(s, edge.arc_length_mm[good], excess.height_mm[good])
    plan = replace(plan, stock_mm=stock)
    down = make_layer(plan, 1, 0.0).cutting
    if not down.any():
        raise InputError("edge", "what fails lies beside clamps or was not measured: the cutter cannot reach it")
    cut = make_layers(plan, layer_heights(stock[down], before.depth_of_cut_mm))
    return path_of(plan, cut, before.cutter, before.depth_of_cut_mm, cloud)


def _between(wanted: list[tuple[float, float]], clear_mm: float, ramp_mm: float) -> list[Lift]:
    """Lifts over what lies between the stretches, where there is room to rise."""
    ends = [-math.inf, *(x for stretch in wanted for x in stretch), math.inf]
    gaps = zip(ends[::2], ends[1::2], strict=True)
    return [
        Lift(a + ramp_mm, b - ramp_mm, clear_mm, LEAVE, ramp_mm)
        for a, b in gaps
        if b - a > 2.0 * ramp_mm + LEAST_CUT_MM
    ]


def _stretches(table: Course, excess: Excess, mask: Bool) -> tuple[Stretch, ...]:
    """Runs of True with what stands above the required face there, or lacks."""
    s, found = table.arc_length_mm, []
    for a, b in cut_stretches(s, mask):
        here = (s >= a) & (s <= b)
        above, lack = float(np.nanmax(excess.height_mm[here])), float(np.nanmax(excess.lack_mm[here]))
        words = f"{lack:.2f} mm below" if excess.lacks[here].any() else f"{above:.2f} mm above"
        found.append(Stretch(a, b, f"the bevel face lies up to {words} the required one"))
    return tuple(found)


def _reason(too_much: tuple[Stretch, ...], too_little: tuple[Stretch, ...]) -> str:
    parts = []
    if too_much:
        parts.append(f"too much material on {len(too_much)} stretches, from arc length {too_much[0].from_mm:.1f} mm")
    if too_little:
        parts.append(
            f"too little material on {len(too_little)} stretches, from arc length "
            f"{too_little[0].from_mm:.1f} mm: these cannot be mended"
        )
    return "; ".join(parts) or LEAVE


# Where a path milled an edge, found on the edge as it was measured afterwards.


def unmilled(edge: Edge, toolpath: Toolpath) -> Bool:
    """Stations (n,) within a cutter's radius of where the path did not cut: what is measured there is no bevel."""
    final, radius = toolpath.layers[-1], toolpath.cutter.diameter_mm / 2.0
    arc, _ = along_edge(edge, poses_of(toolpath, final).origin_mm)
    inside = (final.arc_length_mm >= 0.0) & (final.arc_length_mm <= toolpath.edge_length_mm)
    out = np.zeros(len(edge.arc_length_mm), bool)
    for a, b in cut_stretches(arc, inside & ~final.cutting):
        out |= (edge.arc_length_mm > a - radius) & (edge.arc_length_mm < b + radius)
    return out
