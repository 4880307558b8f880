"""`path.simplify`: key points to the straight and circular moves of a robot's controller."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import Layer, Moves, Postures, Toolpath, Travel
from workbench.errors import InputError
from workbench.geometry.moves import Tolerances, arc_lengths_mm, chords_mm, merge_poses
from workbench.stage import stage
from workbench.units import DEG, Bool, Float, Int, Shaped

OFF_TRACK_MM = 0.5  # that a track may be off where the postures have it: the tool is not
SAME_MM, SAME_CHORD = 1e-6, 1e-8  # poses nearer than this are one target


class Points(NamedTuple):
    """All n points of a path in the order of motion."""

    position_mm: Shaped[Float, "n 3"]
    quaternion_wxyz: Shaped[Float, "n 4"]
    feed_mm_s: Shaped[Float, " n"]
    cutting: Shaped[Bool, " n"]
    measured: Shaped[Bool, " n"]
    layer: Shaped[Int, " n"]  # 0: between layers
    turntable: Shaped[Float, "n ..."]  # of the external axes, rad


@stage("path.simplify")
def simplify(
    toolpath: Toolpath,
    postures: Postures | None = None,
    *,
    chord_tolerance_mm: Annotated[float, Field(ge=0, le=5)] = 0.01,
    angle_tolerance_deg: Annotated[float, Field(ge=0, le=10)] = 0.05,
    feed_tolerance: Annotated[float, Field(ge=0, le=10)] = 0.1,
    arcs: bool = True,
    least_sweep_deg: Annotated[float, Field(gt=0, le=90)] = 4.2,
) -> Moves:
    r"""Replace runs of key points by straight moves and circular arcs.

    From each target the longest straight or circular move is taken whose skipped points lie within both tolerances,
    with the controller's rotation (slerp in the frame of the work object). A move's feed is that of its
    slowest point; arcs turn at most 170 deg. With postures, targets are in the base at the turntable's angles; while
    it turns, every point is a target.

    Args:
        toolpath: the path; its frame stays.
        postures: how robot, cutter and turntable stand along it.
        chord_tolerance_mm: greatest distance of a key point from its move.
        angle_tolerance_deg: greatest angle between its orientation and the move's there.
        feed_tolerance: share by which a key point's feed may exceed its move's, where it cuts; 1 in travel moves.
        arcs: circular moves too; false: straight ones only.
        least_sweep_deg: of a circular move (ABB requires 1 deg in a quarter of it); less stays straight.

    Raises:
        InputError: a path of fewer than two different poses; postures of another path.

    Example:
        >>> from workbench import path
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> moves = path.simplify(plan)
        >>> len(moves.feed_mm_s) < moves.points_before / 5
        True
    """
    if postures is not None and postures.toolpath is not toolpath:
        raise InputError("postures", "expected those of this path, found another path's")
    of_postures = None if postures is None else Points(*(getattr(postures, name) for name in Points._fields))
    every = of_postures or _points(toolpath)
    points, kept = _different(every)
    if chord_tolerance_mm == 0 and angle_tolerance_deg == 0:
        targets, circular = np.arange(len(points.layer)), np.zeros(len(points.layer), bool)
        via, via_turn = np.full((len(targets), 3), np.nan), np.full((len(targets), 4), np.nan)
    else:
        targets, circular, via, via_turn = merge_poses(
            points.position_mm,
            points.quaternion_wxyz,
            points.feed_mm_s,
            np.where(points.cutting, feed_tolerance, 1.0),
            _labels(points, on_track=postures is not None and postures.on_track),
            Tolerances(
                chord_tolerance_mm,
                angle_tolerance_deg * DEG,
                least_sweep_deg * DEG if arcs else math.inf,
                math.hypot(toolpath.cutter.diameter_mm, toolpath.cutter.flute_length_mm) / 2,
            ),
        )
    slowest = np.minimum.reduceat(points.feed_mm_s, np.append(0, targets[:-1] + 1))
    return Moves(
        position_mm=points.position_mm[targets],
        quaternion_wxyz=points.quaternion_wxyz[targets],
        circular=circular,
        via_position_mm=via,
        via_quaternion_wxyz=via_turn,
        feed_mm_s=slowest,
        cutting=points.cutting[targets],
        layer=points.layer[targets],
        toolpath=toolpath,
        points_before=len(every.layer),
        chord_tolerance_mm=chord_tolerance_mm,
        angle_tolerance_deg=angle_tolerance_deg,
        postures=postures,
        point=None if postures is None else kept[targets],
    )


def _labels(points: Points, *, on_track: bool) -> Int:
    """Of the way towards each point; another one at each where the turntable turns, or a track's way bends."""
    label = 4 * points.layer + 2 * points.cutting + points.measured
    if on_track:  # which moves the robot, and not the tool's way
        pieces = _even(points)
        return np.asarray(label + 4 * (points.layer.max() + 1) * pieces)
    turns = np.append(False, _external_turn(points) != 0)
    return np.asarray(np.where(turns, -1 - np.arange(len(label)), label))


def _external_turn(points: Points) -> Float:
    """By how much the external axis turns (n - 1,) from point to point, of several the one that does so most."""
    return np.asarray(np.abs(np.diff(points.turntable, axis=0)).reshape(len(points.layer) - 1, -1).max(axis=1))


def _even(points: Points) -> Int:
    """The piece (n,) of the way on which a track goes evenly with the tool, to OFF_TRACK_MM, towards each point."""
    arc = arc_lengths_mm(points.position_mm)
    piece, start, most, least = np.zeros(len(arc), np.int64), 0, math.inf, -math.inf
    value = points.turntable / DEG
    for i in range(1, len(arc)):
        way, gone = arc[i] - arc[start], value[i] - value[start]
        if not least * way <= gone <= most * way:
            start, most, least = i - 1, math.inf, -math.inf
            way, gone = arc[i] - arc[start], value[i] - value[start]
        if way > 0:
            most, least = min(most, (gone + OFF_TRACK_MM) / way), max(least, (gone - OFF_TRACK_MM) / way)
        piece[i] = start
    return piece


def _points(toolpath: Toolpath) -> Points:
    """The path's points in the order of motion."""
    parts = [_part(part) for part in toolpath.in_order]
    if not parts:
        raise InputError("toolpath", "expected at least one layer, found none")
    return Points(*map(np.concatenate, zip(*parts, strict=True)))


def _different(points: Points) -> tuple[Points, Int]:
    """Points without those that repeat the pose before them, and which are left."""
    step = chords_mm(points.position_mm)
    q = points.quaternion_wxyz
    turn = np.minimum(np.linalg.norm(q[1:] - q[:-1], axis=1), np.linalg.norm(q[1:] + q[:-1], axis=1))
    new = np.append(True, (step > SAME_MM) | (turn > SAME_CHORD) | (_external_turn(points) > SAME_CHORD))
    if new.sum() < 2:
        raise InputError("toolpath", f"expected at least two different poses, found {new.sum()}")
    return Points(*(column[new] for column in points)), np.flatnonzero(new)


def _part(part: Layer | Travel) -> Points:
    k = len(part.position_mm)
    if isinstance(part, Layer):
        more = (part.cutting, part.measured, np.full(k, part.index))
    else:
        more = (np.zeros(k, bool), np.ones(k, bool), np.zeros(k, np.int64))
    return Points(part.position_mm, part.quaternion_wxyz, part.feed_mm_s, *more, np.zeros(k))
