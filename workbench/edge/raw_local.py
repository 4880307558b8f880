"""The local mean of a rough face along its edge, with what a scan leaves out of it (docs/method.md, eq. (16))."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from workbench.edge.directions import LOCAL_MM, TOGETHER_MM
from workbench.geometry.course import Course, fit_course
from workbench.geometry.processes import Shared
from workbench.geometry.splines import through
from workbench.units import Bool, Float, Int, Shaped

CELL_MM = 1.0  # by which frames are averaged first, so that all of the edge counts alike


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


def local_mean(s: Float, value: Float, pass_index: Int) -> Course:
    """The mean of a value (N,) over LOCAL_MM about each place: what a rough face is there, by least squares.

    Its u is what frames in turn differ by, where the window ends (to half a cell), and of what is not seen of the
    window that of the course, which stands for it, and of the roughness beside it. Where the scan ends the plate may
    end, or go on through all of the window.
    """
    course = fit_course(s, value, None, pass_index, shared=Shared(TOGETHER_MM))
    cells = _cells(s[course.kept], value[course.kept])
    there = cells.over(cells.seen.astype(float))
    noise = _noise(cells, there)
    single = float(np.var(cells.value[cells.seen]))
    total = cells.over(cells.value)
    mean = total / np.maximum(there, 0.5)
    variance = noise / np.maximum(there, 0.5)
    shown = np.flatnonzero(there > 0.0)
    shown = shown[(shown >= cells.pad) & (shown < cells.place.size - cells.pad)]
    in_part = shown[cells.over((~cells.seen).astype(float))[shown] > 0.0]
    mean[in_part], unseen_u2 = _with_unseen(cells, course, in_part, there[in_part], total[in_part])
    variance[in_part] += unseen_u2
    variance += 2.0 * (0.5 / np.maximum(there, 0.5)) ** 2 * single  # both ends of the window
    at_mm = np.asarray(cells.place[shown], dtype=float)
    return replace(
        course,
        spline=through(at_mm, cells.line(at_mm) + mean[shown]),
        at_mm=at_mm,
        shared_variance=None,
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


def _with_unseen(cells: _Cells, course: Course, at: Int, there: Float, known: Float) -> tuple[Float, Float]:
    """Mean over the windows about the cells `at` (k,), the course in place of what is not seen; what that adds to u^2.

    there, known (k,): how many of a window's cells are seen, and the sum of their values.
    """
    size = cells.place.size
    expected, expected_u = course.value(cells.place) - cells.line(cells.place), course.u(cells.place)
    rough = (cells.value - expected)[cells.seen]
    scatter = np.array([np.mean(_means(rough, k) ** 2) for k in range(1, 2 * cells.pad + 2)])
    number = np.arange(size)
    beyond = np.maximum(cells.pad - number, number - (size - cells.pad - 1))  # cells beyond the scan's end
    reach = np.arange(-cells.pad, cells.pad + 1)
    near = at[:, None] + reach  # cells of each window
    weight = cells.weight(reach) * ~cells.seen[near]
    means, variances = [], []
    for goes_on in range(cells.pad + 1):  # any of these as likely
        part = weight * (beyond[near] <= goes_on)
        count = part.sum(axis=1)
        whole = there + count
        means.append((known + (part * expected[near]).sum(axis=1)) / whole)  # eq. (16)
        unseen_u2 = ((part * expected_u[near]).sum(axis=1) / np.maximum(count, 1e-9)) ** 2 + np.interp(
            count, np.arange(1, scatter.size + 1), scatter
        )
        variances.append((count / whole) ** 2 * unseen_u2)
    return np.mean(means, axis=0), np.mean(variances, axis=0) + np.var(means, axis=0)


def _means(values: Float, count: int) -> Float:
    """Means of so many in a row of values (n,)."""
    total = np.append(0.0, np.cumsum(values))
    count = min(count, values.size)
    return np.asarray((total[count:] - total[:-count]) / count)
