"""The grid of a line scanner, found again in the order of the points that it wrote: scan lines first, then columns.

Points of a line lie in one plane, the laser's, whatever noise or stray returns do: both act within it. So a line ends
where the next point leaves its plane. Where the order does not show such lines (a cloud that was merged, thinned or
shuffled) there are none. With them the laser plane's axes are found, and each point's column.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from workbench.geometry.gridless import MARGIN
from workbench.units import Bool, Float, Float32, Int, Shaped

LEAST_LINES, LEAST_POINTS = 3, 20  # of a cloud; of a line, in the median
LEAST_SHARE = 0.8  # of the points, in such lines
WINDOW = 20_000  # points from which the laser plane is found without knowing a line
TRIPLES = (15, 40)  # points between the three that span a plane
BEND = 0.03  # sine at the middle one, at the least
ALIKE = 0.01  # difference between unit normals of one plane
LEAST_PITCH_MM, SHARE_OF_PITCH = 0.02, 0.35  # distance between lines; how far off its plane a line's point may lie
SHORT_LINES = 12  # so many short ones in a row: the plane is lost
PASS_JUMP, PASS_LINES = 25.0, 9  # a pass ends at a step of so many usual ones, or where so many lines go another way
ANGLES = 90  # of the lateral axis, that are tried; each further time between the two next to the best
SAMPLE = 60_000  # steps that tell it, a tenth of them the first
LEAST_STEP_MM = 1e-4
LEAST_CELLS, MOST_CELLS = 10_000_000, 50  # of a grid; a point, beyond that
MOST_MISSING = 40  # columns left empty for returns that are missing in a row


@dataclass(frozen=True, slots=True, eq=False)
class ScanLines:
    """N scan lines in the order in which they were written."""

    first: Int  # (N + 1,) index of each line's first point, and the end
    normal: Shaped[Float, "N 3"]  # unit, of the laser plane
    pass_index: Shaped[Int, " N"]


def scan_lines(points_mm: Float) -> ScanLines | None:
    """The scan lines of points (n, 3) in the order in which they were written; None where there are none."""
    first, normals, good = _followed(points_mm)
    if not first or good < LEAST_SHARE * len(points_mm):
        return None
    bounds = np.array([*first, len(points_mm)])
    if len(first) < LEAST_LINES or np.median(np.diff(bounds)) < LEAST_POINTS:
        return None
    return ScanLines(bounds, np.array(normals), _passes(points_mm, bounds, np.array(normals)))


def lines_of_rows(points_mm: Float, row: Int) -> ScanLines | None:
    """The scan lines of points (n, 3) whose rows (n,) are known; None where these lie in no planes of a laser.

    A row whose own points do not tell its plane, such as one that is straight, has that of the row before.
    """
    bounds = np.append(np.flatnonzero(np.diff(row, prepend=row[0] - 1)), len(row))
    found = _laser_plane(points_mm[:WINDOW])
    if found is None or len(bounds) <= LEAST_LINES:
        return None
    normals, good, lost = [], 0, 0
    for at, end in itertools.pairwise(bounds):
        normal, within = _row_plane(points_mm[at:end], *found)
        if within < LEAST_SHARE * (end - at) and (other := _laser_plane(points_mm[at : at + WINDOW])) is not None:
            lost += 1
            found = other
            normal, within = _row_plane(points_mm[at:end], *found)
        if lost > max(SHORT_LINES, len(bounds) // SHORT_LINES):
            return None
        found = (normal, found[1])
        normals.append(normal)
        good += within
    if good < LEAST_SHARE * len(points_mm):
        return None
    return ScanLines(bounds, np.array(normals), _passes(points_mm, bounds, np.array(normals)))


def _row_plane(points: Float, normal: Float, tolerance: float) -> tuple[Float, int]:
    """A row's own normal, near to the one before, and how many of its points lie in that plane."""
    off = points - points.mean(axis=0)
    own = np.linalg.eigh(off.T @ off)[1][:, 0]
    if len(points) >= LEAST_POINTS and abs(own @ normal) > 1.0 - ALIKE:
        normal = own * np.sign(own @ normal)
    return normal, int((np.abs(off @ normal) <= tolerance).sum())


def _followed(points: Float) -> tuple[list[int], list[Float], int]:
    """First point and normal of each line, one after the other, and how many points lie in lines worth the name.

    Gives up where hardly any do. Where the plane is lost, as from pass to pass, it is found anew.
    """
    first: list[int] = []
    normals: list[Float] = []
    at, good, short, lost, size = 0, 0, SHORT_LINES, -1, LEAST_POINTS
    normal, tolerance = np.zeros(3), 0.0
    while at < len(points):
        if short == SHORT_LINES:
            if at > 0:
                at = first[-SHORT_LINES]
                del first[-SHORT_LINES:], normals[-SHORT_LINES:]
            found = _laser_plane(points[at : at + WINDOW])
            if (found is None or at == lost) and good < LEAST_SHARE * max(at, 1):
                break
            normal, tolerance = found or (normal, tolerance)
            short, lost = SHORT_LINES + 1 if at == lost or found is None else 0, at
        end, normal = _line_end(points, at, normal, tolerance, 2 * size)
        first.append(at)
        normals.append(normal)
        short += 1
        if end - at >= LEAST_POINTS:
            short, size, good = 0, end - at, good + end - at
        at = end
    return first, normals, good


def _laser_plane(points: Float) -> tuple[Float, float] | None:
    """Unit normal of most lines' planes among some points in order, and how far off a line's points may lie, mm."""
    normals = []
    for k in TRIPLES:
        p, q = points[k:-k] - points[: -2 * k], points[2 * k :] - points[k:-k]
        n = np.cross(p, q)
        size = np.linalg.norm(n, axis=1)
        bent = size > BEND * np.linalg.norm(p, axis=1) * np.linalg.norm(q, axis=1)
        normals.append(n[bent] / size[bent, None])
    if not sum(map(len, normals)):
        return None
    found = np.concatenate(normals)
    found *= np.where(found[np.arange(len(found)), np.abs(found).argmax(axis=1)] < 0, -1.0, 1.0)[:, None]
    _, group, count = np.unique(
        np.round(found / ALIKE).astype(np.int64), axis=0, return_inverse=True, return_counts=True
    )
    normal = found[group.ravel() == count.argmax()].mean(axis=0)
    normal = found[np.linalg.norm(found - normal, axis=1) < ALIKE].mean(axis=0)
    normal /= np.linalg.norm(normal)
    leaps = np.abs(np.diff(points @ normal))
    leaps = leaps[leaps > LEAST_PITCH_MM]
    if not leaps.size:
        return None
    return normal, SHARE_OF_PITCH * float(np.median(leaps))


def _line_end(points: Float, at: int, normal: Float, tolerance: float, size: int) -> tuple[int, Float]:
    """Index after the last point of the line that begins at `at`, and its own plane's normal."""
    middle = points[at]
    for last in (False, True):
        while True:
            block = points[at : at + size]
            off = np.abs((block - middle) @ normal) > tolerance
            if off.any() or at + size >= len(points):
                break
            size *= 2
        end = at + (int(off.argmax()) if off.any() else len(block))
        if last or end - at < LEAST_POINTS:
            break
        middle = points[at:end].mean(axis=0)
        off_middle = points[at:end] - middle
        own = np.linalg.eigh(off_middle.T @ off_middle)[1][:, 0]
        normal = own * np.sign(own @ normal) if abs(own @ normal) > 1.0 - ALIKE else normal
    return max(end, at + 1), normal


def _passes(points: Float, first: Int, normal: Float) -> Int:
    """Number of the scanning pass of each line: a new one where the lines jump or tilt, or turn back for good."""
    middle = np.add.reduceat(points, first[:-1]) / np.diff(first)[:, None]
    axis = np.linalg.svd(middle - middle.mean(axis=0), full_matrices=False)[2][0]
    facing = normal[1:] * np.sign(normal[1:] @ axis)[:, None]
    advance = np.einsum("ij,ij->i", np.diff(middle, axis=0), facing)  # across the planes: what they hold moves within
    jump = np.abs(advance) > PASS_JUMP * np.median(np.abs(advance))
    tilt = np.linalg.norm(np.cross(normal[1:], normal[:-1]), axis=1) > ALIKE
    known = _share_near(jump | tilt) > 0
    forward = _settled(advance > 0)
    turn = np.diff(forward, prepend=forward[:1]) & ~known
    return np.concatenate([[0], np.cumsum(jump | tilt | turn)])


def _settled(forward: Bool) -> Bool:
    """Majority over PASS_LINES neighbours."""
    return np.asarray(_share_near(forward) > 0.5)


def _share_near(flags: Bool) -> Float:
    """Share of set flags (n,) among PASS_LINES neighbours; beyond the ends it goes on like them."""
    padded = np.pad(flags.astype(float), PASS_LINES // 2, mode="edge")
    return np.convolve(padded, np.full(PASS_LINES, 1.0 / PASS_LINES), "valid")


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
        if pitch < LEAST_STEP_MM:
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
    low, high = 0.0, np.pi
    for sample in (SAMPLE // 10, SAMPLE // 10, SAMPLE):
        some = step[:: max(1, len(step) // sample)]
        angles = np.linspace(low, high, ANGLES)
        scatter = [_scatter(some @ [np.cos(a), np.sin(a)]) for a in angles]
        best = np.argmin(scatter)
        low, high = angles[best] + (high - low) / ANGLES * np.array([-1, 1])
    angle = float(angles[best])
    pitch = float(np.median(some @ [np.cos(angle), np.sin(angle)]))
    return (angle, pitch) if pitch > 0 else (angle + np.pi, -pitch)


def _scatter(step: Float) -> float:
    """Of steps (k,) about their median, in parts of it."""
    middle = np.median(step)
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
