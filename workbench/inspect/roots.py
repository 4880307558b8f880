"""The root size along the edge, with its uncertainty."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Edge
from workbench.geometry.ends import GRID, end_log_likelihood, pooled_end
from workbench.geometry.smoothing import local_polynomial, robust_weights
from workbench.inspect.angles import BevelAngles
from workbench.units import Float, Int


@dataclass(frozen=True, slots=True, eq=False)
class RootSizes:
    """Root size at m places of the edge."""

    root_mm: Float  # (m,) NaN where not measured
    u_mm: Float  # (m,) standard uncertainty


def root_sizes(edge: Edge, at_mm: Float, half_width_mm: float, angles: BevelAngles) -> RootSizes:
    """Root size at arc lengths at_mm (m,), from the frames within half_width_mm.

    Each frame measures from its own corner of root face and bevel face, so vibration and robot error cancel; where the
    lower edge is a silhouette, the likelihoods of all frames near the place are multiplied.
    """
    f = edge.frames
    frames = np.flatnonzero(np.isfinite(f.root_low_mm) & np.isfinite(f.arc_length_mm) & np.isfinite(f.root_sigma_mm))
    frames = frames[np.argsort(f.arc_length_mm[frames], kind="stable")]
    s, low, step = f.arc_length_mm[frames], f.root_low_mm[frames], f.root_step_mm[frames]
    middle, variance = low + 0.5 * step, f.root_sigma_mm[frames] ** 2 + step**2 / 12.0
    stations = np.linspace(s[0], s[-1], max(3, int(s[-1] - s[0]) + 2))
    kept = robust_weights(s, middle, 1.0 / variance, half_width_mm, stations)
    trend = local_polynomial(s, middle, kept, stations, half_width_mm)[:, 0]
    good = np.isfinite(trend)
    expected = np.interp(s, stations[good], trend[good])
    sigma = _widened(edge, frames, middle - expected, kept > 0)
    reach = max(2.5 * float(np.median(step)), 6.0 * float(np.median(sigma)), 0.02)
    grid = np.linspace(-reach, reach, GRID)
    likelihood = end_log_likelihood(low - expected, step, sigma, f.missing[frames], grid)
    pooled = pooled_end(s, likelihood, at_mm, half_width_mm, grid)
    root = np.interp(at_mm, stations[good], trend[good]) + pooled[:, 0]
    lever = np.interp(at_mm, s, f.bevel_lever_mm[frames])
    cot = 1.0 / np.tan(angles.bevel)
    shared = np.hypot(lever / np.sin(angles.bevel) * angles.local_u, 0.5 * root * np.abs(cot) * angles.tilt_u)
    return RootSizes(root, np.hypot(pooled[:, 1], shared))


def _widened(edge: Edge, frames: Int, off_mm: Float, used: np.ndarray) -> Float:
    """Noise of each frame's root size (n,), mm, raised where the frames scatter more than column step and noise say."""
    f = edge.frames
    sigma, step = f.root_sigma_mm[frames].copy(), f.root_step_mm[frames]
    for p in np.unique(edge.pass_index[frames]):
        mine = (edge.pass_index[frames] == p) & used
        if mine.sum() < 8:
            continue
        missing = float(np.median(f.missing[frames][mine]))
        steps = np.mean(step[mine] ** 2) * (1.0 / 12.0 + missing / (1.0 - missing) ** 2)
        found = np.mean(off_mm[mine] ** 2)
        mean_variance = float(np.mean(sigma[mine] ** 2))
        sigma[edge.pass_index[frames] == p] *= np.sqrt(max(found - steps, mean_variance) / mean_variance)
    return sigma
