"""The least uncertainty that range noise and the number of returns allow (formulae: docs/metrology.md).

Frames may be shifted as they like (the robot's errors), so only what each frame says by itself counts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.special import ndtr

from bench.metrology.information import ALONG, CENTRE, COUNT, LEAN, LOWEST, OFFSET, SLOPE, STEP, Frames
from workbench.synthetic import Recipe, raycast
from workbench.synthetic.workpiece import build_surface
from workbench.units import DEG, Bool, Float

WINDOW_MM = 10.0  # half width of the stretch of edge whose frames count for a section
LEAST_POINTS = 5  # on a face, for a frame to count
NODES, REACH_SDS = 241, 6.0  # of the grid on which a posterior is taken


@dataclass(frozen=True, slots=True, eq=False)
class Bounds:
    """Standard uncertainties that cannot be undercut, at m sections; infinite where nothing is seen."""

    root_mm: Float  # (m,)
    bevel_deg: Float  # (m,)


def bounds_at(recipe: Recipe, frames: Frames, at_mm: Float) -> Bounds:
    """Bounds at the places `at_mm` (m,) (u of the recipe's part)."""
    found = [_at(recipe, frames, float(u)) for u in at_mm]
    return Bounds(np.array([root for root, _ in found]), np.array([bevel for _, bevel in found]) / DEG)


def _at(recipe: Recipe, frames: Frames, u: float) -> tuple[float, float]:
    """Bounds of root face (mm) and bevel angle (rad) at u."""
    seen = (frames.root[:, COUNT] >= LEAST_POINTS) & (frames.bevel[:, COUNT] >= LEAST_POINTS)
    near = seen & (np.abs(frames.bevel[:, ALONG] - u) <= WINDOW_MM)
    if not near.any():
        return math.inf, math.inf
    information, tilt_information = 0.0, 0.0
    for number in np.unique(frames.pass_index[near]):
        mine = frames.pass_index == number
        tilt = float(
            frames.root[seen & mine, SLOPE].sum()
        )  # one direction of the root face a pass, from all its frames
        bevel = float(frames.bevel[near & mine, SLOPE].sum())
        information += 1.0 / (1.0 / tilt + 1.0 / bevel)
        tilt_information += tilt
    bevel_u = 1.0 / math.sqrt(float(frames.bevel[near, SLOPE].sum()))
    return _root_bound(recipe, frames, seen, u, bevel_u, tilt_information**-0.5), information**-0.5


def _root_bound(recipe: Recipe, frames: Frames, seen: Bool, u: float, bevel_u: float, tilt_u: float) -> float:
    """Bound of the root face at u (mm), the directions of bevel face and root face being known to bevel_u, tilt_u."""
    surface = build_surface(recipe.part, recipe.seed)
    size, bevel = raycast.course(surface.root, u)[0], raycast.course(surface.bevel, u)[0]
    near = seen & (np.abs(frames.root[:, ALONG] - u) <= WINDOW_MM)
    root, face, lower, ends = frames.root[near], frames.bevel[near], frames.lower[near], frames.ends[near]
    corner = lower[:, COUNT] >= LEAST_POINTS
    known = corner | (ends[:, LOWEST] <= ends[:, STEP])  # else something hides the end
    if not known.any():
        return math.inf
    # how far upper and lower end slide along the root face when it is shifted along its normal
    up, down = -1.0 / math.tan(bevel), np.where(corner, surface.tilt_sin / surface.tilt_cos, ends[:, LEAN])
    variance = (up - down) ** 2 / root[:, OFFSET] + 1.0 / (math.sin(bevel) ** 2 * face[:, OFFSET])
    variance[corner] += 1.0 / (surface.tilt_cos**2 * lower[corner, OFFSET])
    low, step = np.where(corner, 0.0, -ends[:, LOWEST]), np.where(corner, 0.0, ends[:, STEP])
    end = posterior_sd(low[known], step[known], np.sqrt(variance[known]))
    by_bevel = float(face[:, CENTRE].mean()) / math.sin(bevel) * bevel_u
    by_tilt = 0.5 * size * (up + float(down[known].mean())) * tilt_u  # turned about its middle
    return math.sqrt(end**2 + by_bevel**2 + by_tilt**2)


def posterior_sd(low: Float, step: Float, sigma: Float) -> float:
    """Standard deviation of a length of which frame i says: within [low_i, low_i + step_i], blurred by sigma_i.

    A step of 0 is a plain measure. Lengths count from the truth, the data are taken without their noise, the prior is
    flat. With plain measures alone this is the Cramer-Rao bound.
    """
    centre, half = 0.0, float(np.max(step) + REACH_SDS * np.max(sigma))
    a, w, s = low[:, None], step[:, None], sigma[:, None]
    while True:
        r = np.linspace(centre - half, centre + half, NODES)
        inside = np.log(np.maximum(ndtr((r - a) / s) - ndtr((r - a - w) / s), 1e-300))
        log = np.where(w > 0, inside, -0.5 * ((r - a) / s) ** 2).sum(axis=0)
        p = np.exp(log - log.max())
        p /= p.sum()
        centre = float(p @ r)
        sd = math.sqrt(float(p @ (r - centre) ** 2))
        if sd > half / (2.0 * REACH_SDS):
            return sd
        half = max(REACH_SDS * sd, half / 20.0)
