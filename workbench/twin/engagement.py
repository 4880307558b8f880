"""Engagement: radial and axial depth and chip area along a layer."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Layer, LayerEngagement
from workbench.units import Float

_FAR_MM = 1e6


def engage(layer: Layer, u_at_points: Float, u: Float, removed_mm: Float, w_step_mm: float) -> LayerEngagement:
    """Engagement at a layer's k points from the depths (U, W) that it removed, lines `w_step_mm` apart.

    Depths are signed: below 0 the cutter passed that much above the material. `u_at_points` (k,), `u` (U,).
    """
    length, area = _positive_part(removed_mm, w_step_mm)
    radial = np.maximum(removed_mm.max(axis=1), 0.0)
    along = (np.interp(u_at_points, u, value, left=0.0, right=0.0) for value in (radial, length, area))
    return LayerEngagement(layer.index, layer.arc_length_mm, *along)


def _positive_part(depth: Float, step: float) -> tuple[Float, Float]:
    """Length over which piecewise linear depths (U, W) are above 0, and the area there."""
    depth = np.maximum(depth, -_FAR_MM)  # lines beside the part miss it by an infinite depth
    a, b = depth[:, :-1], depth[:, 1:]
    high, low = np.maximum(np.maximum(a, b), 0.0), np.minimum(a, b)
    share = np.where(low >= 0.0, high > 0.0, high / (high - np.minimum(low, -1e-12)))
    area = 0.5 * share * (high + np.maximum(low, 0.0))
    return step * share.sum(axis=1), step * area.sum(axis=1)
