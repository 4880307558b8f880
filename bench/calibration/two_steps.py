"""The paper's two ways: analytic least squares, and its genetic algorithm with equation (6) as it can be used.

Equation (6) holds for pairs that share the flange's orientation; `share_only` keeps to these. Without it, the part that
holds for any pair is used as well (docs/paper.md).
"""

from __future__ import annotations

import numpy as np

from bench.peers.genetic import evolve
from workbench.geometry.poses import pose_from, rotation_from_rpy, rpy_from_rotation
from workbench.plugins.calibration.methods import Centres, _Pairs, translation
from workbench.units import DEG, Float

BOX_MM = 50.0
SHARED_RAD = 0.1 * DEG


def sharing(seen: Centres) -> tuple[Float, Float]:
    """Of pairs that share the orientation: differences in the profiler and in the flange frame (k, 3)."""
    pairs = _Pairs(seen)
    keep = np.abs(pairs.project - np.eye(3)).max(axis=(1, 2)) < 1e-9
    return pairs.seen_by[keep], pairs.moved[keep]


def analytic(seen: Centres) -> Float:
    """Kabsch on the pairs of pure translation, then linear least squares, whatever comes of it."""
    seen_by, moved = sharing(seen)
    U, _, V = np.linalg.svd(moved.T @ seen_by)
    R = U @ np.diag([1.0, 1.0, np.linalg.det(U @ V)]) @ V
    return pose_from(R, translation(R, seen))


def turn_cost(seen: Centres, rotations: Float) -> Float:
    """Equation (6) (s,) over pairs that share the orientation, for rotations (s, 3, 3)."""
    seen_by, moved = sharing(seen)
    return np.asarray(np.sum((np.einsum("sab,kb->ska", rotations, seen_by) - moved) ** 2, axis=(1, 2)))


def genetic(seen: Centres, design: Float, box_deg: float, rng: np.random.Generator) -> Float:
    """The genetic algorithm, 100 generations of 100, within `box_deg` and 50 mm about the design."""
    pairs = _Pairs(seen)

    def cost(genes: Float) -> Float:
        return turn_cost(seen, np.array([rotation_from_rpy(*one) for one in genes]))

    R = rotation_from_rpy(*evolve(cost, np.array(rpy_from_rotation(design[:3, :3])), box_deg * DEG, rng))
    return pose_from(R, evolve(lambda genes: pairs.translation_cost(R, genes), design[:3, 3], BOX_MM, rng))
