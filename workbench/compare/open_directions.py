"""Directions that a registration leaves open, in words."""

from __future__ import annotations

import math

import numpy as np

from workbench.compare.icp import Equations
from workbench.compare.surface_values import Surface
from workbench.units import Float

ALONG = 15.0  # degrees from the longest direction within which a slide is one along the edge


def in_words(direction: Float, equations: Equations, scan: Surface) -> str:
    """What a motion (6,), shift and turn times the lever, does: slide, turn, or both."""
    shift, turn = direction[:3], direction[3:]
    long = np.linalg.svd(
        scan.points_mm[:: max(1, len(scan.points_mm) // 2000)] - scan.points_mm.mean(axis=0), full_matrices=False
    )[2][0]
    if np.linalg.norm(shift) >= np.linalg.norm(turn):
        unit = shift / np.linalg.norm(shift)
        edge = " along the edge" if abs(unit @ long) > math.cos(math.radians(ALONG)) else ""
        return f"sliding{edge} by ({_numbers(unit)})"
    unit = turn / np.linalg.norm(turn)
    return f"turning about ({_numbers(unit)}) through ({', '.join(f'{x:.0f}' for x in equations.pivot_mm)}) mm"


def _numbers(unit: Float) -> str:
    return ", ".join(f"{x + 0.0:.2f}" for x in (unit * np.sign(unit[np.argmax(np.abs(unit))])).round(2))
