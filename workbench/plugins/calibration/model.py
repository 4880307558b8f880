"""The measurement model: what a profile of the sphere shows, given the hand-eye pose, and how uncertain that is.

With (A, b) the flange's pose, (R, t) the hand-eye pose and C the sphere's centre in the base, that centre lies in the
profiler frame at c = R^T (A^T (C - b) - t). The laser plane, y = 0, then cuts the sphere of radius R_s in a circle
about (c_x, c_z) of squared radius w = R_s^2 - c_y^2. Predicting w needs no square root and no sign of c_y. An
uncertain c_y, of variance V, lowers the expected w by V.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
import scipy

from workbench.api import DEG, Bool, Float, Shaped, rotation_from_vector
from workbench.plugins.calibration.observations import Group, Observations

LEAST_MM = (16.0, 20.0)  # half sides of a field of view: the paper's sensor; a sphere alone may show less of one
OUTERMOST = 0.005  # share of a recording's points, on each side, that may be stray
SIZE = 10  # unknowns: t, w (R_true = exp(w) R), C, R_s; the clock offset is the eleventh


@dataclass(frozen=True)
class Noise:
    """What is known before: the robot's repeatability and the sphere's radius."""

    pose_mm: float = 0.07  # standard deviation of a flange position, each axis
    pose_deg: float = 0.01  # of its orientation, each axis
    radius_mm: float = 5.0
    radius_u_mm: float = 0.05
    common: float = 0.0  # share of the poses' variance that all frames of a scan have in common

    @property
    def spread(self) -> Float:
        """Standard deviations (6,) of a pose: position mm, orientation rad."""
        return np.repeat([self.pose_mm, self.pose_deg * DEG], 3)


@dataclass(frozen=True)
class Estimate:
    """A point in the space of unknowns."""

    rotation: Shaped[Float, "3 3"]  # flange from profiler
    translation_mm: Shaped[Float, " 3"]
    center_mm: Shaped[Float, " 3"]  # of the sphere, in the base
    radius_mm: float
    offset_s: float = 0.0

    def moved(self, step: Float) -> Estimate:
        """After a step (10,) or (11,) in the unknowns."""
        return replace(
            self,
            translation_mm=self.translation_mm + step[:3],
            rotation=rotation_from_vector(step[3:6]) @ self.rotation,
            center_mm=self.center_mm + step[6:9],
            radius_mm=self.radius_mm + float(step[9]),
            offset_s=self.offset_s + (float(step[10]) if len(step) > SIZE else 0.0),
        )


@dataclass(frozen=True)
class Linear:
    """The model about an estimate, k observations, P unknowns."""

    centre: Shaped[Float, "k 3"]  # of the sphere in the profiler frame
    residual: Shaped[Float, "k 3"]  # measured minus predicted x_c, z_c, w
    jacobian: Shaped[Float, "k 3 P"]  # of the prediction
    covariance: Shaped[Float, "k 3 3"]  # C_fit + H S H^T of each observation by itself
    by_pose: Shaped[Float, "k 3 6"]  # H: derivative by the errors of position (base) and orientation (flange)
    bent: Shaped[Float, " k"]  # standard deviation of w by the square of the error of c_y

    def subset(self, keep: Bool) -> Linear:
        """Of the observations marked in `keep` (k,)."""
        return Linear(*(getattr(self, f.name)[keep] for f in fields(self)))


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
    scatter = by_pose * noise.spread
    y_variance = np.sum(scatter[:, 1] ** 2, axis=-1) * (noise.common + (1 - noise.common) * seen.evened)
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
    bent = np.sqrt(2) * y_variance
    covariance[:, 2, 2] += bent**2
    return Linear(centre, seen.circle - predicted, jacobian, covariance, to_circle @ by_pose, bent)


@dataclass(frozen=True)
class Normal:
    """Weighted least squares in normal form: information (P, P), right-hand side (P,), sum of weighted squares."""

    matrix: Float
    side: Float
    chi2: float


def normal_equations(linear: Linear, seen: Observations, noise: Noise, radius_mm: float) -> Normal:
    """Normal equations of a Gauss-Newton step, pose errors that frames share and the prior of the radius included."""
    both = np.concatenate([linear.jacobian, linear.residual[..., None]], axis=-1)
    own, at_rest = both[seen.still], linear.covariance[seen.still]
    joined = np.tensordot(own, np.linalg.solve(at_rest, own), axes=([0, 1], [0, 1]))
    for scan in seen.scans:
        joined = joined + _scan_equations(linear, both, scan, noise)
    pull, off = noise.radius_u_mm**-2, noise.radius_mm - radius_mm
    joined[SIZE - 1, SIZE - 1] += pull
    joined[SIZE - 1, -1] += pull * off
    return Normal(joined[:-1, :-1], joined[:-1, -1], float(joined[-1, -1] + pull * off**2))


def _scan_equations(linear: Linear, both: Float, scan: Group, noise: Noise) -> Float:
    """[J r]^T S^-1 [J r] (P + 1, P + 1) of a scan's m frames, S = D + U U^T + V V^T (Woodbury, twice).

    D are the circles' covariances; U carries the errors that each recorded pose has of its own, in standard deviations,
    to the frames, V the errors that all of them share.
    """
    spread = linear.by_pose[scan.rows] * noise.spread
    bent = np.zeros((len(spread), 3, 1))
    scale = noise.common / (noise.common + (1 - noise.common) * (scan.fraction**2 + (1 - scan.fraction) ** 2))
    bent[:, 2, 0] = scale * linear.bent[scan.rows]  # an error in common is so squared too
    alone = linear.covariance[scan.rows] - spread @ np.swapaxes(spread, 1, 2) - bent @ np.swapaxes(bent, 1, 2)
    own, shared = spread * np.sqrt(1 - noise.common), spread * np.sqrt(noise.common)
    columns = np.concatenate([both[scan.rows], shared, bent], axis=-1)
    joined, _ = within_scan(columns, alone, own, scan)
    return with_shared(joined, shared.shape[2] + 1)[0]


def within_scan(columns: Float, alone: Float, own: Float, scan: Group) -> tuple[Float, float]:
    """C^T S^-1 C (c, c) of columns C (m, 3, c) over a scan's m frames and log det S, S = D + U U^T (Woodbury).

    alone (m, 3, 3): D; own (m, 3, 6): what a recorded pose's own error does to a frame, in standard deviations. A frame
    rests on two poses, so I + U^T D^-1 U is block-tridiagonal: the cost grows with the frames, not their cube.
    """
    inverse = np.linalg.inv(alone)
    weighted = inverse @ columns
    joined = np.tensordot(columns, weighted, axes=([0, 1], [0, 1]))
    square = np.swapaxes(own, 1, 2) @ inverse @ own  # (m, 6, 6)
    side = np.swapaxes(own, 1, 2) @ weighted  # (m, 6, c)
    diagonal, below = np.zeros((scan.nodes, 6, 6)), np.zeros((scan.nodes, 6, 6))
    at_nodes = np.zeros((scan.nodes, 6, columns.shape[2]))
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
    flat = at_nodes.reshape(-1, columns.shape[2])
    factor = scipy.linalg.cholesky_banded(band.reshape(12, -1), lower=True)
    joined = joined - flat.T @ scipy.linalg.cho_solve_banded((factor, True), flat)
    return np.asarray(joined), float(2 * np.log(factor[0]).sum() - np.linalg.slogdet(inverse)[1].sum())


def with_shared(joined: Float, more: int) -> tuple[Float, Float]:
    """C^T S^-1 C (..., c, c) with the last `more` columns V taken into S (S + V V^T), and what log det S grows by."""
    in_common = np.eye(more) + joined[..., -more:, -more:]
    rest = joined[..., :-more, :-more] - joined[..., :-more, -more:] @ np.linalg.solve(
        in_common, joined[..., -more:, :-more]
    )
    return np.asarray(rest), np.asarray(np.linalg.slogdet(in_common)[1])


def information(estimate: Estimate, seen: Observations, noise: Noise, with_offset: bool = False) -> Float:
    """Fisher information (P, P) of the unknowns, the prior of the radius included: its inverse is the bound."""
    linear = linearise(estimate, seen, noise, with_offset)
    return normal_equations(linear, seen, noise, estimate.radius_mm).matrix


@dataclass(frozen=True)
class View:
    """The field of view that errors are judged over: a rectangle in the laser plane, in the profiler frame."""

    middle_mm: tuple[float, float]  # x, z
    half_mm: tuple[float, float]  # half width, half height

    @property
    def lever_mm(self) -> float:
        """RMS distance of the field's points from its middle."""
        return float(np.hypot(*self.half_mm) / np.sqrt(3))

    def axes(self, rotation: Float) -> tuple[Float, Float]:
        """Middle (3,), in the flange's axes from the profiler's origin, and half sides (2, 3) likewise."""
        x, z = rotation[:, 0], rotation[:, 2]
        return self.middle_mm[0] * x + self.middle_mm[1] * z, np.stack([self.half_mm[0] * x, self.half_mm[1] * z])


def view_of(circle: Float) -> View:
    """The field in which circles (k, 3) of x_c, z_c, w lie."""
    return _box(*_span(circle))


def view_of_points(x_mm: Float, z_mm: Float, circle: Float) -> View:
    """The field in which a recording's points lie, all but the outermost of each side, and its circles."""
    good = np.isfinite(x_mm) & np.isfinite(z_mm)
    low, high = np.quantile(np.stack([x_mm[good], z_mm[good]]), [OUTERMOST, 1 - OUTERMOST], axis=1)
    first, last = _span(circle)
    return _box(np.minimum(low, first), np.maximum(high, last))


def _span(circle: Float) -> tuple[Float, Float]:
    r = np.sqrt(np.maximum(circle[:, 2:], 0.0))
    return (circle[:, :2] - r).min(axis=0), (circle[:, :2] + r).max(axis=0)


def _box(low: Float, high: Float) -> View:
    """Never less than `LEAST_MM`: where the sphere was shown at one place, the answer must still hold elsewhere."""
    (x, z), (a, b) = (low + high) / 2, np.maximum((high - low) / 2, LEAST_MM)
    return View((float(x), float(z)), (float(a), float(b)))


def volume_weight(rotation: Float, view: View) -> Float:
    """W (6, 6) with volume_u^2 = trace(W covariance): the mean square error of a point over the field."""
    middle, sides = view.axes(rotation)
    at_middle = np.concatenate([np.eye(3), -cross_matrix(middle)], axis=1)
    weight = at_middle.T @ at_middle
    for side in sides:
        weight[3:, 3:] += cross_matrix(side).T @ cross_matrix(side) / 3
    return np.asarray(weight)


def place_u(covariance: Float, rotation: Float, view: View) -> float:
    """Predicted RMS error (mm) over the field along one axis, the least certain, from the covariance (6, 6)."""
    middle, sides = view.axes(rotation)
    at_middle = np.concatenate([np.eye(3), -cross_matrix(middle)], axis=1)
    spread = at_middle @ covariance @ at_middle.T
    for side in sides:
        spread = spread + cross_matrix(side) @ covariance[3:, 3:] @ cross_matrix(side).T / 3
    return float(np.sqrt(np.linalg.eigvalsh(spread)[-1]))


def volume_u(covariance: Float, rotation: Float, view: View) -> float:
    """Predicted RMS error (mm) of a point over the field, from the hand-eye covariance (6, 6)."""
    return float(np.sqrt(np.trace(volume_weight(rotation, view) @ covariance)))
