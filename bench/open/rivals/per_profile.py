"""Profile by profile, as a competent engineer writes it in an afternoon: lines, their crossing, medians over frames.

u is the standard deviation of the median of a section's frames (GUM 4.2.3): such a method knows no other.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from bench.open.rivals.reader import corners, crossing, in_base, line, spread, stretches

TITLE = "per profile"
TRACKS = ("milled",)
MEDIAN = (np.pi / 2.0) ** 0.5  # its standard deviation over that of the mean


def measure(recording: Path, declared: Mapping[str, Any]) -> dict[str, Any]:
    """Median angle and root of the frames in each of nine sections."""
    seen = corners(recording, declared)
    root, bevel = [line(points[1:-1]) for points in seen.root], [line(points[1:-1]) for points in seen.bevel]
    corner = np.array([crossing(a, b) for a, b in zip(root, bevel, strict=True)])
    size = np.linalg.norm(seen.end[:, :2] - corner, axis=1)
    turn = np.array([np.degrees(np.arccos(np.clip(-a[1] @ b[1], -1.0, 1.0))) for a, b in zip(root, bevel, strict=True)])
    place = in_base(seen.base_from_profiler, seen.end[:, :2])
    sections = []
    for mine in stretches(place)[1]:
        if len(mine) < 3:
            continue
        sections.append(
            {
                "origin_mm": np.median(place[mine], axis=0).tolist(),
                "root_mm": float(np.median(size[mine])),
                "root_u_mm": MEDIAN * spread(size[mine]) / len(mine) ** 0.5,
                "bevel_deg": float(np.median(turn[mine])),
                "bevel_u_deg": MEDIAN * spread(turn[mine]) / len(mine) ** 0.5,
            }
        )
    return {"sections": sections}
