"""Corners of a path of straight and circular moves, and how far rounding one off leaves the path."""

from __future__ import annotations

import numpy as np

from workbench.units import Bool, Float, Shaped


def rounding_mm(position_mm: Float, via_mm: Float, circular: Shaped[Bool, " k"], zone_mm: float) -> Float:
    """How far from each target (k,) the path passes that is rounded off from `zone_mm` before to `zone_mm` after it.

    Controllers round corners by parabolas, which pass the corner at half the distance of their chord's middle, and
    begin no earlier than half-way. Infinite where a move has no length, since nothing tells its direction; 0 at both
    ends of the path.

    Args:
        position_mm: targets (k, 3).
        via_mm: middles of circular moves (k, 3).
        circular: (k,) over `via_mm`, else straight.
        zone_mm: where the rounding may begin.
    """
    start, end = position_mm[:-1], position_mm[1:]
    length = np.linalg.norm(end - start, axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        chord = (end - start) / length[:, None]
        leave = np.where(circular[1:, None], _mirrored(chord, via_mm[1:] - start), chord)
        arrive = np.where(circular[1:, None], _mirrored(chord, end - via_mm[1:]), chord)
        sine = np.linalg.norm(leave[1:] - arrive[:-1], axis=1) / 2.0  # of half the angle that the path turns
        off = np.minimum(zone_mm, np.minimum(length[1:], length[:-1]) / 2.0) * sine / 2.0
    return np.concatenate([[0.0], np.where(np.isfinite(off), off, np.inf), [0.0]])


def _mirrored(chord: Float, way: Float) -> Float:
    """The chord's direction mirrored at that of the way to or from the arc's middle: the tangent at that end."""
    along = way / np.linalg.norm(way, axis=1, keepdims=True)
    return np.asarray(2.0 * (along * chord).sum(axis=1, keepdims=True) * along - chord)
