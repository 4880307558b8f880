"""`path.correct`: the finishing pass, corrected by what the first cut was measured to be."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import numpy as np
import scipy
from pydantic import Field

from workbench.artefacts import (
    DECLARED,
    DIRECTIONS,
    END,
    ROUNDING,
    Check,
    Inspection,
    Layer,
    Part,
    PathCorrection,
    PathDeflection,
    Toolpath,
)
from workbench.errors import InputError
from workbench.geometry.moves import interpolated, within
from workbench.geometry.poses import rotation_from_quaternion
from workbench.path.batch import Together, known_batch, together, with_part
from workbench.path.course import LEAST_DEPTH_MM, Poses, components, poses_of, rotated_about_feed
from workbench.path.displacement import Estimate, Prior, estimate
from workbench.path.plan import KEY_POINT_MM, cut_stretches
from workbench.stage import InputFile, stage
from workbench.units import DEG, Bool, Float, Int, Shaped

LARGEST_MM, LARGEST = 1.0, 1.0 * DEG  # standard deviations that the tool's constant errors may have
VARYING_MM, VARYING = 1.0, 0.1 * DEG  # three times what repeats along the way and is not constant: gears, arc minutes
NEAR_MM = 10.0  # farther from the plan's lower edge an inspected place belongs to another edge
ROOT_3 = math.sqrt(3.0)
LEAST_PLACES = 5  # that were cut and measured
YIELD_U = 0.3  # relative standard uncertainty of a predicted giving way: of force and stiffness together
BALANCING = 30  # rounds of stock and giving way, each halfway to the next: far below a micrometre
BEYOND = 3.0  # standard uncertainties that calibrations may be off by before they are doubted
OTHERS = (
    "this cut lies farther from the mean of {} parts before than chance makes of it: another tool, place or path? It "
    "is corrected by itself, and a new batch begins"
)
LEAST_SHARE = 0.5  # of the stretch that the finishing pass cuts, that must be measured


class Cut(NamedTuple):
    """The face as it was cut at n places of the plan: what of the profile lies where the path cuts."""

    arc_length_mm: Shaped[Float, " n"]  # as planned
    root_mm: Shaped[Float, " n"]
    root_u: SharedU  # mm, but for where the lower edge lies
    edge_u_mm: float  # of that, what of it one scan of the whole edge may have wrong
    angle: Shaped[Float, " n"]  # rad
    angle_u: SharedU  # rad
    moved_mm: Shaped[Float, "n 2"]  # the lower edge beside the plan's: along b, along m


class SharedU(NamedTuple):
    """Standard uncertainties at n places, and what of them may be one error of the whole edge."""

    local: Shaped[Float, " n"]
    shared: float


class Displacement(NamedTuple):
    """What n places of a cut show of one displacement, and what may be known of it."""

    values: Shaped[Float, " n"]
    u: SharedU
    axes: Shaped[Float, "k 3"]  # direction along which an error in the base shows, at the final layer's points
    axes_at: Shaped[Float, "m 3"]  # and at the finishing pass'
    prior: Prior


@stage("path.correct")
def correct(
    inspection: Inspection,
    toolpath: Toolpath,
    predicted: PathDeflection | None = None,
    *,
    repeatability_mm: Annotated[float, Field(ge=0, le=2)] = 0.03,
    repeatability_deg: Annotated[float, Field(ge=0, le=2)] = 0.01,
    repeatability_length_mm: Annotated[float, Field(ge=1, le=10000)] = 50.0,
    yield_share: Annotated[float, Field(ge=0, le=1)] = 0.1,
    wear_mm: Annotated[float, Field(ge=0, le=1)] = 0.02,
    most_moved_mm: Annotated[float, Field(gt=0, le=10)] = 0.3,
    earlier: InputFile | None = None,
) -> tuple[Toolpath, PathCorrection]:
    """Compare a first cut with its plan, and correct the finishing pass.

    What is compared, corrected and refused: docs/planning.md, "Measure, cut, measure, correct". `path.check` rejects
    a refused path.

    Args:
        inspection: of the edge after the first cut.
        toolpath: that it was milled along, with its finishing pass (`path.layers`: `finish_allowance_mm`).
        predicted: how far the robot gives way along the first path.
        repeatability_mm: standard deviation of the robot's errors that do not repeat, each axis (ISO 9283).
        repeatability_deg: the same of the tool's tilt.
        repeatability_length_mm: correlation length of both along the path.
        yield_share: deflection of cutter and robot as a share of the stock's height, if not predicted.
        wear_mm: loss of the cutter's radius between first cut and finishing pass; 0 if changed or measured.
        most_moved_mm: greatest distance of the lower edge from that of the first scan.
        earlier: the correction.json of the previous part of the batch, in the same fixture, by the same robot and
            cutter: repeating errors are estimated from all parts; null: from this one.

    Raises:
        InputError: a path without a finishing pass, an inspection of another edge, a prediction of another path;
            earlier parts of another length, bevel or allowance, fixture, robot or cutter.

    Example:
        >>> from workbench import edge, inspect, path, scan, twin
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.feed(path.layers(raw, points, finish_allowance_mm=0.5), points, raw)
        >>> part, engagement = twin.mill(twin.part(recipe="data/synthetic/raw_edge.json"), plan)
        >>> found = inspect.sections(edge.segment(scan.fuse(twin.scan(part))))
        >>> finishing, correction = path.correct(found, plan)
        >>> correction.allowance_mm, len(finishing.layers)
        (0.5, 1)
    """
    if toolpath.finishing is None:
        raise InputError("toolpath", "expected a path with a finishing pass (path.layers: finish_allowance_mm above 0)")
    final, bevel = toolpath.layers[-1], toolpath.bevel_deg * DEG
    cut = _cut(inspection, toolpath, final)
    finish, finishing = toolpath.finishing.layers[-1], toolpath.finishing
    at = np.clip(finish.arc_length_mm, 0.0, toolpath.edge_length_mm)
    frames, frames_at = poses_of(toolpath, final), poses_of(finishing, finish)

    sine = math.sin(bevel)
    moved, lateral = (float(one) for one in np.median(cut.moved_mm, axis=0))
    # Both scans see the same lower edge: by how much their views of it may differ, its place in both tells.
    edge_u = min(math.sqrt(2.0) * cut.edge_u_mm, math.hypot(lateral, math.sqrt(2.0) * repeatability_mm))
    root_u = SharedU(cut.root_u.local * sine, math.hypot(math.hypot(cut.root_u.shared, edge_u) * sine, moved / ROOT_3))

    lies, angle_off, tilts = (cut.root_mm - toolpath.root_mm) * sine, cut.angle - bevel, repeatability_deg * DEG
    length, s = repeatability_length_mm, cut.arc_length_mm
    seen = (
        Displacement(lies, root_u, -frames.x, -frames_at.x, Prior(LARGEST_MM, VARYING_MM, repeatability_mm, length)),
        Displacement(angle_off, cut.angle_u, frames.y, frames_at.y, Prior(LARGEST, VARYING, tilts, length)),
    )
    before = None if earlier is None else known_batch(earlier, toolpath)
    both = [Together(one.values) for one in seen]
    if before is not None:
        there = before.on(s)
        repeats = ((there.shift_mm, before.shift_scatter_mm), (there.turn, before.turn_scatter))
        both = [
            together(one.values, one.u.local, one.prior, before.parts, *what)
            for one, what in zip(seen, repeats, strict=True)
        ]
    others = "" if before is None or not any(one.doubt for one in both) else OTHERS.format(before.parts)
    if others:
        both, before = [Together(one.values) for one in seen], None

    def along(which: int) -> Estimate:
        """The estimate from this part's values, or from all of the batch's."""
        one, share = seen[which], both[which].share
        here = interpolated(s, final.arc_length_mm, one.axes)
        less = replace(one.prior, unrepeated=one.prior.unrepeated * share)
        return estimate(s, both[which].values, one.u.local * share, here, at, one.axes_at, less).less_sure(one.u.shared)

    shift, turn = along(0), along(1)
    evened = bool(shift.significant and shift.value[finish.cutting].max() > LEAST_DEPTH_MM)
    expected = _under_load(shift, predicted, yield_share, toolpath, finish, evened)
    made = expected.significant
    expected = expected.less_sure(wear_mm / ROOT_3)
    by = np.where(made, -expected.value, 0.0)
    tilt = np.where(turn.significant, -turn.value, 0.0)
    finishing = finishing if evened else _without_first(finishing)
    path, comes = _corrected(finishing, frames_at, by, tilt)
    stock = _stock(toolpath.finish_allowance_mm, shift.value if made else 0.0, turn, tilt, finish)
    found = PathCorrection(
        arc_length_mm=finish.arc_length_mm,
        cut=finish.cutting,
        displacement_mm=shift.value,
        displacement_u_mm=expected.u,
        turn=turn.value,
        turn_u=turn.u,
        shift_mm=by,
        tilt=tilt,
        stock_mm=stock,
        bevel=bevel,
        length_mm=toolpath.edge_length_mm,
        allowance_mm=toolpath.finish_allowance_mm,
        repeatability_mm=repeatability_mm,
        moved_mm=moved,
        variation_mm=shift.variation,
        comes=comes,
        part=inspection.part,
        reason=_reason(shift, made, turn, by, tilt, finish.cutting),
        batch=with_part(before, finish.arc_length_mm, s, [(lies, both[0]), (angle_off, both[1])], toolpath),
        warnings=finishing.warnings
        + ((others,) if others else ())
        + _another_part(toolpath.part, inspection.part)
        + _beyond_chain(toolpath, shift, finish.cutting, repeatability_mm)
        + _as_if_finished(toolpath.finish_allowance_mm, shift, finish.cutting),
    )
    checks = _checks(cut, found, shift, finish, most_moved_mm, toolpath.depth_of_cut_mm)
    evidence = (*finishing.evidence, *inspection.checks, *checks)
    found, refused = replace(found, checks=checks), "; ".join(c.finding for c in checks if not c.passed)
    if not refused:
        return replace(path, evidence=evidence), found
    nothing, finishing = np.zeros_like(by), _without_first(toolpath.finishing)
    as_planned = PathDeflection({layer.index: np.zeros_like(layer.position_mm) for layer in finishing.layers})
    return replace(finishing, evidence=evidence), replace(
        found,
        shift_mm=nothing,
        tilt=nothing,
        comes=as_planned,
        batch=before,
        refused=refused,
        reason="nothing corrected: refused",
    )


def _cut(inspection: Inspection, toolpath: Toolpath, final: Layer) -> Cut:
    """What the profile says of the face where the path's last layer cut it, a cutter's radius from its ends."""
    poses, profile, bevel = poses_of(toolpath, final), inspection.profile, toolpath.bevel_deg * DEG
    b, up = -poses.x, -poses.z
    across = math.sin(bevel) * b + math.cos(bevel) * up
    lower = poses.origin_mm - 0.5 * final.width_mm[:, None] * up - toolpath.root_mm * across
    whole = _well_inside(final, toolpath.cutter.diameter_mm / 2.0)
    known = np.isfinite(profile.position_mm).all(axis=1)
    for one in profile.sizes.values():
        known &= np.isfinite(one.value) & np.isfinite(one.u)
    if not whole.any() or not known.any():
        raise InputError("inspection", "nothing was measured where the path cut")
    rows = np.flatnonzero(whole)
    position = profile.position_mm[known]
    away, nearest = scipy.spatial.cKDTree(lower[rows]).query(position)
    at = rows[nearest]
    off = position - lower[at]
    along = (off * poses.y[at]).sum(axis=1)
    here = (away <= NEAR_MM) & (np.abs(along) <= 0.75 * KEY_POINT_MM)
    if here.sum() < LEAST_PLACES:
        raise InputError(
            "inspection",
            f"expected that of the edge that this path milled: {int(here.sum())} of its "
            f"{len(position)} places lie within {NEAR_MM:g} mm of where the path cut",
        )
    arc = (final.arc_length_mm[at] + along)[here]
    if np.median(np.diff(arc)) < 0.0:
        raise InputError("inspection", "the inspected edge runs against the planned one: is upper_side reversed?")
    keep, off = np.flatnonzero(known)[here], off[here]
    root, edge = profile.root_u_by_source_mm, (END, ROUNDING, DECLARED)
    angle = {name: u * DEG for name, u in profile.bevel_u_by_source_deg.items()}
    return Cut(
        arc,
        profile.root_mm[keep],
        _shared_u(root, profile.sizes["root_mm"].u, edge, keep),
        _usual(root, edge, keep),
        profile.bevel_deg[keep] * DEG,
        _shared_u(angle, profile.bevel_u_deg * DEG, (), keep),
        components(off, b[at[here]], across[at[here]]),
    )


def _shared_u(by_source: Mapping[str, Float], u: Float, apart: tuple[str, ...], keep: Int) -> SharedU:
    """What is local and what is shared of u (n,) at places `keep`, but for the sources that count `apart`.

    The directions of the faces and the end of the root face are told anew by the frames of every stretch; where u is
    larger than is usual along the edge, that is local too. Without sources all of it may be both.
    """
    if not by_source:
        return SharedU(u[keep], float(np.median(u[keep])))
    shared = [name for name in by_source if name != DIRECTIONS and name not in apart]
    local = np.hypot(_together(by_source, (END, DIRECTIONS), keep), _together(by_source, tuple(shared), keep))
    return SharedU(local, _usual(by_source, tuple(shared), keep))


def _together(by_source: Mapping[str, Float], names: tuple[str, ...], keep: Int) -> Float:
    return np.sqrt(sum((by_source[name][keep] ** 2 for name in names if name in by_source), np.zeros(keep.size)))


def _usual(by_source: Mapping[str, Float], names: tuple[str, ...], keep: Int) -> float:
    return float(np.median(_together(by_source, names, keep)))


def _well_inside(layer: Layer, radius_mm: float) -> Bool:
    """Points (k,) that are cut, farther than the cutter's radius from those over the edge that are not."""
    s, cut = layer.arc_length_mm, np.flatnonzero(layer.cutting)
    if not cut.size:
        return layer.cutting
    inside = np.arange(s.size) >= cut[0]
    inside[cut[-1] :] = False
    idle = s[inside & ~layer.cutting]
    return np.asarray(layer.cutting & ~within(s, idle, radius_mm))


def _under_load(
    shift: Estimate,
    predicted: PathDeflection | None,
    yield_share: float,
    toolpath: Toolpath,
    finish: Layer,
    evened: bool,
) -> Estimate:
    """The shift as the finishing pass will show it: its load over that of the first cut's last layer is not 1.

    Load goes with the width of the face as cut, which a face that lies high does not reach, and with a power of the
    height h of the stock; so does the giving way g. With what repeats whatever the load, c, the first cut lies at
    d = c + g(h1), the finishing pass at c + g(h). The layer before gave way too, so h1 = allowance + g(before) - g(h1).
    The corrected pass finds h = allowance + d, less what a layer of its own, where what stands too high is `evened`,
    has taken: e = d + g(h) - g(e).
    """
    final, at, allowance = toolpath.layers[-1], finish.arc_length_mm, toolpath.finish_allowance_mm
    planned, full, d = _width(final, at), _width(finish, at), shift.value
    narrower = d * (full - planned) / allowance  # by which the first cut's face is, mm
    as_cut = np.maximum(1.0 - narrower / planned, 0.0)
    if predicted is None:
        load = full / planned * (1.0 + np.clip(d / allowance, -1.0, 0.0)) / np.maximum(as_cut, 0.5)
        return shift.less_sure(yield_share * allowance * (load - 1.0) / ROOT_3)
    power, layer = _power(toolpath, predicted), toolpath.layers[max(len(toolpath.layers) - 2, 0)]
    here, before = (_along(one, _gives_way(one, predicted), at) for one in (final, layer))
    before = before * np.maximum(1.0 - narrower / _width(layer, at), 0.0)

    def gives(height: Float) -> Float:
        return here * np.maximum(height / allowance, 0.0) ** power

    first, taken, height = np.full(at.shape, allowance), np.maximum(d, 0.0) * evened, allowance + np.minimum(d, 0.0)
    for _ in range(BALANCING):
        first = 0.5 * (first + allowance + before - as_cut * gives(first))
        if evened:
            taken = 0.5 * (taken + np.maximum(d + full / planned * gives(height) - gives(taken), 0.0))
        height = np.maximum(allowance + d - taken, 0.0)
    more = full / planned * gives(height) - as_cut * gives(first)
    return replace(shift, value=d + more).less_sure(YIELD_U * more)


def _along(layer: Layer, values: Float, at: Float) -> Float:
    """Values (k,) of a layer's points where it cuts, at arc lengths (m,); those beside where it does not."""
    return np.interp(at, layer.arc_length_mm[layer.cutting], values[layer.cutting])


def _gives_way(layer: Layer, predicted: PathDeflection) -> Float:
    """Displacement (k,) along b, against x, at a layer's points."""
    return -predicted.at(layer)[:, 0]


def _power(toolpath: Toolpath, predicted: PathDeflection) -> float:
    """Of the stock's height, with which the load of one width goes: 1/2 for rubbing edges, 1 for chips of full size.

    From the prediction itself: the layer before the last takes the depth of cut, the last one the allowance.
    """
    if len(toolpath.layers) < 2 or toolpath.depth_of_cut_mm == toolpath.finish_allowance_mm:
        return 1.0
    before, last = (
        float(np.median(np.abs(_gives_way(layer, predicted)[layer.cutting]) / layer.width_mm[layer.cutting]))
        for layer in toolpath.layers[-2:]
    )
    if before <= 0.0 or last <= 0.0:
        return 1.0
    return min(
        max(math.log(before / last) / math.log(toolpath.depth_of_cut_mm / toolpath.finish_allowance_mm), 0.0), 1.0
    )


def _width(layer: Layer, at: Float) -> Float:
    """Width of the face (m,) at arc lengths `at`, that beside where nothing is cut."""
    return _along(layer, layer.width_mm, at)


def _without_first(path: Toolpath) -> Toolpath:
    """A finishing pass of its final layer alone: nothing stands too high."""
    travels = path.travels[:1] + path.travels[2:]
    return replace(path, layers=(replace(path.layers[-1], index=1),), travels=travels)


def _corrected(finishing: Toolpath, frames: Poses, by_mm: Float, tilt: Float) -> tuple[Toolpath, PathDeflection]:
    """The finishing pass moved along b by (k,) at the root end of its face and turned about it; how the tool comes."""
    final, b, up = finishing.layers[-1], -frames.x, -frames.z
    width = _width(final, final.arc_length_mm)
    foot, layers, back = frames.origin_mm - 0.5 * width[:, None] * up, [], {}
    for layer in finishing.layers:
        lever = ((poses_of(finishing, layer).origin_mm - foot) * up).sum(axis=1)
        moved = (by_mm - tilt * lever)[:, None] * b  # a larger angle sinks the face with the way up
        moved = moved if finishing.base_from_workobject is None else moved @ finishing.base_from_workobject[:3, :3]
        quaternion = rotated_about_feed(layer.quaternion_wxyz, -tilt)
        layers.append(replace(layer, position_mm=layer.position_mm + moved, quaternion_wxyz=quaternion))
        back[layer.index] = (np.swapaxes(rotation_from_quaternion(quaternion), 1, 2) @ -moved[:, :, None])[:, :, 0]
    comes = PathDeflection(back, {layer.index: tilt for layer in layers})
    return replace(finishing, layers=tuple(layers)), comes


def _stock(allowance_mm: float, shift_mm: Float | float, turn: Estimate, tilt: Float, finish: Layer) -> Float:
    """What the finishing pass will remove (k,), the least of both ends of its face.

    Uncorrected, the pass is displaced as the cut was and removes the allowance; corrected, what the cut left too much.
    """
    low = allowance_mm + shift_mm
    high = low - (turn.value if tilt.any() else 0.0) * finish.width_mm
    return np.asarray(np.minimum(low, high) + np.zeros(len(finish.arc_length_mm)))


def _another_part(planned: Part, cut: Part) -> tuple[str, ...]:
    """A cut that says that it is of another part than the path: it has errors of its own."""
    if not planned.part_id or not cut.part_id or planned.part_id == cut.part_id:
        return ()
    return (f"the path is of part '{planned.part_id}', the cut of '{cut.part_id}': is this cut the path's own?",)


def _beyond_chain(toolpath: Toolpath, shift: Estimate, cut: Bool, repeatability_mm: float) -> tuple[str, ...]:
    """A cut that lies farther off than calibrations and robot say: it is corrected, but one of them is wrong."""
    chain, eye_mm = toolpath.chain, toolpath.part.hand_eye_u_mm
    if chain is None or eye_mm is None:
        return ()
    mean, stated = float(shift.value[cut].mean()), math.hypot(chain.place_mm, eye_mm / ROOT_3, repeatability_mm)
    if abs(mean) <= BEYOND * math.hypot(stated, float(shift.u[cut].mean())):
        return ()
    links = ", ".join(("hand-eye pose", *chain.rests_on))
    return (
        f"the cut lies {mean:+.2f} mm off its plan, where {links} and repeatability say {stated:.2f} mm (u): one of "
        "them is wrong, or the part has moved",
    )


def _as_if_finished(allowance_mm: float, shift: Estimate, cut: Bool) -> tuple[str, ...]:
    """A cut that lies deeper by the allowance is a finished one rather than that of a tool which errs by just that."""
    value, u = shift.value[cut] + allowance_mm, shift.u[cut]
    if abs(float(value.mean())) > max(LEAST_DEPTH_MM, BEYOND * float(u.mean())) or np.ptp(value) > LEAST_DEPTH_MM:
        return ()
    return (
        f"the cut lies {-float(shift.value[cut].mean()):.2f} mm deeper than planned, as much as the finish allowance: "
        "was the finishing pass, or a path without an allowance, milled already?",
    )


def _checks(
    cut: Cut, found: PathCorrection, shift: Estimate, finish: Layer, most_moved_mm: float, depth_of_cut_mm: float
) -> tuple[Check, ...]:
    """What must hold for a correction: the part lies where it lay, enough was measured, the allowance suffices."""
    lateral = np.abs(cut.moved_mm[:, 0])
    typical, worst = float(np.median(lateral)), int(np.argmax(lateral))
    moved = (
        f"the lower edge lies {typical:.2f} mm beside where the first scan saw it, {lateral[worst]:.2f} mm "
        f"at arc length {cut.arc_length_mm[worst]:.1f} mm: has the part moved, or is this another one?"
    )
    share = float(within(finish.arc_length_mm[finish.cutting], cut.arc_length_mm, 2.0 * KEY_POINT_MM).mean())
    hardly = f"the first cut was measured on {100 * share:.0f} % of what the finishing pass cuts"
    stock = found.stock_mm[found.cut]
    least, u = LEAST_DEPTH_MM + 2.0 * shift.u, 2.0 * float(shift.u.max())
    thin = _off_plan(found, shift, found.stock_mm < least, np.argmin, "deeper")
    most = found.allowance_mm + depth_of_cut_mm
    thick = _off_plan(found, shift, found.stock_mm > most, np.argmax, "higher")
    return (
        Check(
            "edge_moved_mm",
            round(typical, 4),
            most_moved_mm,
            typical <= most_moved_mm,
            "a part that moved after the cut would be cut in another place",
            moved,
        ),
        Check(
            "first_cut_measured_share",
            round(share, 4),
            (LEAST_SHARE, 1.0),
            share >= LEAST_SHARE,
            "what was not measured is only guessed from its neighbours",
            hardly,
        ),
        Check(
            "least_finishing_stock_mm",
            round(float(stock.min()), 4),
            (round(LEAST_DEPTH_MM + u, 4), most),
            not thin,
            "what was cut too deep cannot be corrected",
            thin,
        ),
        Check(
            "most_finishing_stock_mm",
            round(float(stock.max()), 4),
            most,
            not thick,
            "one layer takes no more than the depth of cut, and the allowance is left to the last",
            thick,
        ),
    )


def _off_plan(found: PathCorrection, shift: Estimate, wrong: Bool, pick: Callable[[Float], Any], word: str) -> str:
    """The first stretch with too little, or too much, to remove, and the worst place; '' where there is none."""
    mask = found.cut & wrong
    if not mask.any():
        return ""
    s, rows = found.arc_length_mm, np.flatnonzero(mask)
    worst = rows[int(pick(found.stock_mm[rows]))]
    a, b = cut_stretches(s, mask)[0]
    off, expanded = abs(found.stock_mm[worst] - found.allowance_mm), 2.0 * shift.u[worst]
    return (
        f"arc length {a:.1f} to {b:.1f} mm: the first cut lies up to {off:.2f} mm {word} than planned (at "
        f"{s[worst]:.1f} mm, U = {expanded:.2f} mm), more than an allowance of {found.allowance_mm:g} mm allows"
    )


def _reason(shift: Estimate, shifted: bool, turn: Estimate, by: Float, tilt: Float, cut: Bool) -> str:
    """What is corrected, in words."""
    said = []
    for name, found, significant, made, unit, scale, places in (
        ("shift", shift, shifted, by, "mm", 1.0, 3),
        ("tilt", turn, turn.significant, tilt, "deg", DEG, 3),
    ):
        if significant:
            ends = dict.fromkeys(f"{end / scale:+.{places}f}" for end in (made[cut].min(), made[cut].max()))
            said.append(f"{name} corrected by {' to '.join(ends)} {unit}")
        else:
            most = float(np.abs(found.value[cut]).max()) / scale
            said.append(f"{name} not corrected: {most:.{places}f} {unit} at the most is not significant")
    return "; ".join(said)
