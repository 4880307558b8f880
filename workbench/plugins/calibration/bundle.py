"""The hand-eye pose by maximum likelihood on (x_c, z_c, w), and the search for signs that gives it a start.

The fit is Gauss-Newton's from an answer of that search, gross postures left out. On which side of the laser plane did
the sphere's centre lie in each posture? A circle does not tell: all are tried.

For every pattern of signs of h = c_y in a few postures, the hand-eye pose follows by least squares on the centres (9
unknowns, Gauss-Newton from the design's pose, or from 24 orientations where there is no design). Each answer predicts
all other postures without signs, and is judged by them with truncated squares, so that gross postures cannot spoil
it. More seeds are tried until one explains the data.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import scipy

from workbench.api import Bool, Float, Int, Shaped, estimator, rotation_from_vector, vector_from_rotation
from workbench.plugins.calibration.model import SIZE, Estimate, Linear, Noise, Sphere, cross_matrix, linearise
from workbench.plugins.calibration.observations import Observations, Passes

SEED_SIZE = 5  # postures whose signs are tried exhaustively: 32 patterns
SEEDS = 24  # sets of them: with 2 gross postures in 15, two in five have none
KEPT = 24  # answers of a seed that are judged by all postures
PATTERN_STEPS, PATTERN_TURN = 12, 0.7  # of each pattern's fit, and the most that a step turns, rad
HOPELESS = 300.0  # chi-square of a seed's five postures, over four times the best: no answer
GATE = 25.0  # squared Mahalanobis distance at which a posture stops counting against an answer
SLACK = 9.0  # how much more than its noise a seed's answer may be off elsewhere: it is not refined yet
DESIGN_MM, DESIGN_RAD = 50.0, 0.35  # how far the design may be off: a weak pull in the search only
UNKNOWN_MM, UNKNOWN_RAD = 1000.0, 100.0  # the same without a design

GROSS = float(scipy.special.chdtri(3, 1e-5))  # squared distance of a posture, left out of the fit, that is no chance
NO_CHANCE = 1e-3  # probability below which a misfit is no chance


def solve_patterns(
    xz: Float, h: Float, weight: Float, A: Float, b: Float, start_R: Float, start_t: Float, pull: Float
) -> tuple[Float, Float, Float, Float]:
    """Least squares on the centres for all 2^m patterns of signs of `h` (m,), from each start (s, 3, 3), (s, 3).

    `weight` (m, 3): inverse variances of the centres' x, y, z; `pull` (2,): inverse variances of translation and
    rotation about the start. Returns R (s 2^m, 3, 3), t, C and chi-square.
    """
    m, starts = len(h), len(start_R)
    signs = np.where(np.arange(2**m)[:, None] >> np.arange(m) & 1, 1.0, -1.0)
    x, z = (np.broadcast_to(one, signs.shape) for one in xz.T)
    c = np.tile(np.stack([x, signs * h, z], axis=2), (starts, 1, 1))
    R, t = np.repeat(start_R, 2**m, axis=0), np.repeat(start_t, 2**m, axis=0)
    C = (np.einsum("mij,smj->smi", A, c @ np.swapaxes(R, 1, 2) + t[:, None]) + b).mean(axis=1)
    away, chi2, open_ = np.zeros((len(t), 9)), np.full(len(t), 1e300), np.arange(len(t))  # away from the start
    pulls = np.append(np.repeat(pull, 3), np.zeros(3))
    for step in range(PATTERN_STEPS):
        off, J = _equations(c[open_], A, b, R[open_], t[open_], C[open_])
        before, chi2[open_] = chi2[open_], (weight.ravel() * off**2).sum(axis=1)
        now = chi2[open_]
        done = (step > 1) & (np.abs(before - now) < 0.05 + 1e-3 * now) | (step > 4) & (now > 2000.0 * m)
        off, J, open_ = off[~done], J[~done], open_[~done]
        weighted = np.swapaxes(weight.reshape(-1, 1) * J, 1, 2)
        side = (weighted @ off[..., None])[..., 0] - pulls * away[open_]
        by = np.linalg.solve(weighted @ J + np.diag(pulls), side[..., None])[..., 0]
        by *= np.minimum(1.0, PATTERN_TURN / np.maximum(np.linalg.norm(by[:, 3:6], axis=1), 1e-12))[:, None]
        R[open_] = rotation_from_vector(by[:, 3:6]) @ R[open_]
        away[open_] += by
        t[open_] += by[:, :3]
        C[open_] += by[:, 6:]
    return R, t, C, chi2


def _equations(c: Float, A: Float, b: Float, R: Float, t: Float, C: Float) -> tuple[Float, Float]:
    """Of s answers: centres (s, m, 3) less their predictions (s, 3 m), and derivatives of these by t, w, C."""
    back = np.swapaxes(R, 1, 2)[:, None]
    lever = np.einsum("mji,smj->smi", A, C[:, None] - b) - t[:, None]
    parts = np.broadcast_to(-back, (*c.shape, 3)), back @ cross_matrix(lever), back @ np.swapaxes(A, 1, 2)
    off = c - (back @ lever[..., None])[..., 0]
    return off.reshape(len(c), 3 * len(b)), np.concatenate(parts, axis=-1).reshape(len(c), 3 * len(b), 9)


def candidates(seen: Observations, noise: Noise, design: Float | None) -> Iterator[list[tuple[float, Estimate]]]:
    """For one seed of postures after the other: answers with their truncated score over all postures, best first."""
    starts_R, starts_t, pull = _starts(design)
    centre, weight = _centres(seen, noise)
    A, b = seen.base_from_flange[:, :3, :3], seen.base_from_flange[:, :3, 3]
    middle = b.mean(axis=0)
    for rows in _seeds(seen, centre):
        R, t, C, chi2 = solve_patterns(
            centre[rows][:, ::2],
            centre[rows, 1],
            weight[rows],
            A[rows],
            b[rows] - middle,
            starts_R,
            starts_t,
            pull,
        )
        hopeless = 4 * np.nanmin(chi2) + HOPELESS
        order = [i for i in np.argsort(chi2, kind="stable")[: 4 * KEPT] if chi2[i] <= hopeless]
        made = (Estimate(R[i], t[i], C[i] + middle, noise.radius_mm) for i in order)
        answers = distinct(made, lambda one: one)[:KEPT]
        yield sorted(((truncated(answer, seen, noise), answer) for answer in answers), key=lambda pair: pair[0])


def truncated(estimate: Estimate, seen: Observations, noise: Noise) -> float:
    """Sum over the postures of the squared Mahalanobis distance over SLACK, each at most `GATE`."""
    return float(np.minimum(distances(estimate, seen, noise) / SLACK, GATE).sum())


def distances(estimate: Estimate, seen: Observations, noise: Noise) -> Float:
    """Squared Mahalanobis distance (k,) of each observation from the prediction."""
    linear = linearise(estimate, seen, noise)
    r = linear.residual
    return np.asarray(np.sum(r * np.linalg.solve(linear.covariance, r[..., None])[..., 0], axis=1))


def _centres(seen: Observations, noise: Noise) -> tuple[Float, Float]:
    """Centres (k, 3) with h >= 0, and their inverse variances (k, 3): h is poorly known where it is small."""
    x, z, w = seen.circle.T
    variance = seen.covariance
    h2 = noise.radius_mm**2 - w
    h2_variance = variance[:, 2, 2] + (2 * noise.radius_mm * noise.radius_u_mm) ** 2
    h = np.sqrt(np.maximum(h2, 0.0))
    h_variance = h2_variance / np.maximum(4 * h**2, 2 * np.sqrt(h2_variance))
    lever = np.linalg.norm(seen.base_from_flange[:, :3, 3] - seen.base_from_flange[:, :3, 3].mean(axis=0), axis=1)
    pose = noise.pose_mm**2 + (np.radians(noise.pose_deg) * np.maximum(lever, 200.0)) ** 2
    each = [variance[:, 0, 0] + pose, h_variance + pose, variance[:, 1, 1] + pose]
    return np.stack([x, h, z], axis=1), 1.0 / np.stack(each, axis=1)


def _starts(design: Float | None) -> tuple[Float, Float, Float]:
    """Starts of the search and how weakly they pull: the design, or the 24 orientations of a cube."""
    if design is not None:
        return design[None, :3, :3], design[None, :3, 3], np.array([DESIGN_MM, DESIGN_RAD]) ** -2
    turns = []
    for axes in itertools.permutations(range(3)):
        for signs in itertools.product((1.0, -1.0), repeat=3):
            matrix = np.zeros((3, 3))
            matrix[range(3), axes] = signs
            if np.linalg.det(matrix) > 0:
                turns.append(matrix)
    return np.stack(turns), np.zeros((len(turns), 3)), np.array([UNKNOWN_MM, UNKNOWN_RAD]) ** -2


def _seeds(seen: Observations, centre: Float) -> Iterator[Int]:
    """Sets of postures to begin with: first those that lie farthest apart, then chosen at random."""
    k = len(seen)
    if k <= SEED_SIZE:
        yield np.arange(k)
        return
    turns = seen.base_from_flange[0, :3, :3].T @ seen.base_from_flange[:, :3, :3]
    feature = np.concatenate(
        [vector_from_rotation(turns) * 40.0, centre], axis=1
    )  # 40 mm a rad: about a sensor's reach
    chosen = [int(np.argmax(centre[:, 1]))]
    while len(chosen) < SEED_SIZE:
        apart = np.linalg.norm(feature[:, None] - feature[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(apart)))
    yield np.array(chosen)
    rng = np.random.default_rng(0)
    for _ in range(SEEDS - 1):
        yield rng.choice(k, SEED_SIZE, replace=False)


T = TypeVar("T")


def distinct(
    answers: Iterable[T], pose: Callable[[T], Estimate], within_mm: float = 0.5, within_rad: float = 0.02
) -> list[T]:
    """Answers whose poses differ by more: several starts and signs of small h lead to the same."""
    kept: list[T] = []
    for one in answers:
        if not any(same(pose(one), pose(other), within_mm, within_rad) for other in kept):
            kept.append(one)
    return kept


def same(one: Estimate, other: Estimate, within_mm: float = 0.5, within_rad: float = 0.02) -> bool:
    """Whether two answers place the profiler alike."""
    turn = np.abs(one.rotation - other.rotation).max()
    return bool(turn < within_rad and np.abs(one.translation_mm - other.translation_mm).max() < within_mm)


# Maximum likelihood.


@dataclass(frozen=True)
class Fit:
    """A fit and what it rests on: k observations, P unknowns."""

    estimate: Estimate
    covariance: Shaped[Float, "P P"]
    chi2: float
    freedom: int
    used: Shaped[Bool, " k"]


def fit(
    start: Estimate,
    seen: Observations | Passes,
    noise: Noise,
    *,
    used: Bool | None = None,
    with_offset: bool = False,
    steps: int = estimator.STEPS,
) -> Fit:
    """Least squares from `start` on the observations `used` (k,), None: all.

    Every step weights with the noise predicted at the estimate. The sphere's radius is pulled to the stated one; the
    pull is an observation like any other. `with_offset`: `seen` are passes whose clock offset is estimated too.
    """
    found = estimator.fit(Sphere(seen, noise, with_offset), start, used, steps)
    return Fit(found.at, found.inverse, found.chi2, found.freedom, found.used)


def without_gross(start: Estimate, seen: Observations, noise: Noise) -> Fit:
    """The fit without gross postures: begun with those that agree with `start`, settled one posture at a time.

    A posture is judged by its distance from the fit of the others. Where more than a quarter would go, none does: then
    it is not some postures that are off, but what is known about all of them.
    """
    count = len(seen)
    most = int(estimator.MOST_GROSS * count) if count > 6 else 0
    near = distances(start, seen, noise) < 4 * GATE
    used = near if count - near.sum() <= most else np.ones(count, bool)
    result = fit(start, seen, noise, used=used)
    for _ in range(2 * most + 1):
        off = left_out(result, seen, noise) > GROSS
        worst = np.argmax(np.where(used & off, left_out(result, seen, noise), 0.0))
        back = ~used & ~off
        if back.any():
            used = used | back
        elif (used & off).any() and (~used).sum() < most:
            used = used.copy()
            used[worst] = False
        else:
            break
        result = fit(result.estimate, seen, noise, used=used)
    if (left_out(result, seen, noise)[used] > GROSS).any() or (~used).sum() > most:
        return fit(result.estimate, seen, noise)
    return result


def misfits(result: Fit) -> bool:
    """Whether the residuals are larger than the noise explains."""
    return bool(result.freedom > 0 and scipy.special.chdtrc(result.freedom, result.chi2) < NO_CHANCE)


def matched(result: Fit, seen: Observations, noise: Noise) -> tuple[Fit, Noise]:
    """The fit with the robot's noise as large as the residuals say, so that profiles keep their due weight.

    Postures that only the smaller noise made gross come back.
    """
    for _ in range(10):
        ratio = result.chi2 / result.freedom
        factor = float(np.clip(np.sqrt(ratio), 0.3, 10.0))
        noise = replace(noise, pose_mm=factor * noise.pose_mm, pose_deg=factor * noise.pose_deg)
        used = result.used | (left_out(result, seen, noise) < GROSS)
        if abs(ratio - 1) < 0.02 and (used == result.used).all():
            break
        result = fit(result.estimate, seen, noise, used=used)
    return result, noise


def left_out(result: Fit, seen: Observations, noise: Noise) -> Float:
    """Squared distance (k,) of every observation from the fit of the others (of all that count, for one left out)."""
    rows = Sphere(seen, noise).rows(result.estimate)
    return estimator.distance(rows, result.used, result.covariance[:SIZE, :SIZE]) ** 2


def signed_centres(estimate: Estimate, linear: Linear, seen: Observations) -> Float:
    """Sphere centres (k, 3) in the profiler frame: measured x_c, z_c and |h|, which side by the answer."""
    h = np.sqrt(np.maximum(estimate.radius_mm**2 - seen.circle[:, 2], 0.0))
    return np.stack([seen.circle[:, 0], np.copysign(h, linear.centre[:, 1]), seen.circle[:, 1]], axis=1)


def to_base(centre: Float, estimate: Estimate, seen: Observations) -> Float:
    """Points (k, 3) of the profiler frame in the base."""
    flange = centre @ estimate.rotation.T + estimate.translation_mm
    return np.asarray((seen.base_from_flange[:, :3, :3] @ flange[..., None])[..., 0] + seen.base_from_flange[:, :3, 3])
