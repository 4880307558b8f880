"""How a track goes along a path: it stands where one place serves all of it, else it goes along with the tool.

A law of arc length with two numbers: where the track is at the first point, which the traversal chooses as it chooses a
turntable's angle, and how much of the tool's way along it the track goes: all, or what its limits leave. Corners and
turns back are rounded by the mean over a window. Between the law and the tool the robot makes up for the rest, so that
nothing rests on the law being the best one; the judge drives what is written.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from workbench.api import DEG, Cell, Float, base_from_targets, chords_mm, within_margins
from workbench.plugins.stiffness.path_points import PathPoints

WINDOW_MM = 600.0  # of arc length, over which the tool's way along the track is averaged
STEP_MM = 100.0  # of the grid of places at the first point
MOST_SHARE = 0.98  # of the room that the law takes


def along_track(cell: Cell, points: PathPoints) -> PathPoints:
    """The points as the robot sees them from a track that goes along with the tool, starting from where it was."""
    kept = within_margins(cell).turntable
    assert kept is not None
    way = tool_mm(cell, points)
    room, span = np.ptp(kept.limits) / DEG, np.ptp(way)
    share = min(1.0, MOST_SHARE * room / max(span, 1e-9))
    return replace(points, drift=share * (way - way[0]) * DEG)


def tool_mm(cell: Cell, points: PathPoints) -> Float:
    """How far the tool is along the track (n,), mean over the window."""
    along = (base_from_targets(cell, 0.0) - base_from_targets(cell, DEG))[:3, 3]  # a millimetre of the track
    steps = chords_mm(points.part_mm)
    arc = np.append(0.0, np.cumsum(np.maximum(steps, 1e-9)))
    there = points.part_mm @ along
    area = np.append(0.0, np.cumsum((there[1:] + there[:-1]) / 2 * np.diff(arc)))
    half = np.minimum(WINDOW_MM / 2, np.minimum(arc - arc[0], arc[-1] - arc))  # shorter at the ends: the law is whole
    half = np.maximum(half, 1e-6)
    low, high = np.interp(arc - half, arc, area), np.interp(arc + half, arc, area)
    inside = (half > 1e-5) & (arc[-1] > 1e-3)
    return np.where(inside, (high - low) / (2 * half), there)


def places(cell: Cell, drift: Float) -> Float:
    """Values at the first point, rad, from which a track that goes by `drift` (n,) stays within its limits."""
    kept = within_margins(cell).turntable
    assert kept is not None
    low, high = kept.limits[0] - drift.min(), kept.limits[1] - drift.max()
    return np.linspace(low, high, int((high - low) / (STEP_MM * DEG)) + 2) if high >= low else np.zeros(0)
