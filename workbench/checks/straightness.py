"""Is a face straight? What its line leaves across its width: a bow, or a corner within it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Check, Cloud
from workbench.checks.corners import LEAST_FRAMES, face_columns, fitted_line, frames_with, off_line
from workbench.checks.limits import Bound, check
from workbench.geometry.blocks import as_input
from workbench.kernels import kernel
from workbench.units import DEG, MEDIAN_U, TO_SD, AnyArray, Bool, Float, Float32

FRAMES = 120  # evenly, that show the face
PLACES, LEAST_PLACES = 36, 8  # on the face, from end to end; each holds a return of most frames
TWO_PIECES = 12  # places at the least, that tell a corner
SEEN = 0.5  # share of the frames in which a place is seen
NEXT = 2  # places at the least on each side of a corner
BETTER = 2.5  # times what two straight pieces leave in squares: by how much less it is than what a parabola leaves
SURE_BOW = 3.0  # standard uncertainties by which a bow is one
SURE_CORNER = 6.0  # likewise a corner: 30 compound bevels have 35 and more, noise that columns share 4
STRETCHES = 8  # along the edge, whose sums tell what a rough face leaves: there neighbouring frames are alike
STRAY_SHARE = 0.02  # of its width, within which a face with a corner of up to 4.5 deg stays beside its line
LEAST_MM = 3e-4  # rms of what is left: no sensor knows its own errors better
ALONE = 45.0 * DEG  # turn of the corner beside a face of which it is not known: bevels have as much
NAMES = {ROOT_FACE: "root face", BEVEL_FACE: "bevel face"}


class Straightness(NamedTuple):
    """What the returns of a face show beside its line."""

    width_mm: float = 0.0
    bow_mm: float = 0.0  # height of the parabola through it over its chord
    bow_u_mm: float = 0.0
    turn: float = 0.0  # between two straight pieces that fit better, rad; 0: none do for certain
    at: float = 0.5  # place of their corner, a share of the width

    def of_arc(self, turn: float) -> float:
        """Its bow over that of a chord which makes a corner of `turn`, rad, by itself; 0 where none is certain.

        The two halves of one arc are chords that differ by d, rad; each bows by d / 8 of its width.
        """
        if abs(self.bow_mm) <= SURE_BOW * self.bow_u_mm or not turn > 0.0:
            return 0.0
        return 8.0 * abs(self.bow_mm) / self.width_mm / turn


def straightness(cloud: Cloud, labels: AnyArray, label: int) -> Straightness:
    """How straight the face is that has a label in `labels` (N, M) of a cloud.

    What its line leaves is taken by places on the face, the median of the frames, and fitted by a parabola and by two
    straight pieces: a bow, a sensor's own error or a step is no corner (docs/method.md, (11b)).
    """
    rows = frames_with(labels, [label], FRAMES)
    if len(rows) < LEAST_FRAMES:
        return Straightness()
    counts = ((labels[rows] == label) & cloud.keep[rows]).sum(axis=1)
    places = min(PLACES, int(np.median(counts)))
    if places < LEAST_PLACES:
        return Straightness()
    left, width = np.full((len(rows), places), np.nan), np.full(len(rows), np.nan)
    x, z, keep = (as_input(grid[rows]) for grid in (cloud.x_mm, cloud.z_mm, cloud.keep))
    _left(x, z, keep, as_input(labels[rows]), label, left, width)
    left, width = left[np.isfinite(width)], width[np.isfinite(width)]
    seen = np.isfinite(left).mean(axis=0) > SEEN if len(left) >= LEAST_FRAMES else np.zeros(places, bool)
    seen[[0, -1]] = False  # they may see half of something else
    if seen.sum() < LEAST_PLACES - 2:
        return Straightness()
    return _shape((np.flatnonzero(seen) + 0.5) / places, left[:, seen], float(np.median(width)))


def straight_checks(
    faces: Mapping[int, Straightness],
    turns: Mapping[int, float],
    resembles: str,
    limits: Mapping[str, Bound] | None = None,
) -> tuple[Check, Check]:
    """The checks that no face, by its label, bows as an arc does, and that none is two at an angle.

    turns: of the corner beside a face, rad; ALONE where it is with none. resembles: what a bowed one may be.
    """
    bow, label = max(((one.of_arc(turns.get(of, ALONE)), of) for of, one in faces.items()), default=(0.0, 0))
    share = abs(faces[label].bow_mm) / faces[label].width_mm if bow else 0.0
    round_ = f"what would be the {NAMES.get(label, 'face')} bows by {100 * share:.1f} % of its width, "
    round_ += f"{100 * bow:.0f} % of what makes the corner beside it by itself: {resembles}?"
    turn, at, label = max(((abs(one.turn) / DEG, one.at, of) for of, one in faces.items()), default=(0.0, 0.5, 0))
    bent = f"the {NAMES.get(label, 'face')} has a corner of {turn:.1f} deg at {100 * at:.0f} % of its width: "
    bent += "a compound bevel whose angles hardly differ, or a face that is not straight?"
    return check("face_bow", bow, round_, given=limits), check("face_bend_deg", turn, bent, given=limits)


def _shape(place: Float, of_frames_mm: Float, width_mm: float) -> Straightness:
    """Bow and corner of what is left in f frames (f, k) of a face at places (k,), shares of its width.

    Noise that neighbouring columns share makes smooth shapes too: frames tell by their scatter how large; of a rough
    face, stretches of the edge do.
    """
    left_mm = np.nanmedian(of_frames_mm, axis=0)
    line = np.linalg.qr(np.stack([np.ones_like(place), place], axis=1))[0]
    ats = place[NEXT:-NEXT]
    shapes = np.concatenate([[place**2], np.maximum(place - ats[:, None], 0.0)])  # a parabola's, and each corner's
    shapes -= shapes @ line @ line.T
    size = (shapes**2).sum(axis=1, keepdims=True)
    shares, off = shapes / size, left_mm - line @ (line.T @ left_mm)
    found, scattered = shares @ off, np.nan_to_num(of_frames_mm - left_mm) @ shares.T
    u = MEDIAN_U * np.median(np.abs(scattered), axis=0) * TO_SD / math.sqrt(len(scattered))
    rest = off @ off - found**2 * size[:, 0]
    bowed = Straightness(width_mm, float(found[0]) / 4.0, float(u[0]) / 4.0)
    best = 1 + int(rest[1:].argmin())
    better = rest[0] - rest[best] >= BETTER * (rest[best] + len(place) * LEAST_MM**2)
    lasting = math.hypot(*(one.sum() for one in np.array_split(scattered[:, best], STRETCHES))) / len(scattered)
    if len(place) < TWO_PIECES - 2 or not better or abs(found[best]) <= SURE_CORNER * max(u[best], lasting):
        return bowed
    return bowed._replace(turn=math.atan(found[best] / width_mm), at=float(ats[best - 1]))


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
        stray = max(stray, STRAY_SHARE * (last - first))
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
