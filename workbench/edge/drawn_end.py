"""A free end that a burr draws out: returns beyond the face's edge that rise out of its line (docs/method.md, (12e)).

A worn cutter draws out more and more of the edge, so the burr is looked for in cells along it, whose neighbours have
about as much (a hidden Markov chain over where the line folds: Rabiner, Proceedings of the IEEE 77 (1989), 257).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
import scipy.special

from workbench.artefacts import Cloud
from workbench.edge.end_templates import free_depths
from workbench.edge.last_returns import (
    DEEP_MM,
    LEAST_FRAMES,
    LEAST_GROUPS,
    FaceRim,
    end_groups,
    last_returns,
    pattern_noise,
    sampled,
)
from workbench.geometry.course import fit_course
from workbench.geometry.medians import median
from workbench.units import TO_SD, Bool, Float, Int, Shaped

CELL_FRAMES, TOGETHER = 16, 4.0  # sampled frames of a cell; cells that share the error of a fold's place
RISE, RISE_SD = 0.27, 0.15  # tangent of a burr's lean out of the face
FOLDS, LEAST_COLUMNS, MOST_COLUMNS = 24, 0.5, 16.0  # places of a fold, so many columns before the end
BEGINS, ENDS = 1e-5, 0.01  # probability that a burr begins, and ends, from one cell to the next
CHANGES = 0.3  # usual change of the logarithm of its length from one cell to the next
HANGS, MISLED = 0.5, 0.2  # probability that a burr hangs on the edge, and that the ends' course does not tell it
CLEAN_MM = 0.05  # of a burr, up to which an end counts as the face's own, beside one here and there
LEAST_ALONG = 0.5  # share of the frames from which on a burr is one all along
FALLS = 0.1  # probability that a break makes the end fall
EVIDENT = 3.0  # columns: shorter burrs are the rarer, the shorter: no return tells them
INSIDE = 0.85  # of a face's width, where it is narrow: beyond lies the next face
BOWED = 0.2  # share of a usual bow by which cells of one face differ
BURRED = (
    "a burr of up to {:.2f} mm rises out of {}, {:.0f} to {:.0f} mm along it: it is not in the sizes, unless it stands "
    "on the face itself; what that leaves open is in u"
)
MIXED_MM = np.array([0.03, 0.01])  # by which optics have the last columns off: sheets of light, blur


class DrawnEnd(NamedTuple):
    """A burr that draws out the end of a face in N frames; 0 where there is none."""

    mm: Shaped[Float, " N"]  # its length along the face, up to the last return
    u_mm: Shaped[Float, " N"]
    hanging_mm: Shaped[Float, " N"]  # the face's edge beyond the last return on its line, if the burr hangs on it
    standing_mm: Shaped[Float, " N"]  # if it stands on the face
    alike: Shaped[Float, " N"]  # so many frames share the error of these
    rim_mm: float  # greatest length of the face, along x, that is a burr, where one is likely; 0: none

    def beside(self, seen: Bool) -> DrawnEnd:
        """The same, without the ends of burred frames where most of those `seen` (N,) have none: NaN.

        A burr here and there is told by the frames beside it. Of one all along, where it begins shows the end.
        """
        burred = np.hypot(self.mm, self.u_mm) > CLEAN_MM
        if burred[seen].mean() > LEAST_ALONG:
            return self
        hanging_mm, standing_mm = (np.where(burred, np.nan, of) for of in (self.hanging_mm, self.standing_mm))
        return self._replace(hanging_mm=hanging_mm, standing_mm=standing_mm)

    def edge(self, hangs: float) -> tuple[Float, Float]:
        """How far the face's edge lies beyond its last return on the line (N,), mm, and its standard uncertainty.

        NaN, and 0, where the frames beside tell it.

        hangs: probability that the burr hangs on the edge. Else it stands on the face, which ends where the burr does.
        """
        apart = self.hanging_mm - self.standing_mm
        u = np.sqrt(hangs * self.u_mm**2 + hangs * (1.0 - hangs) * apart**2)
        return self.standing_mm + hangs * apart, np.nan_to_num(u)

    def hangs(self, s: Float, end_mm: Float, variance: Float, pass_index: Int) -> float:
        """Probability that the burr hangs on the edge, by whether the face's ends run more smoothly then.

        end_mm: (N,) the last returns on the line at s (N,) mm; variance: (N,) of these, mm^2.
        """
        on = np.isfinite(s + end_mm + self.hanging_mm)
        variance = variance + self.alike * self.u_mm**2
        stands, hangs = (
            fit_course(s[on], (end_mm + self.edge(share)[0])[on], variance[on], pass_index[on]).log_evidence
            for share in (0.0, 1.0)
        )
        by_course = HANGS / (HANGS + (1.0 - HANGS) * math.exp(min(stands - hangs, 500.0)))
        return MISLED * HANGS + (1.0 - MISLED) * by_course

    @property
    def is_proven(self) -> Bool:
        """Frames (N,) whose end is certainly drawn out."""
        return self.mm > 2.0 * self.u_mm


def burr_note(end: str, drawn: DrawnEnd | None, s: Float) -> tuple[str, ...]:
    """What a burr at an `end` of a face was, of frames at s (N,) mm along it, in words."""
    proven = np.isfinite(s) & (drawn is not None and drawn.is_proven)
    if drawn is None or not proven.any():
        return ()
    return (BURRED.format(drawn.mm[proven].max(), end, s[proven].min(), s[proven].max()),)


def drawn_end(cloud: Cloud, rim: FaceRim, here: Bool) -> DrawnEnd:
    """The burrs of the frames `here` (N,), pass by pass."""
    of_frames, alike, most = np.zeros((4, here.size)), np.ones(here.size), 0.0
    for number in np.unique(cloud.pass_index[here]):
        on = here & (cloud.pass_index == number)
        mine, frames = np.flatnonzero(on), sampled(on & (rim.face.count > LEAST_GROUPS))
        found = _drawn(cloud, rim, frames) if frames.size >= LEAST_FRAMES else None
        if found is None:
            continue
        for of, value in zip(of_frames, found.values, strict=True):
            of[mine] = np.interp(mine, found.frame, value)
        alike[mine], most = TOGETHER * mine.size / found.frame.size, max(most, found.longest_mm)
    mm, u_mm, hanging_mm, standing_mm = of_frames
    return DrawnEnd(mm, u_mm, hanging_mm, standing_mm, alike, most)


class _Cells(NamedTuple):
    """What the cells of a pass show."""

    frame: Shaped[Float, " c"]  # in the middle
    values: Shaped[Float, "4 c"]  # the first four of a DrawnEnd, mm
    longest_mm: float  # along x


def _drawn(cloud: Cloud, rim: FaceRim, frames: Int) -> _Cells | None:
    """Of one pass; None: too little is seen."""
    face, lean = rim.face, float(np.median(rim.face.lean[frames]))
    step = float(np.median(rim.step_mm[frames]))
    reach = np.abs(rim.end_x_mm - face.x_mean)[frames] * lean + 0.5 * face.widths_mm[frames]
    edges = end_groups(min(float(reach.max()), DEEP_MM) / step)
    depth, last = last_returns(cloud, rim, frames, edges)
    shown = np.isfinite(depth[:, :LEAST_GROUPS]).all(axis=1)
    frames, depth, reach, further = frames[shown], depth[shown], INSIDE * reach[shown], step * last[shown, 0]
    if len(frames) < LEAST_FRAMES or len(edges) <= LEAST_GROUPS:
        return None
    edges_mm, fold = step * edges, step * np.geomspace(LEAST_COLUMNS, MOST_COLUMNS, FOLDS)
    cells = np.array_split(np.arange(len(frames)), max(1, len(frames) // CELL_FRAMES))
    mean = np.stack([_mean(depth[cell]) for cell in cells])
    noise = _noise(np.nan_to_num(depth), mean, len(frames) / len(cells))
    groups = [_shown(depth[cell], edges_mm, float(np.median(reach[cell]))) for cell in cells]
    mean -= _bow(mean, groups, edges_mm)
    log = np.zeros((len(cells), FOLDS))
    for c, count in enumerate(groups):
        if count >= LEAST_GROUPS:
            log[c] = _log_ratios(mean[c, :count], noise[:count, :count], edges_mm[: count + 1], fold)
    share = _folds(log, fold / step)
    burred, length = share.sum(axis=1), share @ fold
    spread = 1.0 + math.log(fold[1] / fold[0]) ** 2 / 12.0  # of lengths between two of these
    u = np.sqrt(np.maximum(spread * (share @ fold**2) - length**2, 0.0))
    last = burred * [further[cell].mean() for cell in cells]
    # What stands on the face ends at the foot of its last return on the line; the ray meets the line elsewhere.
    foot = burred * np.maximum(-mean[:, 0], 0.0) * float(np.median(rim.recession(frames)))
    longest = float(np.where(burred > 0.5, length / np.maximum(burred, 0.5), 0.0).max())
    at = np.array([frames[cell].mean() for cell in cells])
    return _Cells(at, np.stack([length, u, last - length, last - foot]), longest / lean)


def _mean(depth: Float) -> Float:
    """Means (g,) of what frames (f, g) show; 0: none does."""
    known = np.isfinite(depth)
    return np.asarray(np.where(known, depth, 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1))


def _shown(depth: Float, edges_mm: Float, reach_mm: float) -> int:
    """How many groups most frames (f, g) of a cell show, within a face that reaches so far from its end."""
    inside = (np.isfinite(depth).mean(axis=0) > 0.5) & (edges_mm[1:] < reach_mm)
    return int(np.append(inside, False).argmin())


def _bow(mean: Float, groups: list[int], edges_mm: Float) -> Float:
    """Depths (g,) of the bow that most cells share, whose means (c, g) show so many `groups` each."""
    middle, weight = 0.5 * (edges_mm[1:] + edges_mm[:-1]), np.sqrt(np.diff(edges_mm))
    shown = [(one, slice(MIXED_MM.size, count)) for one, count in zip(mean, groups, strict=True)]
    curved = [np.polyfit(middle[on], one[on], 2, w=weight[on])[0] for one, on in shown if on.stop >= LEAST_GROUPS]
    return np.asarray((median(np.array(curved)) if curved else 0.0) * middle**2)


def _noise(depth: Float, mean: Float, frames: float) -> Float:
    """Covariance (g, g) of the means (c, g) of cells with so many `frames` each, of depths (f, g) of frames in order.

    Frames that share their errors (roughness) average less: by how cells scatter about their neighbours.
    """
    own = 0.5 * np.cov(np.diff(depth, axis=0).T) / frames
    if len(mean) < 3:
        return np.asarray(own)
    apart = 0.5 * TO_SD**2 * np.median(np.diff(mean, axis=0) ** 2, axis=0)
    return own * max(1.0, float(np.median(apart / np.maximum(np.diag(own), 1e-12))))


def _log_ratios(mean: Float, noise: Float, edges_mm: Float, fold: Float) -> Float:
    """Log-likelihood ratios (k,) of the means (g,) of a cell by folds (k,) mm before the end, against none.

    None: the face, or a break, which falls out of the line where a burr rises.
    """
    middle = 0.5 * (edges_mm[1:] + edges_mm[:-1])
    covariance = noise + pattern_noise(mean, noise, edges_mm) + BOWED**2 * free_depths(edges_mm)
    covariance[: MIXED_MM.size, : MIXED_MM.size] += np.diag(MIXED_MM**2)
    rise = -np.maximum(fold[:, None] - middle, 0.0)
    gain = np.linalg.solve(covariance, rise.T)  # (g, k)
    variance = 1.0 / ((rise.T * gain).sum(axis=0) + 1.0 / RISE_SD**2)
    shown, usual = mean @ gain, RISE / RISE_SD**2

    def log_of(sense: float) -> Float:
        rises = 0.5 * variance * (shown + sense * usual) ** 2 - 0.5 * (RISE / RISE_SD) ** 2
        return np.asarray(rises + 0.5 * np.log(variance / RISE_SD**2))

    falls = scipy.special.logsumexp(log_of(-1.0)) + math.log(FALLS / fold.size)
    return np.asarray(log_of(1.0) - np.logaddexp(math.log(1.0 - FALLS), falls))


def _folds(log: Float, columns: Float) -> Float:
    """Probabilities (c, k) of folds so many `columns` (k,) before the end, by their log-likelihood ratios (c, k)."""
    usual = np.minimum(columns / EVIDENT, 1.0) ** 2
    usual /= usual.sum()
    change = np.exp(-0.5 * (np.log(columns[:, None] / columns) / CHANGES) ** 2)
    change /= change.sum(axis=1, keepdims=True)
    turn = np.zeros((columns.size + 1, columns.size + 1))
    turn[0] = np.append(1.0 - BEGINS, BEGINS * usual)
    turn[1:, 0], turn[1:, 1:] = ENDS, (1.0 - ENDS) * change
    log = np.concatenate([np.zeros((len(log), 1)), log], axis=1)
    likely = np.exp(log - log.max(axis=1, keepdims=True))
    ahead, behind = np.empty_like(likely), np.ones_like(likely)
    ahead[0] = turn[0] * likely[0]
    ahead[0] /= ahead[0].sum()
    for c in range(1, len(likely)):
        ahead[c] = (ahead[c - 1] @ turn) * likely[c]
        ahead[c] /= ahead[c].sum()
    for c in range(len(likely) - 2, -1, -1):
        behind[c] = turn @ (likely[c + 1] * behind[c + 1])
        behind[c] /= behind[c].sum()
    both = ahead * behind
    return np.asarray((both / both.sum(axis=1, keepdims=True))[:, 1:])
