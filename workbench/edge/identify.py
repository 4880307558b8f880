"""Which straight faces of a profile are the root face and the bevel face?

Nothing in a profile says so, nor whether z counts away from the sensor. What is known: corners of a workpiece are
convex; root face and bevel face meet at the bevel angle, upper surface and bevel face at its complement, root face and
lower surface at a right angle; the root face has about its nominal width. Each pair of joined faces is scored as
negative log-likelihood, and all key frames vote.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from workbench.geometry.chains import COUNT, LAST, OFFSET, SLOPE, X0, X1
from workbench.geometry.end_face import BELOW_COLUMNS, TABLE_MM
from workbench.geometry.medians import median
from workbench.units import DEG, Bool, Float

JOIN_MM = 0.6  # faces whose lines cross within this distance of both their ends meet in a corner
ANGLE_SIGMA = 8.0 * DEG  # how far a bevel may be from nominal, with the laser plane oblique
SQUARE_SIGMA = 5.0 * DEG  # how far root face and upper surface may be from square, with the laser plane oblique
WIDTH_SIGMA = 0.6  # of the logarithm of root width over nominal
WORST_SCORE = 5.5
CONTEXT = 3.0  # what a further corner of the right (wrong) angle gains (costs)
GHOST_MM, SAME_MM, SAME_ANGLE = 1.0, 0.1, 4.0 * DEG  # a face goes on beyond returns that lie so far beside it
# Of what a plate lies on: angle to the upper surface, and what the view may show beyond it.
TABLE_ANGLE = 3.0 * DEG
SURFACE_MM = 1.0  # of an upper or lower surface, in view
WIDER = 1.5  # times the nominal root face: no wider, it may as well be that face, and says nothing
CUT_OFF = 4.0  # what it costs that the field of view cuts the root face off: its width then says nothing


@dataclass(frozen=True, slots=True)
class Candidate:
    """One reading of a profile: lines (slope, offset, x at its free end) of each face, None where not seen."""

    score: float
    alone: float  # that of root face and bevel face without what joins them
    side: int  # upper surface, bevel, root face, lower surface come in order of rising side * x
    sense: int  # +1: z counts away from the sensor, -1: towards it
    upper: Float | None
    bevel: Float
    root: Float
    lower: Float | None

    @property
    def upwards(self) -> Float:
        """Unit direction (2,) along x and z of the root face towards the bevel."""
        return np.array([1.0, self.root[0]]) * (-self.side / math.hypot(1.0, self.root[0]))

    def rises(self, towards: Float) -> bool:
        """Whether the bevel lies on that side of the root face to which `towards` (2,), along x and z, points."""
        return float(self.upwards @ towards) > 0.0


def crossing(a: Float, b: Float) -> float:
    """x where lines a and b (rows of a chain) cross; NaN if parallel."""
    dk = a[SLOPE] - b[SLOPE]
    return float((b[OFFSET] - a[OFFSET]) / dk) if abs(dk) > 1e-6 else math.nan


def turn(a: Float, b: Float, sense: int) -> float:
    """Angle by which the surface bends away from the sensor from face a to b (x rising); positive: convex. rad."""
    return sense * (math.atan(b[SLOPE]) - math.atan(a[SLOPE]))


def joined(a: Float, b: Float) -> bool:
    """Do faces a and b (a before b) meet in a corner?"""
    x = crossing(a, b)
    reach_a = JOIN_MM + 3.0 * (a[X1] - a[X0]) / a[COUNT]
    reach_b = JOIN_MM + 3.0 * (b[X1] - b[X0]) / b[COUNT]
    off_a, off_b = abs(x - a[X1]) * math.hypot(1.0, a[SLOPE]), abs(x - b[X0]) * math.hypot(1.0, b[SLOPE])
    return bool(off_a < reach_a and off_b < reach_b)


def _corners(chain: Float) -> list[tuple[int, int]]:
    """Pairs of faces that meet; up to two short lines (outliers) between them are passed over."""
    pairs = []
    for i in range(len(chain)):
        for j in range(i + 1, min(i + 4, len(chain))):
            if all(chain[m][COUNT] < 12 for m in range(i + 1, j)) and joined(chain[i], chain[j]):
                pairs.append((i, j))
                break
    return pairs


def whole_faces(chain: Float) -> Float:
    """The chain with each face in one piece that goes on, along one line, beyond second returns (ghosts) of it.

    Between two pieces of one face lie only returns beside their line; else each piece would pass for a narrow face.
    """
    first = 0
    while True:
        found = [(*_of_one_face(chain, apart), apart) for apart in range(2, len(chain))]
        pairs = [(i, -apart, line[i]) for one, line, apart in found for i in np.flatnonzero(one).tolist() if i >= first]
        if not pairs:
            return chain
        first, back, line = min(pairs, key=lambda pair: pair[:2])
        joint, last = chain[first].copy(), chain[first - back]
        joint[[SLOPE, OFFSET, X1, LAST]] = *line, last[X1], last[LAST]
        joint[COUNT] += last[COUNT]
        chain = np.concatenate([chain[:first], joint[None], chain[first - back + 1 :]])


def _of_one_face(chain: Float, apart: int) -> tuple[Bool, Float]:
    """Whether each face and that `apart` places on (n,) are pieces of one, and its slope and offset (n, 2)."""
    a, b = chain[:-apart], chain[apart:]
    from_mm, to_mm = (0.5 * (one[:, X0] + one[:, X1]) for one in (a, b))
    ahead = to_mm > from_mm
    start = a[:, SLOPE] * from_mm + a[:, OFFSET]
    slope = (b[:, SLOPE] * to_mm + b[:, OFFSET] - start) / np.where(ahead, to_mm - from_mm, 1.0)
    offset, lean = start - slope * from_mm, 1.0 / np.hypot(1.0, slope)
    gap = 0.5 * (a[:, X1] + b[:, X0])
    fits = ahead & (np.abs((a[:, SLOPE] - b[:, SLOPE]) * gap + a[:, OFFSET] - b[:, OFFSET]) * lean < SAME_MM)
    for one in (a, b):
        fits &= np.abs(np.arctan(one[:, SLOPE]) - np.arctan(slope)) < SAME_ANGLE
    for between in (chain[k : k + len(a)] for k in range(1, apart)):
        for end in (between[:, X0], between[:, X1]):
            deviation = (between[:, SLOPE] - slope) * end + between[:, OFFSET] - offset
            fits &= np.abs(deviation) * lean < GHOST_MM
    return fits, np.stack([slope, offset], axis=1)


def _off(angle: float, expected: float, sigma: float = ANGLE_SIGMA) -> float:
    return 0.5 * ((angle - expected) / sigma) ** 2


def candidates(chain: Float, cut: Bool, root_nominal_mm: float, bevel_nominal: float) -> Iterator[Candidate]:
    """All readings of a profile's chain of faces that score better than WORST_SCORE. bevel_nominal in rad.

    cut (2,): whether the field of view ends the chain's first and its last face.
    """
    chain = whole_faces(chain)
    corners = _corners(chain)
    after = dict(corners)
    before = {j: i for i, j in corners}
    for sense in (1, -1):
        for i, j in corners:
            angle = turn(chain[i], chain[j], sense)
            if not 15.0 * DEG < angle < 75.0 * DEG:
                continue
            for side, bevel, root in ((1, i, j), (-1, j, i)):
                onward = after if side > 0 else before
                backward = before if side > 0 else after
                faces = _Numbers(_surface(chain, backward, bevel), bevel, root, _surface(chain, onward, root))
                reading = _read(chain, faces, sense, side, root_nominal_mm, bevel_nominal)
                first, last = bool(cut[0]) and root == 0, bool(cut[1]) and root == len(chain) - 1
                if reading.score + CUT_OFF * (first or last) < WORST_SCORE:
                    yield replace(reading, score=reading.score + CUT_OFF * (first or last))


class _Numbers(NamedTuple):
    """Which faces of a chain are told as what; None: nothing joins the bevel or root face there."""

    upper: int | None
    bevel: int
    root: int
    lower: int | None


def _read(
    chain: Float, faces: _Numbers, sense: int, side: int, root_nominal_mm: float, bevel_nominal: float
) -> Candidate:
    """The reading of a chain by which these are its faces."""
    upper, bevel, root, lower = faces
    b, r = chain[bevel], chain[root]

    def convex(first: Float, second: Float) -> float:
        return turn(first, second, sense) if side > 0 else turn(second, first, sense)

    angle, score = convex(b, r), 0.0
    upper_row = lower_row = None
    root_end = r[X1] if side > 0 else r[X0]
    if upper is not None:
        off = convex(chain[upper], b), math.pi / 2 - angle
        if _off(*off) < 4.5:
            upper_row, wide = chain[upper], width_mm(chain[upper]) > WIDER * root_nominal_mm
            score -= max(CONTEXT - _off(*off, SQUARE_SIGMA), 0.0) if wide else 0.0
        elif convex(chain[upper], b) > 0:
            score += CONTEXT
    if lower is not None:
        if _off(convex(r, chain[lower]), math.pi / 2) < 4.5:
            lower_row, score = chain[lower], score - CONTEXT
            root_end = crossing(r, chain[lower])
        elif lies_on(chain, root, lower, upper_row):
            lower_row, root_end = chain[lower], crossing(r, chain[lower])
        elif convex(r, chain[lower]) > 0 and upper_row is None:  # else a bevel below, too
            score += CONTEXT
    width = abs(root_end - crossing(b, r)) * math.hypot(1.0, r[SLOPE])
    alone = _off(angle, bevel_nominal) + 0.5 * (math.log(max(width, 1e-3) / root_nominal_mm) / WIDTH_SIGMA) ** 2
    return Candidate(
        score + alone,
        alone,
        side,
        sense,
        None if upper_row is None else _line(upper_row, -side),
        _line(b, -side),
        _line(r, side, root_end),
        None if lower_row is None else _line(lower_row, side),
    )


def _surface(chain: Float, neighbours: dict[int, int], face: int) -> int | None:
    """The surface of the plate that a face meets, in a corner or over shorter faces: a rounded edge."""
    found = neighbours.get(face)
    while found is not None and width_mm(chain[found]) < SURFACE_MM:
        found = neighbours.get(found)
    return found


def width_mm(row: Float) -> float:
    """Length of a chain's line."""
    return float((row[X1] - row[X0]) * math.hypot(1.0, row[SLOPE]))


def lies_on(chain: Float, root: int, lower: int, upper: Float | None) -> bool:
    """Whether the face number `lower`, which turns up from the root face, is what the plate lies on: a table or a bar.

    It is parallel to the upper surface, or where that is not in view square to the root face, and wider than the land
    of a nose. The root face does not go on below it, as it is seen to do beside a stop that stands in front.
    """
    row, face = chain[lower], chain[root]
    angle, apart = math.atan(row[SLOPE]), math.atan(face[SLOPE])
    square = abs(abs(angle - apart) - 0.5 * math.pi) < TABLE_ANGLE
    parallel = square if upper is None else abs(angle - math.atan(upper[SLOPE])) < TABLE_ANGLE
    side = 1.0 if lower > root else -1.0
    below = side * ((face[X1] if side > 0 else face[X0]) - crossing(face, row))
    most_below = BELOW_COLUMNS * (face[X1] - face[X0]) / face[COUNT]
    return bool(parallel and width_mm(row) > TABLE_MM and below < most_below)


def _line(row: Float, end: int, at: float | None = None) -> Float:
    """(slope, offset, x of the end that lies towards rising (end = 1) or falling x) of a chain's row."""
    x = at if at is not None else (row[X1] if end > 0 else row[X0])
    return np.array([row[SLOPE], row[OFFSET], x])


def vote(readings: list[list[Candidate]]) -> tuple[int, int] | None:
    """(side, sense) on which the key frames agree, each voting with how good its best such reading is."""
    found = votes(readings)
    return max(found, key=lambda k: found[k]) if found else None


def votes(readings: list[list[Candidate]]) -> dict[tuple[int, int], float]:
    """What the key frames give each (side, sense)."""
    found: dict[tuple[int, int], float] = {}
    for frame in readings:
        best: dict[tuple[int, int], float] = {}
        for c in frame:
            best[c.side, c.sense] = max(best.get((c.side, c.sense), 0.0), WORST_SCORE - c.score)
        for key, value in best.items():
            found[key] = found.get(key, 0.0) + value
    return found


def readings_apart(readings: list[list[Candidate]], choice: tuple[int, int]) -> float:
    """By how much the chosen (side, sense) scores better than any other, the median of the key frames that show it.

    Where neither upper nor lower surface is in view, root face and bevel face can be read from both ends, and their
    widths alone tell.
    """
    apart = []
    for frame in readings:
        scores: dict[bool, float] = {}
        for c in frame:
            mine = (c.side, c.sense) == choice
            scores[mine] = min(scores.get(mine, WORST_SCORE), c.score)
        if True in scores:
            apart.append(scores.get(False, WORST_SCORE) - scores[True])
    return median(np.array(apart))


def contradicted(readings: list[list[Candidate]], choice: tuple[int, int]) -> float:
    """Share of the key frames in which another (side, sense) than the chosen one scores better by a corner of context.

    The view may end on the part where most frames stand; the others then tell which face is which. In sound recordings
    one frame in 25 does at most.
    """

    def best(frame: list[Candidate], chosen: bool) -> float:
        return min((c.score for c in frame if ((c.side, c.sense) == choice) == chosen), default=WORST_SCORE)

    return sum(best(frame, True) > best(frame, False) + CONTEXT for frame in readings) / max(len(readings), 1)
