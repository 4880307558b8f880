"""A corner within what is taken for one straight face: a compound bevel whose two angles differ by little."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Cloud
from workbench.checks.corners import face_columns, fitted_line, frames_with, off_line
from workbench.geometry.blocks import as_input
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Float32

FRAMES, LEAST_FRAMES = 120, 4  # evenly, that show the face
PLACES, LEAST_PLACES = 36, 12  # on the face, from end to end; each holds a return of most frames
SEEN = 0.5  # share of the frames in which a place is seen
NEXT = 2  # places at the least on each side of a corner
SURE = 2.5  # times what two straight pieces leave in squares: by how much less it is than what a parabola leaves
MEDIAN_U = 1.2533  # standard uncertainty of a median over that of a mean
SURE_U = 6.0  # of them, that make a corner certain: 30 compound bevels have 35 and more, noise that columns share 4
BESIDE = 0.02  # of its width, within which a face with a corner of up to 4.5 deg stays beside its line
LEAST_MM = 3e-4  # rms of what is left: no sensor knows its own errors better


class Bend(NamedTuple):
    """The corner within a face that its returns show for certain."""

    turn: float = 0.0  # between the two straight pieces, rad; 0: none is certain
    at: float = 0.5  # its place, a share of the face's width


def bend_of(cloud: Cloud, labels: AnyArray, label: int) -> Bend:
    """The corner within the face that has a label in `labels` (N, M) of a cloud.

    What its line leaves is taken by places on the face, the median of the frames, and fitted by a parabola and by two
    straight pieces: a bow, a sensor's own error or a step is no corner (docs/method.md, (11b)).
    """
    rows = frames_with(labels, [label], FRAMES)
    if len(rows) < LEAST_FRAMES:
        return Bend()
    counts = ((labels[rows] == label) & cloud.keep[rows]).sum(axis=1)
    places = min(PLACES, int(np.median(counts)))
    if places < LEAST_PLACES:
        return Bend()
    left, width = np.full((len(rows), places), np.nan), np.full(len(rows), np.nan)
    x, z, keep = (as_input(grid[rows]) for grid in (cloud.x_mm, cloud.z_mm, cloud.keep))
    _left(x, z, keep, as_input(labels[rows]), label, left, width)
    left, width = left[np.isfinite(width)], width[np.isfinite(width)]
    seen = np.isfinite(left).mean(axis=0) > SEEN if len(left) >= LEAST_FRAMES else np.zeros(places, bool)
    seen[[0, -1]] = False  # they may see half of something else
    if seen.sum() < LEAST_PLACES - 2:
        return Bend()
    return _corner((np.flatnonzero(seen) + 0.5) / places, left[:, seen], float(np.median(width)))


def _corner(place: Float, of_frames_mm: Float, width_mm: float) -> Bend:
    """The corner of what is left in f frames (f, k) of a face at places (k,), shares of its width.

    Noise that neighbouring columns share makes smooth shapes too: frames tell by their scatter how large.
    """
    left_mm = np.nanmedian(of_frames_mm, axis=0)
    line = np.linalg.qr(np.stack([np.ones_like(place), place], axis=1))[0]
    ats = place[NEXT:-NEXT]
    shapes = np.concatenate([[place**2], np.maximum(place - ats[:, None], 0.0)])  # a parabola's, and each corner's
    shapes -= shapes @ line @ line.T
    off = left_mm - line @ (line.T @ left_mm)
    along, size = shapes @ off, (shapes**2).sum(axis=1)
    rest = off @ off - along**2 / size
    best = 1 + int(rest[1:].argmin())
    if rest[0] - rest[best] < SURE * (rest[best] + len(place) * LEAST_MM**2):
        return Bend()
    turns = np.nan_to_num(of_frames_mm - left_mm) @ shapes[best] / size[best]
    u = MEDIAN_U * float(np.median(np.abs(turns))) / 0.6745 / math.sqrt(len(turns))
    turn = along[best] / size[best]
    return Bend(math.atan(turn / width_mm), float(ats[best - 1])) if abs(turn) > SURE_U * u else Bend()


@kernel
def _left(x: Float32, z: Float32, keep: Bool, labels: AnyArray, label: int, left: Float, width: Float) -> None:
    """Fill in for some frames what the line of a face leaves by places (n, p), mm, and the face's width (n,)."""
    columns, places = x.shape[1], left.shape[1]
    on, off, line = np.empty(columns, np.int64), np.empty(columns), np.empty(5)
    total, count = np.empty(places), np.empty(places)
    for i in range(len(x)):
        size = face_columns(keep[i], labels[i], label, on)
        if size < LEAST_PLACES:
            continue
        stray = fitted_line(x[i], z[i], on[:size], off, line)
        first, last = np.inf, -np.inf
        for k in range(size):
            along = (x[i, on[k]] - line[0]) * line[2] + (z[i, on[k]] - line[1]) * line[3]
            first, last = min(first, along), max(last, along)
        stray = max(stray, BESIDE * (last - first))
        total[:], count[:] = 0.0, 0.0
        for k in range(size):
            if off[k] <= stray:
                a, b = float(x[i, on[k]]), float(z[i, on[k]])
                along = (a - line[0]) * line[2] + (b - line[1]) * line[3]
                place = min(int((along - first) / max(last - first, 1e-9) * places), places - 1)
                total[place] += off_line(line, a, b)
                count[place] += 1.0
        for k in range(places):
            if count[k] > 0.0:
                left[i, k] = total[k] / count[k]
        width[i] = last - first
