"""A cloud without a grid: cut across its edge into profiles like a scanner's own, and what its patches show.

Points are laid out along a course: arc length, and place in the section plane. Slices of equal thickness are the frames
of the new grid, strips of equal width its columns; of the points of a cell one stands for it, as a profiler's pixel has
one return.

A patch of points shows the scan lines of one pass or of several, one surface or two. A line's points lie in the laser's
plane whatever its noise, so that on a patch the lines of a pass are straight, parallel and evenly spaced. Seen along
them, the points of that pass stand on a comb, those of any other pass do not.

Residuals about a fitted face are either noise of one surface, or two such noises about two heights. Both are fitted by
maximum likelihood (expectation maximisation; Dempster, Laird, Rubin, J. R. Stat. Soc. B 39, 1977), each with a uniform
background for stray returns.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.geometry.curves import Curve
from workbench.geometry.medians import robust_sd
from workbench.kernels import kernel
from workbench.units import Bool, Float, Float32, Int, Shaped

FRONT_MM = 0.5  # points of a cell this near to its foremost one are of the surface that is seen there
MARGIN = 20  # empty columns on each side: no field of view ends a slice
MOST_COLUMNS = 4000

TANGENTS = np.arange(-0.36, 0.3601, 0.004)  # directions of lines that are tried, against square to the edge
HALF_WIDTH_MM = 0.004  # of a line, seen along it
LEAST_ON_LINE = 6  # other points
ALONE, FURTHER = 0.4, 0.12  # share of points on the comb of an only pass, at the least; on that of a further one
LEAST_LINES, FULL = 5, 0.4  # of a patch; points that a line has, in parts of a usual one's
UNEVEN = 0.3  # half the range of the middle half of steps between lines, in parts of the median: two combs in one

Traces = Literal["none", "one pass", "several passes"]
SPAN_MM = 0.4  # residuals further off are other things
LEAST_SIGMA_MM = 0.001
ROUNDS, SETTLED = 60, 1e-3  # of expectation maximisation; gain of log-likelihood that ends it
BACKGROUND = 0.05  # share of stray returns to begin with
PLANE_ROUNDS, CAUCHY = 4, 3.0  # of reweighting a plane; residuals beyond so many sigmas count little


@dataclass(frozen=True, slots=True, eq=False)
class Laid:
    """n points laid out along a course: each in its own section plane, so that a curved edge becomes straight."""

    course: Curve
    s: Shaped[Float, " n"]  # arc length, mm
    place: Shaped[Float, "n 2"]  # along the course's (a, b), mm


def lay_out(points_mm: Float, course: Curve, s: Float) -> Laid:
    """Lay points (n, 3) out along the course; s (n,): about where they lie along it."""
    s = course.project(points_mm, s)
    _, a, b = course.frame(s)
    off = points_mm - course.position(s)
    return Laid(course, s, np.stack([np.einsum("ij,ij->i", off, axis) for axis in (a, b)], axis=1))


def seen_from(laid: Laid, view: Float, at_mm: Float) -> tuple[Float, Float]:
    """x and z axes (2, 2) in the course's (a, b), z along the view; and x and z of all points (2, n), mm.

    view (3,): direction of sight, away from the observer, in the middle of arc lengths at_mm (N,).
    """
    _, a, b = laid.course.frame(np.array([np.median(at_mm)]))
    turn = float(np.arctan2(b[0] @ view, a[0] @ view))
    axes = np.array([[-np.sin(turn), np.cos(turn)], [np.cos(turn), np.sin(turn)]])
    return axes, axes @ laid.place.T


def cut(laid: Laid, view: Float, at_mm: Float, thickness_mm: float, width_mm: float) -> tuple[Float32, Float32, Float]:
    """Slices of a thickness around arc lengths at_mm (N,), rising and at least a thickness apart, as profiles.

    view (3,): direction of sight, away from the observer, at the middle of the course.

    Returns x and z (N, M), mm, NaN in empty cells, and base_from_profiler (N, 4, 4), y along the course, z along the
    view.
    """
    axes, (x, z) = seen_from(laid, view, at_mm)
    width_mm = max(width_mm, float(np.ptp(x)) / MOST_COLUMNS)
    first = float(x.min()) - MARGIN * width_mm
    frame = np.searchsorted(at_mm - 0.5 * thickness_mm, laid.s, side="right") - 1
    frame[laid.s > at_mm[frame] + 0.5 * thickness_mm] = -1
    # Points of a line are about as evenly spaced as columns: where they stand on a border their noise chooses among
    # them, which would turn a face if the next slice had its columns in the same places.
    at = (x - first) / width_mm + math.sqrt(5.0) * frame % 1.0
    column = at.astype(np.int64)
    off_middle = np.abs(at - column - 0.5)
    chosen = _chosen(frame, column, as_input(z), off_middle, at_mm.size, int(column.max()) + 1 + MARGIN)
    grid = [np.where(chosen >= 0, value[chosen], np.nan).astype(np.float32) for value in (x, z)]
    return grid[0], grid[1], _poses(laid.course, at_mm, axes)


def _poses(course: Curve, at: Float, axes: Float) -> Float:
    """base_from_profiler (N, 4, 4): origin on the course, y along it; rows of `axes`: x and z in its (a, b)."""
    t, a, b = course.frame(at)
    pose = np.tile(np.eye(4), (at.size, 1, 1))
    pose[:, :3, 0] = axes[0, 0] * a + axes[0, 1] * b
    pose[:, :3, 1] = t
    pose[:, :3, 2] = axes[1, 0] * a + axes[1, 1] * b
    pose[:, :3, 3] = course.position(at)
    return pose


@kernel
def _chosen(frame: Int, column: Int, z: Float, off_middle: Float, frames: int, columns: int) -> Int:
    """The point that stands for each cell (frames, columns), -1: none. In front, and nearest to the cell's middle."""
    front = np.full((frames, columns), np.inf)
    for i in range(frame.size):
        if frame[i] >= 0:
            front[frame[i], column[i]] = min(front[frame[i], column[i]], z[i])
    chosen, nearest = np.full((frames, columns), -1, np.int64), np.full((frames, columns), np.inf)
    for i in range(frame.size):
        k, j = frame[i], column[i]
        if k >= 0 and off_middle[i] < nearest[k, j] and z[i] <= front[k, j] + FRONT_MM:
            chosen[k, j], nearest[k, j] = i, off_middle[i]
    return chosen


# Patches of points.


def traces(x_mm: Float, s_mm: Float) -> Traces:
    """Which lines the points (n,) of a patch of about a millimetre show; x across the edge and s along it, in the face.

    "none": the points do not stand on lines, as after thinning; nothing can then be said.
    """
    first, tangent = _comb(x_mm, s_mm)
    rest = ~first
    second = _comb(x_mm[rest], s_mm[rest])[0].sum() if rest.any() else 0
    if second >= FURTHER * x_mm.size:
        return "several passes"
    if first.mean() < ALONE:
        return "none"
    return "several passes" if _uneven(s_mm - tangent * x_mm) else "one pass"


def _comb(x: Float, s: Float) -> tuple[Bool, float]:
    """Points (n,) that stand on lines of the direction in which most do, and its tangent."""
    best, at = np.zeros(x.size, bool), 0.0
    for tangent in TANGENTS:
        u = s - tangent * x
        ordered = np.sort(u)
        near = np.searchsorted(ordered, u + HALF_WIDTH_MM) - np.searchsorted(ordered, u - HALF_WIDTH_MM)
        on = near > LEAST_ON_LINE
        if on.sum() > best.sum():
            best, at = on, float(tangent)
    return best, at


def _uneven(u: Float) -> bool:
    """Whether lines, seen along them (n points), are not evenly spaced."""
    u = np.sort(u)
    line = np.cumsum(np.diff(u, prepend=u[0]) > HALF_WIDTH_MM)
    points = np.bincount(line)
    place = (np.bincount(line, u) / points)[points >= FULL * np.median(points[line])]
    if place.size < LEAST_LINES:
        return False
    low, middle, high = np.quantile(np.diff(place), [0.25, 0.5, 0.75])
    return bool(0.5 * (high - low) > UNEVEN * middle)


@dataclass(frozen=True, slots=True)
class Sheets:
    """Two sheets beside one, as fitted to one patch of a surface."""

    gain: float  # of log-likelihood by the second sheet
    distance_mm: float  # between them
    sigma_mm: float  # noise of each
    smaller_share: float  # of the points, on the sheet with fewer


def two_sheets(x_mm: Float, y_mm: Float, z_mm: Float) -> Sheets:
    """Fit one and two sheets to a patch's points (n,): x and y in the face, z across it."""
    off = _off_plane(x_mm, y_mm, z_mm)
    r = as_input(off[np.abs(off) < SPAN_MM])
    sigma = max(robust_sd(r), LEAST_SIGMA_MM)
    low, high = (float(np.quantile(r, share)) for share in (0.1, 0.9))
    one = _fitted(r, float(np.median(r)), 0.0, sigma, False)[0]
    starts = ((-sigma, sigma), (low, 0.5 * sigma), (-0.5 * sigma, high))
    fits = [_fitted(r, a, b, 0.6 * sigma, True) for a, b in starts]
    two, a, b, sigma, share_a, share_b = max(fits, key=lambda fit: fit[0])
    return Sheets(two - one, abs(b - a), sigma, min(share_a, share_b))


def _off_plane(x: Float, y: Float, z: Float) -> Float:
    """Residuals (n,) of z about a plane, stray points counting little."""
    design = np.stack([np.ones(x.size), x - x.mean(), y - y.mean()], axis=1)
    weight = np.ones(x.size)
    off = z - np.median(z)
    for _ in range(PLANE_ROUNDS):
        plane = np.linalg.lstsq(design * weight[:, None], z * weight, rcond=None)[0]
        off = z - design @ plane
        sigma = max(robust_sd(off), LEAST_SIGMA_MM)
        weight = 1.0 / (1.0 + (off / (CAUCHY * sigma)) ** 2)
    return np.asarray(off)


@kernel
def _fitted(r: Float, a: float, b: float, sigma: float, two: bool) -> tuple[float, float, float, float, float, float]:
    """Log-likelihood, both means, sigma and shares of normal distributions with one sigma, begun at means a and b."""
    background = 1.0 / (2.0 * SPAN_MM)
    share_b = 0.5 * (1.0 - BACKGROUND) if two else 0.0
    share_a, before = 1.0 - BACKGROUND - share_b, -np.inf
    for _ in range(ROUNDS):
        scale, total = 1.0 / (sigma * math.sqrt(2.0 * math.pi)), 0.0
        na = nb = ra = rb = qa = qb = 0.0
        for v in r:
            pa = share_a * scale * math.exp(-0.5 * ((v - a) / sigma) ** 2)
            pb = share_b * scale * math.exp(-0.5 * ((v - b) / sigma) ** 2)
            p = pa + pb + (1.0 - share_a - share_b) * background
            total += math.log(p)
            na, ra, qa = na + pa / p, ra + v * pa / p, qa + v * v * pa / p
            nb, rb, qb = nb + pb / p, rb + v * pb / p, qb + v * v * pb / p
        if total - before < SETTLED:
            break
        before = total
        a, b = ra / max(na, 1e-12), rb / max(nb, 1e-12)
        spread = (qa - na * a * a + qb - nb * b * b) / (na + nb)
        sigma = max(math.sqrt(max(spread, 0.0)), LEAST_SIGMA_MM)
        share_a, share_b = 0.9999 * na / r.size, 0.9999 * nb / r.size
    return total, a, b, sigma, share_a, share_b
