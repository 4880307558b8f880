"""`path.check`: may this path be run? Its own checks, from the edge and the cloud, not from how it was planned."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from itertools import chain
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import (
    UNLABELLED,
    Cloud,
    Edge,
    Layer,
    PathCorrection,
    PathDeflection,
    PathGate,
    RawEdge,
    Toolpath,
    Travel,
)
from workbench.geometry.distances import ALWAYS, axis_distances, build_stock
from workbench.geometry.moves import chords_mm, step_lengths_mm
from workbench.geometry.poses import unit
from workbench.geometry.stations import supported
from workbench.path.course import (
    LEAST_DEPTH_MM,
    Poses,
    bevel_normal,
    cutter_axis,
    edge_course,
    finished,
    greatest_mm,
    loaded,
    lower_course,
    poses_of,
    stocked_course,
)
from workbench.path.feed_stage import from_edge, moves_in_order, standing
from workbench.path.obstacles import foreign, open_ends, scan_of, sections_of
from workbench.path.place import Points, place_of
from workbench.path.plan import KEY_POINT_MM
from workbench.stage import AtLeast, stage
from workbench.synthetic.workpiece import Workpiece
from workbench.units import DEG, Bool, Float

MOST_FAULTS = 3  # faults that the reason names
MOST_DEFLECTION_MM = 1.0  # what a path may allow for: unloaded, the cutter is that much deeper
PENETRATION_MM = 0.05  # the rule: more than this loosens the check
ANGLE_DEG = 0.02  # between a frame's axis and where it must point
TURN_DEG_PER_MM = 3.0  # a radius of 20 mm
UNIT = 1e-6


@stage("path.check")
def check(
    toolpath: Toolpath,
    edge: Edge,
    cloud: Cloud,
    predicted: PathDeflection | None = None,
    correction: PathCorrection | None = None,
    workpiece: Workpiece | None = None,
    *,
    v_fast_mm_s: Annotated[float | None, Field(gt=0, le=5000), AtLeast("v_slow_mm_s", Toolpath)] = None,
    acceleration_mm_s2: Annotated[float, Field(gt=0, le=1e5)] = 50.0,
    penetration_mm: Annotated[float, Field(gt=0, le=2)] = PENETRATION_MM,
    rests_milled: bool = False,
    touched_mm: Points | None = None,
) -> PathGate:
    """Check a path against edge and cloud; only a path that passes becomes a program.

    Layers end on the finished bevel, each no deeper than the depth of cut; nothing is cut where nothing was measured.
    Frames have no jump, the cutter's axis lies in the bevel face, its shank on the upper side. The cutter meets no
    clamp and enters what remains by at most `penetration_mm` + 3 u. Feeds stay within v_slow, v_fast and the
    acceleration. With a predicted deflection or a correction the loaded tool must come where planned, too.

    Without evidence of where the part stands the path is a shape only (docs/planning.md); `penetration_mm` above 0.05,
    or an upper bevel not yet milled, loosens the check: exit status 1.

    Args:
        toolpath: the path.
        edge: the edge that it mills.
        cloud: the scan.
        predicted: how far the robot gives way along this path.
        correction: by which this path was corrected.
        workpiece: the part in the pipeline's own twin, whose place is no question.
        v_fast_mm_s: greatest feed; null: not checked.
        acceleration_mm_s2: greatest change of the feed, per time.
        penetration_mm: how deep the cutter may enter what must remain, in addition to 3 u of the edge.
        rests_milled: the path that this one rests on (a compound bevel's upper one) has been milled.
        touched_mm: points of the part's surface that the robot's tool touched, x, y, z in the base (docs/planning.md,
            "Where the part stands").

    Raises:
        InputError: the prediction, or the correction, is of another path.

    Example:
        >>> from workbench import edge, path, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.feed(path.layers(raw, points), points, raw)
        >>> gate = path.check(plan, raw, points)
        >>> gate.passed, gate.shape_only
        (True, True)
    """
    if correction is not None:
        if correction.refused is not None:
            return decision(toolpath, [correction.refused], penetration_mm, weakened(penetration_mm))
        predicted = correction.comes
    comes = toolpath if predicted is None else loaded(toolpath, predicted)
    faults: Iterator[str] = chain(
        layer_faults(comes, edge),
        frame_faults(comes, edge),
        feed_faults(toolpath, v_fast_mm_s, acceleration_mm_s2),
        collisions(comes, edge, cloud, penetration_mm),
    )
    if predicted is not None:
        given_way = greatest_mm(predicted)
        much = [f"the tool is expected {given_way:.2f} mm beside the path, more than {MOST_DEFLECTION_MM:g} mm"]
        faults = chain(
            much if given_way > MOST_DEFLECTION_MM else [],
            faults,
            collisions(toolpath, edge, cloud, penetration_mm + given_way, as_it_comes=False),
        )
    place = place_of(toolpath, edge, cloud, touched_mm, workpiece is not None)
    faults = chain(place.faults, faults)
    rests = (f"NOT CHECKED: {toolpath.rests_on}",) if toolpath.rests_on and not rests_milled else ()
    shape = (place.shape_only,) if place.shape_only else ()
    loosened = (*shape, *weakened(penetration_mm), *loosened_checks(toolpath), *rests)
    unseen = (
        () if workpiece is not None else (*unseen_checks(toolpath), *beyond_scan(toolpath, edge, cloud), *place.unseen)
    )
    gate = decision(toolpath, faults, penetration_mm, loosened, unseen)
    return dataclasses.replace(gate, loaded=predicted is not None)


def decision(
    toolpath: Toolpath,
    faults: Iterable[str],
    tolerance_mm: float,
    loosened: tuple[str, ...],
    unchecked: tuple[str, ...] = (),
) -> PathGate:
    """The gate: passed where there is no fault."""
    named = list(_first(iter(faults)))
    points = sum(len(layer.arc_length_mm) for layer in toolpath.layers)
    reason = f"path checked: {len(toolpath.layers)} layers, {points} points"
    if named:
        more = "; and more" if len(named) > MOST_FAULTS else ""
        reason = f"path refused: {'; '.join(named[:MOST_FAULTS])}{more}"
    return PathGate(not named, reason, loosened, unchecked, toolpath=toolpath, tolerance_mm=tolerance_mm)


def weakened(penetration_mm: float) -> tuple[str, ...]:
    """What a greater penetration than the rule's is called in programs."""
    if penetration_mm <= PENETRATION_MM:
        return ()
    return (f"the cutter may enter what must remain by {penetration_mm:g} mm, the rule is {PENETRATION_MM:g} mm",)


def loosened_checks(toolpath: Toolpath) -> tuple[str, ...]:
    """Checks of the recording behind the path that a parameter made weaker than the rule."""
    return tuple(f"check {check.name}: {check.finding}" for check in toolpath.evidence if check.loosened)


SHOWING = (
    "flange_turn_deg",
    "fixed_end_share",
    "order_share",
    "position_step_mm",
    "lies_on_share",
    "pass_disagreement_mm",
    "late_turn_deg",
)
# Words of findings where a recording is blind; of earlier files "nothing tells".
UNSHOWN = ("would not show", "in no value", "does not show", "nothing tells")


def unseen_checks(toolpath: Toolpath) -> tuple[str, ...]:
    """What the recording behind the path could not show: it may move the whole path."""
    findings = [check.finding for check in toolpath.evidence if check.name in SHOWING]
    return tuple(finding for finding in findings if any(words in finding for words in UNSHOWN))


def beyond_scan(toolpath: Toolpath, edge: Edge, cloud: Cloud) -> Iterator[str]:
    """What leads mill where the scan stops and the edge does not: nothing was measured there."""
    within = float(edge.arc_length_mm[-1])
    open_ = [end for end, is_open in zip(("start", "end"), open_ends(edge, cloud), strict=True) if is_open]
    if not open_ or not toolpath.mills:
        return
    first, cutter = toolpath.layers[0], toolpath.cutter
    lead = float(max(-first.arc_length_mm[0], first.arc_length_mm[-1] - within))
    yield (
        f"the part beyond the scan, which stops on the edge at its {' and '.join(open_)}: if the edge goes on there, "
        f"lead-in and lead-out mill up to {first.height_mm + toolpath.depth_of_cut_mm:.1f} mm deep over some "
        f"{lead + cutter.radius_mm:.0f} mm that nobody measured, and meet what stands there"
    )


def _first(faults: Iterator[str]) -> Iterator[str]:
    """As many faults as are told, and one more; the costly checks come last and wait for the others."""
    for count, fault in enumerate(faults):
        yield fault
        if count == MOST_FAULTS:
            return


# Checks of a path's feeds.

SHARE = 1e-6  # rounding


def feed_faults(toolpath: Toolpath, v_fast_mm_s: float | None, acceleration_mm_s2: float) -> Iterator[str]:
    """What is wrong with the feeds, in words."""
    moves = toolpath.in_order
    position = np.concatenate([points.position_mm for points in moves])
    feed = np.concatenate([points.feed_mm_s for points in moves])
    slow, fast = toolpath.v_slow_mm_s, np.inf if v_fast_mm_s is None else v_fast_mm_s
    if not (np.isfinite(feed).all() and (feed > 0).all()):
        yield "a feed is not positive"
        return
    if feed.min() < slow * (1.0 - SHARE) or feed.max() > fast * (1.0 + SHARE):
        yield f"feeds from {feed.min():.3g} to {feed.max():.3g} mm/s, expected {slow:g} to {fast:g}"
    change = np.abs(np.diff(feed**2)) / 2.0
    if (change > acceleration_mm_s2 * step_lengths_mm(position)[1:] * (1.0 + SHARE) + 1e-9).any():
        yield f"the feed changes by more than {acceleration_mm_s2:g} mm/s^2"
    for layer in moves:
        if isinstance(layer, Layer):
            fast_cut = layer.cutting & (layer.feed_mm_s > slow * (1.0 + SHARE))
            yield from _faults(layer, (fast_cut, f"cuts faster than {slow:g} mm/s"))


def frame_faults(toolpath: Toolpath, edge: Edge) -> Iterator[str]:
    """What is wrong with the frames, in words."""
    unsound = list(insane(toolpath))
    yield from unsound
    if unsound:
        return
    for layer in toolpath.layers:
        yield from _directions(toolpath, layer, edge)
        yield from _advance(toolpath, layer)


def insane(toolpath: Toolpath) -> Iterator[str]:
    """What no controller could take, in words."""
    for points in toolpath.in_order:
        norm = np.abs(np.linalg.norm(points.quaternion_wxyz, axis=1) - 1.0)
        sane = np.isfinite(points.position_mm).all() and (norm < UNIT).all()
        if not sane or (np.sum(points.quaternion_wxyz[1:] * points.quaternion_wxyz[:-1], axis=1) < 0).any():
            yield "a position is not finite, or a quaternion not of unit length or not continuous in sign"
            return


def _directions(toolpath: Toolpath, layer: Layer, edge: Edge) -> Iterator[str]:
    """y along the edge, z down the bevel face, x into the material: each by itself, so that the words say which."""
    course, bevel = lower_course(edge, layer.arc_length_mm), finished(toolpath)
    poses = poses_of(toolpath, layer)
    rules = (
        (poses.y, course.tangent, "does not move along the edge"),
        (poses.z, cutter_axis(course.normal, course.across, bevel.angle), "has its axis out of the bevel face"),
        (poses.x, -bevel_normal(course.normal, course.across, bevel.angle), "does not face the material"),
    )
    for axis, target, words in rules:
        angle = _angle(axis, target)
        if angle.max() > ANGLE_DEG * DEG:
            worst = int(np.argmax(angle))
            yield (
                f"layer {layer.index} {words} at arc length {layer.arc_length_mm[worst]:.1f} mm "
                f"(off by {angle[worst] / DEG:.2f} deg)"
            )


def _advance(toolpath: Toolpath, layer: Layer) -> Iterator[str]:
    """Origin and cutter's axis go forward at every step, and the frame turns no faster than a cutter can follow."""
    poses, radius = poses_of(toolpath, layer), toolpath.cutter.radius_mm
    step = np.diff(layer.arc_length_mm)
    turn = np.maximum.reduce([_angle(a[1:], a[:-1]) for a in (poses.x, poses.y, poses.z)])
    forward = np.minimum(_forward(poses, poses.origin_mm), _forward(poses, poses.origin_mm - radius * poses.x))
    abrupt = turn > TURN_DEG_PER_MM * DEG * np.maximum(step, 0.1)
    yield from _faults(layer, (forward <= 0.0, "crosses itself"), (abrupt, "turns abruptly"))


def _forward(poses: Poses, points: Float) -> Float:
    return np.asarray((np.diff(points, axis=0) * (poses.y[1:] + poses.y[:-1])).sum(axis=1))


def _angle(a: Float, b: Float) -> Float:
    """Angles (k,) between unit vectors (k, 3), exact for small ones."""
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1)))


HEIGHT_MM = 0.002  # a layer's place along the bevel's normal
ALONG_MM = 0.01  # a point's place along the edge
SPACING_SHARE = 0.05


def layer_faults(toolpath: Toolpath, edge: Edge) -> Iterator[str]:
    """What is wrong with the layers, in words."""
    if not toolpath.layers:
        yield "no layer"
        return
    yield from cutter_faults(toolpath)
    bevel, cutter, above = finished(toolpath), toolpath.cutter, None
    for layer in toolpath.layers:
        course = lower_course(edge, layer.arc_length_mm)
        section = from_edge(toolpath, layer, course)
        height = bevel.height_mm(section)
        along = ((poses_of(toolpath, layer).origin_mm - course.position_mm) * course.tangent).sum(axis=1)
        flute = cutter.flute_length_mm - (cutter.radius_mm if cutter.ball_end else 0.0)
        yield from _faults(
            layer,
            (height < -HEIGHT_MM, "lies below the finished bevel"),
            (layer.cutting & (np.abs(height - layer.height_mm) > HEIGHT_MM), "is not at its height"),
            (np.abs(along) > ALONG_MM, "is not in the section of its arc length"),
            (layer.cutting & ~course.seen, "cuts where nothing was measured"),
            (layer.cutting & ~layer.measured, "cuts where nothing was measured"),
            (layer.cutting & (layer.width_mm > flute), "is wider than the flute"),
        )
        if bevel.fillet_mm:
            off = np.abs((section - bevel.middle(course, layer.height_mm)) @ bevel.up)
            yield from _faults(layer, (off > HEIGHT_MM, "does not stand where its ball end makes the fillet"))
        yield from _spacing(layer, toolpath.edge_length_mm)
        if not layer.cutting.any():
            yield f"layer {layer.index} cuts nothing but air"
        if above is not None and above - layer.height_mm > toolpath.depth_of_cut_mm + HEIGHT_MM:
            yield f"layer {layer.index} is deeper than the depth of cut"
        above = layer.height_mm
    if [layer.index for layer in toolpath.layers] != list(range(1, len(toolpath.layers) + 1)):
        yield "layers are not counted from 1 in cutting order"
    first = toolpath.layers[0]
    if isinstance(edge, RawEdge):
        top = bevel.height_mm(edge_course(edge, first.arc_length_mm, 0.0).upper_mm)
        if (top - first.height_mm)[first.cutting].max(initial=0.0) < LEAST_DEPTH_MM / 2.0:
            yield "layer 1 cuts nothing but air"
    if abs(toolpath.layers[-1].height_mm) > HEIGHT_MM:
        yield "the last layer is not the final one"
    if (np.diff([layer.height_mm for layer in toolpath.layers]) >= 0).any():
        yield "layers do not go down"


def cutter_faults(toolpath: Toolpath) -> Iterator[str]:
    """What is wrong with the cutter's end, in words: the fillet of a J preparation is the ball's."""
    radius, cutter = toolpath.root_radius_mm, toolpath.cutter
    if radius and not (cutter.ball_end and abs(cutter.radius_mm - radius) <= HEIGHT_MM):
        yield f"the cutter has no ball end of the fillet's radius, {radius:g} mm"


def _faults(layer: Layer, *rules: tuple[Bool, str]) -> Iterator[str]:
    """One line for the points that are wrong in some way, with the place of the first."""
    for wrong, words in rules:
        if wrong.any():
            yield f"layer {layer.index} {words} at arc length {layer.arc_length_mm[np.flatnonzero(wrong)[0]]:.1f} mm"


def _spacing(layer: Layer, length_mm: float) -> Iterator[str]:
    """Key points every mm from 0 to the end of the edge; the last interval may be shorter."""
    s = layer.arc_length_mm
    inside = s[(s >= -1e-6) & (s <= length_mm + 1e-6)]
    if inside.size < 2 or abs(inside[0]) > 1e-6 or abs(inside[-1] - length_mm) > 1e-6:
        yield f"layer {layer.index} does not reach from one end of the edge to the other"
        return
    step = np.diff(inside)
    wrong = np.abs(step / KEY_POINT_MM - 1.0) > SPACING_SHARE
    wrong[-1] = step[-1] > KEY_POINT_MM * (1.0 + SPACING_SHARE) or step[-1] <= 0.0
    if wrong.any():
        yield f"layer {layer.index} has no point every mm at arc length {inside[np.flatnonzero(wrong)[0]]:.1f} mm"


SHANK_MM = 300.0  # the cutter and its shank, as long as may matter
STOCK_SHARE = 1.5  # of the depth of cut: beside where it cuts, the cutter may meet a layer and what is rough on it
CORE_SHARE = 0.95  # of the radius: what comes so near the axis was run into, whatever the depth of cut
STEP_MM = 1.0  # between looks at a travel move


def collisions(
    toolpath: Toolpath, edge: Edge, cloud: Cloud, penetration_mm: float, as_it_comes: bool = True
) -> Iterator[str]:
    """Where the cutter enters what it must not, in words.

    The finished part and all that is foreign by more than `penetration_mm` + 3 u; where it is not meant to cut, the
    stock that earlier layers left by more than a ramp takes at its foot. A layer that takes nothing away; not of a path
    that the tool will not follow `as_it_comes`, whose layers need not lie where they cut.
    """
    stands = standing(toolpath, cloud, edge, swept=True)
    taken = np.unique(stands[(stands > 0) & (stands < ALWAYS)])
    above = [layer.height_mm for layer in (*toolpath.before, *toolpath.layers)]
    for order, layer in enumerate(toolpath.layers, start=len(toolpath.before) + 1):
        # The first layer of all may be too thin to hold a point, and so may one that only evens out what is left.
        lower = order > 1 and above[order - 2] - layer.height_mm > LEAST_DEPTH_MM
        if as_it_comes and lower and order not in taken:
            yield f"layer {layer.index} takes nothing away that was measured"
    scan = scan_of(cloud, edge, sections_of(stocked_course(edge, edge.arc_length_mm, toolpath)))
    stands[edge.labels == UNLABELLED] = 0  # stray returns, but for those that neighbours support
    stands[supported(foreign(scan, cloud, edge))] = ALWAYS
    stock = build_stock(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, stands)
    allowed, radius = penetration_mm + 3.0 * _edge_u_mm(toolpath, edge), toolpath.cutter.radius_mm
    if allowed >= radius:
        yield f"the cutter's radius is no more than the {allowed:.2f} mm that it may enter: it cannot be checked"
        return
    in_stock = min(STOCK_SHARE * toolpath.depth_of_cut_mm + allowed, CORE_SHARE * radius)

    def distances(after: int, most_mm: float) -> Callable[[Float, Float], Float]:
        """To what stands after so many layers, as far as it tells whether the cutter enters it by so much."""
        bound, flat = radius - most_mm, not toolpath.cutter.ball_end
        return lambda start, end: axis_distances(
            stock, start, end, np.full(len(start), after), np.full(len(start), bound), flat
        )

    for points, done in moves_in_order(toolpath):
        yield from entered(toolpath, points, distances(ALWAYS - 1, allowed), allowed, "what must remain")
        idle = ~points.cutting if isinstance(points, Layer) else None
        yield from entered(toolpath, points, distances(done, in_stock), in_stock, "the stock", idle)


def _edge_u_mm(toolpath: Toolpath, edge: Edge) -> float:
    """Standard uncertainty of the finished bevel's place, along its normal: the worst of where it is cut."""
    if not isinstance(edge, RawEdge):
        return 0.0
    final = toolpath.layers[-1]
    cut = np.interp(edge.arc_length_mm, final.arc_length_mm, final.cutting.astype(float)) > 0.0
    bevel, places = finished(toolpath), edge.position_u_mm[cut]
    u = np.hypot(*(places * bevel.normal).T)
    u = np.maximum(u, places[:, 1]) if bevel.fillet_mm else u  # where the fillet ends it lies along m
    return float(np.nanmax(u)) if np.isfinite(u).any() else 0.0


def entered(
    toolpath: Toolpath,
    points: Layer | Travel,
    distances: Callable[[Float, Float], Float],
    allowed: float,
    what: str,
    asked: Bool | None = None,
) -> Iterator[str]:
    """The deepest place of a move, of those `asked` (k,), at which the cutter is inside something.

    `distances`: of it from lines (k, 3), (k, 3), here the cutter's axis.
    """
    centre, axis = axes_of(toolpath, points)
    at = np.arange(len(centre)) if asked is None else np.flatnonzero(asked)
    centre, axis = centre[at], axis[at]
    if not len(at):
        return
    depth = toolpath.cutter.radius_mm - distances(*shank_lines(toolpath, centre, axis, allowed))
    worst = int(np.argmax(depth))
    if depth[worst] > allowed + 1e-9:
        where = f"at {np.round(centre[worst], 1).tolist()} mm in a travel move"
        if isinstance(points, Layer):
            where = f"in layer {points.index} at arc length {points.arc_length_mm[at[worst]]:.1f} mm"
        yield f"the cutter enters {what} by {depth[worst]:.2f} mm {where}"


def shank_lines(toolpath: Toolpath, centre: Float, axis: Float, allowed_mm: float) -> tuple[Float, Float]:
    """Ends (k, 3) of the cutter's axis: from its ball's centre, or where it may enter by `allowed_mm`, up the shank."""
    cutter = toolpath.cutter
    reach = cutter.cylinder_end_mm - (0.0 if cutter.ball_end else allowed_mm)
    return np.asarray(centre + reach * axis), np.asarray(centre - SHANK_MM * axis)


def axes_of(toolpath: Toolpath, points: Layer | Travel) -> tuple[Float, Float]:
    """Points on the cutter's axis beside the path's own, and its directions; every mm on the lines of a travel."""
    poses = poses_of(toolpath, points)
    centre = poses.origin_mm - toolpath.cutter.radius_mm * poses.x
    return _dense(centre, poses.z) if isinstance(points, Travel) and len(centre) else (centre, poses.z)


def _dense(centre: Float, axis: Float) -> tuple[Float, Float]:
    """Points every mm on the straight lines of a travel move."""
    length = chords_mm(centre)
    counts = np.maximum(np.ceil(length / STEP_MM).astype(int), 1)
    at = np.concatenate([np.repeat(np.arange(len(counts)), counts), [len(centre) - 1]]).astype(np.int64)
    share = np.concatenate([*(np.arange(n) / n for n in counts), [0.0]])[:, None]
    after = np.minimum(at + 1, len(centre) - 1)
    middle = axis[at] + share * (axis[after] - axis[at])
    return centre[at] + share * (centre[after] - centre[at]), unit(middle)
