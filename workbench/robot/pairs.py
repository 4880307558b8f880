"""How far the bodies of a cell may move against each other while its joints stay within a reach of where they are.

A point of a body moves by at most its distance from each axis times that joint's reach; the distances themselves change
by no more than the point moves, hence the division (Schwarzer, Saha, Latombe, IEEE Trans. Robotics 21 (2005) 338).
"""

from __future__ import annotations

import numpy as np

from workbench.geometry.blocks import in_order
from workbench.robot.bound_kernels import swept_kernel
from workbench.robot.bounds import bounding_volumes, scene
from workbench.robot.cell import Cell
from workbench.robot.collision import CollisionModel, turntable_pose
from workbench.robot.kinematics import joint_axes
from workbench.robot.shapes import ON_TURNTABLE
from workbench.units import Bool, Float, Shaped

WAYS_A_BLOCK = 8  # some 20 ms


class Pairs:
    """Which joints move the bodies of each pair against each other, and how far they must keep apart."""

    def __init__(self, cell: Cell) -> None:
        """Build once, ask often."""
        self.cell, self.model, self.volumes = cell, CollisionModel(cell), bounding_volumes(cell)
        pairs = np.array(self.model.pairs, int).reshape(-1, 2)
        link = np.array([max(shape.link, 0) for shape in cell.shapes] or [0])[pairs]
        on_table = link == ON_TURNTABLE
        arm = np.where(on_table, 0, link)
        low, high = arm.min(axis=1), arm.max(axis=1)
        self.outer = np.take_along_axis(pairs, arm.argmax(axis=1)[:, None], axis=1)[:, 0]
        self.joints = (np.arange(1, 7) > low[:, None]) & (np.arange(1, 7) <= high[:, None])  # (P, 6)
        # Many pairs come nearer by the same motion: that of one volume by the same joints.
        motions, self.by = np.unique(np.column_stack([self.outer, self.joints]), axis=0, return_inverse=True)
        self.carried, self.moves = motions[:, 0].astype(np.int64), motions[:, 1:].astype(bool)
        self.table = on_table.any(axis=1)
        self.standing = np.take_along_axis(pairs, on_table.argmax(axis=1)[:, None], axis=1)[:, 0]
        self.least_mm = self.model.least_mm

    def moved_mm(self, joints: Float, reach: Float, middles: Float) -> Float:
        """By how much each pair (n, P) may come nearer within reaches (n, 7) of joints and turntable."""
        axes, points = joint_axes(self.cell.chain, joints)
        arm = middles[:, None, :, :] - points[:, :, None, :]  # (n, 6, S, 3)
        radius = np.linalg.norm(np.cross(axes[:, :, None, :], arm), axis=-1) + self.volumes.around_mm
        way = np.einsum("nip,pi,ni->np", radius[:, :, self.outer], self.joints.astype(float), reach[:, :6])
        if self.table.any():
            pose = turntable_pose(self.cell, 0.0)
            from_axis = np.linalg.norm(np.cross(middles - pose[:3, 3], pose[:3, 2]), axis=-1) + self.volumes.around_mm
            way += np.where(self.table, from_axis[:, self.standing] * reach[:, 6:], 0.0)
        slack = 1 - reach.sum(axis=1, keepdims=True)
        return np.asarray(np.where(slack > 0, way / np.maximum(slack, 1e-9), np.inf))

    def swept(self, joints: Shaped[Float, "c s 6"], table: Shaped[Float, " c"]) -> Bool:
        """Which places (c, s) of c ways of the joints are not proven free of collision with what lies around them.

        A stretch of a way is proven when every pair of bodies is farther apart in its middle than it must be, and what
        the joints may move it by on the whole stretch; else it is halved, down to half a step either side of a place.

        Args:
            joints: (c, s, 6) rad, s places one after the other, so near that a parabola through three tells the way.
            table: (c,) rad, standing.
        """
        ways, turned = np.ascontiguousarray(joints, float), np.ascontiguousarray(table, float)
        bodies, least = scene(self.cell, self.volumes), self.least_mm

        def some(first: int, last: int) -> Bool:
            chosen = slice(first, last)
            return np.asarray(
                swept_kernel(bodies, ways[chosen], turned[chosen], self.carried, self.moves, self.by, least)
            )

        return np.concatenate([np.zeros((0, ways.shape[1]), bool), *in_order(some, len(ways), WAYS_A_BLOCK)])
