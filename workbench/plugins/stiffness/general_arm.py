"""The posture optimiser's calls for any arm that has an inverse: slower, by joint angles instead of algebra.

Configurations are told apart by the three sides of the arm (`workbench.api.arm_sides`). A spherical wrist has one
solution each; so has a UR. Where an arm has two with the same sides (CRX, at a quarter of its poses) the one that is
farther from singular counts. The two flips of a wrist that is not spherical give way differently: cells of the grid are
ranked by the better one, so with `Choice` the optimum is proven among what one flip can do, not over both.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workbench.api import (
    AnyArray,
    Chain,
    Float,
    InputError,
    arm_sides,
    forward_kinematics,
    inverse,
    inverse_kinematics,
    jacobian_at,
    joint_axes,
    within_limits,
)

MOST_POSES = 60_000  # of one call: some minutes where the inverse is a search
FREE, SINGULAR, LIMIT, UNREACHABLE = range(4)  # indices of `arm.CAUSES`
STRETCHED = 1e-6  # smallest singular value of the Jacobian, lengths in m, below which a posture is singular


@dataclass(eq=False)
class GeneralArm:
    """A robot by its chain; the solutions that were asked for last are kept."""

    chain: Chain
    _last: tuple[bytes, Float] = field(default=(b"", np.empty(0)), repr=False)

    def solutions(self, base_from_flange: Float) -> Float:
        """Joint angles (n, 8, 6) at poses (n, 4, 4), by 4 * behind + 2 * elbow down + flipped; NaN: none.

        Raises:
            InputError: too many poses for a search at each.
        """
        poses = np.ascontiguousarray(base_from_flange)
        if len(poses) > MOST_POSES:
            raise InputError(
                f"robot '{self.chain.name}'",
                f"{len(poses)} postures to look at, and each takes a search: expected at most {MOST_POSES} (a larger "
                "step_deg, fewer sampled_points)",
            )
        if self._last[0] != (key := poses.tobytes()):
            self._last = key, self._solved(poses)
        return self._last[1]

    def _solved(self, poses: Float) -> Float:
        found = inverse_kinematics(self.chain, poses)
        which, row = np.nonzero(np.isfinite(found[..., 0]))
        q = found[which, row]
        label = arm_sides(self.chain, q) @ np.array([4, 2, 1])
        clear = self._smallest(q)
        order = np.argsort(clear, kind="stable")  # the clearest of a label is written last
        made = np.full((len(poses), 8, 6), np.nan)
        made[which[order], label[order]] = q[order]
        return made

    def _smallest(self, q: Float) -> Float:
        """Smallest singular value (k,) of the Jacobian at angles (k, 6), lengths in m."""
        slope = jacobian_at(*joint_axes(self.chain, q), forward_kinematics(self.chain, q)[:, :3, 3])
        slope[:, :3] /= 1e3
        return np.asarray(np.linalg.svd(slope, compute_uv=False)[:, -1]) if len(q) else np.empty(0)

    def joint_angles(self, base_from_flange: Float, branch: int) -> Float:
        """As `arm.joint_angles`; NaN becomes 0, which `displacements` calls unreachable."""
        return np.nan_to_num(self.solutions(base_from_flange)[:, branch])

    def displacements(
        self, stiffness: Float, base_from_flange: Float, tip_mm: Float, force_n: Float, first: int
    ) -> tuple[Float, AnyArray, Float, AnyArray]:
        """Displacement (n,) and what is said (n,) of two flips, `first` and the next branch; tip and force (n, 3)."""
        both: list[Float] = []
        for branch in (first, first + 1):
            q = self.solutions(base_from_flange)[:, branch]
            there = np.isfinite(q[:, 0])
            moved, said = np.full(len(q), np.inf), np.full(len(q), UNREACHABLE)
            inside = np.isfinite(within_limits(self.chain, q[there])).all(axis=1)
            singular = self._smallest(q[there]) < STRETCHED
            said[there] = np.where(singular, SINGULAR, np.where(inside, FREE, LIMIT))
            slope = jacobian_at(*joint_axes(self.chain, q[there]), tip_mm[there])[:, :3]
            torque = np.einsum("nri,nr->ni", slope, force_n[there])
            moved[there] = np.linalg.norm(np.einsum("nri,ni->nr", slope, torque / (1e3 * stiffness)), axis=1)
            both += [moved, said.astype(float)]
        return both[0], both[1].astype(np.uint8), both[2], both[3].astype(np.uint8)

    def traverse(
        self,
        stiffness: Float,
        flange_from_cutter: Float,
        base_from_cutter: Float,
        load_mm: Float,
        force_n: Float,
        angles: Float,
        first: int,
    ) -> tuple[Float, AnyArray]:
        """As `arm.traverse`: mean displacement (a, t) and the worst that is said of it, of the better flip."""
        tables, points = base_from_cutter.shape[:2]
        turns = np.tile(np.eye(4), (len(angles), 1, 1))
        turns[:, 0, 0], turns[:, 0, 1] = np.cos(angles), -np.sin(angles)
        turns[:, 1, 0], turns[:, 1, 1] = np.sin(angles), np.cos(angles)
        flange = base_from_cutter[:, :, None] @ turns @ inverse(flange_from_cutter)
        tip, force = (np.repeat(part.reshape(-1, 3), len(angles), axis=0) for part in (load_mm, force_n))
        one, said, other, flipped = (
            part.reshape(tables, points, len(angles))
            for part in self.displacements(stiffness, flange.reshape(-1, 4, 4), tip, force, first)
        )
        worst = np.stack([said.max(axis=1), flipped.max(axis=1)])
        mean = np.stack([one.mean(axis=1), other.mean(axis=1)])
        mean = np.where(worst == worst.min(axis=0), mean, np.inf).min(axis=0)
        return mean, worst.min(axis=0).astype(np.uint8)
