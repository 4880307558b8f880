"""A layer on a part of an upper surface, which ends beside its edge: primer that was masked, scale that was ground off.

The corner of a joint is that of the bare strip. A strip is too narrow to tell a direction, the layer is not: both are
parallel, a step apart, as the mean of all profiles shows (docs/grooves.md).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Cloud
from workbench.geometry.blocks import evenly
from workbench.units import AnyArray, Float, Int

FRAMES = 200  # whose mean is looked at
BIN_MM, LEAST_BINS = 0.1, 2  # of the distance from the edge; on either side of a step
BESIDE_MM = 0.35  # beside the edge: its rounding
LEAST_MM, MOST_MM = 0.015, 0.5  # height of a layer
CLEAR = 6.0  # times what the step leaves of the mean, rms: the least height of one
BETTER = 0.35  # of what a bow leaves, that a step may leave
ON_MM = 0.06  # a return this near to a level is of it


class Layer(NamedTuple):
    """Two levels of an upper surface, above the lines of the profiles."""

    from_mm: float  # from the edge, where the layer begins
    height_mm: float  # by which the strip beside the edge lies above it
    slope: float  # of both, away from the edge
    offset_mm: float  # of the layer, at the edge


class Surface(NamedTuple):
    """The returns of an upper surface in one profile, up to the face below it."""

    columns: Int  # (k,)
    away_mm: Float  # (k,) along the surface from its edge
    above_mm: Float  # (k,) the line through what was taken for the surface
    cosine: float  # of its slope


def surface(x: Float, z: Float, up: float, columns: Int, on: Int, inner: int, outer: int) -> Surface:
    """Of a profile's points `inner` to `outer`, the nearest to the edge first; on: those that its line goes through."""
    step = 1 if outer >= inner else -1
    index = np.arange(inner, outer + step, step)
    slope, offset = np.polyfit(x[on], up * z[on], 1)
    cosine = float(1.0 / np.hypot(1.0, slope))
    above = (up * z[index] - slope * x[index] - offset) * cosine
    return Surface(columns[index], np.abs(x[index] - x[inner]) / cosine, above, cosine)


def find_layer(surfaces: Sequence[Surface]) -> Layer | None:
    """The layer that the mean of the profiles shows; None: one level, straight or bowed, explains it."""
    at, mean = _mean(surfaces)
    if at.size < 3 * LEAST_BINS:
        return None
    base = np.stack([np.ones_like(at), at], axis=1)
    bow_left = _left(np.column_stack([base, at**2]), mean)[1]
    steps = range(LEAST_BINS, at.size - LEAST_BINS + 1)
    tried = [(*_left(np.column_stack([base, at < at[k]]), mean), k) for k in steps]
    found, left, k = min(tried, key=lambda one: one[1])
    height = float(found[2])
    if not (LEAST_MM < abs(height) < MOST_MM and abs(height) > CLEAR * left and left < BETTER * bow_left):
        return None
    return Layer(float(at[k] - 0.5 * BIN_MM), height, float(found[1]), float(found[0]))


def without_layer(
    cloud: Cloud, labels: AnyArray, label: int, surfaces: Sequence[Surface], up: float
) -> tuple[Cloud, AnyArray, Layer | None]:
    """The profiles (n, M) with the layer lowered to the strip beside it, their labels, and what was taken off."""
    layer = find_layer(surfaces)
    if layer is None:
        return cloud, labels, None
    z, out = cloud.z_mm.astype(np.float64), labels.copy()
    for k, one in enumerate(surfaces):
        on_layer = one.away_mm > layer.from_mm
        z[k, one.columns[on_layer]] += up * layer.height_mm / one.cosine
        level = layer.offset_mm + layer.slope * one.away_mm + np.where(on_layer, 0.0, layer.height_mm)
        of_surface = (one.away_mm > BESIDE_MM) & (np.abs(one.above_mm - level) < ON_MM)
        before = out[k, one.columns]
        out[k, one.columns] = np.where(of_surface, label, np.where(before == label, 0, before))
    return replace(cloud, z_mm=z.astype(cloud.z_mm.dtype)), out, layer


def _mean(surfaces: Sequence[Surface]) -> tuple[Float, Float]:
    """Distances from the edge, and the median height there over some profiles, where most of these return."""
    some = [surfaces[k] for k in evenly(len(surfaces), FRAMES)]
    far = float(np.median([one.away_mm[-1] for one in some]))
    away, above = (np.concatenate(of) for of in zip(*((one.away_mm, one.above_mm) for one in some), strict=True))
    near = np.abs(above) < MOST_MM
    number = np.floor((away[near] - BESIDE_MM) / BIN_MM)
    shown = {k: above[near][number == k] for k in np.arange(0.0, (far - BESIDE_MM) / BIN_MM)}
    seen = {k: float(np.median(one)) for k, one in shown.items() if one.size > 0.5 * len(some)}
    return BESIDE_MM + BIN_MM * (np.array([*seen]) + 0.5), np.array([*seen.values()])


def _left(model: Float, value: Float) -> tuple[Float, float]:
    """The model's coefficients, and the rms that it leaves."""
    found, *_ = np.linalg.lstsq(model, value, rcond=None)
    return np.asarray(found, dtype=np.float64), float(np.sqrt(np.mean((value - model @ found) ** 2)))
