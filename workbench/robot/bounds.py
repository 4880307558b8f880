"""A lower bound of the clearance for very many postures: what it calls free is free, the rest is for fcl to decide.

Every shape is put into a capsule, or where it does not hang on the robot into a box: exact for capsules, spheres,
boxes, and cylinders beside capsules; wider for meshes, and for one of two cylinders. Bounding volumes that keep apart
prove that the shapes do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.robot.bound_kernels import BOX, CYLINDER, FAR_MM, NONE, Scene, bound_kernel, near_kernel, pairs_kernel
from workbench.robot.cell import Cell
from workbench.robot.collision import checked_pairs, turntable_pose
from workbench.robot.shapes import ON_TURNTABLE, Shape
from workbench.units import Bool, Float, Int, Shaped

SAFE_MM = 1e-3  # a posture counts as free only beyond this, so that rounding decides nothing


@dataclass(frozen=True, slots=True, eq=False)
class BoundingVolumes:
    """S shapes as capsules (two ends, a radius) and solids (pose and half lengths), and the pairs to look at."""

    link: Shaped[Int, " S"]  # as in `Shape`, the fixed ones 0
    solid: Shaped[Int, " S"]  # 1: a box and no capsule, 2: a cylinder and the capsule around it, 0: a capsule alone
    ends_mm: Shaped[Float, "S 2 3"]  # at zero, in the base (or the turntable's frame)
    radius_mm: Shaped[Float, " S"]
    pose: Shaped[Float, "S 4 4"]  # of solids, likewise
    half_mm: Shaped[Float, "S 3"]
    around_mm: Shaped[Float, " S"]  # radius of the sphere around each
    pairs: Shaped[Int, "P 2"]


def bounding_volumes(cell: Cell) -> BoundingVolumes:
    """The cell's shapes in volumes whose distances are quick."""
    made = [_volume(shape) for shape in cell.shapes]
    count = len(made)  # 0: nothing is known of any body
    ends = np.array([one for one, _, _ in made]).reshape(count, 2, 3)
    radius, half = np.array([one for _, one, _ in made]), np.array([one for _, _, one in made]).reshape(count, 3)
    inside = np.where(radius < 0, np.linalg.norm(half, axis=1), radius)
    around = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1) / 2 + inside
    return BoundingVolumes(
        link=np.array([max(shape.link, 0) for shape in cell.shapes], np.int64),
        solid=np.array([_solid(shape, r) for shape, r in zip(cell.shapes, radius, strict=True)], np.int64),
        ends_mm=ends,
        radius_mm=np.maximum(radius, 0.0),
        pose=np.array([_centred(shape) for shape in cell.shapes]).reshape(count, 4, 4),
        half_mm=half,
        around_mm=around,
        pairs=np.array(checked_pairs(cell), np.int64).reshape(-1, 2),
    )


def scene(cell: Cell, volumes: BoundingVolumes) -> Scene:
    """The cell and its volumes as the kernels see them."""
    return Scene(
        cell.chain.axes,
        cell.chain.points_mm,
        turntable_pose(cell, 0.0),
        volumes.link,
        volumes.solid,
        volumes.ends_mm,
        volumes.radius_mm,
        volumes.pose,
        volumes.half_mm,
        volumes.around_mm,
        volumes.pairs,
    )


def clearance_bound_mm(
    cell: Cell, volumes: BoundingVolumes, joints: Float, turntable: Float | float = 0.0, most_mm: float = FAR_MM
) -> Float:
    """A distance (n,) that no pair of bodies falls below, at joint angles (n, 6) and turntable angles (n,), rad.

    Free without further look: more than SAFE_MM and what any pair must keep apart. Negative or small: ask
    `CollisionModel`. What is farther apart than `most_mm` need not be known, and takes less time.
    """
    q = np.ascontiguousarray(joints, float).reshape(-1, 6)
    table = np.ascontiguousarray(np.broadcast_to(np.asarray(turntable, float), len(q)))
    return np.asarray(bound_kernel(scene(cell, volumes), q, table, most_mm))


def near_pairs(cell: Cell, volumes: BoundingVolumes, joints: Float, turntable: Float, least_mm: Float) -> Bool:
    """Which pairs (n, P) are not proven to keep `least_mm` (P,) apart at joint angles (n, 6) and turntable angles (n,).

    Angles in rad.
    """
    q, table = np.ascontiguousarray(joints, float), np.ascontiguousarray(turntable, float)
    return np.asarray(near_kernel(scene(cell, volumes), q, table, least_mm + SAFE_MM))


def pair_bounds_mm(cell: Cell, volumes: BoundingVolumes, joints: Float, turntable: Float) -> tuple[Float, Float]:
    """A distance (n, P) that no pair falls below, and the volumes' middles (n, S, 3) in the base, at (n, 6), (n,)."""
    found, middles = pairs_kernel(
        scene(cell, volumes), np.ascontiguousarray(joints, float), np.ascontiguousarray(turntable, float)
    )
    return np.asarray(found), np.asarray(middles)


def _volume(shape: Shape) -> tuple[Float, float, Float]:
    """Ends of a capsule's axis and its radius (negative: a box), half lengths of the box."""
    half = _half_lengths(shape)
    if shape.kind in ("box", "mesh") and not 1 <= shape.link <= 6:
        return np.zeros((2, 3)), -1.0, half
    if shape.kind in ("capsule", "cylinder", "sphere"):
        radius = shape.size_mm[0]
        length = shape.size_mm[1] / 2 if len(shape.size_mm) > 1 else 0.0
        axis = np.array([0.0, 0.0, length])
    else:
        longest = int(np.argmax(half))
        axis = half * (np.arange(3) == longest)
        radius = float(np.linalg.norm(np.delete(half, longest)))
    pose = _centred(shape)
    return np.array([pose[:3, :3] @ (s * axis) + pose[:3, 3] for s in (-1, 1)]), radius, half


def _solid(shape: Shape, radius_mm: float) -> int:
    return CYLINDER if shape.kind == "cylinder" else BOX if radius_mm < 0 else NONE


def _half_lengths(shape: Shape) -> Float:
    if shape.vertices_mm is not None:
        return np.asarray(np.ptp(shape.vertices_mm, axis=0) / 2)
    if shape.kind == "cylinder":
        radius, length = shape.size_mm
        return np.array([radius, radius, length / 2])
    return np.array(shape.size_mm) / 2 if shape.kind == "box" else np.zeros(3)


def _centred(shape: Shape) -> Float:
    """The shape's pose, for a mesh moved to the middle of the box around it."""
    if shape.vertices_mm is None:
        return shape.pose
    middle = np.eye(4)
    middle[:3, 3] = (shape.vertices_mm.min(axis=0) + shape.vertices_mm.max(axis=0)) / 2
    return np.asarray(shape.pose @ middle)


assert ON_TURNTABLE == 7  # the kernel's eighth motion
