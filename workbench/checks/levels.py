"""Returns beside a face that run as it does beyond its end: a step of it, an undercut, a strip below."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from workbench.artefacts import BEVEL_FACE, ROOT_FACE, Check, Cloud
from workbench.checks.corners import LEAST_FRAMES, face_columns, fitted_line, frames_with, off_line
from workbench.checks.limits import Bound, check, most
from workbench.checks.straightness import FRAMES
from workbench.geometry.blocks import as_input
from workbench.kernels import kernel
from workbench.units import AnyArray, Bool, Float, Float32, Int

# Within how much, of each frame's next ones, times as many as right beside it, how far from the face across and along
# it, how many at least, leaning by how much to it.
LEVEL_MM, NEXT, ALONE, LEVEL_FROM_MM, LEVEL_AWAY_MM = 0.1, 2, 2.0, 0.3, 0.15
LEVEL_TO_MM, LEVEL_POINTS, LEVEL_LEAN = 3.0, 3, 0.2

Beyond = tuple[Float, Float]  # of returns beyond an end of a frame's face: distance from it along the face, and across


def one_level(ends: Sequence[Beyond], frames: int) -> tuple[float, float]:
    """Share of some frames whose next returns beyond one end stand on the level on which most of them do; that, mm.

    What falls off from the face step by step is its rounded or chamfered edge; what begins at its end, a surface of the
    plate; nearly as many right beside the level, or a level that leans, are those of some other surface.
    """
    frame = np.repeat(np.arange(len(ends)), [len(away[:NEXT]) for away, _ in ends])
    away, across = (np.concatenate([end[k][:NEXT] for end in ends]) if ends else np.zeros(0) for k in (0, 1))
    falls = np.unique(frame[np.abs(across) <= LEVEL_FROM_MM])
    near = (away > LEVEL_AWAY_MM) & (away < LEVEL_TO_MM) & (np.abs(across) < LEVEL_TO_MM) & ~np.isin(frame, falls)
    frame, away, across = frame[near], away[near], across[near]
    best = (0.0, 0.0)
    for low in np.unique(np.floor(across / (0.5 * LEVEL_MM))) * 0.5 * LEVEL_MM:
        on = (across >= low) & (across < low + LEVEL_MM)
        adjacent = (across >= low - LEVEL_MM) & (across < low + 2.0 * LEVEL_MM) & ~on
        share = len(np.unique(frame[on])) / frames
        if share > best[0] and on.sum() > max(LEVEL_POINTS, ALONE * adjacent.sum()):
            spread = float(np.ptp(away[on]))
            lean = abs(float(np.polyfit(away[on], across[on], 1)[0])) if spread > 0.0 else 0.0
            best = (share, abs(low + 0.5 * LEVEL_MM)) if lean < LEVEL_LEAN else best
    return best


BEHIND = "stands_behind_mm"
LEAST_POINTS = 8  # of the root face
FROM_MM, FROM_SIGMAS, TO_MM = 0.04, 5.0, 3.0  # beside its line
FAR_MM, COLUMNS = 3.0, 60  # beyond its end
RUN_POINTS, RUN_MM, LEAN = 4, 0.15, 0.15  # of a run: returns, length, slope to the face: a rounded edge falls steeper


def step_check(
    cloud: Cloud, labels: AnyArray, root_mm: float, limits: Mapping[str, Bound] | None = None
) -> tuple[Check, Check]:
    """The check that nothing goes on beside the root face (labels (N, M)) beyond its lower end, and how far behind.

    What runs farther behind than the root face is wide, by its nominal size, is held for another body, as a bar:
    the lip of a step would be longer than it is thick. The verdict then rests on that.
    """
    rows = frames_with(labels, (ROOT_FACE, BEVEL_FACE), FRAMES)
    share, at_mm = step_share(cloud, labels, rows)
    finding = (
        f"in {100 * (share or 0.0):.0f} % of the frames returns run parallel to the root face, {at_mm:.2g} mm beside "
        "it, beyond its lower end: a table or a strip right below, a step or an undercut in it, a second plate?"
    )
    another = share is not None and share > most("step_share") and at_mm > root_mm
    return (
        check("step_share", 0.0 if another else share, finding, given=limits),
        Check(BEHIND, at_mm if another else 0.0, None, True, "the verdict rests on its being another body", finding),
    )


def step_share(cloud: Cloud, labels: AnyArray, rows: Int, way: int = 0) -> tuple[float | None, float]:
    """Share of the frames `rows` in which returns run parallel to the root face (labels (N, M)) beyond an end of it.

    And how far beside it, mm. The share is None where there are too few frames.

    Args:
        cloud: organised.
        labels: faces of its points.
        rows: frames that show the face.
        way: 1: beyond its end at the greatest column, -1: at the least one, 0: away from the bevel face.
    """
    if len(rows) < LEAST_FRAMES:
        return None, 0.0
    level, first = np.full(len(rows), np.nan), np.full((len(rows), NEXT, 2), np.nan)
    x, z, keep = (as_input(grid[rows]) for grid in (cloud.x_mm, cloud.z_mm, cloud.keep))
    _levels(x, z, keep, as_input(labels[rows]), way, level, first)
    has_run = np.isfinite(level)
    at_mm = float(np.median(np.abs(level[has_run]))) if has_run.any() else 0.0
    # a step of which a frame shows two or three returns
    ends = [(of[np.isfinite(of[:, 0]), 0], of[np.isfinite(of[:, 0]), 1]) for of in first]
    return max((float(has_run.mean()), at_mm), one_level(ends, len(rows)))


@kernel
def _levels(x: Float32, z: Float32, keep: Bool, labels: AnyArray, beyond: int, level: Float, first: Float) -> None:
    """Fill in for some frames how far beside the root face's line the first such run lies (n,), mm; NaN: none.

    And first (n, k, 2): how far the next returns beyond its end lie along the face from there, and beside it.
    """
    columns = x.shape[1]
    on, off, line = np.empty(columns, np.int64), np.empty(columns), np.empty(5)
    for i in range(len(x)):
        size = face_columns(keep[i], labels[i], BEVEL_FACE, on)
        bevel = on[size // 2] if beyond == 0 else 0
        size = face_columns(keep[i], labels[i], ROOT_FACE, on)
        if size < LEAST_POINTS:
            continue
        fitted_line(x[i], z[i], on[:size], off, line)
        way = beyond if beyond != 0 else 1 if on[size // 2] > bevel else -1
        end = on[size - 1] if way > 0 else on[0]
        level[i] = _first_run(x[i], z[i], keep[i], end, way, line)
        count, j = 0, end + way
        while count < first.shape[1] and 0 <= j < columns and abs(j - end) <= COLUMNS:
            if keep[i, j]:
                a, b = float(x[i, j]), float(z[i, j])
                first[i, count, 0] = abs((a - x[i, end]) * line[2] + (b - z[i, end]) * line[3])
                first[i, count, 1] = off_line(line, a, b)
                count += 1
            j += way


@kernel
def _first_run(x: Float32, z: Float32, keep: Bool, end: int, way: int, line: Float) -> float:
    """Distance from a line (see `fitted_line`) of the first run parallel to it beyond column `end`, mm; NaN: none."""
    least = max(FROM_MM, FROM_SIGMAS * line[4])
    count, last = 0, 0.0
    sums = np.zeros(4)
    for k in range(1, COLUMNS + 1):
        j = end + k * way
        if j < 0 or j >= x.size:
            break
        if not keep[j]:
            continue
        a, b = float(x[j]), float(z[j])
        along = abs((a - x[end]) * line[2] + (b - z[end]) * line[3])
        across = off_line(line, a, b)
        if count > 0 and abs(across - last) > least:
            if _is_level(sums, count, least):
                return float(sums[1] / count)
            count = 0
        if count == 0:
            sums[:] = 0.0
        if abs(across) < TO_MM and along < FAR_MM:
            count, last = count + 1, across
            sums[0], sums[1] = sums[0] + along, sums[1] + across
            sums[2], sums[3] = sums[2] + along * along, sums[3] + along * across
    return float(sums[1] / count) if count > 0 and _is_level(sums, count, least) else np.nan


@kernel
def _is_level(sums: Float, count: int, least: float) -> bool:
    """Whether a run, by its sums of along, across and their products, is parallel to the face and beside it."""
    if count < RUN_POINTS:
        return False
    spread = sums[2] - sums[0] ** 2 / count
    lean = (sums[3] - sums[0] * sums[1] / count) / max(spread, 1e-12)
    return bool(abs(sums[1] / count) > least and math.sqrt(12.0 * spread / count) > RUN_MM and abs(lean) < LEAN)
