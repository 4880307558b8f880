"""Small helpers on directions of faces, and on what else frames show along the edge."""

from __future__ import annotations

import math

import numpy as np

from workbench.geometry.chains import FaceLines
from workbench.geometry.course import stretches
from workbench.geometry.medians import medians
from workbench.units import Float, Int

# A rough face: directions of frames SHARED_LAG_MM apart go together by SHARED_SIGMAS and SHARED_LEAST. Texture does not
# reach so far, what a flame cut leaves does.
SHARED_LAG_MM, SHARED_SIGMAS, SHARED_LEAST = (0.7, 1.5), 3.0, 0.4
TOGETHER_MM = 10.0  # length over which the scatter of a rough face hangs together
LOCAL_MM = 20.0  # of edge, over which nothing proves a course straight; a rough face is its least-squares plane
TREND = 3  # order of what a face may do over the whole edge without being rough
SLOPE_MM = 4.0  # a face's slope is averaged over this much edge, to linearise a frame's own about it


def wrapped(angle: Float) -> Float:
    """Angle in (-pi, pi]."""
    return np.asarray(-((-angle + np.pi) % (2.0 * np.pi) - np.pi))


def between(s: Float, value: Float, at: Float) -> Float:
    """Values (N,) of frames at s (N,) mm at places (k,) between them; NaN is left out, without any it is 0."""
    on = np.flatnonzero(np.isfinite(s) & np.isfinite(value))
    if not on.size:
        return np.zeros(np.shape(at))
    order = on[np.argsort(s[on], kind="stable")]
    return np.interp(at, s[order], value[order])


def width_mm(face: FaceLines) -> float:
    """Width of a face along its lines, the median of the frames, as far as its points reach."""
    on = face.count > 2
    if not on.any():
        return math.nan
    lean = np.hypot(1.0, face.sxz[on] / face.sxx[on])
    return float(np.median(np.sqrt(12.0 * face.sxx[on] / face.count[on]) * lean))


def near_slope(face: FaceLines, s: Float, pass_index: Int) -> Float:
    """Slope dz/dx of a face at each frame (N,), from the frames of its pass within a few mm."""
    slope, out = face.sxz / face.sxx, np.full(s.shape, np.nan)
    on = np.isfinite(s) & np.isfinite(slope)
    if not on.any():
        return out
    block = stretches(s[on], SLOPE_MM)
    key = pass_index[on] * (int(block.max()) + 1) + block
    order = np.argsort(key, kind="stable")
    edges = np.flatnonzero(np.diff(key[order], prepend=-1, append=-1))
    middle = medians(slope[on][order], edges)  # the median withstands a stray frame
    place = np.add.reduceat(s[on][order], edges[:-1]) / np.diff(edges)
    of_pass = pass_index[on][order[edges[:-1]]]
    for p in np.unique(of_pass):
        mine, here = of_pass == p, on & (pass_index == p)
        rising = np.argsort(place[mine])
        out[here] = np.interp(s[here], place[mine][rising], middle[mine][rising])
    return out


def go_together(s: Float, angle: Float, variance: Float, pass_index: Int) -> bool:
    """Do the directions (N,) of frames at s (N,) go together over SHARED_LAG_MM, beside their mean over LOCAL_MM?

    variance (N,): of a direction by the range noise, which is left out of the share that has to go together.
    """
    product, square, noise, pairs = 0.0, 0.0, 0.0, 0
    for p in np.unique(pass_index):
        on = np.flatnonzero((pass_index == p) & np.isfinite(s) & np.isfinite(angle))
        on = on[np.argsort(s[on], kind="stable")]
        if on.size <= TREND:
            continue
        place, value = s[on], angle[on]
        value = value - np.polynomial.Polynomial.fit(place, value, TREND)(place)
        total = np.concatenate([[0.0], np.cumsum(value)])
        first = np.searchsorted(place, place - 0.5 * LOCAL_MM)
        last = np.searchsorted(place, place + 0.5 * LOCAL_MM, side="right")
        off = value - (total[last] - total[first]) / np.maximum(last - first, 1)
        most = 4.0 * float(np.median(np.abs(off)))
        off = np.clip(off, -most, most)
        other = np.searchsorted(place, place + sum(SHARED_LAG_MM) / 2.0)
        near = other < place.size
        far = place[np.minimum(other, place.size - 1)] - place
        near &= (far >= SHARED_LAG_MM[0]) & (far <= SHARED_LAG_MM[1])
        product += float((off[near] * off[other[near]]).sum())
        square += float((off[near] ** 2).sum())
        noise += float(variance[on][near].sum())
        pairs += int(near.sum())
    least = max(SHARED_SIGMAS / math.sqrt(max(pairs, 1)) * square, SHARED_LEAST * (square - noise))
    return pairs > 1 and product > least
