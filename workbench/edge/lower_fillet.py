"""How far the corner of root face and lower surface is rounded, where a view shows both (docs/method.md, section 3)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, Cloud
from workbench.checks.sensor import column_pitch_mm
from workbench.checks.window import averaged_columns
from workbench.edge.faces import TrackedFaces
from workbench.geometry.blocks import evenly
from workbench.units import Bool, Float, Shaped

SAMPLE_FRAMES, LEAST_FRAMES = 400, 20
PROVEN = 2.0  # standard uncertainties of the depth, from which a corner is told to be rounded
# Of a column: where the light lies that it returns, of a surface that grazes the rays and is brighter on one side. A
# lower surface seen at 12 deg lay 0.15 of a column off (bench.simulators.triangulated).
LIT_COLUMNS = 0.1


class LowerFillet(NamedTuple):
    """What the frames that show both say of that corner."""

    depth_mm: float  # under both faces' lines, where it is as deep under the one as under the other
    depth_u_mm: float  # of a sharp corner as well: its returns lie on either side of it
    half_turn: float  # between both faces, rad
    radius_mm: float  # of a rounding so deep; 0 where a sharp corner would look alike
    rim_mm: float  # of the root face, along x, that is rounded; 0 likewise


def lower_fillet(cloud: Cloud, tracked: TrackedFaces) -> LowerFillet | None:
    """The rounded corner of root face and lower surface; None: too few frames show both.

    A circle of radius R that touches two lines, which turn by t, begins R tan(t / 2) before their corner, and lies
    R (1 - cos(t / 2)) under both where it is as deep under the one as under the other.
    """
    root, bevel, lower = (tracked.faces[label] for label in (ROOT_FACE, BEVEL_FACE, LOWER_SURFACE))
    here = np.flatnonzero(tracked.end_is_corner & ~tracked.lies_on & (root.count > 2) & (lower.count > 2))
    if here.size < LEAST_FRAMES:
        return None
    here = here[evenly(here.size, SAMPLE_FRAMES)]
    slope = {one: face.slope[here] for one, face in enumerate((root, lower, bevel))}
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
    depth, chord = _where_alike(along, under[0], under[1], between)
    on = np.isfinite(depth)
    if on.sum() < LEAST_FRAMES:
        return None
    half = 0.5 * np.abs(np.arctan(slope[1]) - np.arctan(slope[0]))[on]
    depth_mm, turn = float(np.median(depth[on])), float(np.median(half))
    slopes, lean = np.median([slope[0], slope[1]], axis=1), math.hypot(1.0, float(np.median(slope[0])))
    # A mean of ranges over a width across the corner lies deeper than it, by an eighth of both slopes' difference.
    mean = averaged_columns(cloud.checks) * column_pitch_mm(cloud.x_mm) * abs(float(np.diff(slopes)[0])) / (8.0 * lean)
    depth_u = math.hypot(float(np.median(chord[on])), mean) / math.sqrt(3.0)
    radius = depth_mm / (1.0 - math.cos(turn)) if depth_mm > PROVEN * depth_u else 0.0
    return LowerFillet(depth_mm, depth_u, turn, radius, radius * math.tan(turn) / lean)


def _where_alike(
    along: Shaped[Float, "f M"], first: Shaped[Float, "f M"], second: Shaped[Float, "f M"], on: Shaped[Bool, "f M"]
) -> tuple[Float, Float]:
    """The value (f,) that both take in the first place along a frame where the first is no longer the lesser one.

    And what it would be of a sharp corner that lies anywhere between the two returns beside that place, at most.
    """
    order = np.argsort(np.where(on, along, np.inf), axis=1)
    off = np.take_along_axis(np.where(on, first - second, -np.inf), order, axis=1)
    first = np.take_along_axis(first, order, axis=1)
    k = np.maximum((off > 0.0).argmax(axis=1), 1)
    row = np.arange(len(k))
    before, after = off[row, k - 1], off[row, k]
    rise = first[row, k] - first[row, k - 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        value = first[row, k - 1] - before / (after - before) * rise
        fall = after - before - rise
        chord = np.abs(rise * fall) / (np.abs(rise) + np.abs(fall))
    found = (before <= 0.0) & (after > 0.0)
    return np.where(found, value, np.nan), np.where(found, chord, np.nan)
