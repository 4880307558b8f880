"""The lines (dexels) on which a part's material is counted while it is milled: normal to a bevel plane."""

from __future__ import annotations

import math

import numpy as np

from workbench.synthetic import raycast
from workbench.synthetic.dexels import Lines
from workbench.synthetic.surface import course_values, edge_frames
from workbench.synthetic.workpiece import Cut
from workbench.units import Float

U_STEP_MM, W_STEP_MM = 0.2, 0.1
_BESIDE_MM = 1.5  # lines lie so far beyond the face at its two edges
_ABOVE_MM = 2.0  # what is this far above the highest place that the stock can have is clear of it
_NEAR_MM = 0.05  # a ray starts this far above the highest place that its line can have


def new_cut(surface: raycast.Surface, root_mm: float, bevel: float) -> Cut:
    """Nothing cut yet: lines from beyond the root face's lower edge to beyond the bevel's upper edge."""
    columns, upwards = math.ceil(surface.length / U_STEP_MM) + 1, surface.tilt_cos * math.cos(bevel)
    upper_edge = (surface.top - surface.tilt_cos * root_mm) / (upwards + surface.tilt_sin * math.sin(bevel))
    first = -root_mm * math.cos(bevel) - _BESIDE_MM
    rows = max(2, math.ceil((upper_edge + _BESIDE_MM - first) / W_STEP_MM) + 1)
    uncut = np.full((columns, rows), np.inf)
    return Cut(uncut, uncut, surface.length / (columns - 1), first, W_STEP_MM, root_mm, bevel, 0)


def lines_of(surface: raycast.Surface, cut: Cut) -> Lines:
    """The lines in the part's frame, and where each leaves the part through the lower surface."""
    edge, cosine, sine = edge_frames(surface, cut.u), math.cos(cut.bevel), math.sin(cut.bevel)
    outward, up = edge[:, :3, 0], edge[:, :3, 2]
    n = surface.tilt_cos * outward - surface.tilt_sin * up
    m = surface.tilt_cos * up + surface.tilt_sin * outward
    base, across, normal = edge[:, :3, 3] + cut.root_mm * m, cosine * m - sine * n, cosine * n + sine * m
    floor = np.full(len(cut.w_mm), -np.inf)
    if normal[0, 2] > 0.0:  # else the lines leave the part elsewhere
        through = cut.w_mm > -cut.root_mm * cosine  # the others pass beside it
        floor[through] = -(base[0, 2] + cut.w_mm[through] * across[0, 2]) / normal[0, 2]
    return Lines(base, across, normal, cut.w_first_mm, cut.w_step_mm, floor)


def ceiling_mm(surface: raycast.Surface, cut: Cut) -> float:
    """A height over the bevel plane that no material reaches."""
    corner = math.sin(cut.bevel) * (surface.top / surface.tilt_cos - cut.root_mm)
    return max(corner, 0.0) + surface.reserve + _ABOVE_MM


def raw_heights_mm(surface: raycast.Surface, cut: Cut, lines: Lines) -> Float:
    """Height (U, W) at which each line, from above, meets the raw part; -inf where it misses it."""
    start = _smooth_heights(surface, cut, lines) + surface.reserve + _NEAR_MM
    origins = lines.base[:, None] + cut.w_mm[:, None] * lines.across[:, None] + start[:, :, None] * lines.up[:, None]
    down = np.broadcast_to(-lines.up[:, None], origins.shape)
    found = raycast.drop(surface, origins.reshape(-1, 3), down.reshape(-1, 3), 2.0 * (surface.reserve + _NEAR_MM))
    return np.asarray(start - found.reshape(start.shape))


def _smooth_heights(surface: raycast.Surface, cut: Cut, lines: Lines) -> Float:
    """As `raw_heights_mm`, without roughness and burrs: where each line crosses the end face or the upper surface."""
    rise = lines.up[0, 2]
    height = np.asarray(np.broadcast_to(cut.w_mm * math.tan(cut.bevel), (len(cut.u), len(cut.w_mm))))
    if rise <= 0.0:  # the end face leans further than the bevel
        return height
    thickness = course_values(surface.thickness, cut.u)
    above = lines.base[:, 2, None] + cut.w_mm * lines.across[:, 2, None]
    return np.asarray(np.minimum(height, (thickness[:, None] - above) / rise))
