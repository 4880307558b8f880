"""One profile across a groove: both plates' upper surfaces and what descends from them.

A profile is read from its chain of straight faces (`geometry.chains`), from both sides inwards. A plate ends in a
square face, in a bevel, or in a flank above a fillet; of a square face that the sensor does not see only the end of
the upper surface is there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from workbench.geometry.chains import FIRST, LAST, OFFSET, SLOPE, X0, X1, straight_faces
from workbench.units import DEG, Bool, Float, Int, Shaped

# edge: nothing is seen below the upper surface; hidden: a fillet, but not the flank above it; unread: a face that is
# too steep, low or curved to read; compound: a face above a steeper one
Kind = Literal["edge", "square", "bevel", "round", "hidden", "unread", "compound"]

LEAST_PLATE_MM, LEAST_PLATE_POINTS = 1.5, 12
PARALLEL = 8.0 * DEG  # plates that meet at more are no butt joint
ON_MM = 0.12  # a return this near to a surface may belong to it
DROP_MM, DROP_POINTS = 0.3, 3  # so many returns in a row so far below a plate: it has ended
JUMP_MM = 0.7  # without returns: likewise
GOES_ON = 8  # returns in a row behind a jump, for the surface to go on there
LEAST_FALL = 15.0 * DEG  # of a bevel below its plate
SQUARE = 85.5 * DEG  # falls of more than this are square faces
UPRIGHT = 80.0 * DEG  # what falls less below a bevel is no root face; in an oblique profile that leans a little
LEAST_WHOLE = 60  # returns of a line that is one face in spite of a gap
NEAR_MM = 2.0  # of a face from the corner at which it starts, with the edge's rounding
ROUND_TURN, ROUND_END = 6.0 * DEG, 45.0 * DEG  # a fillet turns by more, and comes to fall by less than
SHARP_TURN = 45.0 * DEG  # the pieces of a fillet turn by less from one to the next; a weld or a strip joins a face so
FLANK_FALL = 60.0 * DEG  # returns below a flank that is not seen fall by less where they are the fillet's
EDGE_OFFSET_MM = 4.0  # at most, of a face, or the first return of such a fillet, from the upper surface's end
TRIM_MM = 0.35  # left out of a face beside a corner: rounding and mixed pixels
ROUNDED_MM = 0.5  # the greatest rounding of an edge that is followed
ROUND_MORE = 0.5  # of the seen pieces of a rounding: so much more of it lies within ON_MM of the face
FLANK_MM, FLANK_SHARE = 1.0, 0.25  # a shorter flank, in itself or beside its fillet's chord, tells no angle
FLAT_MM = 0.3  # returns that leave a bevel for so long are no noise
ROUNDED_FACE_MM = 1.2  # a shorter line above one that falls more is the rounded upper edge, no face
SHARED = 2  # returns at a root that may belong to both plates, where there is no gap
LINKED_MM = 0.6  # lines and returns so near are one surface
STEEP_STEP_MM = 1.5  # returns on a steep face lie so far apart at most; on two surfaces further
SEEN_BELOW = 8  # so many returns of one below an edge are a face
BELOW_MM, LATERAL_MM = 0.12, 0.35  # returns of a root face lie so far below the root at least, so far aside at most
LEAST_VOTES = 0.25  # share of the profiles that show more of them below the plates than above
LEVEL_MM, LEVEL_RETURNS = 0.3, 24  # of a surface, that show whether it is level
MOST_LEAN = math.tan(20.0 * DEG)  # a root face leans by less from the square to its plate, as few returns show it
OFF_FACE_MM = 0.05  # aside of the line of a root face: rough faces and their rounded ends lie nearer to it
FARTHER = 4.0  # times as far from the one before as usual: a return of another surface, under a root face
FLOOR_STEPS, FLOOR_MM, FLOOR_RISE = 3.0, 0.15, 60.0 * DEG  # what so nearly joins a face's last return covers its end


@dataclass(frozen=True, slots=True, eq=False)
class Side:
    """One plate in one profile. Indices are those of the profile's points."""

    kind: Kind
    fall: float  # angle of the face below the upper surface, rad; NaN at an `edge`
    corner: Shaped[Float, " 2"]  # where both meet, or the upper surface's last return
    upper: Int  # returns of the upper surface, less its end
    face: Int  # of bevel, flank or square face
    arc: Int  # of the fillet, from its flank to the root
    end: int  # of the upper surface: its innermost return
    last: int  # innermost return of upper surface, face or fillet
    step_mm: float  # from there to the next column, along the face
    rounded_mm: float  # how far a rounded edge is seen beyond the upper surface, along it; below which nothing is seen
    below: Int  # returns of the root face
    # the widest way without returns, of what lies between the plates and joins the last return; NaN: nothing does
    parted_mm: float = math.nan


def read_profile(x: Float, y: Float) -> tuple[Side, Side] | None:
    """Left (falling x) and right plate of a profile, y upwards, x rising, both (n,) mm; None: no two plates."""
    if x.size < 4 * LEAST_PLATE_POINTS:
        return None
    lines = straight_faces(x, y)
    lines = _unbridged(x, y, lines, (lines[:, LAST] - lines[:, FIRST] >= LEAST_WHOLE) & ~_floors(lines))
    long = _plates(lines)
    if len(long) == 1:  # level plates over a gap in which nothing is seen
        lines = _unbridged(x, y, lines, np.zeros(len(lines), bool))
        long = _plates(lines)
    if len(long) < 2:
        return None
    turn = math.atan(long[0][SLOPE]) - math.atan(long[-1][SLOPE])
    if abs(turn) > PARALLEL:
        return None
    # What lost returns cut in two is one surface; plates in line over a gap without returns are not: tried next.
    goes_on = _both_sides(x, y, lines, long, True)
    if goes_on is not None and is_read(goes_on):
        return goes_on
    ends = _both_sides(x, y, lines, long, False)
    return ends if goes_on is None or (ends is not None and is_read(ends)) else goes_on


def _plates(lines: Float) -> Float:
    """Those of the lines that are long enough for a plate's upper surface."""
    return lines[(lines[:, X1] - lines[:, X0] > LEAST_PLATE_MM) & (lines[:, LAST] - lines[:, FIRST] >= 11)]


def is_read(sides: tuple[Side, Side]) -> bool:
    """Whether the faces of both plates could be read."""
    return not {"unread", "compound"} & {sides[0].kind, sides[1].kind}


def _both_sides(x: Float, y: Float, lines: Float, long: Float, over: bool) -> tuple[Side, Side] | None:
    left = _side(x, y, lines, long[0], over)
    mirrored = lines[::-1].copy()
    n = x.size - 1
    mirrored[:, [X0, X1]] = -lines[::-1][:, [X1, X0]]
    mirrored[:, [FIRST, LAST]] = n - lines[::-1][:, [LAST, FIRST]]
    mirrored[:, SLOPE] *= -1.0
    plate = mirrored[np.flatnonzero(mirrored[:, FIRST] == n - long[-1][LAST])[0]]
    right = _side(-x[::-1], y[::-1], mirrored, plate, over)
    if left is None or right is None:
        return None
    right = _mirrored(right, n)
    if left.last > right.last + SHARED:
        return None
    ends = [int(side.below[at]) if side.below.size else side.last for side, at in ((left, -1), (right, 0))]
    between = slice(ends[0], max(ends[1], ends[0]) + 1)
    return (
        replace(left, parted_mm=_parted_mm(x[between], y[between], left, math.atan(long[0][SLOPE]))),
        replace(right, parted_mm=_parted_mm(-x[between][::-1], y[between][::-1], right, -math.atan(long[-1][SLOPE]))),
    )


def _parted_mm(x: Float, y: Float, side: Side, level: float) -> float:
    """`Side.parted_mm` of returns from a plate's last one to the other plate's: they do not fall as a face would."""
    near = STEEP_STEP_MM if side.below.size else max(FLOOR_STEPS * side.step_mm, FLOOR_MM)
    if side.kind not in ("bevel", "round"):
        return math.nan
    for k in (1, 2):  # the first return beyond the last one may still be the face's
        to = k + DROP_POINTS
        if x.size <= to + SHARED:
            return math.nan
        way = np.hypot(np.diff(x[: to + 1]), np.diff(y[: to + 1]))
        fall = level - math.atan2(y[to] - y[k], x[to] - x[k])
        if (way[:k] < near).all() and (way[k:] < LINKED_MM).all() and -FLOOR_RISE < fall < LEAST_FALL:
            return float(np.diff(x).max())
    return math.nan


def _floors(lines: Float) -> Bool:
    """Lines (n,) as level as the plates beside them, below both: no bevel, but the bottom of a U, both plates' part."""
    long = _plates(lines)
    if len(long) < 2:
        return np.zeros(len(lines), bool)
    left, right = long[0], long[-1]
    level = 0.5 * (math.atan(left[SLOPE]) + math.atan(right[SLOPE]))
    middle = 0.5 * (lines[:, X0] + lines[:, X1])
    deep = np.minimum(*(one[SLOPE] * middle + one[OFFSET] for one in (left, right))) - (
        lines[:, SLOPE] * middle + lines[:, OFFSET]
    )
    return np.asarray((deep > DROP_MM) & (np.abs(level - np.arctan(lines[:, SLOPE])) < LEAST_FALL))


def _unbridged(x: Float, y: Float, lines: Float, whole: Bool) -> Float:
    """The lines, those that reach over a gap without returns cut in two there: both fillets of a U can lie on one.

    Not cut are those marked in `whole`: an upper surface or a bevel goes on beyond lost returns.
    """
    out = []
    for line, is_whole in zip(lines, whole, strict=True):
        first, last = int(line[FIRST]), int(line[LAST])
        wide = np.flatnonzero(np.diff(x[first : last + 1]) > JUMP_MM)
        if wide.size != 1 or is_whole:
            out.append(line)
            continue
        cut = first + int(wide[0]) + 1
        for i, j in ((first, cut), (cut, last + 1)):
            if j - i >= 4 and x[j - 1] > x[i]:  # returns of one x have no slope
                slope, offset = np.polyfit(x[i:j], y[i:j], 1)
                out.append(np.array([x[i], x[j - 1], slope, offset, j - i, i, j - 1]))
    return np.array(out).reshape(-1, 7)


def _mirrored(side: Side, n: int) -> Side:
    return Side(
        side.kind,
        side.fall,
        side.corner * [-1.0, 1.0],
        n - side.upper[::-1],
        n - side.face[::-1],
        n - side.arc[::-1],
        n - side.end,
        n - side.last,
        side.step_mm,
        side.rounded_mm,
        n - side.below[::-1],
    )


def _side(x: Float, y: Float, lines: Float, plate: Float, over: bool) -> Side | None:
    """The plate whose upper surface is `plate`; the groove lies towards rising x. over: lost returns do not end it."""
    level = math.atan(plate[SLOPE])
    above = (y - plate[SLOPE] * x - plate[OFFSET]) * math.cos(level)
    start = int(plate[FIRST])
    drop, end = _ends_of(x, above, start, over)
    if end is None:
        return None
    on = np.flatnonzero(np.abs(above[: drop + 1]) < ON_MM)
    on = on[on >= start]
    nothing = np.empty(0, np.int64)
    falls, rounded = [_fall(level, line) for line in lines], -1
    for number, (line, fall) in enumerate(zip(lines, falls, strict=True)):
        if line[FIRST] <= start or line[LAST] <= end or fall < LEAST_FALL or abs(above[int(line[LAST])]) < ON_MM:
            continue
        if line[FIRST] > drop + DROP_POINTS:
            break
        if _rounds_edge(x, y, lines, falls, number):
            rounded = int(line[LAST])
            drop = max(drop, rounded)
            continue
        cross = (line[OFFSET] - plate[OFFSET]) / (plate[SLOPE] - line[SLOPE])
        corner = np.array([cross, plate[SLOPE] * cross + plate[OFFSET]])
        first, last = int(line[FIRST]), int(line[LAST])
        if math.hypot(x[first] - corner[0], y[first] - corner[1]) > NEAR_MM:
            break
        if not -EDGE_OFFSET_MM < x[end] - cross < NEAR_MM:
            break  # the other plate's face
        trim = _trim_mm(x, y, corner, rounded)
        upper = on[x[on] < cross - trim]
        if upper.size < LEAST_PLATE_POINTS:
            return None
        to, off = _followed(x, y, line, last)
        arc = _fillet(x, y, lines, number, level, fall, to)
        last = last if arc.size else to  # what goes on beyond the line above a fillet is the fillet's
        other = None if arc.size else _no_bevel(x, y, lines, falls, number, last, level)
        if other is not None:
            return Side(other, math.nan, corner, upper, nothing, nothing, end, last, _step(x, y, upper), 0.0, nothing)
        face = np.arange(first, last + 1)
        # By the columns, not by the returns: on a face along the rays noise would choose which of them count.
        away = np.abs(x[face] - corner[0]) * math.hypot(1.0, line[SLOPE])
        kind: Kind = "square" if fall > SQUARE else "round" if arc.size else "bevel"
        face = face[(away > trim) & (np.abs(off[face]) < ON_MM)]
        if kind != "round":
            face = face[:-SHARED]
        if face.size < 3 or (kind == "round" and _short(x, y, face, arc)):
            break
        innermost = int(arc[-1]) if arc.size else last
        step = _step(x, y, face if not arc.size else arc)
        below = nothing if kind == "square" else _root_face(x, y, level, innermost)
        return Side(kind, fall, corner, upper, face, arc, end, innermost, step, 0.0, below)
    return _without_face(x, y, above, lines, plate, on, end)


def _trim_mm(x: Float, y: Float, corner: Float, rounded: int) -> float:
    """What is left out of both faces beside their corner: a rounding to point `rounded` (-1: none) takes off both."""
    if rounded < 0:
        return TRIM_MM
    away = math.hypot(x[rounded] - corner[0], y[rounded] - corner[1])
    return max(TRIM_MM, away + max(0.5 * TRIM_MM, ROUND_MORE * away))


def _no_bevel(
    x: Float, y: Float, lines: Float, falls: list[float], number: int, last: int, level: float
) -> Kind | None:
    """What a face without fillet, line `number` to point `last`, is instead of a bevel; None: it may be one."""
    other = _goes_on(x, y, lines, falls, number, last)
    if other is None and _flattens(x, y, level, falls[number], last):
        return "unread"  # the face of a fillet of which too little is seen is no bevel
    return other


def _without_face(x: Float, y: Float, above: Float, lines: Float, plate: Float, on: Int, end: int) -> Side | None:
    """A plate of whose groove face nothing is read, to the last return `end` on it; on: points of its surface.

    above: how far the points lie above the surface, mm.
    """
    level = math.atan(plate[SLOPE])
    nothing = np.empty(0, np.int64)
    upper = on[x[on] < x[end] - TRIM_MM]
    if upper.size < LEAST_PLATE_POINTS:
        return None
    step = _step(x, y, upper)
    level_end = end
    while end + 1 < x.size and x[end + 1] - x[end] < 2.5 * step and above[end + 1] > -ROUNDED_MM:
        end += 1  # round the edge, down to where it turns away
    corner = np.array([x[end], plate[SLOPE] * x[end] + plate[OFFSET]])
    beyond = float(math.cos(level) * (x[end] - x[level_end]) + math.sin(level) * (y[end] - y[level_end]))
    arc = _hidden_fillet(x, y, above, lines, level, end)
    if arc.size:
        return Side(
            "hidden", math.nan, corner, upper, nothing, arc, end, int(arc[-1]), _step(x, y, arc), beyond, nothing
        )
    beneath = any(
        line[FIRST] > end and line[LAST] - line[FIRST] >= SEEN_BELOW and LEAST_FALL < _fall(level, line) < SQUARE
        for line in lines
    )  # a face, of which the upper part is not seen
    kind: Kind = "unread" if beneath or _goes_down(x, y, above, level, end) else "edge"
    return Side(kind, math.nan, corner, upper, nothing, nothing, end, end, step, beyond, nothing)


def _fall(level: float, line: Float) -> float:
    """Angle of a line below its plate, rad."""
    fall = level - math.atan(line[SLOPE])
    # Past the vertical a falling line's slope turns positive: an undercut face that the fan still sees.
    return fall + math.pi if line[SLOPE] > 0 and fall < -60.0 * DEG else fall


def _rounds_edge(x: Float, y: Float, lines: Float, falls: list[float], number: int) -> bool:
    """Whether a short line goes on in others, each falling more, to a longer one: a piece of the rounded upper edge."""
    length = [math.hypot(x[int(b)] - x[int(a)], y[int(b)] - y[int(a)]) for a, b in lines[number:, [FIRST, LAST]]]
    if length[0] > ROUNDED_FACE_MM:
        return False
    for k in range(number + 1, len(lines)):
        at, to = int(lines[k - 1, LAST]), int(lines[k, FIRST])
        if falls[k] < falls[k - 1] + 0.5 * ROUND_TURN or math.hypot(x[to] - x[at], y[to] - y[at]) > LINKED_MM:
            return False
        if length[k - number] > length[0] and falls[k] > falls[number] + ROUND_TURN:
            return True
    return False


def _goes_on(x: Float, y: Float, lines: Float, falls: list[float], number: int, last: int) -> Kind | None:
    """What a plate is whose face, seen down to return `last`, goes on in another one; None: it does not.

    One that falls less; or one that falls more, but not squarely.
    """
    for line, fall in zip(lines[number + 1 :], falls[number + 1 :], strict=True):
        first = int(line[FIRST])
        if first > last - DROP_POINTS and int(line[LAST]) - first >= SEEN_BELOW:
            near = math.hypot(x[first] - x[last], y[first] - y[last]) < LINKED_MM
            before = falls[number]
            if near and before + 0.5 * ROUND_TURN < fall < UPRIGHT:
                return "compound"
            return "unread" if near and LEAST_FALL < fall < before - ROUND_TURN else None
    return None


def _flattens(x: Float, y: Float, level: float, fall: float, last: int) -> bool:
    """Whether the returns next to a bevel's last one fall less than it, though they fall: a small fillet."""
    to = slice(last + 1, last + 1 + SEEN_BELOW)
    dx, dy = x[to] - x[last], y[to] - y[last]
    linked = np.cumprod(np.hypot(np.diff(dx, prepend=0.0), np.diff(dy, prepend=0.0)) < LINKED_MM).astype(bool)
    near = linked & (np.hypot(dx, dy) < ROUNDED_FACE_MM)
    if near.sum() < DROP_POINTS or math.hypot(dx[near][-1], dy[near][-1]) < FLAT_MM:
        return False
    falls = level - math.atan2(dy[near][-1], dx[near][-1])
    return LEAST_FALL < falls < fall - ROUND_TURN


def _short(x: Float, y: Float, flank: Int, arc: Int) -> bool:
    """Whether a flank is too short beside its fillet to be told from more of it."""
    length, chord = (math.hypot(x[on[-1]] - x[on[0]], y[on[-1]] - y[on[0]]) for on in (flank, arc))
    return length < max(FLANK_MM, FLANK_SHARE * chord)


def _goes_down(x: Float, y: Float, above: Float, level: float, end: int) -> bool:
    """Whether returns below an upper surface that ends at `end` are one surface with it, and no square face."""
    dx, dy = x[end + 1 : end + SEEN_BELOW + 1] - x[end], y[end + 1 : end + SEEN_BELOW + 1] - y[end]
    if dx.size < SEEN_BELOW:
        return False
    if (np.hypot(np.diff(dx, prepend=0.0), np.diff(dy, prepend=0.0)) < LINKED_MM).all():
        return bool(above[end + SEEN_BELOW] < -DROP_MM)
    across = (dx * math.cos(level) + dy * math.sin(level))[:DROP_POINTS]  # of a steep face only a few are seen
    low = above[end] - above[end + 1 : end + DROP_POINTS + 1]
    way = np.hypot(np.diff(across, prepend=0.0), np.diff(low, prepend=0.0))
    down = (np.diff(low, prepend=0.0) > 0.0).all() and (way < STEEP_STEP_MM).all() and low[-1] > DROP_MM
    return bool(down and math.atan2(low[-1], across[-1]) < SQUARE)


def _ends_of(x: Float, above: Float, start: int, over: bool) -> tuple[int, int | None]:
    """The last return before those of the surface that begins at `start` fall off, and before they fall off or jump.

    None: neither happens. over: a jump that the surface goes on behind is none.
    """
    low = above < -DROP_MM
    run = np.convolve(low, np.ones(DROP_POINTS), "valid") == DROP_POINTS
    falls = np.flatnonzero(run[start:]) + start
    jumps = np.flatnonzero(np.diff(x[start:]) > JUMP_MM) + start + 1
    if over:
        goes_on = [bool((np.abs(above[j : j + GOES_ON]) < ON_MM).all()) for j in jumps]
        jumps = jumps[~np.array(goes_on, bool)]
    stops = np.concatenate([falls, jumps])
    if not stops.size:
        return x.size - 1, None
    drop = int(falls.min()) if falls.size else x.size - 1
    on = np.flatnonzero(np.abs(above[: int(stops.min())]) < ON_MM)
    return drop, int(on[-1]) if on.size and on[-1] > start else None


def _followed(x: Float, y: Float, line: Float, last: int) -> tuple[int, Float]:
    """The last return that goes on a face's line without a jump, and the distances of all returns from the line."""
    off = (y - line[SLOPE] * x - line[OFFSET]) / math.hypot(1.0, line[SLOPE])
    way = np.hypot(np.diff(x), np.diff(y))
    near = 4.0 * float(np.median(way[int(line[FIRST]) : last]))
    at = last
    for k in range(last + 1, min(x.size, last + 40)):
        if math.hypot(x[k] - x[at], y[k] - y[at]) > near or abs(off[k]) > 0.5 * ON_MM:
            break
        at = k
    return at, off


def _fillet(x: Float, y: Float, lines: Float, number: int, level: float, fall: float, last: int) -> Int:
    """Returns of the fillet that begins below face `number`: lines that fall less and less; empty: there is none."""
    before, at, least = fall, last, math.inf
    begin, lowest = int(lines[number, LAST]), lines[number]
    for line in lines[number + 1 :]:
        f, i = level - math.atan(line[SLOPE]), max(int(line[FIRST]), at)
        gap = math.hypot(x[i] - x[at], y[i] - y[at])
        if not 0.5 * ROUND_TURN <= before - f <= SHARP_TURN or f < -20.0 * DEG or gap > 0.6:
            break
        before, at, least, lowest = f, int(line[LAST]), f, line
    if least >= ROUND_END or at - begin < 6:
        return np.empty(0, np.int64)
    return np.arange(begin, _followed(x, y, lowest, at)[0] + 1)


def _hidden_fillet(x: Float, y: Float, above: Float, lines: Float, level: float, end: int) -> Int:
    """Returns of a fillet whose flank is not seen: the first ones below an upper surface that ends at `end`."""
    for number, line in enumerate(lines):
        first = int(line[FIRST])
        if first <= end:
            continue
        fall = level - math.atan(line[SLOPE])
        if above[first] > -DROP_MM or abs(x[first] - x[end]) > EDGE_OFFSET_MM or fall < ROUND_END:
            break
        arc = _fillet(x, y, lines, number, level, fall, int(line[LAST]))
        if not arc.size or above[arc[-1]] > -DROP_MM:
            break
        falls = np.array([level - math.atan(one[SLOPE]) for one in lines[number:]])
        begin = lines[number + int(np.argmax((falls > -20.0 * DEG) & (falls < FLANK_FALL)))]
        return np.arange(int(begin[FIRST]), int(arc[-1]) + 1)
    return np.empty(0, np.int64)


def _step(x: Float, y: Float, on: Int) -> float:
    near = on[-30:]
    return float(np.median(np.hypot(np.diff(x[near]), np.diff(y[near]))))


def _root_face(x: Float, y: Float, level: float, last: int) -> Int:
    """Returns straight below the root: next to it in the profile, each lower than the one before, on one line.

    Returns on a level are what lies under the face, and so is one much lower than those before. One off their line is
    a stray, a mixed pixel of the face's end, or what lies under it.
    """
    across, up = np.array([math.cos(level), math.sin(level)]), np.array([-math.sin(level), math.cos(level)])
    found: list[int] = []
    place: list[tuple[float, float]] = []
    fallen: list[float] = []
    low = 0.0
    for k in range(last + 1, min(x.size, last + 60)):
        off = np.array([x[k] - x[last], y[k] - y[last]])
        a, b = float(off @ across), float(off @ up)
        if abs(a) > LATERAL_MM or b > low + 0.05 or b < low - STEEP_STEP_MM:
            break
        if len(fallen) >= DROP_POINTS and low - b > max(FARTHER * float(np.median(fallen)), DROP_MM):
            break
        if b < -BELOW_MM and _is_level(x[k:] - x[last], y[k:] - y[last], across, up):
            break
        if len(place) >= DROP_POINTS and _off_face(place, a, b) > OFF_FACE_MM:
            continue
        if b < -BELOW_MM:
            found.append(k)
            place.append((a, b))
            fallen.append(low - b)
        low = min(low, b)
    if len(place) >= DROP_POINTS and place[0][1] < -LINKED_MM and abs(_line_of(place)[2]) > MOST_LEAN:
        return np.empty(0, np.int64)  # what lies apart; a face that joins the bevel is one, however it leans
    return np.array(found, np.int64)


def _line_of(place: list[tuple[float, float]]) -> tuple[float, float, float]:
    """Mean aside and down of returns, and how far aside their line goes a mm down."""
    lateral, down = np.array(place).T
    mean_a, mean_b = float(lateral.mean()), float(down.mean())
    square = max(float((down - mean_b) @ (down - mean_b)), 1e-9)
    return mean_a, mean_b, float((lateral - mean_a) @ (down - mean_b)) / square


def _off_face(place: list[tuple[float, float]], a: float, b: float) -> float:
    """How far aside a return lies from the line of those on a steep face, mm."""
    mean_a, mean_b, lean = _line_of(place)
    return abs(a - mean_a - lean * (b - mean_b))


def _is_level(x: Float, y: Float, across: Float, up: Float) -> bool:
    """Whether the surface of returns from the first one on, LEVEL_MM of it, falls by less than it goes aside."""
    away = np.hypot(x[: 1 + LEVEL_RETURNS] - x[0], y[: 1 + LEVEL_RETURNS] - y[0])
    to = int(np.argmax(away > LEVEL_MM))
    if to < DROP_POINTS or (np.diff(away[: to + 1]) > LINKED_MM).any():
        return False
    off = np.array([x[to] - x[0], y[to] - y[0]])
    return bool(-(off @ up) < abs(off @ across))


def upwards(x: list[Float], z: list[Float]) -> float:
    """1 where z counts upwards, out of the plates, -1 where it counts into them; 0: nothing shows it.

    What lies between the outer surfaces of a groove lies below them; in a few profiles that is spatter.
    Where a streak of reflections cuts a surface in two, the gap beside it is wider than usual and tells nothing.
    x, z: profiles with x rising.
    """
    found: list[tuple[float, float]] = []  # width between the surfaces, and how deep returns lie there (0: none), mm
    for xs, zs in zip(x, z, strict=True):
        lines = straight_faces(xs, zs)
        long = _plates(lines)
        if len(long) < 2:
            continue
        first, last = long[0], long[-1]
        off = np.minimum(np.abs(_off(xs, zs, first)), np.abs(_off(xs, zs, last)))
        inner: Bool = (off > DROP_MM) & (xs > first[X1]) & (xs < last[X0])
        shown = inner.sum() >= DROP_POINTS
        deep = np.median(np.polyval(_chord(first, last), xs[inner]) - zs[inner]) if shown else 0.0
        found.append((float(last[X0] - first[X1]), float(deep)))
    width, votes = np.array(found).reshape(-1, 2).T
    votes = votes[width <= np.median(width) + LEAST_PLATE_MM] if width.size else votes
    majority = float(np.sign(votes).sum())
    return float(np.sign(majority)) if abs(majority) > LEAST_VOTES * len(x) else 0.0


def _off(x: Float, z: Float, line: Float) -> Float:
    return np.asarray((z - line[SLOPE] * x - line[OFFSET]) / math.hypot(1.0, line[SLOPE]))


def _chord(first: Float, last: Float) -> Float:
    x = np.array([first[X1], last[X0]])
    z = np.array([line[SLOPE] * at + line[OFFSET] for line, at in zip((first, last), x, strict=True)])
    return np.polyfit(x, z, 1)
