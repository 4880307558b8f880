"""Profiles in the order of their columns, and what it costs where they do not show the order of frames.

Of frames that were shuffled every size scatters about a smooth course that is none of its own: at a place it is known
no better than single profiles scatter. Where neighbouring profiles are alike, scatter beyond their noise is texture.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.artefacts import Cloud
from workbench.geometry.along import by_pass
from workbench.geometry.medians import robust_sd
from workbench.units import Bool, Float, Int


def scatter(left: Float, variance: Float) -> float:
    """Standard deviation of single profiles about their course, by what it leaves (n,), beyond their stated noise."""
    good = np.isfinite(left) & np.isfinite(variance)
    if not good.any():
        return 0.0
    found = robust_sd(left[good])
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
    for mine in by_pass(cloud.pass_index):
        # The normal of the laser plane, x from left to right and z both as in the first frame, keeps its sense.
        same = float((np.cross(ez[mine], ex[mine]) @ np.cross(ez[0], ex[0])).mean())
        out[mine] = 1.0 if same >= 0 else -1.0
    return out


def left_out(pass_index: Int, used: Bool) -> tuple[str, ...]:
    """Of passes without a frame that is `used` (N,), in words."""
    passes = np.unique(pass_index)
    unused = [str(k) for k, one in enumerate(passes, 1) if not used[pass_index == one].any()]
    if not unused:
        return ()
    which = f"pass{'es' if len(unused) > 1 else ''} {', '.join(unused)} of {passes.size}"
    return (f"{which} left out: no profile there shows all faces that are measured",)
