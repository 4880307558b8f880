"""Where the first three joints put the wrist's centre, solved backwards for axes that stand in any way to each other.

After Pieper (1968): joint 2 changes neither the height of the wrist's centre along axis 2 nor its distance from a
point of it. Turned back by joint 1 the centre must have both as it has them turned on by joint 3: two equations, linear
in the cosines and sines of joints 1 and 3 (`workbench.robot.two_angles`). Newton's steps on the position itself take
away what rounding left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.robot.chain import Chain
from workbench.robot.kinematics import joint_axes, motions
from workbench.robot.two_angles import two_angles
from workbench.units import Float, Shaped

REACHED = 1e-12  # what may be missing of a position, in units of the arm's size
STEPS = 3  # of Newton's: each squares what is missing
GENERIC = np.array([[0.3, 0.7, 1.1], [-0.9, 0.4, -1.7], [1.9, -1.2, 2.6], [0.1, 2.2, 0.5]])  # no angle is special


@dataclass(frozen=True, slots=True, eq=False)
class Circle:
    """Points going round an axis, as seen from a point of axis 2: `middle + radius (cos(angle) e + sin(angle) f)`."""

    foot: Shaped[Float, " 3"]  # a point on the axis
    middle: Shaped[Float, "n 3"]
    radius: Shaped[Float, " n"]
    e: Shaped[Float, " 3"]
    f: Shaped[Float, " 3"]
    start: Shaped[Float, " n"]  # the angle at which each stands

    def at(self, angle: Float) -> Float:
        """Points (n, k, 3) at angles (n, k)."""
        c, s = (self.radius[:, None] * part for part in (np.cos(angle), np.sin(angle)))
        return self.middle[:, None] + c[..., None] * self.e + s[..., None] * self.f

    def seen(self, axis: Float) -> tuple[Float, Float]:
        """Height along `axis` and half the squared distance: (2, 2) times radius (cos, sin), and constants (n, 2)."""
        square = (self.middle**2).sum(axis=1) + self.radius**2
        linear = np.array([[row @ self.e, row @ self.f] for row in (axis, self.foot)])
        return linear, np.column_stack([self.middle @ axis, square / 2])


def general_position(chain: Chain, centre_mm: Float, wanted_mm: Float) -> Float:
    """Angles (n, 4, 3) of joints 1 to 3 that bring the wrist's centre to `wanted_mm` (n, 3); NaN: no such branch.

    `centre_mm` (3,) with all joints at zero, both in the base. Joint 1 is 0 where the wrist's centre stands on axis 1.
    Branches come in no particular order, and coincide where the arm is singular.
    """
    h, size = chain.axes, arm_size_mm(chain, centre_mm)
    feet = (chain.points_mm[:3] - chain.points_mm[1]) / size
    back = _circle((wanted_mm - chain.points_mm[1]) / size, feet[0], h[0])
    on = _circle(np.broadcast_to((centre_mm - chain.points_mm[1]) / size, (len(wanted_mm), 3)), feet[2], h[2])
    (a, at_a), (b, at_b) = back.seen(h[1]), on.seen(h[1])
    alpha, beta = two_angles(a, back.radius, b, on.radius, at_b - at_a)
    alpha = np.where((back.radius < REACHED)[:, None] & np.isfinite(alpha), back.start[:, None], alpha)
    q2 = _turn(h[1], on.at(beta), back.at(alpha))
    q = np.stack([back.start[:, None] - alpha, q2, beta - on.start[:, None]], axis=-1)
    return _polished(chain, centre_mm, wanted_mm, q, size)


def arm_size_mm(chain: Chain, centre_mm: Float) -> float:
    """A length in which the arm's reach is about 1: from point to point of the first three axes to the wrist."""
    points = np.vstack([chain.points_mm[:3], centre_mm])
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())


def moves_everywhere(chain: Chain, centre_mm: Float) -> bool:
    """Whether joints 1 to 3 can move the wrist's centre in all directions, in some posture."""
    _, _, slope = _centre(chain, centre_mm, GENERIC, arm_size_mm(chain, centre_mm))
    return bool(np.abs(np.linalg.det(slope)).max() > 1e-9)


def _circle(points: Float, foot: Float, axis: Float) -> Circle:
    """The circles of points (n, 3) about the axis through `foot`."""
    e = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    e /= np.linalg.norm(e)
    f = np.cross(axis, e)
    arm = points - foot
    x, y = arm @ e, arm @ f
    return Circle(foot, foot + (arm @ axis)[:, None] * axis, np.hypot(x, y), e, f, np.arctan2(y, x))


def _turn(axis: Float, start: Float, end: Float) -> Float:
    """Angles about `axis` that turn `start` to `end`, (..., 3)."""
    across = np.cross(start, end) @ axis
    return np.asarray(np.arctan2(across, (start * end).sum(axis=-1) - (start @ axis) * (end @ axis)))


def _centre(chain: Chain, centre_mm: Float, q: Float, size: float) -> tuple[Float, Float, Float]:
    """Six joint angles (..., 6), the wrist's centre (..., 3) there and its slopes (..., 3, 3), in units of `size`."""
    six = np.concatenate([q, np.zeros_like(q)], axis=-1)
    moved = motions(chain, six)[..., 3, :, :]
    at = moved[..., :3, :3] @ centre_mm + moved[..., :3, 3]
    axes, points = joint_axes(chain, six)
    slope = np.cross(axes[..., :3, :], at[..., None, :] - points[..., :3, :])
    return six, at / size, np.swapaxes(slope, -1, -2) / size


def _polished(chain: Chain, centre_mm: Float, wanted_mm: Float, q: Float, size: float) -> Float:
    """Newton's steps from `q` (n, k, 3), damped where the arm is singular; what does not arrive is no branch."""
    best, missing = np.nan_to_num(q), np.full(q.shape[:-1], np.inf)
    here = best
    for _ in range(STEPS + 1):
        _, at, slope = _centre(chain, centre_mm, here, size)
        miss = wanted_mm[:, None] / size - at
        now = np.linalg.norm(miss, axis=-1)
        best = np.where((now < missing)[..., None], here, best)
        missing = np.minimum(now, missing)
        square = np.swapaxes(slope, -1, -2) @ slope + 1e-14 * np.eye(3)
        here = here + np.linalg.solve(square, np.swapaxes(slope, -1, -2) @ miss[..., None])[..., 0]
    there = np.isfinite(q).all(axis=-1) & (missing < REACHED)
    return np.where(there[..., None], best, np.nan)
