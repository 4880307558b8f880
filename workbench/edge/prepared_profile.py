"""One profile across a prepared plate: upper surface, the faces of its preparation, root face.

The chain of straight faces (`geometry.chains`) is walked from a long line on, face by face where they meet in a corner.
What a face falls below the first one is the sum of the turns at the corners, convex ones counted positive. The first
one is the upper surface if the chain ends in a face that stands upright on it, and the falls between are those of a
known preparation (ISO 9692-1: a bevel, two of them, a bevel above a land, a flank above a fillet).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import NamedTuple

from workbench.artefacts.edges import PreparationType
from workbench.edge.identify import joined, turn, width_mm
from workbench.geometry.chains import COUNT, OFFSET, SLOPE, X0, X1
from workbench.units import DEG, Float

LEAST_UPPER_MM, LEAST_UPPER = 1.0, 12  # of an upper surface: length and returns
PASSED_OVER, FEW = 2, 12  # lines of fewer returns between two faces that meet: strays
UPRIGHT = 10.0 * DEG  # the root face stands upright on the upper surface to within this
LEAST_FALL, MOST_FALL = 5.0 * DEG, 88.0 * DEG  # of a bevel below the upper surface
LEAST_TURN = 2.5 * DEG  # between two bevels
LEVEL, TILTED = 8.0 * DEG, 15.0 * DEG  # a land falls by no more, a bevel below a steeper one by no less
STEEP, ARC_STEP = 45.0 * DEG, 3.0 * DEG  # a flank falls by more; a fillet's pieces fall less and less, by so much
ENDS = 30.0 * DEG  # its last piece falls by less: a fillet ends level
ROUNDED_MM = 0.35  # a shorter line between two faces, which turns as they do, is their rounded corner
HOLLOW, PARTING_MM = 12.0 * DEG, 2.0  # turn of a hollow corner, and how far its fillet may part its surfaces


class Reading(NamedTuple):
    """One way to read a profile."""

    kind: PreparationType
    side: int  # +1: from the upper surface to the root face x rises
    sense: int  # +1: z counts away from the sensor
    faces: list[Float]  # rows of the chain: upper surface, faces, root face; of a J: upper surface, flank, root face
    arc: list[Float]  # of a J: the rows of its fillet and land
    below: Float | None = None  # the row of what the root face ends at: the lower bevel, or the lower surface


def readings(chain: Float) -> Iterator[Reading]:
    """Every way to read a profile's chain as a prepared plate; at most one for each side and sense."""
    for side in (1, -1):
        order = list(chain if side > 0 else chain[::-1])
        for sense in (1, -1):
            found = (_from(order, first, side, sense) for first in range(len(order)))
            yield from [one for one in found if one is not None][:1]


def _from(order: Sequence[Float], first: int, side: int, sense: int) -> Reading | None:
    """The plate whose upper surface is `first`; None: it is none."""
    if width_mm(order[first]) < LEAST_UPPER_MM or order[first][COUNT] < LEAST_UPPER:
        return None
    if first > 0 and _rises(order[first - 1], order[first], side, sense):
        return None  # the land below a bevel
    at, falls = [first], [0.0]  # places in the chain of faces that meet, and what they fall below the first one
    while (found := _next(order, at[-1], side)) is not None:
        falls.append(falls[-1] + _convex(order[at[-1]], order[found], side, sense))
        at.append(found)
    faces = [order[k] for k in at]
    for root in range(len(faces) - 1, 1, -1):
        stands = at[root] + 1 < len(order) and _rises(faces[root], order[at[root] + 1], side, sense)
        if abs(falls[root] - math.pi / 2) < UPRIGHT and not stands:
            inner = [k for k in range(1, root) if not _rounds_corner(faces[k], falls[k - 1 : k + 2])]
            kind = kind_of([falls[k] for k in inner])
            below = _below(faces[root + 1 :], falls[root:])
            if kind == "J":
                arc = [faces[k] for k in inner[1:]]
                return Reading(kind, side, sense, [faces[0], faces[inner[0]], faces[root]], arc, below)
            if kind is not None:
                return Reading(kind, side, sense, [faces[0], *(faces[k] for k in inner), faces[root]], [], below)
    return None


def _below(faces: Sequence[Float], falls: Sequence[float]) -> Float | None:
    """The first of the faces that meet beyond the root face, if it is one; falls: from the root face's on."""
    if not faces or falls[1] < falls[0] + HOLLOW:
        return None
    return faces[0] if width_mm(faces[0]) > LEAST_UPPER_MM and faces[0][COUNT] >= LEAST_UPPER else None


def _convex(before: Float, after: Float, side: int, sense: int) -> float:
    """Turn from a face to the next one, rad; positive: convex."""
    return turn(before, after, sense) if side > 0 else turn(after, before, sense)


def _rises(before: Float, after: Float, side: int, sense: int) -> bool:
    """Whether two surfaces make a hollow corner, or one with a fillet: one of them stands up from the other."""
    one, other = (before, after) if side > 0 else (after, before)
    ends = [(row[at], row[SLOPE] * row[at] + row[OFFSET]) for row, at in ((one, X1), (other, X0))]
    return _convex(before, after, side, sense) < -HOLLOW and math.dist(*ends) < PARTING_MM


def _next(order: Sequence[Float], at: int, side: int) -> int | None:
    """The face that meets face `at` in a corner, farther from the upper surface."""
    for found in range(at + 1, min(at + 2 + PASSED_OVER, len(order))):
        strays = all(order[k][COUNT] < FEW for k in range(at + 1, found))
        pair = (order[at], order[found]) if side > 0 else (order[found], order[at])
        if strays and joined(*pair):
            return found
    return None


def _rounds_corner(face: Float, falls: Sequence[float]) -> bool:
    return width_mm(face) < ROUNDED_MM and falls[0] < falls[1] < falls[2]


def kind_of(falls: Sequence[float]) -> PreparationType | None:
    """The preparation whose faces between upper surface and root face fall so (rad); None: no known one.

    Example:
        >>> kind_of([0.87]), kind_of([0.87, 0.0]), kind_of([0.5, 0.9]), kind_of([1.4, 1.0, 0.6, 0.2])
        ('bevel', 'nose', 'compound', 'J')
    """
    if not falls or not LEAST_FALL < falls[0] < MOST_FALL + ARC_STEP:
        return None
    if len(falls) > 2:
        less = all(after < before - ARC_STEP for before, after in pairwise(falls))
        return "J" if less and falls[0] > STEEP and -LEVEL < falls[-1] < ENDS else None
    if falls[0] > MOST_FALL:
        return None
    if len(falls) == 1:
        return "bevel"
    if abs(falls[1]) < LEVEL:
        return "nose"
    least = LEAST_FALL if falls[1] > falls[0] else TILTED
    return "compound" if least < falls[1] < MOST_FALL and abs(falls[1] - falls[0]) > LEAST_TURN else None
