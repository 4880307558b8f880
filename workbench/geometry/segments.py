"""Least distances between straight segments: many queries against many lines, exact."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np

from workbench.geometry.blocks import as_input, in_order
from workbench.kernels import kernel
from workbench.units import Float, Shaped

GROUP = 16  # neighbouring lines that share a sphere
QUERIES = 2048  # in a task


@dataclass(frozen=True, slots=True, eq=False)
class LineIndex:
    """Segments in an order in which neighbours are near each other, and a sphere around every 16 of them."""

    start_mm: Shaped[Float, "n 3"]
    end_mm: Shaped[Float, "n 3"]
    spheres: Shaped[Float, "groups 4"]  # centre and radius


def index_lines(start_mm: Float, end_mm: Float) -> LineIndex | None:
    """An index of the segments from start to end (n, 3); None where there are none."""
    if len(start_mm) == 0:
        return None
    groups = []
    for first in range(0, len(start_mm), GROUP):
        ends = np.concatenate([start_mm[first : first + GROUP], end_mm[first : first + GROUP]])
        centre = ends.mean(axis=0)
        groups.append([*centre, np.linalg.norm(ends - centre, axis=1).max() + 1e-9])
    return LineIndex(as_input(start_mm), as_input(end_mm), as_input(np.array(groups)))


def line_distances(index: LineIndex, start_mm: Float, end_mm: Float) -> Float:
    """Least distance (k,) from each of the segments from start to end (k, 3) to the lines."""
    out = np.full(len(start_mm), np.inf)
    ask = partial(_ask, index.start_mm, index.end_mm, index.spheres, as_input(start_mm), as_input(end_mm), out)
    list(in_order(ask, len(out), QUERIES))
    return out


@kernel
def _ask(a: Float, b: Float, spheres: Float, start: Float, end: Float, out: Float, first: int, last: int) -> None:
    warm = 0
    for k in range(first, last):
        best = _group(a, b, warm, start[k], end[k], np.inf)
        for g in range(spheres.shape[0]):
            if g != warm and _to_point(spheres[g], start[k], end[k]) - spheres[g, 3] < best:
                nearer = _group(a, b, g, start[k], end[k], best)
                if nearer < best:
                    best, warm = nearer, g
        out[k] = best


@kernel
def _to_point(point: Float, start: Float, end: Float) -> float:
    length2, along = 0.0, 0.0
    for c in range(3):
        d = end[c] - start[c]
        length2, along = length2 + d * d, along + d * (point[c] - start[c])
    share = min(max(along / max(length2, 1e-300), 0.0), 1.0)
    square = 0.0
    for c in range(3):
        d = start[c] + share * (end[c] - start[c]) - point[c]
        square += d * d
    return math.sqrt(square)


@kernel
def _group(a: Float, b: Float, group: int, start: Float, end: Float, best: float) -> float:
    for i in range(group * GROUP, min((group + 1) * GROUP, a.shape[0])):
        best = min(best, _apart(start, end, a[i], b[i]))
    return best


@kernel
def _apart(p1: Float, q1: Float, p2: Float, q2: Float) -> float:
    """Distance of two segments (Ericson, "Real-Time Collision Detection", 2005, section 5.1.9)."""
    a, e, f, b, c = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(3):
        d1, d2, r = q1[k] - p1[k], q2[k] - p2[k], p1[k] - p2[k]
        a, e, f, b, c = a + d1 * d1, e + d2 * d2, f + d2 * r, b + d1 * d2, c + d1 * r
    s, t = 0.0, 0.0
    if a <= 1e-18 and e > 1e-18:
        t = min(max(f / e, 0.0), 1.0)
    elif a > 1e-18 and e <= 1e-18:
        s = min(max(-c / a, 0.0), 1.0)
    elif a > 1e-18:
        across = a * e - b * b
        if across > 1e-12 * a * e:  # not parallel
            s = min(max((b * f - c * e) / across, 0.0), 1.0)
        t = (b * s + f) / e
        if t < 0.0:
            s, t = min(max(-c / a, 0.0), 1.0), 0.0
        elif t > 1.0:
            s, t = min(max((b - c) / a, 0.0), 1.0), 1.0
    square = 0.0
    for k in range(3):
        d = p1[k] + s * (q1[k] - p1[k]) - p2[k] - t * (q2[k] - p2[k])
        square += d * d
    return math.sqrt(square)
