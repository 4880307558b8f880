"""How far the bodies of a cell may move against each other while its joints stay within a reach of where they are.

A point of a body moves by at most its distance from each axis times that joint's reach; the distances themselves change
by no more than the point moves, hence the division (Schwarzer, Saha, Latombe, IEEE Trans. Robotics 21 (2005) 338).
"""

from __future__ import annotations

import numpy as np

from workbench.robot.bounds import SAFE_MM, bounding_volumes, pair_bounds_mm
from workbench.robot.cell import Cell
from workbench.robot.collision import CollisionModel, turntable_pose
from workbench.robot.kinematics import joint_axes
from workbench.robot.margins import COVERAGE, joint_reach
from workbench.robot.shapes import ON_TURNTABLE
from workbench.units import Bool, Float, Int

CURVED = 1.3  # by how much joints may go beyond what the Jacobian says of a short way
MOST_REACH = 0.25  # rad, of all joints together, for which that holds


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
        self.table = on_table.any(axis=1)
        self.standing = np.take_along_axis(pairs, on_table.argmax(axis=1)[:, None], axis=1)[:, 0]
        self.by_tool = (high == 6) & (low == 0)  # what link 6 carries against what stands
        self.least_mm = self._least(pairs)

    def _least(self, pairs: Int) -> Float:
        """The clearance (P,) and what tool and part may be off, coverage 2."""
        margins, shapes = self.cell.margins, self.cell.shapes
        around = self.volumes.around_mm if len(shapes) else np.zeros(0)
        tool = np.array([shape.body in ("tool", "cutter") for shape in shapes])
        part = np.array([not 0 <= shape.link <= 6 for shape in shapes])
        flange = self.cell.chain.base_from_flange_at_zero[:3, 3]
        lever = np.array([np.linalg.norm(shape.pose[:3, 3] - flange) for shape in shapes]) + around
        lever = np.where(part, around, lever)
        off = np.where(tool, np.hypot(margins.flange_mm, margins.flange_rad * lever), 0.0)
        off = np.where(part, np.hypot(margins.part_mm, margins.part_rad * lever), off)
        two = off[pairs]
        return np.asarray(self.cell.margin_mm + COVERAGE * np.hypot(two[:, 0], two[:, 1]))

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

    def proven(self, joints: Float, table: Float, tip_mm: Float, far_mm: float, turn: float) -> Bool:
        """Which postures (n, 6), turntable (n,), are free of collision with all whose tip (n, 3) is so near to theirs.

        The tool goes no farther than its tip and what a turn adds. The joints go no farther than the Jacobian asks,
        times CURVED for what it changes on so short a way. False: not proven, which says nothing.

        Args:
            joints: rad.
            table: rad.
            tip_mm: in the base.
            far_mm: of the tip.
            turn: of the tool, rad.
        """
        reach = CURVED * joint_reach(self.cell.chain, joints, tip_mm, far_mm, turn)
        free = np.asarray(np.isfinite(joints).all(axis=1) & (reach.sum(axis=1) < MOST_REACH))
        if self.model.pairs and free.any():
            some = np.flatnonzero(free)
            apart, middles = pair_bounds_mm(self.cell, self.volumes, joints[some], table[some])
            moved = self.moved_mm(joints[some], np.column_stack([reach[some], np.zeros(len(some))]), middles)
            lever = np.linalg.norm(middles - tip_mm[some, None], axis=2) + self.volumes.around_mm
            carried = (far_mm + turn * lever)[:, self.outer]
            moved = np.where(self.by_tool, np.minimum(moved, carried), moved)
            free[some] = (apart - moved > self.least_mm + SAFE_MM).all(axis=1)
        return free
