"""The fillet of a J preparation: a circle that touches the flank above it and the land, or the root's level, below it.

In the axes of the upper surface (x outwards from the upper corner, y out of the plate) the flank is known: it starts at
(0, 0) and falls by phi. Level and land are the line through (0, -h) at the angle delta, nearly parallel to the upper
surface. A circle of radius R that touches both from the open side has its centre at c, with

    c . (sin phi, cos phi) = R,    c . (-sin delta, cos delta) = R - h cos delta,

so that a fillet with its flank and its land has three unknowns: h, R and delta.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from workbench.edge.groove_form import repeated_mm
from workbench.units import DEG, Float, Shaped

LAND_TILT = 2.0 * DEG  # standard deviation of delta before anything is seen of it
LEAST_POINTS = 12
LOSS_SIGMAS = 3.0
SHARP_MM = 0.5  # radius of a fillet that passes for a corner: corners of cutters have up to 0.4
SMALLEST_MM, LARGEST_MM = 0.3, 40.0  # radius
STEPS = 40
RUNS = 12  # of points along flank, fillet and land


@dataclass(frozen=True, slots=True)
class Fillet:
    """One profile's fillet, in the axes of the upper surface."""

    level_mm: float  # h
    radius_mm: float  # R
    tilt: float  # delta, rad
    covariance: Shaped[Float, "3 3"]  # of level, radius and tilt: by noise
    rms_mm: float
    left_mm: Shaped[Float, " RUNS"]  # mean of what is left in runs of equally many points, from the flank on
    by_run: Shaped[Float, "3 3"]  # covariance for runs that err by 1 mm, each on its own, mm^-2

    def form_u(self, x_mm: float) -> tuple[float, float, float]:
        """By how much the land's level at x, its tilt and the radius err where every run does by 1 mm, rms."""
        at = np.array([[1.0, 0.0, -x_mm], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])
        level, tilt, radius = np.sqrt(np.einsum("ki,ij,kj->k", at, self.by_run, at)).tolist()
        return level, tilt, radius

    def tangent(self, fall: float) -> Float:
        """Where the circle touches the land (2,)."""
        centre = _centre(self.level_mm, self.radius_mm, self.tilt, fall)
        return centre - self.radius_mm * np.array([-math.sin(self.tilt), math.cos(self.tilt)])

    def flank_mm(self, fall: float) -> float:
        """Length of the flank, down to where the circle touches it."""
        centre = _centre(self.level_mm, self.radius_mm, self.tilt, fall)
        return float(centre @ [math.cos(fall), -math.sin(fall)])


def fit_fillet(points: Float, fall: float, sigma_mm: float, start: Fillet | None) -> Fillet | None:
    """The fillet of points (n, 2) on flank, fillet and land; fall: of the flank, rad. None: they do not fix one."""
    if len(points) < LEAST_POINTS:
        return None
    lowest = -float(np.quantile(points[:, 1], 0.1))
    begins = [(lowest, radius, 0.0) for radius in (SHARP_MM, 0.5 * lowest)]
    if start is not None:
        begins = [(start.level_mm, start.radius_mm, start.tilt)]

    def away(unknown: Float) -> Float:
        return np.append(_away(points, unknown, fall) / sigma_mm, unknown[2] / LAND_TILT)

    best = None
    for begin in begins:
        found = scipy.optimize.least_squares(
            away, begin, loss="soft_l1", f_scale=LOSS_SIGMAS, x_scale=[0.1, 0.3, 0.01], max_nfev=STEPS
        )
        if best is None or found.cost < best.cost:
            best = found
    if best is None or not SMALLEST_MM < best.x[1] < LARGEST_MM:
        return None
    left = _away(points, best.x, fall)
    rms = 1.4826 * float(np.median(np.abs(left)))
    try:
        covariance = np.linalg.inv(best.jac.T @ best.jac) * max(rms / sigma_mm, 1.0) ** 2
    except np.linalg.LinAlgError:
        return None
    level, radius, tilt = (float(v) for v in best.x)
    runs = np.array_split(left[np.argsort(points[:, 0])], RUNS)
    by_run = covariance * len(points) / RUNS / max(rms, sigma_mm) ** 2
    return Fillet(level, radius, tilt, covariance, rms, np.array([np.mean(run) for run in runs]), by_run)


def misfit_mm(fillets: Sequence[Fillet]) -> float:
    """How far flanks and fillets stand off their lines and circles in the same way in all profiles, rms."""
    return repeated_mm(np.array([one.left_mm for one in fillets]))


def _centre(level: float, radius: float, tilt: float, fall: float) -> Float:
    rows = np.array([[math.sin(fall), math.cos(fall)], [-math.sin(tilt), math.cos(tilt)]])
    return np.linalg.solve(rows, np.array([radius, radius - level * math.cos(tilt)]))


def _away(points: Float, unknown: Float, fall: float) -> Float:
    """Distance (n,) of points from flank, circle or land, counted into the open."""
    level, radius, tilt = (float(v) for v in unknown)
    centre = _centre(level, radius, tilt, fall)
    down, onward = np.array([math.cos(fall), -math.sin(fall)]), np.array([math.cos(tilt), math.sin(tilt)])
    off = points - centre
    of_flank = points @ np.array([math.sin(fall), math.cos(fall)])
    of_land = points @ np.array([-math.sin(tilt), math.cos(tilt)]) + level * math.cos(tilt)
    round_ = radius - np.hypot(off[:, 0], off[:, 1])
    return np.asarray(np.where(off @ down < 0.0, of_flank, np.where(off @ onward > 0.0, of_land, round_)))
