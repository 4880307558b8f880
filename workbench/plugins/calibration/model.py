"""The measurement model: what a profile of the sphere shows, given the hand-eye pose, and how uncertain that is.

With (A, b) the flange's pose, (R, t) the hand-eye pose and C the sphere's centre in the base, that centre lies in the
profiler frame at c = R^T (A^T (C - b) - t). The laser plane, y = 0, then cuts the sphere of radius R_s in a circle
about (c_x, c_z) of squared radius w = R_s^2 - c_y^2. Predicting w needs no square root and no sign of c_y. An
uncertain c_y, of variance V, lowers the expected w by V.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import solveh_banded

from workbench.api import DEG, Float, rotation_from_vector
from workbench.plugins.calibration.observations import Group, Observations

SIZE = 10  # unknowns: t, w (R_true = exp(w) R), C, R_s; the clock offset is the eleventh
FIELD_MM = (16.0, 20.0)  # half width and half height of the field of view that errors are judged over


@dataclass(frozen=True)
class Noise:
    """What is known before: the robot's repeatability and the sphere's radius."""

    pose_mm: float = 0.07  # standard deviation of a flange position, each axis
    pose_deg: float = 0.01  # of its orientation, each axis
    radius_mm: float = 5.0
    radius_u_mm: float = 0.05


@dataclass(frozen=True)
class Estimate:
    """A point in the space of unknowns."""

    rotation: Float  # (3, 3) flange from profiler
    translation_mm: Float  # (3,)
    center_mm: Float  # (3,) of the sphere, in the base
    radius_mm: float
    offset_s: float = 0.0

    def moved(self, step: Float) -> Estimate:
        """After a step (10,) or (11,) in the unknowns."""
        return replace(
            self, translation_mm=self.translation_mm + step[:3],
            rotation=rotation_from_vector(step[3:6]) @ self.rotation, center_mm=self.center_mm + step[6:9],
            radius_mm=self.radius_mm + float(step[9]),
            offset_s=self.offset_s + (float(step[10]) if len(step) > SIZE else 0.0),
        )  # fmt: skip


@dataclass(frozen=True)
class Linear:
    """The model about an estimate, k observations, P unknowns."""

    centre: Float  # (k, 3) of the sphere in the profiler frame
    residual: Float  # (k, 3) measured minus predicted x_c, z_c, w
    jacobian: Float  # (k, 3, P) of the prediction
    covariance: Float  # (k, 3, 3) C_fit + H S H^T of each observation by itself
    by_pose: Float  # (k, 3, 6) H: derivative by the errors of position (base) and orientation (flange)


def cross_matrix(v: Float) -> Float:
    """[v]x (..., 3, 3) with [v]x u = v x u."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return np.asarray(out - np.swapaxes(out, -1, -2))


def linearise(estimate: Estimate, seen: Observations, noise: Noise, with_offset: bool = False) -> Linear:
    """Prediction, its derivatives and its noise at an estimate."""
    A, b = seen.base_from_flange[:, :3, :3], seen.base_from_flange[:, :3, 3]
    R_t = estimate.rotation.T
    A_t = np.swapaxes(A, -1, -2)
    in_flange = (A_t @ (estimate.center_mm - b)[..., None])[..., 0]
    lever = in_flange - estimate.translation_mm
    centre = lever @ estimate.rotation
    by_center = R_t @ A_t
    by_pose = np.concatenate([-by_center, R_t @ cross_matrix(in_flange)], axis=-1)  # of the centre, (k, 3, 6)
    scatter = by_pose * np.repeat([noise.pose_mm, noise.pose_deg * DEG], 3)
    y_variance = np.sum(scatter[:, 1] ** 2, axis=-1)
    predicted = np.stack([centre[:, 0], centre[:, 2], estimate.radius_mm**2 - centre[:, 1] ** 2 - y_variance], axis=1)
    to_circle = np.zeros((len(centre), 3, 3))  # from the centre to (x_c, z_c, w)
    to_circle[:, 0, 0] = to_circle[:, 1, 2] = 1.0
    to_circle[:, 2, 1] = -2 * centre[:, 1]
    columns = [np.broadcast_to(-R_t, A.shape), R_t @ cross_matrix(lever), by_center]
    if with_offset:  # profile time - robot time grows: the pose that belongs to a frame is an earlier one
        moving = -(R_t @ (cross_matrix(in_flange) @ seen.velocity[:, 3:, None] - seen.velocity[:, :3, None]))
        columns.append(moving)
    jacobian = to_circle @ np.concatenate(columns, axis=-1)
    by_radius = np.zeros((len(centre), 3, 1))
    by_radius[:, 2] = 2 * estimate.radius_mm
    jacobian = np.concatenate([jacobian[..., :9], by_radius, jacobian[..., 9:]], axis=-1)
    spread = to_circle @ scatter
    covariance = seen.covariance + spread @ np.swapaxes(spread, -1, -2)
    covariance[:, 2, 2] += 2 * y_variance**2
    return Linear(centre, seen.circle - predicted, jacobian, covariance, to_circle @ by_pose)


@dataclass(frozen=True)
class Normal:
    """Weighted least squares in normal form: information (P, P), right-hand side (P,), sum of weighted squares."""

    matrix: Float
    side: Float
    chi2: float


def normal_equations(linear: Linear, seen: Observations, noise: Noise, radius_mm: float) -> Normal:
    """Normal equations of a Gauss-Newton step, pose errors that frames share and the prior of the radius included."""
    both = np.concatenate([linear.jacobian, linear.residual[..., None]], axis=-1)
    own = both[seen.still]
    joined = np.tensordot(own, np.linalg.solve(linear.covariance[seen.still], own), axes=([0, 1], [0, 1]))
    for scan in seen.scans:
        joined = joined + _scan_equations(linear, both, scan, noise)
    pull, off = noise.radius_u_mm**-2, noise.radius_mm - radius_mm
    joined[SIZE - 1, SIZE - 1] += pull
    joined[SIZE - 1, -1] += pull * off
    return Normal(joined[:-1, :-1], joined[:-1, -1], float(joined[-1, -1] + pull * off**2))


def _scan_equations(linear: Linear, both: Float, scan: Group, noise: Noise) -> Float:
    """[J r]^T S^-1 [J r] (P + 1, P + 1) of a scan's m frames, S = D + U U^T by Woodbury's identity.

    D are the circles' covariances; U carries the errors of the recorded poses, in standard deviations, to the frames.
    A frame rests on two poses, so I + U^T D^-1 U is block-tridiagonal: the cost grows with the frames, not their cube.
    """
    spread = linear.by_pose[scan.rows] * np.repeat([noise.pose_mm, noise.pose_deg * DEG], 3)
    inverse = np.linalg.inv(linear.covariance[scan.rows] - spread @ np.swapaxes(spread, 1, 2))
    weighted = inverse @ both[scan.rows]
    joined = np.tensordot(both[scan.rows], weighted, axes=([0, 1], [0, 1]))
    square = np.swapaxes(spread, 1, 2) @ inverse @ spread  # (m, 6, 6)
    side = np.swapaxes(spread, 1, 2) @ weighted  # (m, 6, P + 1)
    diagonal, below = np.zeros((scan.nodes, 6, 6)), np.zeros((scan.nodes, 6, 6))
    at_nodes = np.zeros((scan.nodes, 6, both.shape[2]))
    after, before = scan.fraction[:, None, None], 1 - scan.fraction[:, None, None]
    np.add.at(diagonal, scan.node, before**2 * square)
    np.add.at(diagonal, scan.node + 1, after**2 * square)
    np.add.at(below, scan.node, before * after * square)
    np.add.at(at_nodes, scan.node, before * side)
    np.add.at(at_nodes, scan.node + 1, after * side)
    band = np.zeros((12, scan.nodes, 6))  # LAPACK's lower band storage
    band[0] = 1.0
    for row in range(6):
        for column in range(6):
            if row >= column:
                band[row - column, :, column] += diagonal[:, row, column]
            band[6 + row - column, :-1, column] += below[:-1, row, column]
    flat = at_nodes.reshape(-1, both.shape[2])
    return np.asarray(joined - flat.T @ solveh_banded(band.reshape(12, -1), flat, lower=True))


def information(estimate: Estimate, seen: Observations, noise: Noise, with_offset: bool = False) -> Float:
    """Fisher information (P, P) of the unknowns, the prior of the radius included: its inverse is the bound."""
    linear = linearise(estimate, seen, noise, with_offset)
    return normal_equations(linear, seen, noise, estimate.radius_mm).matrix


def field_of_view(estimate: Estimate, centre: Float) -> tuple[Float, Float]:
    """Middle of the field, in the flange's axes from the profiler's origin, and its half sides (2, 3) likewise.

    The field lies in the laser plane, about the mean of the sphere centres (k, 3) in the profiler frame.
    """
    middle = estimate.rotation @ (centre.mean(axis=0) * (1.0, 0.0, 1.0))
    return middle, np.stack([FIELD_MM[0] * estimate.rotation[:, 0], FIELD_MM[1] * estimate.rotation[:, 2]])


def volume_u(covariance: Float, middle: Float, sides: Float) -> float:
    """Predicted RMS error (mm) of a point over the field, from the hand-eye covariance (6, 6)."""

    def mean_square(lever: Float, with_translation: bool) -> float:
        by = np.concatenate([np.eye(3) * with_translation, -cross_matrix(lever)], axis=1)
        return float(np.trace(by @ covariance @ by.T))

    return float(np.sqrt(mean_square(middle, True) + sum(mean_square(s, False) for s in sides) / 3))
