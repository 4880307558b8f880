"""Robust lines in sections, as papers on seam tracking and edge inspection describe it.

The returns of 5 mm of edge are brought into the plane normal to it; a line through each face by iteratively reweighted
least squares with Tukey's biweight (c = 4.685; Holland and Welsch 1977); the root from their crossing to the median of
the last returns. u: standard deviation over five groups of frames (jackknife), with half a column at the end.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.open.rivals.reader import Corners, corners, crossing, in_base, stretches, tangents
from workbench.units import Float, Int

TITLE = "robust lines"
TRACKS = ("milled", "raw")
WINDOW_MM, TUKEY, ROUNDS, GROUPS = 2.5, 4.685, 12, 5
Line = tuple[Float, Float, Float]


def measure(recording: Path, declared: Mapping[str, Any]) -> dict[str, Any]:
    """Nine sections."""
    seen = corners(recording, declared)
    place = in_base(seen.base_from_profiler, seen.end[:, :2])
    chord, parts = stretches(place)
    along = tangents(place, chord)
    sections = []
    for mine in parts:
        if len(mine) < GROUPS:
            continue
        middle = np.median(place[mine], axis=0)
        near = np.flatnonzero(np.abs((place - middle) @ chord) < WINDOW_MM)
        near = near if len(near) >= GROUPS else mine
        way = np.median(along[mine], axis=0)
        way /= np.linalg.norm(way)
        whole = section(seen, place, near, way)
        parted = [section(seen, place, np.delete(near, np.s_[k::GROUPS]), way) for k in range(GROUPS)]
        each = np.array([[size, turn, lower @ whole[3], lower @ whole[4]] for size, turn, lower, *_ in parted])
        u = np.sqrt((GROUPS - 1) / GROUPS * ((each - each.mean(axis=0)) ** 2).sum(axis=0))
        half = float(np.median(seen.end[near, 2])) / 12**0.5
        sections.append(told(declared, whole, u, half, way))
    return {"sections": sections}


def section(seen: Corners, place: Float, near: Int, way: Float) -> tuple[float, float, Float, Float, Float]:
    """Root (mm), angle (deg), lower edge, direction of the root face from its corner, of the bevel; in the base."""
    origin = place[near].mean(axis=0)
    out = -np.cross(way, seen.base_from_profiler[near[0], :3, 2])
    u = out / np.linalg.norm(out)
    v = np.cross(u, way)
    axes = np.stack([u, v], axis=1)

    def fitted(faces: list[Float]) -> Line:
        points = [in_base(np.repeat(seen.base_from_profiler[i : i + 1], len(faces[i]), 0), faces[i]) for i in near]
        return tukey(
            (np.concatenate(points) - origin) @ axes, (np.median([p[-1] - p[0] for p in points], axis=0)) @ axes
        )

    root, bevel = fitted(seen.root), fitted(seen.bevel)
    corner = crossing(root, bevel)
    size = float(np.median((((place[near] - origin) @ axes) - corner) @ root[1]))
    turn = float(np.degrees(np.arccos(np.clip(-root[1] @ bevel[1], -1.0, 1.0))))
    return size, turn, origin + axes @ (corner + size * root[1]), axes @ root[1], axes @ bevel[1]


def tukey(points: Float, way: Float) -> Line:
    """A line by reweighted total least squares, directed as `way`."""
    along, middle = way / np.linalg.norm(way), np.median(points, axis=0)
    for _ in range(ROUNDS):
        residual = (points - middle) @ np.array([-along[1], along[0]])
        scale = TUKEY * 1.4826 * float(np.median(np.abs(residual))) + 1e-9
        weight = np.where(np.abs(residual) < scale, (1.0 - (residual / scale) ** 2) ** 2, 0.0)
        middle = (weight[:, None] * points).sum(axis=0) / weight.sum()
        off = points - middle
        along = np.linalg.svd((weight[:, None] * off).T @ off)[0][:, 0]
    return middle, along if along @ way > 0 else -along, residual


def told(declared: Mapping[str, Any], found: Any, u: Float, half_mm: float, way: Float) -> dict[str, Any]:
    """As a section of a submission."""
    size, turn, lower, root_way, bevel_way = found
    if declared["kind"] != "raw":
        names = ("root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg")
        values = dict(zip(names, (size, float(np.hypot(u[0], half_mm)), turn, float(u[1])), strict=True))
        return {"origin_mm": lower.tolist(), **values}
    m = -root_way
    t = way if np.cross(m, -bevel_way) @ way > 0 else -way  # t = m x n; the upper face runs inwards
    n = np.cross(t, m)
    return {
        "origin_mm": lower.tolist(),
        "normal": n.tolist(),
        "tangent": t.tolist(),
        "along_n_u_mm": float(max(u[3], 1e-3)),
        "along_m_u_mm": float(np.hypot(u[2], half_mm)),
        "axis_u_deg": float(max(u[1], 1e-3)),
        "heading_u_deg": float(max(u[1], 1e-3)),
    }
