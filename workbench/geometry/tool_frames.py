"""Frames of a cutter along an edge, from the section's axes t, n, m (docs/conventions.md)."""

from __future__ import annotations

import math

import numpy as np

from workbench.geometry.poses import quaternion_from_rotation
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
