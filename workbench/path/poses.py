"""Tool poses of a path: the cutter's frames along an edge (docs/conventions.md) and where it comes under load."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.artefacts import Layer, PathDeflection, Toolpath, Travel
from workbench.errors import InputError
from workbench.geometry.poses import quaternion_from_rotation, rotation_from_quaternion, rotation_from_vector
from workbench.units import Float


def unit(vectors: Float) -> Float:
    """Vectors (..., 3) at length 1."""
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))


def bevel_normal(normal: Float, across: Float, bevel: float) -> Float:
    """Outward normals b (k, 3) of a bevel face at the angle `bevel` (rad) to the end face: n cos + m sin."""
    return np.asarray(math.cos(bevel) * normal + math.sin(bevel) * across)


def cutter_axis(normal: Float, across: Float, bevel: float) -> Float:
    """Axes z (k, 3) of a cutter that lies in that bevel face, from shank to tip: down from the upper side.

    The tilt is about the feed t: z = n sin - m cos. (The paper's section 4.3 prints a turn about z, which changes
    nothing.)
    """
    return np.asarray(math.sin(bevel) * normal - math.cos(bevel) * across)


def tool_quaternions(tangent: Float, normal: Float, across: Float, bevel: float) -> Float:
    """Orientations (k, 4), w first: y = t, z the cutter's axis, x = y x z = -b into the material.

    Neighbours have the same sign, so that interpolation between them never takes the long way round.
    """
    axes = [-bevel_normal(normal, across, bevel), tangent, cutter_axis(normal, across, bevel)]
    return same_sign(quaternion_from_rotation(np.stack(axes, axis=-1)))


def same_sign(quaternion_wxyz: Float) -> Float:
    """The same orientations (k, 4) with no jump from q to -q between neighbours."""
    flips = np.sum(quaternion_wxyz[1:] * quaternion_wxyz[:-1], axis=1) < 0
    sign = np.where(np.cumsum(np.concatenate([[False], flips])) % 2 == 1, -1.0, 1.0)
    return np.asarray(quaternion_wxyz * sign[:, None])


def smoothstep(x: Float) -> Float:
    """0 up to x = 0, 1 from x = 1 on, with a slope of 0 at both: 3 x^2 - 2 x^3."""
    x = np.clip(x, 0.0, 1.0)
    return np.asarray(x * x * (3.0 - 2.0 * x))


@dataclass(frozen=True, slots=True, eq=False)
class Poses:
    """Frames of the tool at k points: origin and axes (k, 3) in the base."""

    origin_mm: Float
    x: Float  # into the material
    y: Float  # along the feed
    z: Float  # the cutter's axis, from shank to tip


def poses_of(toolpath: Toolpath, points: Layer | Travel) -> Poses:
    """The frames of a layer or travel in the base, whatever frame the path is in."""
    axes, origin = rotation_from_quaternion(points.quaternion_wxyz), points.position_mm
    work = toolpath.base_from_workobject
    if work is not None:
        axes, origin = work[:3, :3] @ axes, origin @ work[:3, :3].T + work[:3, 3]
    return Poses(origin, axes[:, :, 0], axes[:, :, 1], axes[:, :, 2])


def cutter_ends(toolpath: Toolpath, poses: Poses) -> tuple[Float, Float]:
    """Ends (k, 3) of the cutter's axis, tip and shank end of the flute, a radius off the origin at x = -R."""
    cutter = toolpath.cutter
    centre, half = poses.origin_mm - cutter.diameter_mm / 2.0 * poses.x, cutter.flute_length_mm / 2.0 * poses.z
    return np.asarray(centre + half), np.asarray(centre - half)


def loaded(toolpath: Toolpath, predicted: PathDeflection) -> Toolpath:
    """The path displaced by the prediction, point by point; InputError where that is of another path."""
    return replace(toolpath, layers=tuple(_displaced(layer, predicted) for layer in toolpath.layers))


def greatest_mm(predicted: PathDeflection) -> float:
    """The largest displacement anywhere."""
    return max((float(np.linalg.norm(d, axis=1).max(initial=0.0)) for d in predicted.by_layer_mm.values()), default=0.0)


def _displaced(layer: Layer, predicted: PathDeflection) -> Layer:
    moved = predicted.by_layer_mm.get(layer.index)
    if moved is None or moved.shape != layer.position_mm.shape or not np.isfinite(moved).all():
        raise InputError("path.check", f"expected a deflection for each point of layer {layer.index} of this path")
    away = (rotation_from_quaternion(layer.quaternion_wxyz) @ moved[:, :, None])[:, :, 0]
    turn = predicted.turn_by_layer.get(layer.index)
    quaternion = layer.quaternion_wxyz if turn is None else turned_about_feed(layer.quaternion_wxyz, turn)
    return replace(layer, position_mm=layer.position_mm + away, quaternion_wxyz=quaternion)


def turned_about_feed(quaternion_wxyz: Float, angle: Float) -> Float:
    """Tool frames (k, 4) turned by angles (k,) rad about their own y."""
    turn = rotation_from_vector(np.asarray(angle)[:, None] * np.array([0.0, 1.0, 0.0]))
    return same_sign(quaternion_from_rotation(rotation_from_quaternion(quaternion_wxyz) @ turn))
