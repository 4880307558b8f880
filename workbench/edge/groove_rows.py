"""Corners of a V groove in rows of ranges alone: without unit, pitch or poses, in columns.

A row is a chain of four straight lines that meet: upper surface, flank, flank, upper surface. Many returns
between the flanks may be reflections of one in the other, so the chain is fitted by Cauchy's loss, from several
places of the root and again from where the neighbouring rows have it; upper corners then by what lies near them,
since flanks may bow.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from workbench.geometry.chains import FIRST, LAST, SLOPE, noise_sigma, straight_faces
from workbench.units import Bool, Float

LEAST_RETURNS = 200  # of a row
PIECES_MM = 0.05  # a column counts as so much where faces are looked for, whose limits are those of sensors
LEAST_LONG = 0.06  # share of the returns that an upper surface has
ROOTS = (0.3, 0.4, 0.5, 0.6, 0.7)  # between the upper corners, where the fit begins
LOSS_SIGMAS = 4.0
NEIGHBOURS = 15  # rows whose median is a start
ASIDE = 12.0  # columns from that median, beyond which a row is fitted again from there
LEAST_DEPTH = 10.0  # times the noise: the depth of a groove
LEAST_ON, ON_SIGMAS = 0.5, 8.0  # share of a row's returns that lie so near its chain
TOLD_SIGMAS = 3.0  # a return farther from a corner tells nothing of it
LEAST_ROWS = 0.8  # share of the rows in which it is found, for them to show a groove
NEAR, LEAST_NEAR, MOST_MOVED = 120.0, 40, 40.0  # columns about an upper corner; returns on each side; it moves by less
THIN, MOST_STEPS = 350, 60  # returns of a first fit; steps of a fit
FIT_SCALE = np.array([20.0] * 3 + [5.0] * 5)  # columns, ranges
COLUMNS = ("left_upper", "root", "right_upper")


class Rows(NamedTuple):
    """Corners of every row: fractional columns and ranges (N, 3) of COLUMNS; NaN where a row shows no groove."""

    column: Float
    z: Float
    root_away: Float  # (N,) columns from the root to the nearest return on its flanks

    @property
    def found(self) -> Bool:
        """Rows (N,) in which the groove was found."""
        return np.asarray(np.isfinite(self.column).all(axis=1))


def corners_of_rows(z: Float) -> Rows | None:
    """Corners of the groove in rows of ranges (N, M), NaN: no return; None: these rows show no V groove.

    Both senses of the range are tried. Every row is found by itself; where it then lies beside its neighbours, it is
    fitted again from their median.
    """
    best: tuple[float, Float] | None = None
    some = np.unique(np.linspace(0, len(z) - 1, min(len(z), 4)).astype(int))
    for sense in (1.0, -1.0):
        tried = [_row(sense * z[i], None) for i in some]
        share = float(np.mean([one is not None for one in tried]))
        if share >= 0.5 and (best is None or share > best[0]):
            best = share, sense * z
    if best is None:
        return None
    up = best[1]
    sense = 1.0 if up is z or np.array_equal(up, z, equal_nan=True) else -1.0
    found: list[Float | None] = []
    for row in up:  # a row's groove lies near that of the row before
        before = found[-1] if found else None
        one = _row(row, before)
        found.append(_row(row, None) if one is None and before is not None else one)
    table = np.array([[np.nan] * 6 if one is None else one for one in found])
    for _ in range(2):
        filled = _filled(table)
        if filled is None:
            return None
        middle = scipy.ndimage.median_filter(filled, (NEIGHBOURS, 1), mode="nearest")
        # The groove wanders from row to row as a whole: its corners keep their distances.
        middle[:, :3] += np.median(filled[:, :3] - middle[:, :3], axis=1)[:, None]
        middle[:, 3:] += np.median(filled[:, 3:] - middle[:, 3:], axis=1)[:, None]
        aside = ~(np.abs(table[:, :3] - middle[:, :3]) < ASIDE).all(axis=1)
        for i in np.flatnonzero(aside):
            again = _row(up[i], middle[i])
            table[i] = np.nan if again is None else again
    rows = Rows(table[:, :3], sense * table[:, 3:], np.array([_away(*both) for both in zip(up, table, strict=True)]))
    return rows if rows.found.mean() >= LEAST_ROWS else None


def _away(z: Float, corner: Float) -> float:
    """Columns from a row's root to the nearest return within three noises of a flank; NaN: no groove, or none."""
    column = np.flatnonzero(np.isfinite(z))
    column = column[(column > corner[0]) & (column < corner[2])]
    if column.size == 0:
        return np.nan
    on = np.abs(np.interp(column, corner[:3], corner[3:]) - z[column]) < TOLD_SIGMAS * noise_sigma(z[np.isfinite(z)])
    return float(np.abs(column[on] - corner[1]).min()) if on.any() else np.nan


def _filled(table: Float) -> Float | None:
    at = np.arange(len(table))
    good = np.isfinite(table).all(axis=1)
    if good.sum() < 2:
        return None
    return np.stack([np.interp(at, at[good], column[good]) for column in table.T], axis=1)


def _row(z: Float, near: Float | None) -> Float | None:
    """Columns of left corner, root and right corner, then their ranges; z counts out of the plates."""
    column = np.flatnonzero(np.isfinite(z)).astype(float)
    if column.size < LEAST_RETURNS:
        return None
    y = z[np.isfinite(z)]
    sigma = noise_sigma(y)
    starts = _starts(column, y) if near is None else [near]
    best = None
    for start in starts:
        at = np.clip(start[:3], column[0] + 1.0, column[-1] - 1.0)
        ends = [_range_at(column, y, 0, start[0], start[3]), _range_at(column, y, -1, start[2], start[5])]
        found = _fitted(column, y, np.array([*at, *start[3:], *ends]), LOSS_SIGMAS * sigma)
        if found is not None and (best is None or found[0] < best[0]):
            best = found
    if best is None:
        return None
    corner = best[1]
    depth = min(corner[3], corner[5]) - corner[4]
    on = np.abs(_chain(corner, column, column) - y) < ON_SIGMAS * sigma
    if depth < LEAST_DEPTH * sigma or on.mean() < LEAST_ON:
        return None
    for k in (0, 2):
        corner[k], corner[3 + k] = _near(column, y, corner, k, LOSS_SIGMAS * sigma)
    return np.asarray(corner[:6])


def _near(column: Float, y: Float, corner: Float, k: int, scale: float) -> tuple[float, float]:
    """An upper corner (k 0 or 2) from two lines through the returns within NEAR columns of it."""
    at, z = float(corner[k]), float(corner[3 + k])
    near = np.abs(column - at) < NEAR
    x, seen = column[near] - at, y[near]
    if min((x < 0).sum(), (x > 0).sum()) < LEAST_NEAR:
        return at, z
    left, right = (np.diff(_chain(corner, np.array(pair), column))[0] for pair in ((at - 9.0, at), (at, at + 9.0)))

    def away(unknown: Float) -> Float:
        off = x - unknown[0]
        return np.asarray((unknown[1] + np.where(off < 0, unknown[2], unknown[3]) * off - seen) / scale)

    found = scipy.optimize.least_squares(
        away, [0.0, z, left / 9.0, right / 9.0], loss="cauchy", x_scale=[10.0, 5.0, 0.1, 0.1]
    )
    return (at + float(found.x[0]), float(found.x[1])) if abs(found.x[0]) < MOST_MOVED else (at, z)


def _starts(column: Float, y: Float) -> list[Float]:
    """Corners of the outermost long lines, and the root at several places between, where the flanks' lines lead."""
    lines = straight_faces(PIECES_MM * column, PIECES_MM * y)
    long = lines[(lines[:, LAST] - lines[:, FIRST]) >= LEAST_LONG * column.size]
    if len(long) < 2:
        return []
    first, last = int(long[0][LAST]), int(long[-1][FIRST])
    left, right = column[first], column[last]
    if not left < right:
        return []
    inner = [line for line in long[1:-1] if abs(line[SLOPE] - long[0][SLOPE]) > 0.05]
    falls = [line[SLOPE] for line in inner if line[SLOPE] < 0] or [-0.5]
    lowest = float(np.quantile(y[first : last + 1], 0.05)) if last > first else float(y.min())
    out = []
    for share in ROOTS:
        root = left + share * (right - left)
        guess = max(lowest, y[first] + falls[0] * (root - left))
        out.append(np.array([left, root, right, y[first], guess, y[last]]))
    return out


def _range_at(column: Float, y: Float, end: int, corner: float, z: float) -> float:
    """Range of the upper surface at the row's first (0) or last (-1) column, for a start."""
    few = y[:25] if end == 0 else y[-25:]
    return float(np.median(few)) if abs(corner - column[end]) > 25 else z


def _chain(corner: Float, at: Float, column: Float) -> Float:
    place = np.array([column[0], *np.sort(corner[:3]), column[-1]])
    return np.asarray(np.interp(at, place, np.array([corner[6], *corner[3:6], corner[7]])))


def _fitted(column: Float, y: Float, start: Float, scale: float) -> tuple[float, Float] | None:
    """Cost and corners (8,): columns of left, root, right; ranges there; ranges at the row's ends."""
    if not column[0] < start[0] < start[1] < start[2] < column[-1]:
        return None
    for thin in (max(1, column.size // THIN), 1):
        some, seen = column[::thin], y[::thin]
        found = scipy.optimize.least_squares(
            lambda corner, some=some, seen=seen: (_chain(corner, some, column) - seen) / scale,
            start,
            lambda corner, some=some: _derivative(corner, some, column) / scale,
            loss="cauchy",
            x_scale=FIT_SCALE,
            max_nfev=MOST_STEPS,
        )
        start = found.x
        if not column[0] < start[0] < start[1] < start[2] < column[-1]:
            return None
    return float(found.cost), start


def _derivative(corner: Float, at: Float, column: Float) -> Float:
    """Derivative (n, 8) of `_chain`: a corner moves its neighbours' lines by their slopes and its share in them."""
    place = np.array([column[0], *np.sort(corner[:3]), column[-1]])
    value = np.array([corner[6], *corner[3:6], corner[7]])
    piece = np.clip(np.searchsorted(place, at, side="right") - 1, 0, 3)
    wide = np.maximum(np.diff(place), 1e-9)
    share = (at - place[piece]) / wide[piece]
    basis = np.zeros((at.size, 5))
    basis[np.arange(at.size), piece] = 1.0 - share
    basis[np.arange(at.size), piece + 1] = share
    slope = (np.diff(value) / wide)[piece]
    return np.column_stack([-basis[:, 1:4] * slope[:, None], basis[:, 1:4], basis[:, 0], basis[:, 4]])
