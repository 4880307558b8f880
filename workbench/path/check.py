"""`path.check`: may this path be run? Its own checks, from the edge and the cloud, not from how it was planned."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud, Edge, Layer, PathCorrection, PathDeflection, PathGate, Toolpath
from workbench.geometry.times import step_lengths_mm
from workbench.path.path_checks import collisions, frame_faults, layer_faults
from workbench.path.poses import greatest_mm, loaded
from workbench.stage import stage

MOST_TOLD = 3  # faults that the reason names
MOST_DEFLECTION_MM = 1.0  # what a path may allow for: unloaded, the cutter is that much deeper
PENETRATION_MM = 0.05  # the rule: more than this loosens the check


@stage("path.check")
def check(
    toolpath: Toolpath,
    edge: Edge,
    cloud: Cloud,
    predicted: PathDeflection | None = None,
    correction: PathCorrection | None = None,
    *,
    v_fast_mm_s: Annotated[float | None, Field(gt=0, le=5000)] = None,
    acceleration_mm_s2: Annotated[float, Field(gt=0, le=1e5)] = 50.0,
    penetration_mm: Annotated[float, Field(gt=0, le=2)] = PENETRATION_MM,
    rests_milled: bool = False,
) -> PathGate:
    """Check a path against the edge and the cloud. A program is written only for a path that passes.

    Layers: the last one lies on the finished bevel, none below it; each takes no more than the depth of cut, and some
    point of the cloud away; key points every 1 mm; nothing is cut where nothing was measured. Frames: y along the edge,
    the cutter's axis in the bevel face, shank on the upper side, x into the material, no jump. The cutter, a cylinder
    without end on the shank's side, meets no clamp and enters nothing that remains after its layer, by more than
    `penetration_mm` + 3 u. Feeds within v_slow and v_fast and the acceleration.

    Where a deflection is predicted (a path that `stiffness.compensate` moved against it), or a cut was measured
    (`path.correct`; then a prediction does not count besides), the tool as it comes must come where the plan asks; the
    path as commanded is held against clamps and part too, with the deflection allowed for. A refused correction
    refuses the path.

    A `penetration_mm` above 0.05 loosens the check, and so does a path that rests on another one (the lower bevel of a
    compound one), until `rests_milled` says that it is milled: programs then say so, and the exit status is 1.

    Args:
        toolpath: the path.
        edge: the edge that it mills.
        cloud: the scan.
        predicted: how far the robot gives way along this path.
        correction: by which this path was corrected.
        v_fast_mm_s: greatest feed; null: not checked.
        acceleration_mm_s2: greatest change of the feed, per time.
        penetration_mm: how deep the cutter may touch what must remain, besides 3 u of the edge.
        rests_milled: the path that this one rests on has been milled (of a compound bevel the upper one's); nothing in
            the scan of the raw edge shows it.

    Raises:
        InputError: the prediction, or the correction, is of another path.

    Example:
        >>> from workbench import edge, path, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> plan = path.feed(path.layers(raw, points), points, raw)
        >>> path.check(plan, raw, points).passed
        True
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
    rests = (f"NOT CHECKED: {toolpath.rests_on}",) if toolpath.rests_on and not rests_milled else ()
    loosened = (*weakened(penetration_mm), *loosened_checks(toolpath), *rests)
    return decision(toolpath, faults, penetration_mm, loosened, unseen_checks(toolpath))


def decision(
    toolpath: Toolpath,
    faults: Iterable[str],
    tolerance_mm: float,
    loosened: tuple[str, ...],
    unchecked: tuple[str, ...] = (),
) -> PathGate:
    """The gate: passed where there is no fault."""
    told = list(_first(iter(faults)))
    points = sum(len(layer.arc_length_mm) for layer in toolpath.layers)
    reason = f"path checked: {len(toolpath.layers)} layers, {points} points"
    if told:
        more = "; and more" if len(told) > MOST_TOLD else ""
        reason = f"path refused: {'; '.join(told[:MOST_TOLD])}{more}"
    return PathGate(not told, reason, loosened, unchecked, toolpath=toolpath, tolerance_mm=tolerance_mm)


def weakened(penetration_mm: float) -> tuple[str, ...]:
    """What a greater penetration than the rule's is called in programs."""
    if penetration_mm <= PENETRATION_MM:
        return ()
    return (f"the cutter may enter what must remain by {penetration_mm:g} mm, the rule is {PENETRATION_MM:g} mm",)


def loosened_checks(toolpath: Toolpath) -> tuple[str, ...]:
    """Checks of the recording behind the path that a parameter made weaker than the rule."""
    return tuple(f"check {check.name}: {check.finding}" for check in toolpath.evidence if check.loosened)


SHOWING = ("flange_turn_deg", "fixed_end_share", "wiggle_mm", "position_step_mm", "lies_on_share")
UNSHOWN = ("would not show", "in no value", "nothing tells which")  # what these say where a recording is blind


def unseen_checks(toolpath: Toolpath) -> tuple[str, ...]:
    """What the recording behind the path could not show: it may move the whole path."""
    told = [check.finding for check in toolpath.evidence if check.name in SHOWING]
    return tuple(finding for finding in told if any(words in finding for words in UNSHOWN))


def _first(faults: Iterator[str]) -> Iterator[str]:
    """As many faults as are told, and one more; the costly checks come last and wait for the others."""
    for count, fault in enumerate(faults):
        yield fault
        if count == MOST_TOLD:
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
        if isinstance(layer, Layer) and (layer.feed_mm_s[layer.cutting] > slow * (1.0 + SHARE)).any():
            at = layer.arc_length_mm[layer.cutting & (layer.feed_mm_s > slow * (1.0 + SHARE))][0]
            yield f"layer {layer.index} cuts faster than {slow:g} mm/s at arc length {at:.1f} mm"
