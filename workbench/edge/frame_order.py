"""Whether profiles show the order in which they were taken, and what it costs where they do not.

Of frames that were shuffled every size scatters about a smooth course that is none of its own: at a place it is known
no better than single profiles scatter. Where a part drifts through the view, or its sizes change along it, neighbouring
profiles are alike, and scatter beyond their noise is texture.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.artefacts import Cloud
from workbench.units import Float, Int

LEAST_FRAMES = 30  # of a pass, that tell
SURE_SIGMAS = 5.0  # by which neighbours differ less than any two profiles do
SPREAD = 0.78  # standard deviation of the mean of n neighbours' differences of ranks, over it and over 1 / sqrt(n)


def shows_order(values: Float, s: Float, group: Int) -> bool:
    """Whether any of values (n, k) of profiles at s (n,) mm of passes (n,) differs less between neighbours than at all.

    NaN is left out.
    """
    for number in np.unique(group):
        for column in values.T:
            mine = np.flatnonzero((group == number) & np.isfinite(column) & np.isfinite(s))
            if mine.size < LEAST_FRAMES:
                continue
            rank = _ranks(column[mine[np.argsort(s[mine], kind="stable")]])
            n = rank.size
            any_two = 2.0 * float(((2.0 * np.arange(n) - n + 1) * np.sort(rank)).sum()) / (n * (n - 1))
            if np.abs(np.diff(rank)).mean() < any_two * (1.0 - SURE_SIGMAS * SPREAD / math.sqrt(n)):
                return True
    return False


def _ranks(values: Float) -> Float:
    """Ranks (n,) from 1, of equal values their mean; scipy.stats has them too and takes half a second to load."""
    _, which, count = np.unique(values, return_inverse=True, return_counts=True)
    return np.asarray((np.cumsum(count) - 0.5 * (count - 1))[which])


def scatter(left: Float, variance: Float) -> float:
    """Standard deviation of single profiles about their course, by what it leaves (n,), beyond their stated noise."""
    good = np.isfinite(left) & np.isfinite(variance)
    if not good.any():
        return 0.0
    found = 1.4826 * float(np.median(np.abs(left[good])))
    return math.sqrt(max(found**2 - float(np.median(variance[good])), 0.0))


def profile(cloud: Cloud, i: int, flip: float = 1.0) -> tuple[Float, Float, Int]:
    """x (times `flip`) and z of the returns of frame i, and their columns, in whose order they are; x mostly rises.

    Under a fan, what lies far below a face that stands upright may have a smaller x than that.
    """
    column = np.flatnonzero(cloud.keep[i])
    x, z = flip * cloud.x_mm[i, column].astype(np.float64), cloud.z_mm[i, column].astype(np.float64)
    order = slice(None, None, -1 if x.size and x[-1] < x[0] else 1)
    return x[order], z[order], column[order]


def flips(cloud: Cloud) -> Float:
    """1 for each frame whose x runs as that of the first frame does, else -1."""
    ex, ez = cloud.base_from_profiler[:, :3, 0], cloud.base_from_profiler[:, :3, 2]
    out = np.ones(len(ex))
    for p in np.unique(cloud.pass_index):
        mine = cloud.pass_index == p
        # The normal of the laser plane, x from left to right and z both as in the first frame, keeps its sense.
        same = float((np.cross(ez[mine], ex[mine]) @ np.cross(ez[0], ex[0])).mean())
        out[mine] = 1.0 if same >= 0 else -1.0
    return out
