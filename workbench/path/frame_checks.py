"""Checks of a path's tool frames: which way the cutter lies, and that it goes on without a jump."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from workbench.artefacts import Edge, Layer, Toolpath
from workbench.geometry.tool_frames import bevel_normal, cutter_axis
from workbench.path.course import lower_course
from workbench.path.poses import Poses, poses_of
from workbench.path.section import finished
from workbench.units import DEG, Float

ANGLE_DEG = 0.02  # between a frame's axis and where it must point
TURN_DEG_PER_MM = 3.0  # a radius of 20 mm
UNIT = 1e-6


def frame_faults(toolpath: Toolpath, edge: Edge) -> Iterator[str]:
    """What is wrong with the frames, in words."""
    told = list(insane(toolpath))
    yield from told
    if told:
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
    for wrong, words in (
        (forward <= 0.0, "crosses itself"),
        (turn > TURN_DEG_PER_MM * DEG * np.maximum(step, 0.1), "turns abruptly"),
    ):
        if wrong.any():
            at = layer.arc_length_mm[np.flatnonzero(wrong)[0]]
            yield f"layer {layer.index} {words} at arc length {at:.1f} mm"


def _forward(poses: Poses, points: Float) -> Float:
    return np.asarray((np.diff(points, axis=0) * (poses.y[1:] + poses.y[:-1])).sum(axis=1))


def _angle(a: Float, b: Float) -> Float:
    """Angles (k,) between unit vectors (k, 3), exact for small ones."""
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(a - b, axis=1), np.linalg.norm(a + b, axis=1)))
