"""A layer on a part of an upper surface, which ends beside its edge: primer that was masked, scale that was ground off.

The corner of a joint is that of the bare strip. A strip is too narrow to tell a direction, the layer is not: both are
parallel, a step apart, as the mean of all profiles shows (docs/grooves.md).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy

from workbench.artefacts import Cloud
from workbench.edge.groove_profile import TRIM_MM
from workbench.units import Float, Int

STRETCH = 30  # profiles, whose mean is looked at
BIN_MM, LEAST_BINS = 0.1, 3  # of the distance from the edge; on either side of a step
BLUR_MM = 1.1 * BIN_MM  # beside a step returns belong to neither level
LEAST_MM, MOST_MM = 0.015, 0.5  # height of a layer
CLEAR = 6.0  # times what the step leaves of the mean, rms: the least height of one
BETTER = 0.35  # of what a bow or a bend leaves, that a step may leave
LAYER = (
    "about {:.1f} mm beside its edge the upper surface of the {} {} by {:.2f} mm towards that (primer that was masked, "
)
LAYER += "scale that came off?): its corner is that of the surface beside the edge"


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
    """The layer that the mean of the profiles shows; None: one level, straight, bowed or bent, explains it.

    Lines through either level, or both, tilt the profiles unlike: seen a second time, they lie level beside the step.
    """
    layer = _shown(surfaces)
    return None if layer is None else _shown([_levelled(one, layer) for one in surfaces])


def _shown(surfaces: Sequence[Surface]) -> Layer | None:
    at, mean = _mean(surfaces)
    if at.size < 3 * LEAST_BINS:
        return None
    starts = at[LEAST_BINS : at.size - LEAST_BINS + 1, None]
    of_steps = _left_beside((at < starts).astype(float), at, mean)
    from_mm, left = float(starts[of_steps.argmin(), 0] - 0.5 * BIN_MM), float(of_steps.min())
    clear = np.abs(at - from_mm) > BLUR_MM
    model = np.stack([np.ones_like(at), at, at < from_mm], axis=1)[clear]
    height = float(np.linalg.lstsq(model, mean[clear], rcond=None)[0][2])
    bends = np.maximum(starts - at, 0.0)  # an edge that is ground off, or rounded
    rival = float(_left_beside(np.vstack([at**2, bends]), at, mean).min())
    if not (LEAST_MM < abs(height) < MOST_MM and abs(height) > CLEAR * left and left < BETTER * rival):
        return None
    return Layer(from_mm, height)


def without_layers(
    cloud: Cloud, frames: Int, plates: Mapping[str, Sequence[Surface]], up: float
) -> tuple[Cloud, tuple[str, ...]]:
    """A cloud with the layers on upper surfaces lowered to the strips beside them, and what they are, in words.

    frames (n,): the profiles that show the n surfaces of each plate, by its name; up: 1 where z counts out of these.
    A layer may cover a part of the edge: each profile has that of a stretch beside it, or none, as leaves least.
    """
    z, keep, notes = cloud.z_mm.astype(np.float64), cloud.keep.copy(), list[str]()
    parts = np.array_split(np.arange(frames.size), max(1, frames.size // STRETCH))
    for name, surfaces in plates.items():
        found = [find_layer([surfaces[k] for k in part]) for part in parts]
        shown = [one for one in found if one is not None]
        for number, part in enumerate(parts if shown else ()):
            possible = [one for one in found[max(number - 1, 0) : number + 2] if one is not None]
            for k in part:
                one = surfaces[k]
                layer = min((None, *possible), key=partial(_left_by, one))
                if layer is not None:
                    beyond = one.away_mm - layer.from_mm
                    z[frames[k], one.columns[beyond > 0.0]] += up * layer.height_mm / one.cosine
                    keep[frames[k], one.columns[np.abs(beyond) < BLUR_MM]] = False
        if shown:
            goes = "falls" if shown[0].height_mm < 0.0 else "rises"
            notes.append(LAYER.format(shown[0].from_mm, name, goes, abs(shown[0].height_mm)))
    return (replace(cloud, z_mm=z.astype(cloud.z_mm.dtype), keep=keep) if notes else cloud), tuple(notes)


def _left_by(of: Surface, layer: Layer | None) -> float:
    """What a line with a layer on it leaves of a profile's surface, rms."""
    return _line(of, layer)[1]


def _levelled(of: Surface, layer: Layer) -> Surface:
    """A profile's surface above the line through both its levels."""
    offset, slope = _line(of, layer)[0]
    return of._replace(above_mm=of.above_mm - offset - slope * of.away_mm)


def _line(of: Surface, layer: Layer | None) -> tuple[Float, float]:
    """Offset and slope of the line through a profile's surface without its layer, and the rms that it leaves."""
    use = (of.away_mm > TRIM_MM) & (np.abs(of.above_mm) < MOST_MM)
    away, above = of.away_mm[use], of.above_mm[use]
    value = above if layer is None else above - layer.height_mm * (away <= layer.from_mm)
    base = np.stack([np.ones_like(away), away], axis=1)
    found = np.linalg.lstsq(base, value, rcond=None)[0]
    return np.asarray(found), float(np.sqrt(np.mean((value - base @ found) ** 2)))


def _mean(surfaces: Sequence[Surface]) -> tuple[Float, Float]:
    """Distances from the edge, and the median height there over the profiles, where most of these return."""
    far = float(np.median([one.away_mm[-1] for one in surfaces]))
    away, above = (np.concatenate(of) for of in zip(*((one.away_mm, one.above_mm) for one in surfaces), strict=True))
    near = np.abs(above) < MOST_MM
    number = np.floor((away[near] - TRIM_MM) / BIN_MM).astype(np.int64)
    bins = np.arange(math.ceil((far - TRIM_MM) / BIN_MM))
    seen = bins[np.bincount(number[number >= 0], minlength=bins.size)[: bins.size] > 0.5 * len(surfaces)]
    mean = scipy.ndimage.median(above[near], number, seen) if seen.size else seen
    return np.asarray(TRIM_MM + BIN_MM * (seen + 0.5), dtype=np.float64), np.asarray(mean, dtype=np.float64)


def _left_beside(shapes: Float, at: Float, value: Float) -> Float:
    """What a line beside each of some shapes (c, n) leaves of values (n,) at (n,), rms."""
    line, _ = np.linalg.qr(np.stack([np.ones_like(at), at], axis=1))
    own, off = shapes - shapes @ line @ line.T, value - line @ (line.T @ value)
    explained = (own @ off) ** 2 / np.maximum((own**2).sum(axis=1), 1e-12)
    return np.asarray(np.sqrt(np.maximum(off @ off - explained, 0.0) / value.size))
