"""The grid of a line scanner, found again from its scan lines: the laser plane's axes, and each point's column."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.geometry.scan_lines import ScanLines
from workbench.units import Float, Float32, Int, Shaped

ANGLES = 360  # of the lateral axis, that are tried; then as many between the two next to the best
SAMPLE = 60_000  # steps that tell it
MARGIN = 20  # empty columns on each side: where the field of view ended is not known
LEAST_PITCH_MM = 1e-4
LEAST_CELLS, MOST_CELLS = 10_000_000, 50  # of a grid; a point, beyond that
MOST_MISSING = 40  # columns left empty for returns that are missing in a row


@dataclass(frozen=True, slots=True, eq=False)
class ScanGrid:
    """Frames (N) by columns (M), with x rising; which way z counts is not known."""

    x_mm: Shaped[Float32, "N M"]  # NaN where nothing came back
    z_mm: Shaped[Float32, "N M"]
    base_from_profiler: Shaped[Float, "N 4 4"]


def scan_grid(points_mm: Float, lines: ScanLines, known: Int | None = None) -> ScanGrid | None:
    """The grid that n points came from, whose columns (n,) may be known.

    A profiler's columns lie at equal steps of x, whatever z and its noise are.

    The lateral axis of each pass is the direction in the laser plane along which neighbours lie most equally apart.
    None where they are nowhere apart, or leave next to all of the grid empty: that is no profiler's.
    """
    line = np.repeat(np.arange(len(lines.normal)), np.diff(lines.first))
    first_axis = _transported(lines)
    second_axis = np.cross(lines.normal, first_axis)
    origin = _origins(points_mm, lines)
    off = points_mm - origin[line]
    plane = np.stack([np.einsum("ij,ij->i", off, axis[line]) for axis in (first_axis, second_axis)], axis=1)
    x_axis, column, x, z = np.empty((len(lines.normal), 3)), np.empty(len(line), np.int64), *np.empty((2, len(line)))
    for number in np.unique(lines.pass_index):
        here = lines.pass_index == number
        mine = here[line]
        angle, pitch = lateral_axis(plane[mine], line[mine])
        if pitch < LEAST_PITCH_MM:
            return None
        c, s = np.cos(angle), np.sin(angle)
        x_axis[here] = c * first_axis[here] + s * second_axis[here]
        x[mine], z[mine] = plane[mine] @ [c, s], plane[mine] @ [-s, c]
        column[mine] = _columns(x[mine], line[mine], pitch) if known is None else known[mine]
    column += MARGIN - column.min()
    if len(lines.normal) * int(column.max()) > LEAST_CELLS + MOST_CELLS * len(line):
        return None
    grid = np.full((2, len(lines.normal), int(column.max()) + 1 + MARGIN), np.nan, np.float32)
    grid[0, line, column], grid[1, line, column] = x, z
    pose = np.tile(np.eye(4), (len(lines.normal), 1, 1))
    pose[:, :3, 0], pose[:, :3, 1], pose[:, :3, 3] = x_axis, -lines.normal, origin
    pose[:, :3, 2] = np.cross(x_axis, -lines.normal)
    return ScanGrid(grid[0], grid[1], pose)


def _transported(lines: ScanLines) -> Float:
    """A unit vector in each laser plane (N, 3) that turns no more than the planes do, from line to line."""
    axis = np.empty((len(lines.normal), 3))
    v = np.eye(3)[np.argmin(np.abs(lines.normal[0]))]
    for i, n in enumerate(lines.normal):
        v = v - n * (n @ v)
        v = axis[i] = v / np.linalg.norm(v)
    return axis


def _origins(points: Float, lines: ScanLines) -> Float:
    """A point of each laser plane (N, 3), mm, all on one straight line a pass, so that profiles move smoothly."""
    middle = np.add.reduceat(points, lines.first[:-1]) / np.diff(lines.first)[:, None]
    origin = np.empty_like(middle)
    for number in np.unique(lines.pass_index):
        mine = lines.pass_index == number
        m, n = middle[mine], lines.normal[mine]
        mean = np.median(m, axis=0)
        along = n.mean(axis=0)
        origin[mine] = mean + ((m - mean) * n).sum(axis=1)[:, None] / (n @ along)[:, None] * along
    return origin


def lateral_axis(plane_mm: Float, line: Int) -> tuple[float, float]:
    """Angle of x in the plane's axes, with x rising from point to point, rad; and the step between columns, mm.

    plane_mm (n, 2): points in the laser plane, line after line (n,).
    """
    step = np.diff(plane_mm, axis=0)[np.diff(line) == 0]
    step = step[:: max(1, len(step) // SAMPLE)]
    low, high = 0.0, np.pi
    for _ in range(2):
        angles = np.linspace(low, high, ANGLES)
        scatter = [_scatter(step @ [np.cos(a), np.sin(a)]) for a in angles]
        best = int(np.argmin(scatter))
        low, high = angles[best] - (high - low) / ANGLES, angles[best] + (high - low) / ANGLES
    angle = float(angles[best])
    pitch = float(np.median(step @ [np.cos(angle), np.sin(angle)]))
    return (angle, pitch) if pitch > 0 else (angle + np.pi, -pitch)


def _scatter(step: Float) -> float:
    """Of steps (k,) about their median, in parts of it."""
    middle = float(np.median(step))
    return float(np.median(np.abs(step - middle))) / max(abs(middle), 1e-9)


def _columns(x: Float, line: Int, pitch: float) -> Int:
    """Column of each point: the first one's by its x, then as many further as the step has pitches, at least one."""
    start = np.flatnonzero(np.diff(line, prepend=line[0] - 1))
    size = np.diff(np.append(start, line.size))
    step = np.clip(np.round(np.diff(x, prepend=x[:1]) / pitch), 1, MOST_MISSING)
    step[start] = np.round(x[start] / pitch - _phase(x / pitch, start, size))
    before = np.cumsum(step)
    return np.asarray(before - np.repeat(before[start] - step[start], size), dtype=np.int64)


def _phase(x: Float, start: Int, size: Int) -> Float:
    """Where each line's columns lie about whole numbers of x (n,) in columns: robot and sensor move a little."""
    turn = np.add.reduceat(np.exp(2j * np.pi * x), start) / size
    return np.asarray(np.unwrap(np.angle(turn)) / (2.0 * np.pi))
