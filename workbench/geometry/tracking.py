"""Following the faces of an edge from frame to frame, and reducing each frame to the sums that least squares needs.

A frame's edge is a chain of faces in the order upper surface, bevel face, root face, lower surface, along rising
`side * x` (side = +1 or -1). Each face is a line z = k x + c; the frame before predicts the next one, since a part of
5 m drifts by millimetres but a frame only by hundredths.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from workbench.geometry.blocks import as_input, as_rows, in_order
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped

# Faces in chain order, and what a state row holds for each: slope, offset, seen (0 or 1), free end x.
UPPER, BEVEL, ROOT, LOWER = range(4)
SLOPE, OFFSET, SEEN, END = range(4)
# What `follow` reports for each frame and face.
COUNT, X_MEAN, Z_MEAN, SXX, SXZ, SZZ, FIRST, LAST = range(8)

SLACK_MM = 2.0  # how far the ends of the faces may move while a frame's lines settle
GATES_MM = np.array([0.6, 0.3, 0.15])  # how far off its line a point may lie while the frame's lines settle
TWO_LINES, SHIFTS = 1.7, 12  # sigmas of a face's points that are more than one line; steps of half a gate, each way
CORNER_MARGIN_MM = 0.03  # points this near to a corner are left out of both faces: corners are never quite sharp,
CORNER_SIGMAS = 4.0  # and their place in the frame is this uncertain; a stray point of the bevel turns the root face
SIDE_FACE_MM = 4.0  # of the upper and lower surface only this much next to the corner serves to measure it
FINAL_SIGMAS = 4.5
# A root face's returns have ended after so many columns that see something else, or so many that see nothing.
MAX_GAP_COLUMNS, MAX_LOST_COLUMNS = 8, 24
CLEAR, MIXED, CUT, BURR = range(4)  # how the root face's end was seen
NEARER_MM = 0.3  # a return this much nearer than the face's line is no burr on it, but stands in front
IN_FRONT_MM = 0.1  # than its end, beyond the noise: it stands in front of what follows
FLANK = 0.5  # width across the rays over height of a nearer surface's flank that is lost, at most: 63 deg and more
MIXED_STEP_MM = 0.3  # range step that tells a mixed pixel from the surface behind it
STILL = 0.02  # of the noise, by which a face's line may still move once its points are summed up
MIN_SHARE = 0.35  # of a face's columns that must have returned, for the frame to count
LOST_AFTER = 12  # frames without the edge, after which the prediction starts again from the key frames


@kernel
def _crossing(state: Float, a: int, b: int) -> float:
    """x of the corner between faces a and b."""
    dk = state[a, SLOPE] - state[b, SLOPE]
    if abs(dk) < 1e-6:
        return np.nan
    return float((state[b, OFFSET] - state[a, OFFSET]) / dk)


@kernel
def _copy(a: Float, b: Float) -> None:
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            b[i, k] = a[i, k]


@kernel
def _finite(a: Float) -> bool:
    for i in range(a.shape[0]):
        for k in range(a.shape[1]):
            if not np.isfinite(a[i, k]):
                return False
    return True


@kernel
def _limits(state: Float, side: float, margin_mm: float, rim_mm: float) -> Float:
    """Start and stop of each face along u = side * x, the margin at its ends taken off; empty if not seen.

    rim_mm: taken off the lower end of the root face besides, along x, and as much of the lower surface: their edge is
    rounded there.
    """
    limits = np.full((4, 2), np.nan)
    bevel_root = side * _crossing(state, BEVEL, ROOT)
    limits[BEVEL, 1], limits[ROOT, 0] = bevel_root, bevel_root
    limits[BEVEL, 0] = side * (_crossing(state, UPPER, BEVEL) if state[UPPER, SEEN] else state[BEVEL, END])
    limits[ROOT, 1] = side * (_crossing(state, ROOT, LOWER) if state[LOWER, SEEN] else state[ROOT, END])
    if state[UPPER, SEEN]:
        limits[UPPER, 1] = limits[BEVEL, 0]
        limits[UPPER, 0] = max(side * state[UPPER, END], limits[UPPER, 1] - SIDE_FACE_MM)
    if state[LOWER, SEEN]:
        limits[LOWER, 0] = limits[ROOT, 1]
        limits[LOWER, 1] = min(side * state[LOWER, END], limits[LOWER, 0] + SIDE_FACE_MM)
    for f in range(4):
        margin = margin_mm / np.sqrt(1.0 + state[f, SLOPE] ** 2)
        limits[f, 0] += margin
        limits[f, 1] -= margin
    limits[ROOT, 1] = max(limits[ROOT, 1] - rim_mm, 0.5 * (limits[ROOT, 0] + limits[ROOT, 1]))
    if state[LOWER, SEEN]:
        as_long = rim_mm * np.sqrt((1.0 + state[ROOT, SLOPE] ** 2) / (1.0 + state[LOWER, SLOPE] ** 2))
        limits[LOWER, 0] = min(limits[LOWER, 0] + as_long, 0.5 * (limits[LOWER, 0] + limits[LOWER, 1]))
    return limits


@kernel
def _corner_sigma(state: Float, count: float, sigma: float) -> float:
    """Standard deviation (mm) along the faces of a frame's corner of root face and bevel face, from the root line."""
    turn = abs(np.arctan(state[ROOT, SLOPE]) - np.arctan(state[BEVEL, SLOPE]))
    across = sigma / np.sqrt(1.0 + state[ROOT, SLOPE] ** 2)
    return float(2.0 * across / np.sqrt(max(count, 4.0)) / max(np.tan(turn), 0.2))


@kernel
def _spans(x: Float32, side: float, limits: Float) -> Int:
    """First and last + 1 column (4, 2) of each face, with SLACK_MM beyond its limits; empty if not seen."""
    spans = np.zeros((4, 2), np.int64)
    for f in range(4):
        if np.isfinite(limits[f, 0]) and np.isfinite(limits[f, 1]):
            spans[f, 0], spans[f, 1] = _window(x, side, limits[f, 0] - SLACK_MM, limits[f, 1] + SLACK_MM)
    return spans


@kernel
def _sums(
    x: Float32, z: Float32, keep: Bool, spans: Int, side: float, state: Float, limits: Float, gates: Float, out: Float
) -> None:
    """Fill `out` (4, 8), rows COUNT to SZZ: each face's sums over the points within its limits and gate, mm along z.

    Of the root face those alone that lie no nearer to what joins its lower end: above a table that crosses its line.
    """
    for f in range(4):
        i, j = spans[f, 0], spans[f, 1]
        start, stop, k, c = limits[f, 0], limits[f, 1], state[f, SLOPE], state[f, OFFSET]
        neighbour = LOWER if f == ROOT and state[LOWER, SEEN] else f
        other, lean = state[neighbour], np.sqrt((1.0 + k * k) / (1.0 + state[neighbour, SLOPE] ** 2))
        n, mx, mr, sxx, sxr, srr = _moments(x[i:j], z[i:j], keep[i:j], side, start, stop, k, c, gates[f], other, lean)
        out[f, COUNT], out[f, SXX], out[f, SXZ] = n, sxx, sxr + k * sxx  # z no longer relative to the line
        out[f, SZZ] = srr + 2.0 * k * sxr + k * k * sxx
        out[f, X_MEAN] = mx + start * side if n > 0 else 0.0
        out[f, Z_MEAN] = mr + k * out[f, X_MEAN] + c if n > 0 else 0.0


@kernel(fastmath={"reassoc", "contract"})
def _moments(
    x: Float32,
    z: Float32,
    keep: Bool,
    side: float,
    start: float,
    stop: float,
    slope: float,
    offset: float,
    gate: float,
    other: Float,
    lean: float,
) -> tuple[float, float, float, float, float, float]:
    """Count, means of x and r and centred sums xx, xr, rr of a face's points: x from its start, r from its line.

    Of those alone that lie no nearer to an `other` line, along whose z distances are `lean` times as long.
    """
    k, c = other[SLOPE], other[OFFSET]
    n, sx, sr, sxx, sxr, srr = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for j in range(x.size):
        xj = np.float64(x[j])
        r = np.float64(z[j]) - slope * xj - offset
        near = (abs(r) <= gate) & (abs(r) <= lean * abs(np.float64(z[j]) - k * xj - c))
        if keep[j] & (start <= side * xj) & (side * xj <= stop) & near:
            u = xj - start * side
            n, sx, sr, sxx, sxr, srr = n + 1.0, sx + u, sr + r, sxx + u * u, sxr + u * r, srr + r * r
    mx, mr = sx / max(n, 1.0), sr / max(n, 1.0)
    return n, mx, mr, max(sxx - n * mx * mx, 0.0), sxr - n * mx * mr, max(srr - n * mr * mr, 0.0)


@kernel
def _mark_ends(
    x: Float32, z: Float32, keep: Bool, spans: Int, side: float, state: Float, limits: Float, gates: Float, out: Float
) -> None:
    """Fill FIRST and LAST of `out` (4, 8): the first and the last column that `_sums` counts; -1 if there is none."""
    for f in range(4):
        k, c, gate, low, high = state[f, SLOPE], state[f, OFFSET], gates[f], limits[f, 0], limits[f, 1]
        for end, step in ((FIRST, 1), (LAST, -1)):
            out[f, end] = -1.0
            j = spans[f, 0] if step > 0 else spans[f, 1] - 1
            while spans[f, 0] <= j < spans[f, 1]:
                xj = np.float64(x[j])
                if keep[j] and low <= side * xj <= high and abs(z[j] - k * xj - c) <= gate:
                    out[f, end] = j
                    break
                j += step


@kernel
def _refit(state: Float, sums: Float, sigma: Float, free_slope: bool) -> float:
    """Move each face's line to its points; turn it too where they span enough to say. By how many sigmas, at most."""
    moved = 0.0
    for f in range(4):
        n = sums[f, COUNT]
        if not state[f, SEEN] or n < 3:
            continue
        slope, at = state[f, SLOPE], sums[f, X_MEAN]
        before = state[f, OFFSET] + slope * at
        if free_slope and n >= 6:
            state[f, SLOPE] = sums[f, SXZ] / max(sums[f, SXX], 1e-12)
        state[f, OFFSET] = sums[f, Z_MEAN] - state[f, SLOPE] * at
        rotation = abs(state[f, SLOPE] - slope) * np.sqrt(3.0 * sums[f, SXX] / n)
        moved = max(moved, (abs(sums[f, Z_MEAN] - before) + rotation) / sigma[f])
    return moved


@kernel
def _is_more_than_one(sums: Float, f: int, sigma: Float) -> bool:
    """Do a face's points scatter about their line by more than noise explains?"""
    left = sums[f, SZZ] - sums[f, SXZ] ** 2 / max(sums[f, SXX], 1e-12)
    return bool(left >= (TWO_LINES * sigma[f]) ** 2 * max(sums[f, COUNT] - 2.0, 1.0))


@kernel
def _onto_most(
    x: Float32,
    z: Float32,
    keep: Bool,
    spans: Int,
    side: float,
    state: Float,
    limits: Float,
    slopes: Float,
    sigma: Float,
    sums: Float,
) -> None:
    """Put the lines of bevel and root face, where their points are more than one line, onto most of the points.

    Spatter or second returns on a part of a face draw a least-squares line between both. slopes (4,): of before.
    """
    for f in (BEVEL, ROOT):
        if sums[f, COUNT] < 6 or not _is_more_than_one(sums, f, sigma):
            continue
        offset = state[f, OFFSET] + (state[f, SLOPE] - slopes[f]) * sums[f, X_MEAN]
        gate = FINAL_SIGMAS * sigma[f] + 0.004
        most, best = 0, 0.0
        for k in range(-SHIFTS, SHIFTS + 1):
            count = 0
            for j in range(spans[f, 0], spans[f, 1]):
                if keep[j] and limits[f, 0] <= side * x[j] <= limits[f, 1]:
                    r = z[j] - slopes[f] * np.float64(x[j]) - offset - 0.5 * k * gate
                    count += abs(r) <= gate
            if count > most:
                most, best = count, 0.5 * k * gate
        state[f, SLOPE], state[f, OFFSET] = slopes[f], offset + best


@kernel
def _window(x: Float32, side: float, low: float, high: float) -> tuple[int, int]:
    """First and last + 1 column whose u = side * x lies in [low, high]."""
    first, last = x.size, 0
    a, b = np.float32(min(side * low, side * high)), np.float32(max(side * low, side * high))
    for j in range(x.size):  # no branch: many at a time
        on = (a <= x[j]) & (x[j] <= b)
        first = min(first, j if on else x.size)
        last = max(last, j + 1 if on else 0)
    return (first, last) if first < last else (0, 0)


@kernel
def _cut_short(z: Float32, j: int, direction: int, on_line: float, step: float, sense: float, gate: float) -> bool:
    """Does something else than the face's own edge end it at column j: the field of view, or a nearer surface?

    A nearer surface casts its shadow on the face. Its flank towards the face may graze the rays (every column `step`
    mm farther on), and be lost.
    """
    nearer, k = 0, j + direction
    while 0 <= k < z.size:
        rise = -sense * (z[k] - on_line)
        if np.isfinite(z[k]):
            beyond = abs(k - j)
            if rise < max(gate, IN_FRONT_MM) or (beyond > MAX_GAP_COLUMNS and beyond * step > FLANK * rise):
                return False
            nearer += 1
            if nearer > 2:
                return True
        k += direction
    return nearer > 1 or abs(k - j) <= 2


@kernel
def _burred(x: Float32, z: Float32, keep: Bool, j: int, direction: int, line: Float, sense: float, gate: float) -> bool:
    """Does the surface rise out of the face's line beyond column j, without a jump: a burr on its end?"""
    rising = 0
    for d in range(1, 4):
        k = j + d * direction
        if k < 0 or k >= z.size:
            return False
        if not keep[k]:
            continue
        out = -sense * (z[k] - line[SLOPE] * np.float64(x[k]) - line[OFFSET])
        if out < 0.5 * gate or (rising == 0 and out > NEARER_MM):
            break
        rising += 1
    return rising >= 2


@kernel
def stands_alone(z: Float32, j: int, way: int, step_mm: float) -> bool:
    """Does column j return a range that the next one outwards does not share to `step_mm`: a mixed pixel?"""
    if j < 0 or j >= z.size or not np.isfinite(z[j]):
        return False
    beyond = j + way
    return beyond < 0 or beyond >= z.size or not abs(z[j] - z[beyond]) < step_mm


@kernel
def root_end(x: Float32, z: Float32, keep: Bool, side: float, state: Float, sums: Float, gate: float) -> Float:
    """The last return on the root face away from the bevel: x, z on its line, step along it a column, column, flag.

    Walks outwards from the face's points; stops after MAX_GAP_COLUMNS off the line or MAX_LOST_COLUMNS without return.
    The flag is MIXED where the next column returned a range of its own, neither the face's nor that of what lies
    behind: a pixel that saw both; CUT where the face ends in the field of view's limit or behind something; BURR where
    the surface rises out of it; else CLEAR.
    """
    first, last = int(sums[ROOT, FIRST]), int(sums[ROOT, LAST])
    rising = side * (np.float64(x[last]) - np.float64(x[first])) > 0
    direction = 1 if rising else -1
    j = end = last if rising else first
    off = lost = 0
    while off <= MAX_GAP_COLUMNS and lost <= MAX_LOST_COLUMNS:
        j += direction
        if j < 0 or j >= x.size:
            break
        on_line = keep[j] and abs(z[j] - state[ROOT, SLOPE] * np.float64(x[j]) - state[ROOT, OFFSET]) < gate
        if on_line and side * (x[j] - x[end]) > 0:
            end, off, lost = j, 0, 0
        elif np.isfinite(z[j]):
            off += 1
        else:
            lost += 1
    far = first if rising else last
    k = state[ROOT, SLOPE]
    dx = abs(np.float64(x[end]) - np.float64(x[far])) / max(abs(end - far), 1)
    xe = np.float64(x[end])
    ze = k * xe + state[ROOT, OFFSET]
    sense = np.sign(side * (np.arctan(state[ROOT, SLOPE]) - np.arctan(state[BEVEL, SLOPE])))  # convex: +1, z away
    flag = CLEAR
    if _burred(x, z, keep, end, direction, state[ROOT], sense, gate):
        flag = BURR
    elif _cut_short(z, end, direction, ze, dx, sense, gate):
        flag = CUT
    elif stands_alone(z, end + direction, direction, MIXED_STEP_MM):
        flag = MIXED
    return np.array([xe, ze, dx * np.sqrt(1.0 + k * k), float(end), float(flag)])


@kernel
def _enough(sums: Float, face: int, least: int) -> bool:
    span = abs(sums[face, LAST] - sums[face, FIRST]) + 1.0
    return bool(sums[face, COUNT] >= least and sums[face, COUNT] >= MIN_SHARE * span)


@kernel
def _sharpened(x: Float32, z: Float32, side: float, state: Float, half_mm: float) -> Float32:
    """The profile less what a mean over `half_mm` to either side adds beside corners (docs/method.md, 2)."""
    if not half_mm > 0.0:
        return z
    out = z.copy()
    for f in range(3):
        if not (state[f, SEEN] and state[f + 1, SEEN]):
            continue
        corner, turn = _crossing(state, f, f + 1), side * (state[f + 1, SLOPE] - state[f, SLOPE])
        for j in range(x.size):
            within = half_mm - abs(np.float64(x[j]) - corner)
            if within > 0.0:
                out[j] -= np.float32(turn * within * within / (4.0 * half_mm))
    return out


@kernel
def _pure(z: Float32, keep: Bool, reach: int) -> Bool:
    """Which of the columns (M,) that are kept have returns in `reach` columns to either side.

    A mean over columns is that of another place beside a lost one.
    """
    out = keep.copy()
    if reach > 0:
        for j in range(z.size):
            if not np.isfinite(z[j]):
                out[max(j - reach, 0) : j + reach + 1] = False
    return out


@kernel
def _follow_frame(x: Float32, z: Float32, keep: Bool, state: Float, faces: KnownFaces, sums: Float, end: Float) -> bool:
    """Settle `state` on one frame in place; write its sums and the root face's end. False: edge not seen."""
    side, sigma, _, rim_mm, mean_mm, reach = faces
    filtered, pure = z, _pure(z, keep, reach)
    width0 = abs(_crossing(state, BEVEL, ROOT) - state[ROOT, END])
    bevel0 = abs(_crossing(state, BEVEL, ROOT) - state[BEVEL, END])
    spans = _spans(x, side, _limits(state, side, 0.0, 0.0))
    least = CORNER_MARGIN_MM + 0.5 * mean_mm
    gates, margin = np.empty(4), least
    before = state[:, SLOPE].copy()
    plain, moved = False, np.inf
    for step in range(GATES_MM.size + 2):
        if plain and step < GATES_MM.size:  # the widest gate holds one line alone
            continue
        z = _sharpened(x, filtered, side, state, 0.5 * mean_mm)
        for f in range(4):
            lean = np.sqrt(1.0 + state[f, SLOPE] ** 2)
            settled = FINAL_SIGMAS * sigma[f] + 0.004
            gates[f] = lean * GATES_MM[step] if step < GATES_MM.size else settled
            if step < GATES_MM.size:
                gates[f] = max(gates[f], settled)
        _sums(x, z, pure, spans, side, state, _limits(state, side, margin, rim_mm), gates, sums)
        if sums[BEVEL, COUNT] < 5 or sums[ROOT, COUNT] < 3:
            return False
        moved = _refit(state, sums, sigma, step > 0)
        margin = least + CORNER_SIGMAS * _corner_sigma(state, sums[ROOT, COUNT], sigma[ROOT])
        if step == GATES_MM.size - 1:
            _onto_most(x, z, pure, spans, side, state, _limits(state, side, margin, rim_mm), before, sigma, sums)
        if step == 0:  # the frame as a whole may have moved: carry the free ends along with the corner
            _carry_ends(state, width0, bevel0, side)
            plain = not (_is_more_than_one(sums, BEVEL, sigma) or _is_more_than_one(sums, ROOT, sigma))
    limits = _limits(state, side, margin, rim_mm)
    if moved > STILL:
        _sums(x, z, pure, spans, side, state, limits, gates, sums)
    _mark_ends(x, z, pure, spans, side, state, limits, gates, sums)
    if not (_enough(sums, BEVEL, 6) and _enough(sums, ROOT, 3)):
        return False
    for k, value in enumerate(root_end(x, z, keep, side, state, sums, gates[ROOT])):
        end[k] = value
    corner = _crossing(state, BEVEL, ROOT)
    width = abs(end[0] - corner)
    hollow = (state[ROOT, SLOPE] - state[BEVEL, SLOPE]) * (before[ROOT] - before[BEVEL]) <= 0.0
    if hollow or not 0.4 * width0 < width < 2.5 * width0:
        return False
    state[ROOT, END] = end[0]
    return True


@kernel
def _carry_ends(state: Float, root_dx: float, bevel_dx: float, side: float) -> None:
    corner = _crossing(state, BEVEL, ROOT)
    state[ROOT, END] = corner + side * root_dx
    state[BEVEL, END] = corner - side * bevel_dx


@kernel
def _label(
    x: Float32, z: Float32, keep: Bool, side: float, state: Float, sigma: Float, names: Int, labels: AnyArray
) -> None:
    """Name the face of each point of a frame whose lines are known."""
    bounds = np.empty(5)
    bounds[1] = side * (_crossing(state, UPPER, BEVEL) if state[UPPER, SEEN] else state[BEVEL, END])
    bounds[2] = side * _crossing(state, BEVEL, ROOT)
    bounds[3] = side * (_crossing(state, ROOT, LOWER) if state[LOWER, SEEN] else state[ROOT, END])
    bounds[0] = side * state[UPPER, END] if state[UPPER, SEEN] else bounds[1]
    bounds[4] = side * state[LOWER, END] if state[LOWER, SEEN] else bounds[3]
    first, second, third = bounds[1], bounds[2], bounds[3]
    low, high = bounds[0] - 0.01, bounds[4] + 0.01
    gates = FINAL_SIGMAS * sigma + 0.004
    gates[UPPER], gates[LOWER] = 3.0 * FINAL_SIGMAS * sigma[UPPER], 3.0 * FINAL_SIGMAS * sigma[LOWER]
    k0, k1, k2, k3 = state[0, SLOPE], state[1, SLOPE], state[2, SLOPE], state[3, SLOPE]
    c0, c1, c2, c3 = state[0, OFFSET], state[1, OFFSET], state[2, OFFSET], state[3, OFFSET]
    g0, g1, g2, g3 = gates
    n0, n1, n2, n3 = names
    for j in range(x.size):  # no branch: many at a time
        xj = np.float64(x[j])
        u = side * xj
        upper, bevel, root = u <= first, u <= second, u <= third
        k = k0 if upper else (k1 if bevel else (k2 if root else k3))
        c = c0 if upper else (c1 if bevel else (c2 if root else c3))
        gate = g0 if upper else (g1 if bevel else (g2 if root else g3))
        name = n0 if upper else (n1 if bevel else (n2 if root else n3))
        on = keep[j] & (low <= u) & (u <= high) & (abs(np.float64(z[j]) - k * xj - c) < gate)
        labels[j] = name if on else 0


class Profiles(NamedTuple):
    """The grid of one pass."""

    x: Shaped[Float32, "r M"]  # one row for all frames, or each frame's own
    z: Shaped[Float32, "n M"]
    keep: Shaped[Bool, "n M"]


class KeyFrames(NamedTuple):
    """Frames in which the faces are known: in all of them the same."""

    frames: Shaped[Int, " k"]  # rising
    states: Shaped[Float, "k 4 4"]


class KnownFaces(NamedTuple):
    """What is known of the faces in all frames."""

    side: float
    sigma: Shaped[Float, " 4"]  # range noise of each, mm
    names: Shaped[Int, " 4"]  # label of each
    rim_mm: float  # rounded end of the root face that its line leaves out
    mean_mm: float  # width along x of the sensor's mean over columns; 0: none
    reach: int  # columns to either side that it takes in


class Followed(NamedTuple):
    """What is found in each frame."""

    sums: Shaped[Float, "n 4 8"]
    end: Shaped[Float, "n 5"]  # as `root_end`
    seen: Shaped[Bool, " n"]
    labels: Shaped[AnyArray, "n M"]


@kernel
def _follow_from(
    state: Float, frames: Int, reach: Int, ends: Float, grid: Profiles, faces: KnownFaces, found: Followed
) -> None:
    """Follow the faces from `state`, which moves with them, through frames in their order.

    ends (2, 4, 4): states at frames `reach` (2,), on a line between which it starts again where the edge is lost.
    """
    side, sigma, names, _, _, _ = faces
    sums, end, seen, labels = found
    lost = 0
    for frame in frames:
        if lost > LOST_AFTER or not _finite(state):
            w = (frame - reach[0]) / (reach[1] - reach[0])
            for f in range(4):
                for k in range(4):
                    state[f, k] = (1.0 - w) * ends[0, f, k] + w * ends[1, f, k]
        trial, x, z, keep = state.copy(), grid.x[min(frame, len(grid.x) - 1)], grid.z[frame], grid.keep[frame]
        seen[frame] = _follow_frame(x, z, keep, trial, faces, sums[frame], end[frame])
        if seen[frame]:
            _copy(trial, state)
            lost = 0
            _label(x, z, keep, side, state, sigma, names, labels[frame])
        else:
            for f in range(4):
                for k in range(8):
                    sums[frame, f, k] = 0.0
            for j in range(z.size):
                labels[frame, j] = 0
            lost += 1


@kernel
def _follow_stretch(c: int, keys: Int, states: Float, grid: Profiles, faces: KnownFaces, found: Followed) -> None:
    """Follow the faces between key frames c - 1 and c from both to the middle, and in key frame c: alike either way.

    A frame in the middle starts from the mean of its neighbours. Stretch 0 lies before the first key frame.
    """
    reach = np.array([-1 if c == 0 else keys[c - 1], grid.z.shape[0] if c == keys.size else keys[c]])
    ends = np.stack((states[max(c - 1, 0)], states[min(c, keys.size - 1)]))
    between = reach[1] - reach[0] - 1
    ahead = between if c == keys.size else (0 if c == 0 else between // 2)
    back = between if c == 0 else (0 if c == keys.size else between // 2)
    low, high = ends[0].copy(), ends[1].copy()
    _follow_from(low, np.arange(reach[0] + 1, reach[0] + 1 + ahead), reach, ends, grid, faces, found)
    _follow_from(high, np.arange(reach[1] - 1, reach[1] - 1 - back, -1), reach, ends, grid, faces, found)
    middle = np.arange(reach[0] + 1 + ahead, reach[1] - back)
    _follow_from(0.5 * (low + high), middle, reach, ends, grid, faces, found)
    if c < keys.size:
        _follow_from(ends[1].copy(), reach[1:].copy(), reach, ends, grid, faces, found)


def follow(grid: Profiles, keys: KeyFrames, faces: KnownFaces, found: Followed) -> None:
    """Follow the faces through the frames between the key frames, on all cores; fill in what is `found`."""
    profiles = Profiles(as_rows(grid.x), as_input(grid.z), as_input(grid.keep))
    frames, states = as_input(keys.frames), as_input(keys.states)
    faces = faces._replace(sigma=as_input(faces.sigma), names=as_input(faces.names))

    def stretch(c: int, _: int) -> None:
        _follow_stretch(c, frames, states, profiles, faces, found)

    for _ in in_order(stretch, keys.frames.size + 1, 1):
        pass


def face_sigmas(sums: Float, seen: Bool) -> Float:
    """Range noise of each face (4,), mm: median over frames of the rms residual about its own line."""
    sigma = np.full(4, 0.02)
    for f in range(4):
        face = sums[seen & (sums[:, f, COUNT] >= 3), f]
        rss = np.maximum(face[:, SZZ] - face[:, SXZ] ** 2 / np.maximum(face[:, SXX], 1e-12), 0.0)
        free, many = face[:, COUNT] - 2.0, face[:, COUNT] >= 5
        if many.sum() > 0.5 * many.size:
            free, rss = free[many], rss[many]
        else:
            free *= (1.0 - 2.0 / (9.0 * free)) ** 3  # half of such sums lie below
        if free.size:
            sigma[f] = max(float(np.median(np.sqrt(rss / free))), 0.002)
    return sigma
