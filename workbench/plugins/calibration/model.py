"""The measurement model: what a profile of the sphere shows, given the hand-eye pose, and how uncertain that is.

With (A, b) the flange's pose, (R, t) the hand-eye pose and C the sphere's centre in the base, that centre lies in the
profiler frame at c = R^T (A^T (C - b) - t). The laser plane, y = 0, then cuts the sphere of radius R_s in a circle
about (c_x, c_z) of squared radius w = R_s^2 - c_y^2. Predicting w needs no square root and no sign of c_y. An
uncertain c_y, of variance V, lowers the expected w by V.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from workbench.api import DEG, AnyArray, Float, Shaped, estimator, mapped, rotation_from_vector, vector_from_rotation
from workbench.plugins.calibration.observations import Flange, Observations, Timed, sharing

LEAST_MM = (16.0, 20.0)  # half sides of a field of view: the paper's sensor; a sphere alone may show less of one
OUTERMOST = 0.005  # share of a recording's points, on each side, that may be stray
MOST_TURN = 0.5  # rad, of a step
SIZE = 10  # unknowns: t, w (R_true = exp(w) R), C, R_s; then the scales of the profiler, then its clock's offset
ROUNDS = 5  # of weights, where places are sought
BLIND, BLIND_STEPS = 1.0, 8  # variance of w where it must tell nothing, over that of any w
CLEAR = 0.2  # shift along y, in radii, to another start
POSE = 6  # of these, the first, are the hand-eye pose's
FREE = 0.1  # standard uncertainty, a share, of a radius or scale that the data contradict
HELD = 1e-6  # of a scale that is not estimated


@dataclass(frozen=True)
class Noise:
    """What is known before: the robot's repeatability, the sphere's radius, the scales of the profiler."""

    pose_mm: float = 0.07  # standard deviation of a flange position, each axis
    pose_deg: float = 0.01  # of its orientation, each axis
    radius_mm: float = 5.0
    radius_u_mm: float = 0.05
    common: float = 0.0  # share of the poses' variance that all frames of a scan have in common
    scale_u: tuple[float, float] = (HELD, HELD)  # of the profiler's x and z, as shares

    def times(self, factor: float) -> Noise:
        """The robot's larger by a factor."""
        return replace(self, pose_mm=factor * self.pose_mm, pose_deg=factor * self.pose_deg)

    @property
    def prior_u(self) -> Float:
        """Standard uncertainties (3,) of the radius, mm, and of the scales of x and z."""
        return np.array([self.radius_u_mm, *self.scale_u])

    def freed(self, which: int) -> Noise:
        """With one of `prior_u` so large that the data alone tell it."""
        if which == 0:
            return replace(self, radius_u_mm=max(self.radius_u_mm, FREE * self.radius_mm))
        x, z = self.scale_u
        return replace(self, scale_u=(FREE, z) if which == 1 else (x, FREE))

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
    scale: Shaped[Float, " s"] = field(default_factory=lambda: np.zeros(0))  # errors of x and z; none: certain

    def moved(self, step: Float) -> Estimate:
        """After a step (10 + s,) in the unknowns, or (11 + s,) with the offset."""
        last = SIZE + len(self.scale)
        return replace(
            self,
            translation_mm=self.translation_mm + step[:3],
            rotation=rotation_from_vector(step[3:6]) @ self.rotation,
            center_mm=self.center_mm + step[6:9],
            radius_mm=self.radius_mm + step[9],
            offset_s=self.offset_s + (step[last] if len(step) > last else 0.0),
            scale=self.scale + step[SIZE:last],
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


CROSSED = np.cross(np.eye(3), np.eye(3)[:, None]).reshape(3, 9)  # [e]x of each axis e, row by row


def cross_matrix(v: Float) -> Float:
    """[v]x (..., 3, 3) with [v]x u = v x u."""
    return np.asarray((v @ CROSSED).reshape(*v.shape, 3))


def carried(rotation: Float, place: Float) -> Float:
    """What small errors (translation, rotation) of a frame are at a place in it (..., 3), by other axes: 6 x 6."""
    out = np.zeros((*rotation.shape[:-2], 6, 6))
    out[..., :3, :3] = out[..., 3:, 3:] = rotation
    out[..., :3, 3:] = -rotation @ cross_matrix(place)
    return out


def linearise(estimate: Estimate, seen: Observations, noise: Noise, with_offset: bool = False) -> Linear:
    """Prediction, its derivatives and its noise at an estimate."""
    flange = seen.here
    A, b = flange.base_from_flange[:, :3, :3], flange.base_from_flange[:, :3, 3]
    R_t = estimate.rotation.T
    A_t = A.mT
    in_flange = (A_t @ (estimate.center_mm - b)[..., None])[..., 0]
    lever = in_flange - estimate.translation_mm
    centre = lever @ estimate.rotation
    by_center = R_t @ A_t
    by_pose = np.concatenate([-by_center, R_t @ cross_matrix(in_flange)], axis=-1)  # of the centre, (k, 3, 6)
    scatter = by_pose * noise.spread
    y_variance = np.sum(scatter[:, 1] ** 2, axis=-1) * (noise.common + (1 - noise.common) * flange.evened)
    predicted = np.stack([centre[:, 0], centre[:, 2], estimate.radius_mm**2 - centre[:, 1] ** 2 - y_variance], axis=1)
    to_circle = np.zeros((len(centre), 3, 3))  # from the centre to (x_c, z_c, w)
    to_circle[:, 0, 0] = to_circle[:, 1, 2] = 1.0
    to_circle[:, 2, 1] = -2 * centre[:, 1]
    columns = [np.broadcast_to(-R_t, A.shape), R_t @ cross_matrix(lever), by_center]
    if with_offset:  # profile time - robot time grows: the pose that belongs to a frame is an earlier one
        moving = -(R_t @ (cross_matrix(in_flange) @ flange.velocity[:, 3:, None] - flange.velocity[:, :3, None]))
        columns.append(moving)
    jacobian = to_circle @ np.concatenate(columns, axis=-1)
    by_radius = np.zeros((len(centre), 3, 1))
    by_radius[:, 2] = 2 * estimate.radius_mm
    jacobian = np.concatenate([jacobian[..., :9], by_radius, -seen.by_scale, jacobian[..., 9:]], axis=-1)
    spread = to_circle @ scatter
    covariance = seen.covariance + spread @ spread.mT
    bent = np.sqrt(2) * y_variance
    covariance[:, 2, 2] += bent**2
    return Linear(centre, seen.circle_at(estimate.scale) - predicted, jacobian, covariance, to_circle @ by_pose, bent)


def signed_centres(estimate: Estimate, linear: Linear, seen: Observations) -> Float:
    """Sphere centres (k, 3) in the profiler frame: measured x_c, z_c and |h|, which side by the answer."""
    x, z, w = seen.circle_at(estimate.scale).T
    h = np.sqrt(np.maximum(estimate.radius_mm**2 - w, 0.0))
    return np.stack([x, np.copysign(h, linear.centre[:, 1]), z], axis=1)


def by_circle(y_mm: Float) -> Float:
    """Change (k, 3, 3) of a sphere's centre in the profiler frame with x_c, z_c and w, its y being `y_mm` (k,)."""
    change = np.zeros((len(y_mm), 3, 3))
    change[:, 0, 0] = change[:, 2, 1] = 1.0
    change[:, 1, 2] = -1 / (2 * y_mm)
    return change


def to_base(centre: Float, estimate: Estimate, seen: Observations) -> Float:
    """Points (k, 3) of the profiler frame in the base."""
    at = centre @ estimate.rotation.T + estimate.translation_mm
    poses = seen.here.base_from_flange
    return mapped(poses, at)


def rows_of(linear: Linear, seen: Observations, noise: Noise, at: Estimate) -> estimator.Rows:
    """Circles as the estimator sees them at an estimate, whose radius and scales have the stated ones for a prior.

    Frames of a scan share errors that each recorded pose has of its own, and those of all of them.
    """
    size, known = linear.jacobian.shape[2], np.arange(SIZE - 1, SIZE + len(at.scale))
    prior, away = np.zeros((size, size)), np.zeros(size)
    prior[known, known] = noise.prior_u[: len(known)] ** -2.0
    away[known] = [noise.radius_mm - at.radius_mm, *-at.scale]
    flange = seen.here
    spread, bent = linear.by_pose * noise.spread, np.zeros((len(linear.bent), 3, 1))
    scale = noise.common / (noise.common + (1 - noise.common) * flange.evened)
    bent[:, 2, 0] = scale * linear.bent  # an error in common is so squared too
    alone = linear.covariance - spread @ spread.mT
    alone[:, 2, 2] -= scale * (2 - scale) * linear.bent**2  # what is its own stays, not its product with the common one
    whole = np.concatenate([spread * np.sqrt(noise.common), bent], axis=2)
    own = spread * np.sqrt(1 - noise.common)
    shared = tuple(sharing(scan, alone, own, whole) for scan in flange.scans)
    covariance = linear.covariance.copy()
    for one in shared:
        evened = flange.evened[one.rows, None, None]
        covariance[one.rows] = one.alone + evened * (one.own @ one.own.mT) + one.whole @ one.whole.mT
    values = np.full(len(linear.residual), 3.0)
    return estimator.Rows(linear.residual, linear.jacobian, covariance, values, prior, away, shared)


class Sphere:
    """A sphere's circles: unknown are hand-eye pose, centre and radius, and where it is open the clock's offset.

    `known`: what is known of the hand-eye pose before, as information (6, 6) about that of an estimate.
    """

    what = "sphere"

    def __init__(self, seen: Observations, noise: Noise, known: tuple[Estimate, Float] | None = None) -> None:
        self.seen, self.noise, self.known = seen, noise, known

    @property
    def flange(self) -> Flange | Timed:
        """Where it is seen from."""
        return self.seen.flange

    def rows(self, at: Estimate) -> estimator.Rows:
        """With a clock's offset the frames go to the poses of other times."""
        here = self.seen.place(at.offset_s)
        linear = linearise(at, here, self.noise, isinstance(self.flange, Timed))
        rows = rows_of(linear, here, self.noise, at)
        if self.known is not None:
            before, rows.prior[:6, :6] = self.known
            rows.away[:3] = before.translation_mm - at.translation_mm
            rows.away[3:6] = vector_from_rotation(before.rotation @ at.rotation.T)
        return rows

    def moved(self, at: Estimate, step: Float) -> Estimate:
        """Turns by half a rad at most: beyond, the model is no plane."""
        return at.moved(step * min(1.0, MOST_TURN / max(float(np.linalg.norm(step[3:6])), 1e-12)))

    @staticmethod
    def pose(at: Estimate) -> Estimate:
        """The estimate itself."""
        return at

    def shown(self, at: Estimate) -> Float:
        """Where the centre lies in the profiler frame (k, 3)."""
        return linearise(at, self.seen.place(at.offset_s), self.noise).centre

    def noisy(self, noise: Noise) -> Sphere:
        """With other noise."""
        return Sphere(self.seen, noise, self.known)

    def searched(self, most: int, flange: Flange | None = None) -> Sphere:
        """Of observations spread over all."""
        seen = self.seen if flange is None else replace(self.seen, flange=flange)
        some = np.isin(np.arange(len(seen)), np.linspace(0, len(seen) - 1, most).astype(int))
        return Sphere(seen.subset(some), self.noise)

    def starts(self, rotations: Float, offsets_s: Float, most: int) -> list[tuple[float, Estimate]]:
        """Places by x and z alone, then the side of the laser plane, which w tells: of all that one frame allows."""
        radius_mm, rough = self.noise.radius_mm, list[tuple[float, Estimate, Observations]]()
        for offset_s in offsets_s.tolist():
            seen = self.seen.place(offset_s)
            for R, center, t, off in zip(rotations, *_places(rotations, seen), strict=True):
                rough.append((off, Estimate(R, t, center, radius_mm, offset_s, seen.scale), seen))
        begun = []
        for _, start, seen in sorted(rough, key=lambda one: one[0])[:most]:
            blind = seen.covariance.copy()
            blind[:, 2, 2] += BLIND * radius_mm**4
            by_place = Sphere(replace(seen, covariance=blind), self.noise)
            at = estimator.fit(by_place, start, estimator.nearest(by_place, start), BLIND_STEPS).at
            begun += [(self._off(one, seen), one) for one in _sides(at, seen)]
        return sorted(begun, key=lambda one: one[0])

    def _off(self, at: Estimate, seen: Observations) -> float:
        """How far off three quarters of the observations lie."""
        rows = rows_of(linearise(at, seen, self.noise), seen, self.noise, at)
        used = np.ones(len(seen), bool)
        return estimator.usual(estimator.distance(rows, used, np.zeros_like(rows.prior)), used)


def _places(rotations: Float, seen: Observations) -> tuple[Float, Float, Float]:
    """For each rotation (m, 3, 3) centre and translation (m, 3) by x and z alone, and how far off these are (m,).

    Linear least squares, in turns with less weight for what is far off: a gross posture does not draw them.
    """
    poses = seen.here.base_from_flange
    A, b = poses[:, :3, :3], poses[:, :3, 3]
    middle = b.mean(axis=0)
    axes = (A @ rotations[:, None])[..., [0, 2]].mT  # (m, k, 2, 3)
    matrix = np.concatenate([axes, np.broadcast_to(-np.eye(2), (*axes.shape[:2], 2, 2))], axis=-1)
    side = seen.circle[:, :2] + np.einsum("mkai,ki->mka", axes, b - middle)
    weight = np.ones(axes.shape[:2])
    for _ in range(ROUNDS):
        square = np.einsum("mk,mkai,mkaj->mij", weight, matrix, matrix)
        x = (np.linalg.pinv(square, 1e-9, True) @ np.einsum("mk,mkai,mka->mi", weight, matrix, side)[..., None])[..., 0]
        off = np.linalg.norm(side - np.einsum("mkai,mi->mka", matrix, x), axis=2)
        weight = 1.0 / np.maximum(1.0, off / np.maximum(np.median(off, axis=1), 1e-9)[:, None]) ** 2
    t = np.einsum("mia,ma->mi", rotations[:, :, [0, 2]], x[:, 3:])
    return x[:, :3] + middle, t, np.median(off, axis=1)


def _sides(at: Estimate, seen: Observations) -> Iterator[Estimate]:
    """The profiler shifted along its y so that w fits best, and the best of those on the other side of that place."""
    y, h2 = linearise(at, seen, Noise(0.0, 0.0)).centre[:, 1], at.radius_mm**2 - seen.circle[:, 2]
    h = np.sqrt(np.maximum(h2, 0.0))
    shifts = np.concatenate([h - y, -h - y])
    off = np.median(np.abs((y + shifts[:, None]) ** 2 - h2), axis=1)
    first = shifts[off.argmin()]
    away = np.abs(shifts - first) > CLEAR * at.radius_mm
    for shift in (first, shifts[np.where(away, off, np.inf).argmin()]):
        yield replace(at, translation_mm=at.translation_mm - shift * at.rotation[:, 1])


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


def view_of_points(x_mm: AnyArray, z_mm: AnyArray, circle: Float) -> View:
    """The field in which a recording's points lie, all but the outermost of each side, and its circles (k, 3).

    Never less than `LEAST_MM`: where the sphere was shown at one place, the answer must still hold elsewhere.
    """
    good, r = np.isfinite(x_mm) & np.isfinite(z_mm), np.sqrt(np.maximum(circle[:, 2:], 0.0))
    low, high = np.quantile(np.stack([x_mm[good], z_mm[good]]), [OUTERMOST, 1 - OUTERMOST], axis=1)
    low = np.minimum(low, (circle[:, :2] - r).min(axis=0))
    high = np.maximum(high, (circle[:, :2] + r).max(axis=0))
    (x, z), (a, b) = (low + high) / 2, np.maximum((high - low) / 2, LEAST_MM)
    return View((x, z), (a, b))


def displacements(rotation: Float, view: View) -> Float:
    """How errors (6,) of the hand-eye pose displace the middle of the field, and either half of it (3, 3, 6).

    Sums of their squares are mean squares over the field.
    """
    middle, sides = view.axes(rotation)
    levers = np.vstack([middle, sides / np.sqrt(3)])
    return np.concatenate([np.eye(3) * np.array([1.0, 0.0, 0.0])[:, None, None], -cross_matrix(levers)], axis=2)


def volume_weight(rotation: Float, view: View) -> Float:
    """W (6, 6) with volume_u^2 = trace(W covariance): the mean square error of a point over the field."""
    moved = displacements(rotation, view).reshape(-1, 6)
    return moved.T @ moved


def place_u(covariance: Float, rotation: Float, view: View) -> float:
    """Predicted RMS error (mm) over the field along one axis, the least certain, from the covariance (6, 6)."""
    moved = displacements(rotation, view)
    return estimator.worst(np.einsum("sip,pq,sjq->ij", moved, covariance, moved))[0]


def volume_u(covariance: Float, rotation: Float, view: View) -> float:
    """Predicted RMS error (mm) of a point over the field, from the hand-eye covariance (6, 6)."""
    return float(np.sqrt(np.trace(volume_weight(rotation, view) @ covariance)))
