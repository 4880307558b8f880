"""Small helpers on directions of faces, and on what else frames show along the edge."""

from __future__ import annotations

import math

import numpy as np

from workbench.geometry.along import by_pass, in_order, near, running_median
from workbench.geometry.chains import FaceLines
from workbench.geometry.course import HIDDEN_MM
from workbench.units import Float, Int

# A rough face: directions of frames SHARED_LAG_MM apart go together by SHARED_SIGMAS and SHARED_LEAST. Texture does not
# reach so far, what a flame cut leaves does.
SHARED_LAG_MM, SHARED_SIGMAS, SHARED_LEAST = (0.7, 1.5), 3.0, 0.4
TOGETHER_MM = 10.0  # length over which the scatter of a rough face hangs together
LOCAL_MM = HIDDEN_MM  # nothing proves a course straight over it; a rough face is its least-squares plane
TREND = 3  # order of what a face may do over the whole edge without being rough
SLOPE_MM = 4.0  # a face's slope is averaged over this much edge, to linearise a frame's own about it


def wrapped(angle: Float) -> Float:
    """Angle in (-pi, pi]."""
    return np.asarray(-((-angle + np.pi) % (2.0 * np.pi) - np.pi))


def near_slope(face: FaceLines, s: Float, pass_index: Int) -> Float:
    """Slope dz/dx of a face at each frame (N,), from the frames of its pass within a few mm."""
    slope, out = face.slope, np.full(s.shape, np.nan)
    for mine in by_pass(pass_index, np.isfinite(s + slope)):
        at = np.arange(s[mine].min(), s[mine].max() + SLOPE_MM, SLOPE_MM)
        out[mine] = np.interp(s[mine], at, running_median(s[mine], slope[mine], at, 0.5 * SLOPE_MM))
    return out


def go_together(s: Float, angle: Float, variance: Float, pass_index: Int) -> bool:
    """Do the directions (N,) of frames at s (N,) go together over SHARED_LAG_MM, beside their mean over LOCAL_MM?

    variance (N,): of a direction by the range noise, which is left out of the share that has to go together.
    """
    product, square, noise, pairs = 0.0, 0.0, 0.0, 0
    for mine in by_pass(pass_index):
        on = mine[in_order(s[mine], angle[mine])]
        if on.size <= TREND:
            continue
        place, value = s[on], angle[on]
        value = value - np.polynomial.Polynomial.fit(place, value, TREND)(place)
        total = np.concatenate([[0.0], np.cumsum(value)])
        first, last = near(place, place, 0.5 * LOCAL_MM)
        off = value - (total[last] - total[first]) / np.maximum(last - first, 1)
        most = 4.0 * float(np.median(np.abs(off)))
        off = np.clip(off, -most, most)
        other = np.searchsorted(place, place + sum(SHARED_LAG_MM) / 2.0)
        paired = other < place.size
        far = place[np.minimum(other, place.size - 1)] - place
        paired &= (far >= SHARED_LAG_MM[0]) & (far <= SHARED_LAG_MM[1])
        product += float((off[paired] * off[other[paired]]).sum())
        square += float((off[paired] ** 2).sum())
        noise += float(variance[on][paired].sum())
        pairs += int(paired.sum())
    least = max(SHARED_SIGMAS / math.sqrt(max(pairs, 1)) * square, SHARED_LEAST * (square - noise))
    return pairs > 1 and product > least
