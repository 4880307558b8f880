"""Tool poses of a path in the base, as arrays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Layer, Toolpath, Travel
from workbench.geometry.poses import rotation_from_quaternion
from workbench.units import Float


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
