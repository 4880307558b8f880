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
from workbench.edge.groove_profile import ON_MM, TRIM_MM
from workbench.units import AnyArray, Bool, Float, Int

STRETCH = 30  # profiles, whose mean is looked at
BIN_MM, LEAST_BINS = 0.1, 3  # of the distance from the edge; on either side of a step
LEAST_MM, MOST_MM = 0.015, 0.5  # height of a layer
CLEAR = 6.0  # times what the step leaves of the mean, rms: the least height of one
BETTER = 0.35  # of what a bow or a bend leaves, that a step may leave


class Layer(NamedTuple):
    """Two levels of an upper surface."""

    from_mm: float  # from the edge, where the layer begins
    height_mm: float  # by which the strip beside the edge lies above it


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
    """The layer that the mean of the profiles shows; None: one level, straight, bowed or bent, explains it."""
    at, mean = _mean(surfaces)
    if at.size < 3 * LEAST_BINS:
        return None
    base = np.stack([np.ones_like(at), at], axis=1)
    starts = range(LEAST_BINS, at.size - LEAST_BINS + 1)
    tried = [(*_left(np.column_stack([base, at < at[k]]), mean), k) for k in starts]
    found, left, k = min(tried, key=lambda one: one[1])
    bends = [np.maximum(at[i] - at, 0.0) for i in starts]  # an edge that is ground off, or rounded
    rival = min(_left(np.column_stack([base, of]), mean)[1] for of in (at**2, *bends))
    height = float(found[2])
    if not (LEAST_MM < abs(height) < MOST_MM and abs(height) > CLEAR * left and left < BETTER * rival):
        return None
    return Layer(float(at[k] - 0.5 * BIN_MM), height)


def without_layers(
    cloud: Cloud, labels: AnyArray, label: int, surfaces: Sequence[Surface], up: float
) -> tuple[Cloud, AnyArray, Layer | None]:
    """The profiles (n, M) with layers lowered to the strip beside them, their labels, and one that was taken off.

    A layer may cover a part of the edge: each profile has that of a stretch beside it, or none, as leaves least.
    """
    parts = np.array_split(np.arange(len(surfaces)), max(1, len(surfaces) // STRETCH))
    found = [find_layer([surfaces[k] for k in part]) for part in parts]
    layers = [one for one in found if one is not None]
    if not layers:
        return cloud, labels, None
    z, out = cloud.z_mm.astype(np.float64), labels.copy()
    for number, part in enumerate(parts):
        possible = [one for one in found[max(number - 1, 0) : number + 2] if one is not None]
        for k in part if possible else ():
            one = surfaces[k]
            fits = [_fit(one, layer) for layer in (None, *possible)]
            height, on_layer, level, _ = min(fits, key=lambda fit: fit[-1])
            if height == 0.0:
                continue
            z[k, one.columns[on_layer]] += up * height / one.cosine
            on = (one.away_mm > TRIM_MM) & (np.abs(one.above_mm - level) < 0.5 * ON_MM)
            before = out[k, one.columns]
            out[k, one.columns] = np.where(on, label, np.where(before == label, 0, before))
    return replace(cloud, z_mm=z.astype(cloud.z_mm.dtype)), out, layers[0]


def _fit(of: Surface, layer: Layer | None) -> tuple[float, Bool, Float, float]:
    """Height of a profile's strip over its layer, the returns on that, the levels of all, and what these leave."""
    on_layer = of.away_mm > (0.0 if layer is None else layer.from_mm)
    height = 0.0 if layer is None else layer.height_mm
    step = np.where(on_layer, 0.0, height)
    use = (of.away_mm > TRIM_MM) & (np.abs(of.above_mm) < MOST_MM)
    line = np.polyfit(of.away_mm[use], (of.above_mm - step)[use], 1)
    level = np.asarray(np.polyval(line, of.away_mm) + step, dtype=np.float64)
    return height, on_layer, level, float(np.sqrt(np.mean((of.above_mm - level)[use] ** 2)))


def _mean(surfaces: Sequence[Surface]) -> tuple[Float, Float]:
    """Distances from the edge, and the median height there over the profiles, where most of these return."""
    far = float(np.median([one.away_mm[-1] for one in surfaces]))
    away, above = (np.concatenate(of) for of in zip(*((one.away_mm, one.above_mm) for one in surfaces), strict=True))
    near = np.abs(above) < MOST_MM
    number = np.floor((away[near] - TRIM_MM) / BIN_MM)
    shown = {k: above[near][number == k] for k in np.arange(0.0, (far - TRIM_MM) / BIN_MM)}
    seen = {k: float(np.median(one)) for k, one in shown.items() if one.size > 0.5 * len(surfaces)}
    return TRIM_MM + BIN_MM * (np.array([*seen]) + 0.5), np.array([*seen.values()])


def _left(model: Float, value: Float) -> tuple[Float, float]:
    """The model's coefficients, and the rms that it leaves."""
    found, *_ = np.linalg.lstsq(model, value, rcond=None)
    return np.asarray(found, dtype=np.float64), float(np.sqrt(np.mean((value - model @ found) ** 2)))
