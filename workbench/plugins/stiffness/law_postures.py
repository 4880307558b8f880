"""From a law to postures: joint angles, displacement, clearance and the turned targets of every point."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from workbench.api import (
    Cell,
    Float,
    Int,
    Postures,
    Shaped,
    Toolpath,
    forward_kinematics,
    inverse,
    jacobian_at,
    joint_axes,
    quaternion_from_rotation,
)
from workbench.plugins.stiffness.arm import BRANCHES
from workbench.plugins.stiffness.elastic import MM
from workbench.plugins.stiffness.law import Law
from workbench.plugins.stiffness.path_points import PathPoints
from workbench.plugins.stiffness.traversal import COLLISION, FREE, Choice, Configuration, Examiner, PostureMap
from workbench.plugins.stiffness.values import JointStiffness


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A constant pair of angles that the choice is compared with."""

    rotation: float
    table: float
    joints: Shaped[Float, "n 6"]
    displacement_mm: Shaped[Float, " l"]  # of the loaded points
    cause: int  # index into `traversal.CAUSES`: free or in collision
    pair: tuple[str, str] | None  # that collides


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """All that the posture optimiser found, for its file and its chapter."""

    postures: Postures
    points: PathPoints
    choice: Choice  # the constant pair
    map: PostureMap
    mode: str
    bound_mm: Shaped[Float, " s"]  # least displacement over the grid of each sampled loaded point, collision aside
    law_bound_mm: float | None  # below the mean displacement and step cost of any law; None: constant angles
    law_gap: float | None  # how far above it the law may be, as a share; 0: it is proven the best
    bound_at: Shaped[Int, " s"]  # which of the loaded points they are
    cases: Mapping[str, Case | None]  # as planned, worst, best; None: the robot cannot do it

    @property
    def displacement_mm(self) -> Float:
        """Length of the displacement (l,) of the loaded points as chosen."""
        return np.asarray(np.linalg.norm(self.postures.displacement_mm[self.points.loaded], axis=1))

    @property
    def gap(self) -> float:
        """How far the law is above the point-wise bound, as a share of it."""
        return float(self.displacement_mm[self.bound_at].mean() / self.bound_mm.mean() - 1)


def case_at(examiner: Examiner, k: Float, rotation: float, table: float) -> Case | None:
    """The best configuration for a constant pair of angles; one in collision only where none is free."""
    points, n = examiner.points, len(examiner.points.layer)
    angles = np.full(n, rotation), np.full(n, table)
    found = []
    for branch, flip in np.ndindex(len(BRANCHES), 2):
        joints, cause, hit = examiner.along(Configuration(branch, flip), *angles)
        if cause in (FREE, COLLISION):
            moved = _displacements(examiner.cell, k, joints, points.turned(examiner.cell, angles[1]), points)
            length = np.linalg.norm(moved[points.loaded], axis=1)
            pair = examiner.screen.pair(hit) if cause == COLLISION else None
            found.append(Case(rotation, table, joints, length, cause, pair))
    return min(found, key=lambda case: (case.cause, case.displacement_mm.mean()), default=None)


def postures(
    examiner: Examiner,
    stiffness: JointStiffness,
    toolpath: Toolpath,
    law: Law,
    warnings: tuple[str, ...],
) -> Postures:
    """The postures of a law."""
    cell, points, joints = examiner.cell, examiner.points, law.joints
    flange_from_point = cell.flange_from_cutter @ inverse(points.point_from_tip)
    targets = forward_kinematics(cell.chain, joints) @ flange_from_point
    turned = points.turned(cell, law.table)
    return Postures(
        toolpath=toolpath,
        layer=points.layer,
        cutting=points.cutting,
        measured=points.measured,
        position_mm=targets[:, :3, 3],
        quaternion_wxyz=quaternion_from_rotation(targets[:, :3, :3]),
        feed_mm_s=_feeds(points, targets[:, :3, 3]),
        cutter_rotation=law.rotation,
        turntable=law.table,
        joints=joints,
        displacement_mm=_displacements(cell, stiffness.nm_per_rad, joints, turned, points),
        clearance_mm=examiner.screen.clearances_mm(joints, law.table),
        flange_from_point=flange_from_point,
        has_turntable=cell.turntable is not None,
        warnings=warnings + _too_fast(cell, joints, points),
        planned_turntable=points.planned,
    )


def _too_fast(cell: Cell, joints: Float, points: PathPoints) -> tuple[str, ...]:
    """Joints that cannot follow the path's own feed: the controller will slow down there."""
    speed = np.abs(np.diff(joints, axis=0)) / points.time_steps_s[1:, None]
    return tuple(
        f"joint {j} would need {share:.1f} times its largest speed at the path's feed"
        for j, share in enumerate((speed.max(axis=0) / cell.chain.speeds).tolist(), 1)
        if share > 1
    )


def _displacements(cell: Cell, k: Float, joints: Float, turned: Float, points: PathPoints) -> Float:
    """J K^-1 J^T f (n, 3) of the loaded point, mm, base axes."""
    at = (turned @ points.base_from_point)[:, :3, 3]
    force = (turned[:, :3, :3] @ points.force_n[:, :, None])[:, :, 0]
    jacobian = jacobian_at(*joint_axes(cell.chain, joints), at)[:, :3]
    torque = np.einsum("nri,nr->ni", jacobian, force) / MM
    return np.asarray(np.einsum("nri,ni->nr", jacobian, torque / k))


def _feeds(points: PathPoints, position_mm: Float) -> Float:
    """Feeds in the base that take as long from point to point as the path's own do on the workpiece."""
    way = np.linalg.norm(np.diff(position_mm, axis=0), axis=1)
    planned = np.linalg.norm(np.diff(points.base_from_point[:, :3, 3], axis=0), axis=1)
    same = np.isclose(way, planned, rtol=1e-9, atol=1e-9) | (planned < 1e-6) | (way < 1e-6)
    ratio = np.where(same, 1.0, way / np.where(same, 1.0, planned))
    return np.append(points.feed_mm_s[:1], points.feed_mm_s[1:] * ratio)
