"""Displacement of very many postures, without their joint angles: the traversal of the paper's Fig. 17.

Where the wrist's centre and the axis of joint 6 are given, all joint axes follow by algebra: the first three from a
triangle in the arm's plane, the fourth along the forearm, the fifth across the fourth and the sixth. The displacement
J K^-1 J^T f is then a sum of six products, and limits are tested by cosines. A wrist flip turns joint 5's axis round,
which changes nothing in that sum. The arm frame: origin on axis 1, z along axis 1, y along axis 2 at zero; in the arm's
plane a point is the complex number z + i x, which a turn q about y multiplies by exp(i q).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from workbench.api import (
    AnyArray,
    Cell,
    Chain,
    Float,
    InputError,
    Shaped,
    arm_sides,
    dexterity,
    forward_kinematics,
    inverse,
    inverse_kinematics,
    jacobian,
    mapped,
    pose_from,
    spherical_wrist,
    turn_about_z,
    within_limits,
)
from workbench.plugins.stiffness.arm_kernels import (
    ArmPath,
    Branch,
    Vector,
    joints_kernel,
    traverse_kernel,
)
from workbench.plugins.stiffness.elastic import PER_M, pushed

MOST_POSES = 60_000  # of one call: some minutes where the inverse is a search
NO_SPRINGS = np.ones(6)  # where nobody knows them: joint angles take no notice
FREE, SINGULAR, LIMIT, UNREACHABLE = range(4)  # what is said of a posture, the worse the higher
BRANCHES = 4  # shoulder and elbow; a flip of the wrist changes no displacement
SQUARE = 1e-9  # cosine that still counts as a right angle
COMFORT_ROWS = 16  # of a path that are looked at for awkwardness
STRETCHED = 1e-6  # smallest singular value of the Jacobian, lengths in m, below which a posture is singular


class LoadedPath(NamedTuple):
    """Where the cutter stands at p path points for each of a turntable angles, and what pushes it there."""

    flange_from_cutter: Shaped[Float, "4 4"]
    base_from_cutter: Shaped[Float, "a p 4 4"]  # at rotation 0
    load_mm: Shaped[Float, "a p 3"]  # where the force acts, in the base
    force_n: Shaped[Float, "a p 3"]  # base axes


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """A robot in the arm frame, for the kernels here."""

    arm_from_base: Shaped[Float, "4 4"]
    wrist_in_flange_mm: Shaped[Float, " 3"]  # the wrist's centre
    axis_in_flange: Shaped[Float, " 3"]  # of joint 6
    across_in_flange: Shaped[Float, " 3"]  # of joint 5, where joint 6 is at zero
    bend: float  # of axis 6 against axis 4 about axis 5, where joint 5 is at zero
    lengths: tuple[float, ...]  # 11, mm: see `arm_kernels.posture`
    limits: tuple[float, ...]  # 15: cosine and sine of the middle, cosine of half the span, of joints 1 to 5
    springs: Shaped[Float, " 6"]  # of the joints, Nm/rad

    def traverse(self, path: LoadedPath, angles: Float, branch: int) -> tuple[Float, AnyArray]:
        """Mean displacement over a path, at every cutter rotation and turntable angle: eq. (25)'s function on its grid.

        Args:
            path: for a turntable angles and p points.
            angles: (t,) rotations of the cutter about its axis, rad.
            branch: 2 * shoulder + elbow as `inverse_kinematics` counts them, kept all along the path.

        Returns:
            Mean displacement (2, a, t), mm, of both flips of the wrist, each kept all along the path, and the worst
            that is said of one of the path's postures (2, a, t): FREE ... UNREACHABLE.
        """
        turn, shift = self.arm_from_base[:3, :3], self.arm_from_base[:3, 3]
        cutter_from_flange = inverse(path.flange_from_cutter)
        there = ArmPath(
            turn @ path.base_from_cutter[..., :3, :3],
            path.base_from_cutter[..., :3, 3] @ turn.T + shift,
            path.load_mm @ turn.T + shift,
            path.force_n @ turn.T,
            _vector(mapped(cutter_from_flange, self.wrist_in_flange_mm)),
            _vector(cutter_from_flange[:3, :3] @ self.axis_in_flange),
        )
        mean, *said = traverse_kernel(self._branch(branch), there, np.cos(angles), np.sin(angles))
        return np.stack([mean, mean]), np.stack(said)

    def joint_angles(self, base_from_flange: Float, configuration: int) -> Float:
        """Joint angles (n, 6) in (-pi, pi] at poses (n, 4, 4): rows 4 * shoulder + 2 * elbow + flip of the inverse.

        Meaningless, but finite, where the posture is unreachable or singular: forward kinematics tells.
        """
        turn, shift = self.arm_from_base[:3, :3], self.arm_from_base[:3, 3]
        rotation, at = base_from_flange[:, :3, :3], base_from_flange[:, :3, 3]
        w = (rotation @ self.wrist_in_flange_mm + at) @ turn.T + shift
        a, b = (rotation @ axis @ turn.T for axis in (self.axis_in_flange, self.across_in_flange))
        found, (branch, flip) = np.empty((len(at), 6)), divmod(configuration, 2)
        joints_kernel(self._branch(branch), self.bend, 1.0 - 2.0 * flip, w, a, b, found)
        return found

    def _branch(self, branch: int) -> Branch:
        """A branch as the kernels take it; the elbow's side turns with the sense of axis 3."""
        springs = tuple(1e3 * k for k in self.springs)  # N mm/rad
        shoulder, elbow = divmod(branch, 2)
        return Branch(self.lengths, self.limits, springs, 1.0 - 2.0 * shoulder, (2.0 * elbow - 1.0) * self.lengths[9])


def _vector(values: Float) -> Vector:
    x, y, z = map(float, values)
    return x, y, z


def fast_arm(chain: Chain, springs: Float = NO_SPRINGS) -> Arm:
    """The arm of a robot, if the kernels hold for it.

    Raises:
        InputError: axes 2 and 3 are not parallel, axis 2 is not square to axis 1, the forearm's axis not to axis 3,
            axis 5 not to axes 4 and 6 or not along axis 3 at zero. Limits of joint 6 are not looked at here:
            `traversal.followed` and `law.nodes` do.
    """
    h, o, wrist = chain.axes, chain.points_mm, spherical_wrist(chain)
    off = [h[0] @ h[1], h[3] @ h[2], np.linalg.norm(np.cross(h[4], h[2]))]
    if not (wrist.parallel_axes and wrist.square) or np.abs(off).max() > SQUARE:
        raise InputError(
            f"robot '{chain.name}'",
            "expected axes 2 and 3 parallel, axis 2 square to axis 1, axis 4 to axis 3, axis 5 to axes 4 and 6, and "
            "axis 5 along axis 3 at zero",
        )
    centre = wrist.centre_mm
    base_from_arm = pose_from(np.column_stack([np.cross(h[1], h[0]), h[1], h[0]]), o[0])
    arm_from_base = inverse(base_from_arm)
    turn, at = arm_from_base[:3, :3], arm_from_base[:3, :3] @ (np.vstack([o, centre]) - o[0]).T
    upper, fore, h4 = at[:, 2] - at[:, 1], at[:, 6] - at[:, 2], turn @ h[3]
    u, f = complex(upper[2], upper[0]), complex(fore[2], fore[0])
    g = complex(h4[2], h4[0]) * f.conjugate() / abs(f) ** 2
    bend = np.arctan2(np.cross(h[3], h[5]) @ h[4], h[3] @ h[5])
    senses = [np.sign(h[j] @ h[1]) for j in (2, 4)]
    lengths = [at[0, 1], at[2, 1], at[1, 6], u.real, u.imag, f.real, f.imag, g.real, g.imag, *senses]
    flange = chain.base_from_flange_at_zero
    limits = chain.limits[:5].copy()
    limits[4] += bend  # the wrist's bend is that between axes 4 and 6
    windows = tuple(number for low, high in limits for number in _window(low, high))
    return Arm(
        arm_from_base,
        flange[:3, :3].T @ (centre - flange[:3, 3]),
        flange[:3, :3].T @ h[5],
        flange[:3, :3].T @ h[4],
        bend,
        tuple(length for length in lengths),
        windows,
        springs,
    )


def _window(low: float, high: float) -> tuple[float, float, float]:
    """An angle q lies between the limits where cos(q - middle) is at least the third number."""
    middle, half = (low + high) / 2, (high - low) / 2
    return np.cos(middle), np.sin(middle), np.cos(half) - 1e-12 if half < np.pi else -2.0


# Any arm that has an inverse: slower, by joint angles instead of algebra. Configurations are told apart by the three
# sides of the arm (`workbench.api.arm_sides`). A spherical wrist has one solution each; so has a UR. Where an arm has
# two with the same sides (CRX, at a quarter of its poses) the one that is farther from singular counts.


@dataclass(eq=False)
class GeneralArm:
    """A robot by its chain; the solutions that were asked for last are kept."""

    chain: Chain
    springs: Float  # of the joints, Nm/rad
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
        if self._last[0] == (key := poses.tobytes()):
            return self._last[1]
        found = inverse_kinematics(self.chain, poses)
        which, row = np.nonzero(np.isfinite(found[..., 0]))
        q = found[which, row]
        label = arm_sides(self.chain, q) @ np.array([4, 2, 1])
        clear = self._smallest(q)
        order = np.argsort(clear, kind="stable")  # the clearest of a label is written last
        made = np.full((len(poses), 8, 6), np.nan)
        made[which[order], label[order]] = q[order]
        self._last = key, made
        return made

    def _smallest(self, q: Float) -> Float:
        """Smallest singular value (k,) of the Jacobian at angles (k, 6), lengths in m."""
        slope = jacobian(self.chain, q) / PER_M[:, None]
        return np.asarray(np.linalg.svd(slope, compute_uv=False)[:, -1])

    def joint_angles(self, base_from_flange: Float, configuration: int) -> Float:
        """As an `Arm`'s; NaN becomes 0."""
        return np.nan_to_num(self.solutions(base_from_flange)[:, configuration])

    def traverse(self, path: LoadedPath, angles: Float, branch: int) -> tuple[Float, AnyArray]:
        """As an `Arm`'s."""
        tables, points = path.base_from_cutter.shape[:2]
        flange = path.base_from_cutter[:, :, None] @ turn_about_z(angles) @ inverse(path.flange_from_cutter)
        tip, force = (np.repeat(part.reshape(-1, 3), len(angles), axis=0) for part in (path.load_mm, path.force_n))
        means, worst = [], []
        for q in np.moveaxis(self.solutions(flange.reshape(-1, 4, 4))[:, 2 * branch : 2 * branch + 2], 1, 0):
            there = np.isfinite(q[:, 0])
            moved, said = np.full(len(q), np.inf), np.full(len(q), UNREACHABLE)
            inside = np.isfinite(within_limits(self.chain, q[there])).all(axis=1)
            singular = self._smallest(q[there]) < STRETCHED
            said[there] = np.where(singular, SINGULAR, np.where(inside, FREE, LIMIT))
            moved[there] = np.linalg.norm(pushed(self.chain, self.springs, q[there], tip[there], force[there]), axis=1)
            means.append(moved.reshape(tables, points, -1).mean(axis=1))
            worst.append(said.reshape(tables, points, -1).max(axis=1))
        return np.stack(means), np.stack(worst).astype(np.uint8)


def arm_of(chain: Chain, springs: Float = NO_SPRINGS) -> Arm | GeneralArm:
    """The arm of a robot: for the kernels here where they hold for it, else by its inverse kinematics.

    Raises:
        InputError: the robot has no inverse.
    """
    try:
        return fast_arm(chain, springs)
    except InputError:
        inverse_kinematics(chain, chain.base_from_flange_at_zero)
        return GeneralArm(chain, springs)


@dataclass(frozen=True, slots=True, eq=False)
class Unsprung:
    """A robot whose stiffness nobody knows: its awkwardness stands where others have a displacement.

    Of all rows of a path COMFORT_ROWS are looked at, and of the grid what `arm` can reach.
    """

    arm: Arm | GeneralArm
    cell: Cell  # with its margins

    def joint_angles(self, base_from_flange: Float, configuration: int) -> Float:
        """Those of the arm."""
        return self.arm.joint_angles(base_from_flange, configuration)

    def traverse(self, path: LoadedPath, angles: Float, branch: int) -> tuple[Float, AnyArray]:
        """As an `Arm`'s, the mean over the loaded rows."""
        _, said = self.arm.traverse(path, angles, branch)
        loaded = np.flatnonzero(np.linalg.norm(path.force_n[0], axis=-1) > 0)
        weight = len(loaded) / path.base_from_cutter.shape[1]
        rows = loaded[np.unique(np.linspace(0, len(loaded) - 1, min(COMFORT_ROWS, len(loaded))).astype(int))]
        rows = rows if len(rows) else np.zeros(1, int)  # nothing pushes: the joints' limits hold all the same
        mean, tool = np.full(said.shape, np.inf), turn_about_z(angles) @ inverse(path.flange_from_cutter)
        for flip, table in np.ndindex(said.shape[:2]):
            free = np.flatnonzero(said[flip, table] == FREE)
            if not len(free):
                continue
            flange = (path.base_from_cutter[table, rows, None] @ tool[free]).reshape(-1, 4, 4)
            q = within_limits(self.cell.chain, self.joint_angles(flange, 2 * branch + flip))
            inside = np.isfinite(q).all(axis=1)
            cost = np.full(len(q), np.inf)
            cost[inside] = awkwardness(self.cell, q[inside])
            found = cost.reshape(len(rows), -1).mean(axis=0)
            mean[flip, table, free] = np.where(np.isfinite(found), weight * found, np.inf)
            said[flip, table, free[~np.isfinite(found)]] = LIMIT
        return mean, said


AnyArm = Arm | GeneralArm | Unsprung


def awkwardness(cell: Cell, joints: Shaped[Float, "n 6"]) -> Float:
    """How near postures (n, 6) are to singular ones and to limits (n,): 1 at best, infinite there.

    The Jacobian's condition number of Frobenius norms (Angeles 1992), times the mean over the joints of
    range^2 / (4 (q - low) (high - q)) (Chan and Dubey 1995).
    """
    chain = cell.chain
    tip = (forward_kinematics(chain, joints) @ cell.flange_from_cutter)[:, :3, 3]
    _, condition, _ = dexterity(chain, joints, tip, np.zeros(6), np.inf)
    low, high = chain.limits.T
    with np.errstate(divide="ignore"):
        room = (high - low) ** 2 / (4 * np.maximum(joints - low, 0.0) * np.maximum(high - joints, 0.0))
    return np.asarray(condition / 6 * room.mean(axis=1))
