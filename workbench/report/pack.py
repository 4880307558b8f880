"""A scene as the text that the page's viewer reads: JSON, arrays in base64, points as int16 in blocks.

A block is a short stretch along the edge with a step of its own, so that rounding stays below 0.002 mm for points that
lie within 100 mm of each other, however long the edge is. Base coordinates are `origin` plus the scene's own.
"""

from __future__ import annotations

import base64
import json
import math
from typing import Any

import numpy as np

from workbench.artefacts import Mark, Scene, Shading, Strokes
from workbench.units import AnyArray, Float, Int

BLOCK_POINTS = 8192
HALF_STEPS = 32_767  # of int16
SAMPLE, BESIDE = 500, 32  # points whose nearest neighbour is looked for, and in how many first


def packed(scene: Scene, most: int) -> str:
    """JSON of a scene with its first `most` points at most; nothing in it ends a script or starts a tag."""
    origin = np.round(everything_mm(scene).mean(axis=0), 3)
    local = scene.points_mm[:most] - origin
    order = np.argsort(local @ scene.axes[0], kind="stable")
    content = {
        "origin": origin.tolist(),
        "axes": scene.axes.tolist(),
        "axes_names": scene.axes_names,
        "marks_are": scene.marks_are,
        **_points(local[order]),
        "pitch_mm": round(pitch_mm(local), 4),
        "shadings": [_shading(each, order) for each in scene.shadings],
        "strokes": [_strokes(each, origin) for each in scene.strokes if each.lines_mm],
        "marks": [_mark(each, origin) for each in scene.marks],
    }
    text = json.dumps(content, allow_nan=False, ensure_ascii=True, separators=(",", ":"))
    return text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026")


def everything_mm(scene: Scene) -> Float:
    """(q, 3) all that the scene shows, in the base."""
    lines = [line for strokes in scene.strokes for line in strokes.lines_mm]
    return np.vstack([scene.points_mm, *lines, *(mark.outline_mm for mark in scene.marks)])


def pitch_mm(points_mm: Float) -> float:
    """How far a point is from its nearest neighbour, where they are sparse: nine in ten are nearer."""
    if len(points_mm) < 2:
        return 1.0
    longest = int(np.argmax(np.ptp(points_mm, axis=0)))
    points = points_mm[np.argsort(points_mm[:, longest])]  # what is nearest lies near in this order too
    found = []
    for i in range(0, len(points), max(1, len(points) // SAMPLE)):
        at, reach = points[i, longest], _second(points[max(0, i - BESIDE) : i + BESIDE + 1], points[i]) * (1.0 + 1e-9)
        low = np.searchsorted(points[:, longest], at - reach)
        high = np.searchsorted(points[:, longest], at + reach, side="right")
        found.append(_second(points[low:high], points[i]) if high - low > 1 else reach)
    return float(np.percentile(found, 90.0))


def _second(points_mm: Float, place_mm: Float) -> float:
    """Distance of the second nearest of the points, the nearest being the place itself."""
    off = points_mm - place_mm
    return math.sqrt(float(np.partition(np.einsum("ij,ij->i", off, off), 1)[1]))


def _points(local_mm: Float) -> dict[str, Any]:
    """Blocks (middle x, y, z, step, number of points) and the coordinates in steps from the middle."""
    blocks, steps = [], []
    for block in np.array_split(local_mm, max(1, -(-len(local_mm) // BLOCK_POINTS))) if len(local_mm) else ():
        low, high = block.min(axis=0), block.max(axis=0)
        middle = np.round((low + high) / 2, 3)
        step = max(1e-6, float((np.abs(block - middle)).max()) / HALF_STEPS)
        blocks.append([*middle.tolist(), step, len(block)])
        steps.append(np.round((block - middle) / step).astype("<i2"))
    return {"blocks": blocks, "points": _text(np.vstack(steps) if steps else np.zeros(0, "<i2"))}


def _shading(shading: Shading, order: Int) -> dict[str, Any]:
    palette = np.zeros((256, 3), np.uint8)
    palette[: len(shading.palette)] = shading.palette
    return {
        "name": shading.name,
        "palette": _text(palette),
        "index": _text(shading.index[order]),
        "legend": shading.legend,
    }


def _strokes(strokes: Strokes, origin: Float) -> dict[str, Any]:
    """Points of all lines, and red, green, blue and whether a line leads to the point (0 at a line's first one)."""
    rgba = [np.column_stack([colour, np.full(len(colour), 255)]) for colour in strokes.colours]
    for colour in rgba:
        colour[0, 3] = 0
    return {
        "name": strokes.name,
        "shown": strokes.shown,
        "points": _text((np.vstack(strokes.lines_mm) - origin).astype("<f4")),
        "colours": _text(np.vstack(rgba).astype(np.uint8)),
    }


def _mark(mark: Mark, origin: Float) -> dict[str, Any]:
    return {
        "key": mark.key,
        "place": np.round(mark.place_mm - origin, 3).tolist(),
        "outline": np.round(mark.outline_mm - origin, 3).tolist(),
        "colour": mark.colour,
        "facts": mark.facts,
    }


def _text(array: AnyArray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
