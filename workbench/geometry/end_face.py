"""The end face of a raw plate in a profile: the straight run between the plate's two surfaces, compiled.

A profile is turned into coordinates p, along the face from the lower to the upper side, and q, across it. In these the
face is the level of q along which p advances most, rough or not; the plate's surfaces run across it from its ends.
"""

from __future__ import annotations

import math

import numpy as np

from workbench.geometry.medians import median_of
from workbench.geometry.tracking import COUNT, FINAL_SIGMAS, FIRST, LAST, SXX, SXZ, SZZ, X_MEAN, Z_MEAN, stands_alone
from workbench.kernels import kernel
from workbench.units import TO_SD, AnyArray, Bool, Float, Float32, Int

# Faces that `read_frame` reports; of each the sums of geometry.tracking.
FACE, UPPER, LOWER, WHOLE = range(4)  # WHOLE: the end face with its margins
# What it reports of the face's lower end (0) and upper end (1).
KIND, END_X, END_Z, COLUMN, PITCH, SLOPE, ALONE, PROUD, GAP = range(9)
HIDDEN, SILHOUETTE, CORNER, GOES_ON = range(4)  # kinds of ends

LEVEL_MM = 0.25  # width of the levels of q that are compared
LEVELS = 5  # that one face may spread over
STEP_MM = 3.0  # along the face without a return, at most
GAP_POINTS = 10  # off the face between two of its own: more belong to something else, and the face has ended
JUMP_MM = 0.6  # across it between neighbouring returns, at most
LEAST_WIDTH_MM = 1.0
LEAST_POINTS = 8
GATES_MM = (0.8, 0.6, 0.6)  # about the face's line while it settles
STREAK = 0.5  # times what the line leaves, that most points leave of theirs: the others are a streak, not roughness
SCALE_POINTS = 128  # and up to twice as many, of its points, that tell how most of them lie
FINAL_LEAST_MM, FINAL_MOST_MM = 0.08, 0.6
# Of the face at its ends that is left out, and of its width: burrs, and the corner's own points.
MARGIN_MM, MARGIN = 0.5, 0.25
SURFACE_FROM_MM, SURFACE_TO_MM = 0.6, 8.0  # depth behind the face at which its surfaces are measured
SURFACE_NEAR_MM = 2.5  # a surface that joins the face is seen within this depth
SURFACE_SLACK, SURFACE_LEAN = 0.8, 0.15  # mm, and mm per mm of depth, that a surface may be off the square
# What the plate lies on: lean to the upper surface, mm per mm, how far out it is seen, columns of the face below it.
TABLE_LEAN, TABLE_MM, BELOW_COLUMNS = 0.05, 5.0, 2.0
LOOK_COLUMNS = 12  # beyond the face's end, for what ends it
OFF_LINE_MM = 0.3  # in front of or behind the face's line
PROUD_NEAR_MM, PROUD_FROM_MM, PROUD_TO_MM = 1.2, 0.08, 1.5  # of the edge: points that stand out there; how far
BROKEN_MM = 2.0  # beyond the face, of a rounding or a chamfer
LEFT_MM = 0.1  # under the face's line: it is left
END_POINTS = 7  # at the face's end that say how it leans there


@kernel
def _rotated(x: Float32, z: Float32, keep: Bool, gx: float, gz: float, at: Int, p: Float, q: Float) -> int:
    """Fill columns `at`, p and q of the kept points; how many."""
    n = 0
    for j in range(x.size):
        if keep[j]:
            u, w = np.float64(x[j]), np.float64(z[j])
            at[n], p[n], q[n] = j, gx * u + gz * w, gx * w - gz * u
            n += 1
    return n


@kernel
def _level(p: Float, q: Float, n: int, rising: float) -> tuple[float, float]:
    """The level of q along which p advances most, and by how much, mm. rising: +1 if p rises with the column."""
    low, high = np.inf, -np.inf
    for k in range(n):
        low, high = min(low, q[k]), max(high, q[k])
    advance = np.zeros(int((high - low) / LEVEL_MM) + LEVELS + 1)
    for k in range(n - 1):
        dp = rising * (p[k + 1] - p[k])
        if abs(q[k + 1] - q[k]) < JUMP_MM and abs(dp) < STEP_MM:
            advance[int((0.5 * (q[k] + q[k + 1]) - low) / LEVEL_MM)] += dp
    best, most = 0, -np.inf
    for b in range(advance.size - LEVELS):
        total = advance[b : b + LEVELS].sum()
        if total > most:
            best, most = b, total
    return low + (best + 0.5 * LEVELS) * LEVEL_MM, most


@kernel
def _block(p: Float, q: Float, n: int, a: float, b: float, gate: float) -> tuple[int, int]:
    """First and last of the points within the gate of q = a + b p: the longest run along p without a gap."""
    best_first, best_last, longest = 0, -1, 0.0
    first, last = -1, -1
    for k in range(n + 1):
        if k < n and abs(q[k] - a - b * p[k]) > gate:
            continue
        if k < n and last >= 0 and abs(p[k] - p[last]) < STEP_MM and k - last <= GAP_POINTS:
            last = k
            continue
        if last >= 0 and abs(p[last] - p[first]) > longest:
            best_first, best_last, longest = first, last, abs(p[last] - p[first])
        first, last = k, k
    return best_first, best_last


@kernel
def _left_out(width: float) -> float:
    """Of a face so wide, at each end, mm."""
    return min(MARGIN_MM, MARGIN * width)


@kernel
def _settle(p: Float, q: Float, n: int, level: float, leave: bool) -> tuple[float, float, int, int, float, bool]:
    """The face's line q = a + b p, its first and last point, the gate (mm) about it, and whether a streak was left out.

    leave: a streak of stray returns beside the face may be left out.
    """
    a, b, gate, left = level, 0.0, GATES_MM[0], False
    for step in range(len(GATES_MM) + 1):
        if step < len(GATES_MM):
            gate = GATES_MM[step]
        first, last = _block(p, q, n, a, b, gate)
        if last < 0:
            return a, b, 0, -1, gate, left
        low, high = min(p[first], p[last]), max(p[first], p[last])
        if high - low < LEAST_WIDTH_MM:
            return a, b, 0, -1, gate, left
        margin = _left_out(high - low)
        low, high = low + margin, high - margin
        m, sp, sq, spp, spq, sqq = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for k in range(first, last + 1):
            r, u = q[k] - a - b * p[k], p[k] - low
            if abs(r) <= gate and low <= p[k] <= high:
                m, sp, sq, spp, spq, sqq = m + 1.0, sp + u, sq + r, spp + u * u, spq + u * r, sqq + r * r
        if m < LEAST_POINTS:
            return a, b, 0, -1, gate, left
        spread = spp - sp * sp / m
        turn = (spq - sp * sq / m) / max(spread, 1e-9)
        rss = max(sqq - sq * sq / m - turn * turn * spread, 0.0)
        a, b = a + (sq - turn * sp) / m - turn * low, b + turn
        scale = math.sqrt(rss / m)
        if leave and step == len(GATES_MM) - 1 and scale > FINAL_LEAST_MM / FINAL_SIGMAS:
            most_a, most_b, most_scale = _without_streaks(p, q, first, last, a, b)
            left = most_scale < STREAK * scale
            if left:
                a, b, scale = most_a, most_b, most_scale
        gate = min(max(FINAL_SIGMAS * scale, FINAL_LEAST_MM), FINAL_MOST_MM)
    first, last = _block(p, q, n, a, b, gate)
    return a, b, first, last, gate, left


@kernel
def _without_streaks(p: Float, q: Float, first: int, last: int, a: float, b: float) -> tuple[float, float, float]:
    """The line that most points of a run follow, near q = a + b p, and how far they scatter about it, mm.

    A streak of stray returns beside the face leans as the face does: slopes over a fifth of the run tell the face's, as
    long as the streak takes less than half of it.
    """
    along, off, work = np.empty(2 * SCALE_POINTS), np.empty(2 * SCALE_POINTS), np.empty(2 * SCALE_POINTS)
    size = 0
    for k in range(first, last + 1, max(1, (last + 1 - first) // SCALE_POINTS)):
        r = q[k] - a - b * p[k]
        if abs(r) <= GATES_MM[0]:
            along[size], off[size] = p[k] - p[first], r
            size += 1
    apart, slopes = max(1, size // 5), 0
    for i in range(size - apart):
        way = along[i + apart] - along[i]
        if way != 0.0:
            work[slopes] = (off[i + apart] - off[i]) / way
            slopes += 1
    turn = median_of(work, slopes) if slopes else 0.0
    for i in range(size):
        work[i] = off[i] - turn * along[i]
    middle = median_of(work, size) if size else 0.0
    for i in range(size):
        work[i] = abs(off[i] - turn * along[i] - middle)
    scale = median_of(work, size) * TO_SD if size else GATES_MM[0]
    return a + middle - turn * p[first], b + turn, scale


@kernel
def best_direction(x: Float32, z: Float32, keep: Bool, gx: float, gz: float, angles: Float, out: Float) -> None:
    """The end face's direction in a profile, among `angles` about (gx, gz), and what lies beside it.

    Fills out (6,): the face's angle from (gx, gz) towards (-gz, gx), rad; its width, mm (0: no face); and how many of
    the points next to its upper end, then next to its lower end, lie at higher and at lower z than its line.
    """
    at, p, q = np.empty(x.size, np.int64), np.empty(x.size), np.empty(x.size)
    out[:] = 0.0
    best, most = 0.0, LEAST_WIDTH_MM
    for angle in angles:
        c, s = math.cos(angle), math.sin(angle)
        n = _rotated(x, z, keep, gx * c - gz * s, gz * c + gx * s, at, p, q)
        if n < LEAST_POINTS:
            return
        length = _level(p, q, n, _rising(x, at, n, gx * c - gz * s))[1]
        if length > most:
            best, most = angle, length
    if most == LEAST_WIDTH_MM:
        return
    for _ in range(2):
        c, s = math.cos(best), math.sin(best)
        ux, uz = gx * c - gz * s, gz * c + gx * s
        n = _rotated(x, z, keep, ux, uz, at, p, q)
        a, b, first, last, gate, _ = _settle(p, q, n, _level(p, q, n, _rising(x, at, n, ux))[0], False)
        if last < 0:
            return
        best += math.atan(b)
        if not angles[0] <= best <= angles[-1]:
            return  # another surface, which stands across
    out[0], out[1] = best, abs(p[last] - p[first])
    for k in range(n):
        end = first if k < first else last
        r = (q[k] - a - b * p[k]) * np.sign(ux)
        if first <= k <= last or abs(at[k] - at[end]) > 2 * LOOK_COLUMNS or abs(r) < max(OFF_LINE_MM, gate):
            continue
        is_lower = p[end] < 0.5 * (p[first] + p[last])
        out[(4 if is_lower else 2) + (0 if r > 0.0 else 1)] += 1.0


@kernel
def _rising(x: Float32, at: Int, n: int, gx: float) -> float:
    """+1 if p rises with the column on a face that the scanner sees, else -1."""
    return 1.0 if (np.float64(x[at[n - 1]]) - np.float64(x[at[0]])) * gx > 0.0 else -1.0


@kernel
def _sum_up(x: Float32, z: Float32, at: Int, chosen: Bool, n: int, weight: Float, out: Float) -> None:
    """Fill out (8,) with the sums of the chosen points, by their weights (mean 1)."""
    m, total, sx, sz, first = 0.0, 0.0, 0.0, 0.0, -1
    for k in range(n):
        if chosen[k]:
            w = weight[k]
            m, total = m + 1.0, total + w
            sx, sz = sx + w * np.float64(x[at[k]]), sz + w * np.float64(z[at[k]])
            first = at[k] if first < 0 else first
            out[LAST] = at[k]
    out[COUNT], out[FIRST] = m, first
    if m == 0.0:
        return
    mx, mz = sx / total, sz / total
    sxx, sxz, szz = 0.0, 0.0, 0.0
    for k in range(n):
        if chosen[k]:
            w, dx, dz = weight[k], np.float64(x[at[k]]) - mx, np.float64(z[at[k]]) - mz
            sxx, sxz, szz = sxx + w * dx * dx, sxz + w * dx * dz, szz + w * dz * dz
    out[X_MEAN], out[Z_MEAN], out[SXX], out[SXZ], out[SZZ] = mx, mz, sxx, sxz, szz


@kernel
def _spread_out(p: Float, chosen: Bool, n: int, weight: Float) -> None:
    """Weights (mean 1) by which the chosen points stand for the face evenly: slopes towards the scanner show more."""
    before, m, total = -1, 0.0, 0.0
    for k in range(n):
        weight[k] = 0.0
        if chosen[k]:
            if before >= 0:
                gap = abs(p[k] - p[before])
                weight[before], weight[k] = weight[before] + gap, gap
                total += 2.0 * gap
            before, m = k, m + 1.0
    for k in range(n):
        weight[k] *= m / max(total, 1e-9)


@kernel
def _surface(
    p: Float, depth: Float, first: int, last: int, end: float, way: int, chosen: Bool
) -> tuple[float, float, float]:
    """The surface that runs into the plate from the face's end at p = `end`, over points first to last - 1.

    Marks its points in `chosen`; its line p = a + b depth and the gate (mm) about it, which is 0 where none is seen.
    The farther from the face its columns (in the sense of `way`), the deeper it lies: what is seen through a gap under
    the plate, a table, runs the other way.
    """
    a, b, gate = end, 0.0, SURFACE_SLACK
    lean = SURFACE_LEAN
    for limit in (0.4, 0.2, 0.0, 0.0):
        m, sd, sp, sdd, sdp, spp = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        near, far, mk, kd = np.inf, -np.inf, 0.0, 0.0
        for k in range(first, last):
            d = depth[k]
            r = p[k] - a - b * d
            chosen[k] = SURFACE_FROM_MM < d < SURFACE_TO_MM and abs(r) < gate + lean * d
            if chosen[k]:
                m, sd, sp, sdd, sdp, spp = m + 1.0, sd + d, sp + r, sdd + d * d, sdp + d * r, spp + r * r
                near, far, mk, kd = min(near, d), max(far, d), mk + k, kd + k * d
        if m < LEAST_POINTS or near > SURFACE_NEAR_MM or far - near < 1.0 or way * (kd - mk * sd / m) < 0.0:
            return a, b, 0.0
        spread = sdd - sd * sd / m
        turn = (sdp - sd * sp / m) / max(spread, 1e-9)
        rss = max(spp - sp * sp / m - turn * turn * spread, 0.0)
        a, b, lean = a + (sp - turn * sd) / m, b + turn, 0.0
        gate = limit if limit > 0.0 else min(max(FINAL_SIGMAS * math.sqrt(rss / m), 0.03), 0.2)
    return a, b, gate


@kernel
def _table(
    p: Float, depth: Float, out: Float, end: int, other: int, n: int, way: int, lean: float, pitch: float, chosen: Bool
) -> tuple[float, float]:
    """Where what a plate lies on crosses its face, which ends at point `end`, and the gate about it, mm; 0: none.

    It is parallel to the upper surface (lean; NaN: not seen), reaches out in front of the face, and the face does not
    go on below it, as beside a stop. Marks its points in `chosen`. out (n,) is scratch.
    """
    if not math.isfinite(lean):
        return 0.0, 0.0
    far = 0.0
    for k in range(n):
        out[k], chosen[k] = -depth[k], False
    # The face's last points may be where the table crosses its line: it begins before them.
    first, last = (min(end, other), n) if way > 0 else (0, max(end, other) + 1)
    a, b, around = _surface(p, out, first, last, p[end], way, chosen)
    below = (p[end] - a) * np.sign(p[end] - p[other])
    if around == 0.0 or abs(b + lean) > TABLE_LEAN or below > BELOW_COLUMNS * pitch:
        return 0.0, 0.0
    for k in range(first, last):
        if chosen[k]:
            far = max(far, out[k])
    return (a, around) if far > TABLE_MM else (0.0, 0.0)


@kernel
def _gap(p: Float, depth: Float, n: int, middle: int, way: int, crossing: float, around: float, gate: float) -> float:
    """How far above the crossing with what a plate lies on (its returns within `around`) the face's returns end, mm.

    middle: a point of the face; its lower end lies towards `way`. What returns from behind the face lies below it.
    """
    k, low = middle, p[middle]
    while 0 <= k < n and not (depth[k] > gate and abs(p[k] - crossing) < around):
        low = min(low, p[k]) if abs(depth[k]) <= gate else low
        k += way
    return float(low - crossing)


@kernel
def _walked(p: Float, depth: Float, at: Int, n: int, end: int, way: int, climb: float) -> int:
    """The face's last point beyond `end`: where a burr stands on its end, it goes on out of its line."""
    k = end
    while 0 <= k + way < n and abs(at[k + way] - at[k]) <= 2:
        dp, out = climb * (p[k + way] - p[k]), -depth[k + way]
        if not (dp > 0.0 and -0.05 < out < 3.0 and abs(depth[k + way] - depth[k]) < 0.2 + 2.0 * dp):
            break
        k += way
    return k if abs(k - end) >= 2 else end


@kernel
def _what_ends(p: Float, depth: Float, at: Int, n: int, columns: int, end: int, way: int) -> int:
    """HIDDEN where the field of view or a nearer surface ends the face, GOES_ON where a surface does; else SILHOUETTE.

    What goes on for less than BROKEN_MM is its rounded or chamfered edge.
    """
    rim = at[end] if way < 0 else columns - 1 - at[end]
    if rim < 2:
        return HIDDEN
    nearer, k = 0, end + way
    while 0 <= k < n and abs(at[k] - at[end]) <= LOOK_COLUMNS:
        nearer += -depth[k] > OFF_LINE_MM
        k += way
    if nearer >= 2:
        return HIDDEN
    on, k = 0, end + way
    while 0 <= k < n and abs(at[k] - at[k - way]) <= 3:
        if abs(depth[k] - depth[k - way]) + abs(p[k] - p[k - way]) > 0.3 * abs(at[k] - at[k - way]):
            break
        on, k = on + 1, k + way
    start = end  # where what goes on leaves the face
    while 0 < start < n - 1 and depth[start] > LEFT_MM:
        start -= way
    far = math.hypot(p[k - way] - p[start], depth[k - way] - depth[start])
    return GOES_ON if on >= 4 and far > BROKEN_MM else SILHOUETTE


@kernel
def _read_frame(
    x: Float32,
    z: Float32,
    keep: Bool,
    gx: float,
    gz: float,
    sense: float,
    names: Int,
    work: Float,
    at: Int,
    chosen: Bool,
    sums: Float,
    ends: Float,
    labels: AnyArray,
    leave: bool,
) -> tuple[bool, bool]:
    """One frame of `read_frames`; work (4, M), at (M,) and chosen (M,) are scratch. Is there an end face; a streak?"""
    p, q, depth = work[0], work[1], work[2]
    n = _rotated(x, z, keep, gx, gz, at, p, q)
    if n < LEAST_POINTS:
        return False, False
    rising = _rising(x, at, n, gx)
    level, length = _level(p, q, n, rising)
    if length < 0.5 * LEAST_WIDTH_MM:
        return False, False
    a, b, first, last, gate, left = _settle(p, q, n, level, leave)
    if last < 0 or abs(p[last] - p[first]) < LEAST_WIDTH_MM:
        return False, False
    inward = sense * np.sign(gx)
    low_end, high_end = (first, last) if rising > 0 else (last, first)
    low, high = p[low_end], p[high_end]
    margin = _left_out(high - low)
    for k in range(n):
        depth[k] = inward * (q[k] - a - b * p[k])
        chosen[k] = first <= k <= last and abs(depth[k]) <= gate
    _label_chosen(chosen, at, n, names[FACE], labels)
    _spread_out(p, chosen, n, work[3])
    _sum_up(x, z, at, chosen, n, work[3], sums[WHOLE])
    for k in range(n):
        chosen[k] = chosen[k] and low + margin <= p[k] <= high - margin
    work[3, :n] = 1.0
    _sum_up(x, z, at, chosen, n, work[3], sums[FACE])
    if sums[FACE, COUNT] < LEAST_POINTS:
        return False, False
    lean = np.nan  # of the upper surface, mm per mm of depth
    for upper in (1, 0):
        end = high_end if upper else low_end
        way = 1 if end == last else -1
        climb = 1.0 if upper else -1.0
        start, stop = (end, n) if way > 0 else (0, end + 1)
        chosen[:n] = False
        sa, sb, around = _surface(p, depth, start, stop, p[end], way, chosen)
        if upper and around > 0.0:
            lean = sb
        if not upper and around == 0.0:
            pitch = abs(p[last] - p[first]) / max(last - first, 1)
            ta, table = _table(p, depth, q, end, high_end, n, way, lean, pitch, chosen)
            if table > 0.0:
                ends[0, KIND], ends[0, PROUD] = CORNER, 0.0
                ends[0, GAP] = max(_gap(p, depth, n, (first + last) // 2, way, ta, table, gate) - 0.5 * pitch, 0.0)
                _sum_up(x, z, at, chosen, n, work[3], sums[LOWER])
                _label_chosen(chosen, at, n, names[LOWER], labels)
                continue
        edge = sa if around > 0.0 else p[end]
        ends[upper, PROUD] = _proud(p, depth, n, climb, edge, sb, around, gate)
        if around > 0.0:
            _sum_up(x, z, at, chosen, n, work[3], sums[UPPER if upper else LOWER])
            ends[upper, KIND] = CORNER
            _label_surface(p, depth, at, start, stop, sa, sb, 2.0 * around, names[UPPER if upper else LOWER], labels)
            continue
        tip = _walked(p, depth, at, n, end, way, climb)
        ends[upper, KIND] = _what_ends(p, depth, at, n, x.size, tip, way)
        j = at[tip]
        ends[upper, END_X], ends[upper, END_Z], ends[upper, COLUMN] = x[j], z[j], way * j
        ends[upper, SLOPE] = _slope_at(x, z, at, depth, end, -way, gate)
        ends[upper, PITCH] = abs(np.float64(x[at[last]]) - np.float64(x[at[first]])) / abs(at[last] - at[first])
        ends[upper, ALONE] = stands_alone(z, j + way, way, OFF_LINE_MM)
    return True, left


@kernel
def _proud(p: Float, depth: Float, n: int, climb: float, edge: float, lean: float, around: float, gate: float) -> int:
    """How many points next to the edge stand out of the face, or (around > 0: it is seen) of the surface beside it."""
    count = 0
    for k in range(n):
        above = climb * (p[k] - edge - lean * depth[k])
        from_face = -PROUD_NEAR_MM < above < 0.3 and gate < -depth[k] < PROUD_TO_MM
        from_surface = around > 0.0 and -gate < depth[k] < PROUD_NEAR_MM
        count += from_face or (from_surface and max(PROUD_FROM_MM, 2.0 * around) < above < PROUD_TO_MM)
    return count


@kernel
def _slope_at(x: Float32, z: Float32, at: Int, depth: Float, end: int, way: int, gate: float) -> float:
    """Slope dz/dx of the face at its end: of the line through its last points."""
    m, sx, sz, sxx, sxz = 0.0, 0.0, 0.0, 0.0, 0.0
    k = end
    while m < END_POINTS:
        if abs(depth[k]) <= gate:
            u, w = np.float64(x[at[k]]) - np.float64(x[at[end]]), np.float64(z[at[k]]) - np.float64(z[at[end]])
            m, sx, sz, sxx, sxz = m + 1.0, sx + u, sz + w, sxx + u * u, sxz + u * w
        k += way
    return float((sxz - sx * sz / m) / max(sxx - sx * sx / m, 1e-9))


@kernel
def _label_chosen(chosen: Bool, at: Int, n: int, name: int, labels: AnyArray) -> None:
    for k in range(n):
        if chosen[k]:
            labels[at[k]] = name


@kernel
def _label_surface(
    p: Float, depth: Float, at: Int, first: int, last: int, a: float, b: float, gate: float, name: int, labels: AnyArray
) -> None:
    """Name the points of a surface: those on its line behind the face, as far as it goes."""
    for k in range(first, last):
        if depth[k] > 0.0 and abs(p[k] - a - b * depth[k]) < gate and labels[at[k]] == 0:
            labels[at[k]] = name


@kernel
def read_frames(
    x: Float32,
    z: Float32,
    keep: Bool,
    along: Float,
    sense: float,
    names: Int,
    sums: Float,
    ends: Float,
    seen: Bool,
    labels: AnyArray,
    streaks: Bool,
    first: int,
    last: int,
) -> None:
    """The end face, its ends and the surfaces that join it, in frames first to last - 1.

    x, z, keep: (N, M) grid; along (N, 2) direction of the face in (x, z), unit, from the lower to the upper side, good
    to some degrees (NaN: leave the frame out); sense +1 if z counts away from the sensor, else -1; names (3,) labels of
    face, upper and lower surface. Filled in: sums (N, 4, 8), ends (N, 2, 8), seen (N,), labels (N, M). streaks (N,):
    in which frames a streak beside the face may be left out; filled in: where one was.
    """
    columns = x.shape[1]
    work, at, chosen = np.empty((4, columns)), np.empty(columns, np.int64), np.empty(columns, np.bool_)
    for i in range(first, last):
        if np.isfinite(along[i, 0]):
            seen[i], streaks[i] = _read_frame(
                x[min(i, len(x) - 1)],
                z[i],
                keep[i],
                along[i, 0],
                along[i, 1],
                sense,
                names,
                work,
                at,
                chosen,
                sums[i],
                ends[i],
                labels[i],
                streaks[i],
            )
        if not seen[i]:
            sums[i], ends[i], labels[i] = 0.0, np.nan, 0
