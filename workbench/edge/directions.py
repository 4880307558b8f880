"""Small helpers on directions of faces, frame by frame."""

from __future__ import annotations

import numpy as np

from workbench.geometry.faces import FaceLines
from workbench.units import Float, Int

SLOPE_MM = 4.0  # a face's slope is averaged over this much edge, to linearise a frame's own about it
LEG_FRAMES = 2000  # of a pass, by which it is looked at for where it turns back


def wrapped(angle: Float) -> Float:
    """Angle in (-pi, pi]."""
    return np.asarray(-((-angle + np.pi) % (2.0 * np.pi) - np.pi))


def near_slope(face: FaceLines, s: Float, pass_index: Int) -> Float:
    """Slope dz/dx of a face at each frame (N,), from the frames within a few mm on the same way along the edge.

    On the way back a scanner that sways holds another orientation at the same place.
    """
    pass_index = _legs(s, pass_index)
    slope, out = face.sxz / face.sxx, np.full(s.shape, np.nan)
    on = np.isfinite(s) & np.isfinite(slope)
    if not on.any():
        return out
    block = np.floor(s[on] / SLOPE_MM).astype(np.int64)
    key = pass_index[on].astype(np.int64) * (int(np.ptp(block)) + 10) + block - block.min()
    _, number = np.unique(key, return_inverse=True)
    order = np.lexsort((slope[on], number))
    first = np.flatnonzero(np.diff(number[order], prepend=-1))
    count = np.diff(np.append(first, order.size))
    middle = slope[on][order[first + count // 2]]  # the median withstands a stray frame
    place = np.bincount(number, s[on]) / count
    of_pass = pass_index[on][order[first]]
    for p in np.unique(of_pass):
        mine, here = of_pass == p, on & (pass_index == p)
        rising = np.argsort(place[mine])
        out[here] = np.interp(s[here], place[mine][rising], middle[mine][rising])
    return out


def _legs(s: Float, pass_index: Int) -> Int:
    """Numbers (N,) of the stretches of passes without a turn back, of frames at s (N,) in order of time."""
    out, number = np.zeros(s.size, np.int64), 0
    for p in np.unique(pass_index):
        mine = np.flatnonzero(pass_index == p)
        seen = mine[np.isfinite(s[mine])]
        turns, way, first, far = [], 0.0, np.nan, 0
        for i in seen[:: max(1, seen.size // LEG_FRAMES)]:
            first = s[i] if np.isnan(first) else first
            if way == 0.0:
                way = float(np.sign(s[i] - first)) if abs(s[i] - first) > SLOPE_MM else 0.0
                far = i
            elif (s[i] - s[far]) * way > 0.0:
                far = i
            elif (s[far] - s[i]) * way > SLOPE_MM:
                turns.append(int(far))
                way, far = -way, i
        out[mine] = number + np.searchsorted(turns, mine, side="right")
        number += len(turns) + 1
    return out
