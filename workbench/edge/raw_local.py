"""The local mean of a rough face along its edge, with what a scan leaves out of it (docs/method.md, eq. (16))."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from workbench.edge.directions import LOCAL_MM, TOGETHER_MM
from workbench.geometry.course import Course, fit_course
from workbench.geometry.processes import Shared
from workbench.geometry.splines import Spline
from workbench.units import Bool, Float, Int, Shaped

CELL_MM = 1.0  # by which frames are averaged first, so that all of the edge counts alike
LENGTHS_MM = np.array([1.0, 2.0, 4.0, 8.0, 16.0])  # over which a rough face hangs together, all alike likely before
REACH_MM = 40.0  # of edge beside what is not seen, that tells it; longer waves are its straight line there
MOST_STRETCHES = 12  # of so much edge, evenly chosen, that tell how a face hangs together
LEAST_CELLS = 5  # of a stretch: two go into its line
BLOCK_MM = 10.0  # half a window: so much of what is seen is told by the rest, to see how well that goes
PRIOR_BLOCKS = 2.0  # that are told as well as they should be, before any is tried


@dataclass(frozen=True, slots=True, eq=False)
class _Cells:
    """Frames averaged over cells along the edge, those in turn apart; `pad` more cells beyond each end of the scan."""

    place: Shaped[Float, " c"]  # arc length of their middles, mm
    value: Shaped[Float, " c"]  # beside the straight line through all; 0 where not seen
    seen: Shaped[Bool, " c"]
    apart: Shaped[Float, " c"]  # by how much the means of both halves of its frames differ
    both: Shaped[Bool, " c"]  # where both halves have frames
    line: np.polynomial.Polynomial
    half: float  # cells to each side of a window's middle, the last one in part
    pad: int

    def over(self, cells: Float) -> Float:
        """Sums (c,) of cells (c,) over the windows about each."""
        reach = np.arange(-self.pad, self.pad + 1)
        return np.convolve(cells, self.weight(reach), mode="full")[self.pad : self.pad + cells.size]

    def weight(self, away: Int) -> Float:
        """Share of cells, so many `away` from a window's middle, that lies in it."""
        return np.clip(self.half + 0.5 - np.abs(away), 0.0, 1.0)


@dataclass(frozen=True, slots=True, eq=False)
class _Roughness:
    """What the seen cells say of each covariance."""

    share: Shaped[Float, " g"]  # of belief
    variance: Shaped[Float, " g"]  # of a cell, Student's factor and the misfit in it
    noise: float  # variance of a cell's mean by its frames, over that of the face


def local_mean(s: Float, value: Float, pass_index: Int) -> Course:
    """The mean of a value (N,) over LOCAL_MM about each place: what a rough face is there, by least squares.

    Its u is what frames in turn differ by, where the window ends (to half a cell), and how well what is not seen of
    the window is told by what is. Where the scan ends the plate may end, or go on through all of the window.
    """
    course = fit_course(s, value, None, pass_index, shared=Shared(TOGETHER_MM))
    cells = _cells(s[course.kept], value[course.kept])
    there = cells.over(cells.seen.astype(float))
    noise = _noise(cells, there)
    single = float(np.var(cells.value[cells.seen]))
    total = cells.over(cells.value)
    mean = total / np.maximum(there, 0.5)
    variance = noise / np.maximum(there, 0.5)
    rough = _roughness(cells, noise / max(single, 1e-30))
    for at in _seen_in_part(cells, there):
        mean[at], told_u2 = _told(cells, rough, at, there[at], total[at])
        variance[at] += told_u2
    variance += 2.0 * (0.5 / np.maximum(there, 0.5)) ** 2 * single  # both ends of the window
    shown = np.flatnonzero(there > 0.0)
    shown = shown[(shown >= cells.pad) & (shown < cells.place.size - cells.pad)]
    at_mm = np.asarray(cells.place[shown], dtype=float)
    spline = scipy.interpolate.make_interp_spline(at_mm, cells.line(at_mm) + mean[shown], k=min(3, shown.size - 1))
    return replace(
        course,
        spline=Spline(spline.t, spline.c, spline.k),
        at_mm=at_mm,
        variance=variance[shown],
        slope_variance=np.zeros(shown.size),
    )


def _cells(s: Float, value: Float) -> _Cells:
    """Frames (N,) in cells of CELL_MM, longer where there are fewer than two of them in each."""
    order = np.argsort(s, kind="stable")
    s, value = s[order], value[order]
    start, length = float(s[0]), float(s[-1] - s[0])
    count = max(int(length / max(CELL_MM, 2.0 * length / s.size)), 1)
    cell_mm = length / count
    pad = math.ceil(LOCAL_MM / 2.0 / cell_mm)
    cell = pad + np.minimum(((s - start) / length * count).astype(np.int64), count - 1)
    turn, size = np.arange(s.size) % 2, count + 2 * pad
    frames = np.stack([np.bincount(cell[turn == k], minlength=size) for k in (0, 1)])
    total = np.stack([np.bincount(cell[turn == k], value[turn == k], size) for k in (0, 1)])
    seen, both = np.asarray(frames.sum(axis=0) > 0), np.asarray((frames > 0).all(axis=0))
    halves = total / np.maximum(frames, 1)
    place = np.asarray(start + (np.arange(size) - pad + 0.5) * cell_mm, dtype=float)
    mean = total.sum(axis=0)[seen] / frames.sum(axis=0)[seen]
    # A face that turns along the edge is not where the middle of a window at its end is.
    line = np.polynomial.Polynomial.fit(place[seen], mean, min(1, int(seen.sum()) - 1))
    off = np.zeros(size)
    off[seen] = mean - line(place[seen])
    apart = np.where(both, halves[0] - halves[1], 0.0)
    return _Cells(place, off, seen, apart, both, line, LOCAL_MM / 2.0 / cell_mm, pad)


def _noise(cells: _Cells, there: Float) -> float:
    """Variance of the mean of a cell's frames, by how the means over windows of every other frame differ."""
    known = cells.over(cells.both.astype(float))[there > 0.0]
    apart = cells.over(cells.apart)[there > 0.0]
    return float(np.mean((apart / np.maximum(known, 1.0)) ** 2 * known)) / 4.0


def _seen_in_part(cells: _Cells, there: Float) -> list[Int]:
    """Cells in a row, at most a window's length of them, about which the window is seen, but not all of it."""
    at = np.flatnonzero((there > 0.0) & (cells.over((~cells.seen).astype(float)) > 0.0))
    at = at[(at >= cells.pad) & (at < cells.seen.size - cells.pad)]
    rows = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1)
    return [part for row in rows if row.size for part in np.array_split(row, math.ceil(row.size / (2 * cells.pad)))]


def _told(cells: _Cells, rough: _Roughness, at: Int, there: Float, known: Float) -> tuple[Float, Float]:
    """Mean and variance (k,) over the windows about the cells `at` (k,), by what is told of those not seen.

    there, known (k,): how many are seen, and the sum of their values.
    """
    run = np.arange(max(at[0] - cells.pad, 0), min(at[-1] + cells.pad + 1, cells.seen.size))
    run = run[~cells.seen[run]]
    mean, covariance = _predicted(cells, rough, run)
    weight = cells.weight(run[None, :] - at[:, None])
    beyond = np.maximum(cells.pad - run, run - (cells.seen.size - cells.pad - 1))  # cells beyond the scan's end
    means, variances = [], []
    for goes_on in range(max(0, int(beyond.max())) + 1):  # any of these as likely
        part = weight * (beyond <= goes_on)
        whole = there + part.sum(axis=1)
        means.append((known + part @ mean) / whole)  # eq. (16)
        variances.append(np.einsum("ku,uv,kv->k", part, covariance, part) / whole**2)
    return np.mean(means, axis=0), np.mean(variances, axis=0) + np.var(means, axis=0)


def _covariances(apart: Float) -> Float:
    """Both families, exponential and Matern 3/2, of each length at distances (n, m): (g, n, m), 1 at no distance."""
    d = apart / LENGTHS_MM[:, None, None]
    return np.concatenate([np.exp(-d), (1.0 + math.sqrt(3.0) * d) * np.exp(-math.sqrt(3.0) * d)])


def _roughness(cells: _Cells, noise: float) -> _Roughness:
    """Restricted likelihoods of the covariances by stretches of REACH_MM about a straight line each (eq. (16a)).

    noise: variance of cells by their frames over that of the face. How well blocks of a stretch are told by the rest of
    it, as what is not seen will be, raises the variance of a covariance that is surer of it.
    """
    noise = min(max(noise, 1e-6), 1.0)
    models = 2 * LENGTHS_MM.size
    likely, square, off, free, blocks = np.zeros(models), np.full(models, 1e-30), np.zeros(models), 0, 0
    for group in _stretches(cells):
        place, value = cells.place[group], cells.value[group]
        line = _straight(place, float(place.mean()))
        both = _covariances(np.abs(place[:, None] - place[None, :])) + noise * np.eye(group.size)
        weight = np.linalg.inv(both)
        on_line = line.T @ weight @ line
        weight = weight - weight @ line @ np.linalg.solve(on_line, line.T @ weight)  # the line is free
        left = weight @ value
        square += left @ value
        likely -= 0.5 * (np.linalg.slogdet(both)[1] + np.linalg.slogdet(on_line)[1])
        free += group.size - 2
        for block in np.array_split(np.arange(group.size), max(round((place[-1] - place[0]) / BLOCK_MM), 1)):
            if 2 <= block.size <= group.size - LEAST_CELLS:
                told = np.linalg.inv(weight[:, block[:, None], block])
                off += (told @ left[:, block, None]).sum(axis=(1, 2)) ** 2 / told.sum(axis=(1, 2))
                blocks += 1
    likely -= 0.5 * free * np.log(square)
    if not free:  # so few cells that nothing tells how they hang together
        spread = float((cells.value**2).sum()) / max(int(cells.seen.sum()) - 3, 1)
        return _Roughness(np.full(models, 1.0 / models), np.full(models, spread), noise)
    share = np.exp(likely - likely.max())
    variance = square / free
    misfit = np.maximum(1.0, (off / variance + PRIOR_BLOCKS) / (blocks + PRIOR_BLOCKS))
    student = 1.0 / max(1.0 - 2.0 / free, 0.1)
    return _Roughness(share / share.sum(), student * misfit * variance, noise)


def _stretches(cells: _Cells) -> list[Int]:
    """Seen cells by stretches of REACH_MM, at most MOST_STRETCHES of them."""
    there = np.flatnonzero(cells.seen)
    stretch = np.floor((cells.place[there] - cells.place[there[0]]) / REACH_MM).astype(np.int64)
    groups = [there[stretch == k] for k in np.unique(stretch)]
    groups = [group for group in groups if group.size >= LEAST_CELLS]
    chosen = np.linspace(0, len(groups) - 1, min(MOST_STRETCHES, len(groups))).round().astype(int)
    return [groups[k] for k in chosen]


def _straight(place: Float, about: float) -> Float:
    return np.column_stack([np.ones(place.size), (place - about) / REACH_MM])


def _predicted(cells: _Cells, rough: _Roughness, run: Int) -> tuple[Float, Float]:
    """Mean (r,) and covariance (r, r) of the cells `run`, by those seen within REACH_MM, over all covariances."""
    at = cells.place[run]
    near = np.flatnonzero(cells.seen & (cells.place >= at[0] - REACH_MM) & (cells.place <= at[-1] + REACH_MM))
    place, value = cells.place[near], cells.value[near]
    about = float(place.mean())
    line, there = _straight(place, about), _straight(at, about)
    inner = _covariances(np.abs(place[:, None] - place[None, :])) + rough.noise * np.eye(near.size)
    cross = _covariances(np.abs(place[:, None] - at[None, :]))
    right = np.concatenate([np.broadcast_to(np.column_stack([line, value]), (len(inner), near.size, 3)), cross], axis=2)
    solved = np.linalg.solve(inner, right)
    by_line, by_value, by_cross = solved[:, :, :2], solved[:, :, 2], solved[:, :, 3:]
    spread = np.linalg.pinv(line.T @ by_line)  # of the line's unknowns
    fitted = np.einsum("gij,gj->gi", spread, by_value @ line)
    left = there - np.swapaxes(cross, 1, 2) @ by_line
    mean = fitted @ there.T + np.einsum("gnr,gn->gr", cross, by_value - np.einsum("gni,gi->gn", by_line, fitted))
    free = _covariances(np.abs(at[:, None] - at[None, :]))
    covariance = free - np.swapaxes(cross, 1, 2) @ by_cross + left @ spread @ np.swapaxes(left, 1, 2)
    middle = rough.share @ mean
    away = mean - middle
    over_all = np.tensordot(rough.share * rough.variance, covariance, 1) + (rough.share[:, None] * away).T @ away
    return middle, over_all
