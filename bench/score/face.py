"""The truth of raw edges: on a rough end face its local least-squares plane; what a user knows of the upper side."""

from __future__ import annotations

from typing import Any

import numpy as np

from bench.drawn.seeds import generator
from bench.simulators.swept.truth import local_plane, local_slope
from workbench.geometry.poses import rotation_from_vector
from workbench.synthetic.workpiece import build_surface, pose
from workbench.units import DEG, Float

MOST_TURNED_DEG = 10.0  # of `upper_side`, which a user knows roughly


def rough_upper_side(truth: Any, rng: np.random.Generator | None = None) -> tuple[float, float, float]:
    """The true direction from the lower to the upper side, turned by up to 10 deg about any axis square to it.

    Without `rng` by the part's own random numbers.
    """
    rng = rng or generator(truth.recipe.seed, truth.recipe.title, 1)
    across = truth.across[len(truth.across) // 2]
    axis = np.cross(across, rng.normal(size=3))
    turned = rotation_from_vector(axis / np.linalg.norm(axis) * rng.uniform(0, MOST_TURNED_DEG) * DEG) @ across
    return float(turned[0]), float(turned[1]), float(turned[2])


def local_face(truth: Any) -> dict[str, Float]:
    """Lower edge, n, m and t at the truth's stations; on a rough face, of its local least-squares plane.

    The swept simulator's truth is that plane already.
    """
    place, t, n, m = truth.position_mm, truth.tangent, truth.normal, truth.across
    part = truth.recipe.part
    waves = [] if hasattr(truth, "upper_position_mm") else build_surface(part, truth.recipe.seed).roughness
    if len(waves):
        width = truth.thickness_mm / (m @ pose(part.base_from_part)[:3, 2])
        u = np.linspace(0.0, part.length_mm, len(truth.arc_length_mm))
        share = np.linspace(0, 1, 64)
        height = np.zeros((len(u), len(share)))
        for amplitude, along, over, phase in waves:
            height += amplitude * np.cos(along * u[:, None] + over * share * width[:, None] + phase)
        low, high = local_plane(height, float(np.median(np.diff(u))))
        place = place + low[:, None] * n
        lean = np.arctan2(high - low, width)[:, None]
        up = np.cos(lean) * m + np.sin(lean) * n
        t = _unit(local_slope(place))
        n = _unit(np.cross(t, up))
        m = np.cross(n, t)
    return {"position_mm": place, "normal": n, "across": m, "tangent": t}


def _unit(vectors: Float) -> Float:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=1, keepdims=True))
