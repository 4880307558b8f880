"""The measurement model: what a profile of the sphere shows, given the hand-eye pose, and how uncertain that is.

With (A, b) the flange's pose, (R, t) the hand-eye pose and C the sphere's centre in the base, that centre lies in the
profiler frame at c = R^T (A^T (C - b) - t). The laser plane, y = 0, then cuts the sphere of radius R_s in a circle
about (c_x, c_z) of squared radius w = R_s^2 - c_y^2. Predicting w needs no square root and no sign of c_y. An
uncertain c_y, of variance V, lowers the expected w by V.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from workbench.api import DEG, Float, Int, rotation_from_vector
from workbench.plugins.calibration.observations import Observations

SIZE = 10  # unknowns: t, w (R_true = exp(w) R), C, R_s; the clock offset is the eleventh
FIELD_MM = (16.0, 20.0)  # half width and half height of the field of view that errors are judged over


@dataclass(frozen=True)
class Noise:
    """What is known before: the robot's repeatability and the sphere's radius."""

    pose_mm: float = 0.07  # standard deviation of a flange position, each axis
    pose_deg: float = 0.01  # of its orientation, each axis
    radius_mm: float = 5.0
    radius_u_mm: float = 0.02


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


def whitened(linear: Linear, seen: Observations, noise: Noise, shared: Float | None = None) -> tuple[Float, Float]:
    """Residuals (3k,) and Jacobian (3k, P) in units of the noise, correlated pose errors included.

    `shared` (k, k): covariance in mm^2 of a further position error, each axis of the base, that postures share.
    """
    k, p = len(linear.residual), linear.jacobian.shape[2]
    both = np.concatenate([linear.jacobian, linear.residual[..., None]], axis=-1)
    if shared is not None:
        groups = [(np.arange(k)[None], _joint_correlation(seen)[None])]
    else:
        groups = _batched(seen)
    out = []
    for rows, correlation in groups:
        covariance = _group_covariance(linear, noise, rows, correlation, shared)
        size = 3 * rows.shape[1]
        out.append(
            np.linalg.solve(np.linalg.cholesky(covariance), both[rows].reshape(-1, size, p + 1)).reshape(-1, p + 1)
        )
    stacked = np.concatenate(out)
    return stacked[:, -1], stacked[:, :-1]


def _group_covariance(linear: Linear, noise: Noise, rows: Int, correlation: Float, shared: Float | None) -> Float:
    """Covariances (g, 3m, 3m) of g groups of m rows each."""
    g, m = rows.shape
    if m == 1 and shared is None:
        return np.asarray(linear.covariance[rows[:, 0]])
    H = linear.by_pose[rows]  # (g, m, 3, 6)
    scatter = H * np.repeat([noise.pose_mm, noise.pose_deg * DEG], 3)
    own = np.einsum("gaip,gajp->gaij", scatter, scatter)
    between = np.einsum("gab,gaip,gbjp->gaibj", correlation, scatter, scatter)
    if shared is not None:
        between += np.einsum("ab,gaip,gbjp->gaibj", shared, H[..., :3], H[..., :3])
    index = np.arange(m)
    between[:, index, :, index, :] += np.swapaxes(linear.covariance[rows] - own, 0, 1)
    return np.asarray(between.reshape(g, 3 * m, 3 * m))


def _batched(seen: Observations) -> list[tuple[Int, Float]]:
    """Groups of equal size together: rows (g, m), correlations (g, m, m)."""
    by_size: dict[int, list[tuple[Int, Float]]] = {}
    for rows, correlation in seen.groups:
        by_size.setdefault(len(rows), []).append((rows, correlation))
    return [(np.stack([r for r, _ in some]), np.stack([c for _, c in some])) for some in by_size.values()]


def dense_covariance(linear: Linear, seen: Observations, noise: Noise, shared: Float) -> Float:
    """Covariance (3k, 3k) of all observations together."""
    rows = np.arange(len(seen))[None]
    return np.asarray(_group_covariance(linear, noise, rows, _joint_correlation(seen)[None], shared)[0])


def _joint_correlation(seen: Observations) -> Float:
    out = np.zeros((len(seen), len(seen)))
    for rows, correlation in seen.groups:
        out[np.ix_(rows, rows)] = correlation
    return out


def information(estimate: Estimate, seen: Observations, noise: Noise, with_offset: bool = False,
                shared: Float | None = None) -> Float:  # fmt: skip
    """Fisher information (P, P) of the unknowns, the prior of the radius included: its inverse is the bound."""
    linear = linearise(estimate, seen, noise, with_offset)
    J = whitened(linear, seen, noise, shared)[1]
    matrix = J.T @ J
    matrix[9, 9] += noise.radius_u_mm**-2
    return np.asarray(matrix)


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
