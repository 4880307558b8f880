"""Straight faces: a profile as a chain of them, by an optimal partition into lines z = k x + c; one face as lines.

Noise acts along the range axis z, so lines are regressions of z on x (docs/paper.md, eq. (10)). The partition minimises
the sum of squared residuals over the noise variance, plus one price per line and one price per point left out (dynamic
programming over all breakpoints; Jackson et al., "An algorithm for optimal partitioning of data on an interval", 2005).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.geometry.blocks import as_input, as_rows
from workbench.geometry.medians import median_of
from workbench.kernels import kernel
from workbench.units import TO_SD, AnyArray, Float, Float32, Int, Shaped

LINE_PRICE = 40.0  # squared sigmas that a further line must save
POINT_PRICE = 14.0  # squared sigmas above which a point is better left out
MIN_POINTS = 4
MIN_SIGMA_MM = 0.002
MAX_BREAKS = 700  # candidate breakpoints a profile; more points share one
STRAY_SIGMAS, ROUNDS = 3.5, 4  # returns further off a face's line are none of it; times that they are looked for

# Columns of a chain, the array of lines that `straight_faces` returns.
X0, X1, SLOPE, OFFSET, COUNT, FIRST, LAST = range(7)


@dataclass(frozen=True, slots=True, eq=False)
class FaceLines:
    """One face as straight lines z(x), one a frame, in the profiler frame.

    `count` is 0 where the face is not seen in the frame; all other entries are then NaN.
    """

    count: Shaped[Int, " N"]  # points used
    x_mean: Shaped[Float, " N"]  # mm
    z_mean: Shaped[Float, " N"]  # mm
    sxx: Shaped[Float, " N"]  # sum (x - x_mean)^2, mm^2
    sxz: Shaped[Float, " N"]  # sum (x - x_mean)(z - z_mean), mm^2
    szz: Shaped[Float, " N"]  # sum (z - z_mean)^2, mm^2
    columns: Shaped[Int, "N 2"]  # first and last column of the face; -1 where not seen

    @property
    def slope(self) -> Float:
        """dz/dx (N,)."""
        return self.sxz / self.sxx

    @property
    def rss(self) -> Float:
        """What the lines leave (N,): sums of squares along z, mm^2."""
        return np.maximum(self.szz - self.sxz**2 / self.sxx, 0.0)

    @property
    def lean(self) -> Float:
        """Length of a line per mm along x (N,)."""
        return np.hypot(1.0, self.slope)

    def z(self, x: Float) -> Float:
        """z (N,) of each line at x (N,), mm."""
        return self.z_mean + self.slope * (x - self.x_mean)

    def z_at(self, frames: Int, x: Float32) -> Float:
        """z (k, M) of the lines of some frames (k,) at x (k, M), mm."""
        return self.z_mean[frames, None] + self.slope[frames, None] * (x - self.x_mean[frames, None])

    def crossing(self, other: FaceLines) -> Float:
        """x (N,) where each line meets the other face's, mm."""
        return self.x_mean + (other.z(self.x_mean) - self.z_mean) / (self.slope - other.slope)

    @property
    def widths_mm(self) -> Float:
        """How far evenly spread points reach along each line (N,)."""
        return np.sqrt(12.0 * self.sxx / self.count) * self.lean

    @property
    def width_mm(self) -> float:
        """The median of the frames' widths; NaN: none shows the face."""
        on = self.count > 2
        return float(np.median(self.widths_mm[on])) if on.any() else math.nan

    def typical(self, frames: Int) -> tuple[float, float, float]:
        """x and z in the face's middle, mm, and its slope, in the median of some frames."""
        middle, slope = np.median(self.x_mean[frames]), np.median(self.slope[frames])
        height = np.median(self.z_mean[frames] - slope * (self.x_mean[frames] - middle))
        return float(middle), float(height), float(slope)

    @property
    def noise_mm(self) -> float:
        """Range noise of the face: the median of what the lines leave, rms."""
        on = self.count > 2
        rms = np.sqrt(self.rss[on] / (self.count[on] - 2.0))
        return max(float(np.median(rms)), MIN_SIGMA_MM) if rms.size else MIN_SIGMA_MM


def labelled_lines(x: Float32, z: Float32, labels: AnyArray, label: int) -> FaceLines:
    """The lines of the returns with this label in `labels` (N, M), least squares without strays, which lose the label.

    x, z: (N, M) mm. Fewer than MIN_POINTS are no line, and lose it too.
    """
    sums, columns = np.full((6, len(labels)), np.nan), np.full((len(labels), 2), -1)
    _labelled_lines(as_rows(x), as_rows(z), labels, label, sums, columns)
    count = np.nan_to_num(sums[0]).astype(np.int64)
    return FaceLines(count, sums[1], sums[2], sums[3], sums[4], sums[5], columns)


@kernel
def _labelled_lines(x: Float32, z: Float32, labels: AnyArray, label: int, out: Float, columns: Int) -> None:
    """Fill out (6, n): count, means of x and z, centred sums xx, xz, zz; columns (n, 2): first and last."""
    on, off = np.empty(labels.shape[1], np.int64), np.empty(labels.shape[1])
    for i in range(labels.shape[0]):
        row, count = x[min(i, len(x) - 1)], 0
        for j in range(labels.shape[1]):
            on[count] = j
            count += labels[i, j] == label
        for _ in range(ROUNDS):
            kept = _near_line(row, z[i], on, off, count)
            for k in range(kept, count):
                labels[i, on[k]] = 0
            if kept == count:
                break
            count = kept
        if count < MIN_POINTS:
            for k in range(count):
                labels[i, on[k]] = 0
            continue
        out[0, i], columns[i, 0], columns[i, 1] = count, on[0], on[count - 1]
        out[1, i], out[2, i], out[3, i], out[4, i], out[5, i] = _sums(row, z[i], on, count)


@kernel
def _sums(x: Float32, z: Float32, on: Int, count: int) -> tuple[float, float, float, float, float]:
    """Means of x and z and centred sums xx, xz, zz of the first `count` columns in `on`."""
    mx = mz = sxx = sxz = szz = 0.0
    for k in range(count):
        mx += np.float64(x[on[k]]) / count
        mz += np.float64(z[on[k]]) / count
    for k in range(count):
        u, w = np.float64(x[on[k]]) - mx, np.float64(z[on[k]]) - mz
        sxx, sxz, szz = sxx + u * u, sxz + u * w, szz + w * w
    return mx, mz, sxx, sxz, szz


@kernel
def _near_line(x: Float32, z: Float32, on: Int, off: Float, count: int) -> int:
    """How many of the first `count` columns in `on` are no strays off their line: put first there, in their order."""
    if count < MIN_POINTS:
        return count
    mx, mz, sxx, sxz, _ = _sums(x, z, on, count)
    slope, stray = sxz / max(sxx, 1e-12), np.empty(count, np.int64)
    for k in range(count):
        off[k] = abs(np.float64(z[on[k]]) - mz - slope * (np.float64(x[on[k]]) - mx))
    limit = STRAY_SIGMAS * (TO_SD * median_of(off[:count].copy(), count) + MIN_SIGMA_MM)
    kept = 0
    for k in range(count):
        if off[k] > limit:
            stray[k - kept] = on[k]
        else:
            on[kept] = on[k]
            kept += 1
    for k in range(kept, count):  # a slice takes two seconds to compile
        on[k] = stray[k - kept]
    return kept


def noise_sigma(z: Float) -> float:
    """Standard deviation of the range noise of a profile (mm), from second differences over 1, 2 and 4 columns.

    The largest of the three: correlated noise hides from neighbours. Medians: corners and jumps count little.
    """
    return float(_noise_sigma(as_input(z)))


@kernel
def _noise_sigma(z: Float) -> float:
    sigma, second = MIN_SIGMA_MM, np.empty(z.size)
    for step in (1, 2, 4):
        n = z.size - 2 * step
        if n < 8:
            break
        for i in range(n):
            second[i] = abs(z[i] - 2.0 * z[i + step] + z[i + 2 * step])
        sigma = max(sigma, median_of(second, n) * TO_SD / math.sqrt(6.0))
    return sigma


def _prefix_sums(x: Float, z: Float) -> Float:
    """Sums of x, z, xx, xz and zz over the first 0 to n points: (n + 1, 5)."""
    sums = np.zeros((x.size + 1, 5))
    np.cumsum(np.stack([x, z, x * x, x * z, z * z], axis=1), axis=0, out=sums[1:])
    return sums


@kernel
def _line(sums: Float, i: int, j: int) -> tuple[float, float, float]:
    """Slope, offset and residual sum of squares of the line through points i to j - 1."""
    n = j - i
    sx = sums[j, 0] - sums[i, 0]
    sz = sums[j, 1] - sums[i, 1]
    sxx = sums[j, 2] - sums[i, 2] - sx * sx / n
    sxz = sums[j, 3] - sums[i, 3] - sx * sz / n
    szz = sums[j, 4] - sums[i, 4] - sz * sz / n
    slope = sxz / max(sxx, 1e-12)
    return slope, (sz - slope * sx) / n, max(szz - slope * sxz, 0.0)


@kernel(error_model="numpy")
def _partition(x: Float, sums: Float, sigma: float) -> Int:
    """Rows (first, last + 1) of the lines of the cheapest partition."""
    breaks = min(x.size, MAX_BREAKS - x.size % 2)  # odd where the points are: the same from either end
    at = np.empty(breaks + 1)
    s1, s2, s3 = np.empty(breaks + 1), np.empty(breaks + 1), np.empty(breaks + 1)
    s4, s5 = np.empty(breaks + 1), np.empty(breaks + 1)
    for b in range(breaks + 1):
        i = b * x.size // breaks if 2 * b <= breaks else x.size - (breaks - b) * x.size // breaks
        at[b] = i
        s1[b], s2[b], s3[b], s4[b], s5[b] = sums[i, 0], sums[i, 1], sums[i, 2], sums[i, 3], sums[i, 4]
    cost, trial = np.zeros(breaks + 1), np.empty(breaks + 1)
    came_from = np.zeros(breaks + 1, np.int64)
    skipped = np.zeros(breaks + 1, np.bool_)
    price = 1.0 / (sigma * sigma)
    for b in range(1, breaks + 1):
        cost[b] = cost[b - 1] + POINT_PRICE * (at[b] - at[b - 1])
        came_from[b] = b - 1
        skipped[b] = True
        starts = b
        while starts > 0 and at[b] - at[starts - 1] < MIN_POINTS:
            starts -= 1
        for a in range(starts):  # no branch: many at a time
            per = 1.0 / (at[b] - at[a])
            sx, sz = s1[b] - s1[a], s2[b] - s2[a]
            sxx = s3[b] - s3[a] - sx * sx * per
            sxz = s4[b] - s4[a] - sx * sz * per
            szz = s5[b] - s5[a] - sz * sz * per
            trial[a] = cost[a] + LINE_PRICE + price * max(szz - sxz * sxz / max(sxx, 1e-12), 0.0)
        for a in range(starts):
            if trial[a] < cost[b]:
                cost[b], came_from[b], skipped[b] = trial[a], a, False
    spans = np.empty((breaks, 2), np.int64)
    count = 0
    b = breaks
    while b > 0:
        if not skipped[b]:
            spans[count, 0], spans[count, 1] = at[came_from[b]], at[b]
            count += 1
        b = came_from[b]
    return spans[:count][::-1]


def _collinear(a: Float, b: Float, tolerance_mm: float) -> bool:
    """Do lines a and b (a before b) continue each other: under 4 deg of turn, and meeting within the tolerance?"""
    if abs(math.atan(a[SLOPE]) - math.atan(b[SLOPE])) > 0.07:
        return False
    middle = 0.5 * (a[X1] + b[X0])
    gap = abs(a[SLOPE] * middle + a[OFFSET] - b[SLOPE] * middle - b[OFFSET])
    return bool(gap / math.sqrt(1.0 + a[SLOPE] * a[SLOPE]) < tolerance_mm)


def _joined(a: Float, b: Float) -> Float:
    """Collinear lines a and b (a before b) as one: their mean, weighted by points."""
    w = a[COUNT] / (a[COUNT] + b[COUNT])
    slope = w * a[SLOPE] + (1.0 - w) * b[SLOPE]
    at = 0.5 * (a[X1] + b[X0])
    z = w * (a[SLOPE] * at + a[OFFSET]) + (1.0 - w) * (b[SLOPE] * at + b[OFFSET])
    return np.array([a[X0], b[X1], slope, z - slope * at, a[COUNT] + b[COUNT], a[FIRST], b[LAST]])


def straight_faces(x: Shaped[Float, " n"], z: Shaped[Float, " n"]) -> Float:
    """The straight faces of one profile, in order of its points: rows (x0, x1, slope, offset, count, first, last).

    x, z: (n,) mm, n points in column order with x rising, no NaN. `first`, `last` index the points. Lines that continue
    each other, such as the pieces of a face that an outlier cut in two or of a slightly bent one, come as one.
    """
    if x.size < 2 * MIN_POINTS:
        return np.empty((0, 7))
    shift_x, shift_z = x.mean(), z.mean()  # sums of squares near the origin lose no digits
    sigma = noise_sigma(z)
    sums = as_input(_prefix_sums(x - shift_x, z - shift_z))
    chain: list[Float] = []
    for i, j in _partition(as_input(x), sums, sigma):
        slope, offset, _ = _line(sums, i, j)
        line = np.array([x[i], x[j - 1], slope, offset + shift_z - slope * shift_x, j - i, i, j - 1])
        if chain and _collinear(chain[-1], line, 0.05 + 4.0 * sigma):
            line = _joined(chain.pop(), line)
        chain.append(line)
    return np.array(chain).reshape(-1, 7)
