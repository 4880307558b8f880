"""The paper's methods, on sphere centres whose signs are known: the analytic one, and the genetic one in two steps.

All take the centres P_i (k, 3) in the profiler frame and the flange's poses (r_i, t_i), and give R and t. Of equations
(6) and (8) the corrected forms are used: (6) as printed compares R (P_i - P_j) with r^-1 (t_j - t_i) and holds only
for pairs that share the orientation r; for any pair, with a the axis of r_i^T r_j,
a . [R (P_i - P_j) - r_i^T (t_j - t_i)] = 0. And (8) reads (r_j - r_i) t = r_i R P_i - r_j R P_j + t_i - t_j.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.api import (
    DEG,
    Float,
    InputError,
    estimator,
    pose_from,
    rotation_from_rpy,
    rotation_from_vector,
    rpy_from_rotation,
)
from workbench.api import vector_from_rotation as vector

SHARED_RAD = 0.1 * DEG  # orientations that differ by less count as one: pairs of pure translation
BOX_RAD, BOX_MM = 20 * DEG, 50.0  # how far from the design the genetic algorithm looks
POPULATION, GENERATIONS = 100, 100
STEP_MM = 1e-3  # for differences


@dataclass(frozen=True)
class Centres:
    """Sphere centres in the profiler frame (k, 3), flange orientations (k, 3, 3) and positions (k, 3)."""

    P: Float
    r: Float
    t: Float


class Pairs:
    """All pairs of postures, prepared for equation (6)."""

    def __init__(self, seen: Centres) -> None:
        i, j = np.triu_indices(len(seen.P), 1)
        turn = vector(seen.r[i].mT @ seen.r[j])
        angle = np.linalg.norm(turn, axis=1)
        axis = turn / np.maximum(angle, 1e-12)[:, None]
        self.shared = angle < SHARED_RAD  # orientation: (6) holds along all axes, else along that of the turn
        self.project = np.where(self.shared[:, None, None], np.eye(3), axis[:, :, None] * axis[:, None, :])
        self.seen_by = seen.P[i] - seen.P[j]
        self.moved = np.einsum("kji,kj->ki", seen.r[i], seen.t[j] - seen.t[i])

    def residual(self, R: Float) -> Float:
        """Residuals (s, 3 pairs) of equation (6), as it holds for any pair, for rotations (s, 3, 3)."""
        off = np.einsum("sab,kb->ska", R, self.seen_by) - self.moved
        return np.asarray(np.einsum("kab,skb->ska", self.project, off).reshape(len(R), -1))


def translation(R: Float, seen: Centres) -> Float:
    """t (3,) given R: linear least squares on r_i t - C = -(r_i R P_i + t_i), equation (8) with C kept."""
    k = len(seen.P)
    matrix = np.concatenate([seen.r.reshape(-1, 3), np.tile(-np.eye(3), (k, 1))], axis=1)
    side = -((seen.r @ (seen.P @ R.T)[..., None])[..., 0] + seen.t).ravel()
    return np.asarray(np.linalg.lstsq(matrix, side, rcond=None)[0][:3])


def analytic(seen: Centres, where: str = "postures") -> Float:
    """Hand-eye pose (4, 4): Kabsch on the pairs of pure translation, then the translation by linear least squares.

    Raises:
        InputError: the pairs that share the flange's orientation do not span two directions.
    """
    pairs = Pairs(seen)
    U, size, V = np.linalg.svd(pairs.moved[pairs.shared].T @ pairs.seen_by[pairs.shared])
    if pairs.shared.sum() < 2 or size[1] < 1e-3 * size[0]:
        raise InputError(
            where,
            "method 'analytic' needs postures that share the flange's orientation, moved in two "
            "directions; take 'bundle'",
        )
    R = U @ np.diag([1.0, 1.0, np.sign(np.linalg.det(U @ V))]) @ V
    return pose_from(R, translation(R, seen))


def genetic(design: Float, seen: Centres, seed: int) -> Float:
    """Hand-eye pose (4, 4) by the paper's two steps, equations (4) to (8) put right: rotation first, then translation.

    Floating-point genes within a box about the design; differential evolution (Storn and Price 1997), as scipy
    keeps it, with 100 generations of 100.
    """
    pairs = Pairs(seen)
    rpy = np.array(rpy_from_rotation(design[:3, :3]))

    def rotation(genes: Float) -> Float:
        return np.array([rotation_from_rpy(*one) for one in np.atleast_2d(genes.T)])

    angles = _evolve(lambda genes: np.sum(pairs.residual(rotation(genes)) ** 2, axis=1), rpy, BOX_RAD, seed)
    R = rotation_from_rpy(*angles)

    def cost(genes: Float) -> Float:
        """Squares of equation (8) over all pairs, for translations: k times that about the mean."""
        base = np.einsum("kab,skb->ska", seen.r, seen.P @ R.T + np.atleast_2d(genes.T)[:, None]) + seen.t
        return np.asarray(len(seen.P) * np.sum((base - base.mean(axis=1, keepdims=True)) ** 2, axis=(1, 2)))

    return pose_from(R, _evolve(cost, design[:3, 3], BOX_MM, seed))


def two_step(start: Float, seen: Centres) -> Float:
    """Where the genetic algorithm's objectives have their minimum near `start`: what it would find given for ever."""
    pairs = Pairs(seen)

    def residual(step: Float) -> Float:
        return np.asarray(pairs.residual((rotation_from_vector(step) @ start[:3, :3])[None])[0])

    R = rotation_from_vector(scipy.optimize.least_squares(residual, np.zeros(3), method="lm").x) @ start[:3, :3]
    return pose_from(R, translation(R, seen))


def propagated(rule: Callable[[Centres], Float], seen: Centres, covariance: Float) -> Float:
    """Covariance (6, 6) of the pose that `rule` gives, by differences, from that of each centre in its frame (k, 3, 3).

    Errors of the flange's poses are part of the centres' covariance.
    """
    pose = rule(seen)

    def moved(step: Float) -> Float:
        now = rule(replace(seen, P=seen.P + step.reshape(-1, 3)))
        return np.concatenate([now[:3, 3], vector(now[:3, :3] @ pose[:3, :3].T)])[None]

    slope = estimator.jacobian_of(moved, np.full(seen.P.size, STEP_MM)).reshape(6, -1, 3)
    return np.asarray(np.einsum("pki,kij,qkj->pq", slope, covariance, slope))


def _evolve(cost: Callable[[Float], Float], middle: Float, half: float, seed: int) -> Float:
    """Minimum of `cost` over genes (3, s) within a box about `middle`."""
    found = scipy.optimize.differential_evolution(
        cost,
        [(m - half, m + half) for m in middle],
        popsize=POPULATION // 3,
        maxiter=GENERATIONS,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=np.random.default_rng(seed),
    )
    return np.asarray(found.x)
