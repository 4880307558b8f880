"""How far the corner of root face and lower surface is rounded, where a view shows both (docs/method.md, section 3)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, Cloud
from workbench.edge.faces import TrackedFaces
from workbench.geometry.tracking import CORNER_MARGIN_MM
from workbench.units import Bool, Float, Shaped

SAMPLE_FRAMES, LEAST_FRAMES = 400, 20


class LowerFillet(NamedTuple):
    """The rounding of that corner; zeros where it is no larger than what lines of faces leave out anyway."""

    radius_mm: float
    rim_mm: float  # of the root face, along x, that is rounded


def lower_fillet(cloud: Cloud, tracked: TrackedFaces) -> LowerFillet:
    """The rounded corner of root face and lower surface in all frames that show both.

    A circle of radius R that touches two lines, which turn by t, begins R tan(t / 2) before their corner, and lies
    R (1 - cos(t / 2)) under both where it is as deep under the one as under the other.
    """
    root, bevel, lower = (tracked.faces[label] for label in (ROOT_FACE, BEVEL_FACE, LOWER_SURFACE))
    here = np.flatnonzero(tracked.end_is_corner & ~tracked.lies_on & (root.count > 2) & (lower.count > 2))
    if here.size < LEAST_FRAMES:
        return LowerFillet(0.0, 0.0)
    here = here[np.unique(np.linspace(0, here.size - 1, SAMPLE_FRAMES).round().astype(np.int64))]
    slope = {one: face.sxz[here] / face.sxx[here] for one, face in enumerate((root, lower, bevel))}
    side = tracked.side[here]
    sense = np.sign(side * (slope[0] - slope[2]))  # +1: z counts away from the sensor
    x = np.where(cloud.keep[here], cloud.x_mm[here].astype(np.float64), np.nan)
    along = side[:, None] * x
    under = [
        sense[:, None]
        * (cloud.z_mm[here] - (face.z_mean[here] + slope[k] * (x.T - face.x_mean[here])).T)
        / np.hypot(1.0, slope[k])[:, None]
        for k, face in enumerate((root, lower))
    ]
    between = (along > (side * root.x_mean[here])[:, None]) & (along < (side * lower.x_mean[here])[:, None])
    half = 0.5 * np.abs(np.arctan(slope[1]) - np.arctan(slope[0]))
    radius = _where_alike(along, under[0], under[1], between) / (1.0 - np.cos(half))
    length = radius * np.tan(half)
    if np.isfinite(length).sum() < LEAST_FRAMES or not np.nanmedian(length) > CORNER_MARGIN_MM:
        return LowerFillet(0.0, 0.0)
    return LowerFillet(float(np.nanmedian(radius)), float(np.nanmedian(length / np.hypot(1.0, slope[0]))))


def _where_alike(
    along: Shaped[Float, "f M"], first: Shaped[Float, "f M"], second: Shaped[Float, "f M"], on: Shaped[Bool, "f M"]
) -> Float:
    """The value (f,) that both take in the first place along a frame where the first is no longer the lesser one."""
    order = np.argsort(np.where(on, along, np.inf), axis=1)
    off = np.take_along_axis(np.where(on, first - second, -np.inf), order, axis=1)
    first = np.take_along_axis(first, order, axis=1)
    k = np.maximum((off > 0.0).argmax(axis=1), 1)
    row = np.arange(len(k))
    before, after = off[row, k - 1], off[row, k]
    with np.errstate(invalid="ignore", divide="ignore"):
        weight = -before / (after - before)
        value = (1.0 - weight) * first[row, k - 1] + weight * first[row, k]
    return np.where((before <= 0.0) & (after > 0.0), value, np.nan)
