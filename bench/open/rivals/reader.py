"""What the rivals of this folder read profiles by: straight runs, and the pair of them that is the wanted corner.

Nothing of the project's own reading is in it: split and merge (Pavlidis and Horowitz 1974) of every profile, then of
all neighbouring runs the two that meet at about the nominal angle, the first about as long as the nominal root face.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from workbench.scan import read
from workbench.scan.fuse_stage import flange_poses
from workbench.units import Float, Int

SPLIT_SIGMAS, LEAST_SPLIT_MM = 6.0, 0.03  # a run is split where a point lies farther off its chord's line
GAP_MM = 1.0  # between neighbouring returns of a run
LEAST_POINTS = 6
ANGLE_DEG, LENGTH = 12.0, 0.5  # how far a pair may be off: its angle, and the root's length as a share of the nominal
SECTIONS = 9


class Corners(NamedTuple):
    """Frames (n,) in which the pair was found; poses and, of each, the returns (k, 2) of root face and bevel face."""

    base_from_profiler: Float  # (n, 4, 4)
    root: list[Float]
    bevel: list[Float]
    end: Float  # (n, 3): x, z of the root's last return, and the distance to the column after it


def corners(recording: Path, declared: Mapping[str, Any]) -> Corners:
    """The wanted corner in every frame that shows it.

    Raises:
        ValueError: it is in fewer than ten frames.
    """
    scan = read(recording=recording)
    assert scan.flange_from_profiler is not None
    poses = flange_poses(scan) @ scan.flange_from_profiler
    raw = declared["kind"] == "raw"
    angle = 90.0 if raw else float(declared["bevel_nominal_deg"])
    length = None if raw else float(declared["root_nominal_mm"])
    kept, root, bevel, ends = [], [], [], []
    for i, (x, z) in enumerate(zip(scan.x_mm.astype(float), scan.z_mm.astype(float), strict=True)):
        up = poses[i][:3, [0, 2]].T @ np.asarray(declared["upper_side"], float) if raw else None
        pair = best_pair(list(runs(x, z)), angle, length, up)
        if pair is None:
            continue
        kept.append(i)
        root.append(pair[0])
        bevel.append(pair[1])
        pitch = np.median(np.linalg.norm(np.diff(pair[0], axis=0), axis=1))
        ends.append([*pair[0][-1], pitch])
    if len(kept) < 10:
        raise ValueError(f"the corner is in {len(kept)} of {len(poses)} profiles")
    return Corners(poses[kept], root, bevel, np.array(ends))


def runs(x: Float, z: Float) -> Iterator[Float]:
    """Straight runs (k, 2) of a profile, in its order."""
    points = np.stack([x, z], axis=1)[np.isfinite(x) & np.isfinite(z)]
    if len(points) < LEAST_POINTS:
        return
    step = np.diff(points, axis=0)
    sigma = 1.4826 * np.median(np.abs(np.diff(step[:, 1]))) / 6**0.5  # second differences know no slope
    limit = max(LEAST_SPLIT_MM, SPLIT_SIGMAS * sigma)
    for piece in np.split(points, np.flatnonzero(np.linalg.norm(step, axis=1) > GAP_MM) + 1):
        stack = [piece]
        while stack:
            run = stack.pop()
            if len(run) < LEAST_POINTS:
                continue
            off = np.abs(across(run, run[0], run[-1]))
            worst = int(off.argmax())
            if off[worst] <= limit or worst in (0, len(run) - 1):
                yield run
            else:
                stack += [run[worst:], run[: worst + 1]]


def across(points: Float, a: Float, b: Float) -> Float:
    """Signed distances of points from the line through a and b."""
    way = (b - a) / max(float(np.linalg.norm(b - a)), 1e-9)
    off = points - a
    return np.asarray(off[:, 0] * way[1] - off[:, 1] * way[0])


def best_pair(found: list[Float], angle_deg: float, length_mm: float | None, up: Float | None) -> Any:
    """Root and bevel run, each from the corner outwards; None: no pair is like the nominal one."""
    best, least = None, 2.0
    for first, second in pairwise(found):
        if np.linalg.norm(second[0] - first[-1]) > GAP_MM:
            continue
        a, b = first[-1] - first[0], second[-1] - second[0]
        turn = np.degrees(np.arccos(np.clip(a @ b / np.linalg.norm(a) / np.linalg.norm(b), -1.0, 1.0)))
        for root, bevel in ((first[::-1], second), (second, first[::-1])):
            cost = abs(turn - angle_deg) / ANGLE_DEG
            if length_mm is not None:
                cost += abs(np.linalg.norm(root[-1] - root[0]) / length_mm - 1.0) / LENGTH
            if up is not None and (root[-1] - bevel[-1]) @ up > 0.0:
                continue  # the end face is the lower one
            if cost < least:
                best, least = (root, bevel), cost
    return best


def line(points: Float) -> tuple[Float, Float, Float]:
    """Mean point, direction away from the first point, and residuals of the total least-squares line."""
    middle = points.mean(axis=0)
    way = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    way = way if (points[-1] - points[0]) @ way > 0 else -way
    return middle, way, (points - middle) @ np.array([-way[1], way[0]])


def crossing(one: tuple[Float, Float, Float], other: tuple[Float, Float, Float]) -> Float:
    """Where two lines meet."""
    at = np.linalg.solve(np.stack([one[1], -other[1]], axis=1), other[0] - one[0])
    return np.asarray(one[0] + at[0] * one[1])


def in_base(pose: Float, xz: Float) -> Float:
    """Points (n, 3) in the base of (x, z) (n, 2) in frames at poses (n, 4, 4)."""
    return np.asarray(pose[:, :3, 3] + xz[:, :1] * pose[:, :3, 0] + xz[:, 1:2] * pose[:, :3, 2])


def stretches(points: Float) -> tuple[Float, list[Int]]:
    """Direction of the edge through points (n, 3), and which of them lie in each of nine equal stretches."""
    middle = np.median(points, axis=0)
    way = np.linalg.svd(points - middle, full_matrices=False)[2][0]
    along = (points - middle) @ way
    ends = np.linspace(*np.percentile(along, [0.5, 99.5]), SECTIONS + 1)
    number = np.searchsorted(ends, along)
    return way, [np.flatnonzero(number == k + 1) for k in range(SECTIONS)]


def tangents(points: Float, chord: Float) -> Float:
    """Unit tangents (n, 3) at points along an edge: a cubic over the chord, without what lies off it."""
    q = (points - points.mean(axis=0)) @ chord
    q = q / max(float(np.abs(q).max()), 1e-9)
    good, powers = np.ones(len(q), bool), np.vander(q, 4)
    for _ in range(5):
        fit = np.linalg.lstsq(powers[good], points[good], rcond=None)[0]
        off = np.linalg.norm(points - powers @ fit, axis=1)
        good = off < 4.0 * float(np.median(off))
    way = np.vander(q, 3) @ (fit[:3] * np.array([[3.0], [2.0], [1.0]]))
    way *= np.sign(way @ chord)[:, None]
    return np.asarray(way / np.linalg.norm(way, axis=1, keepdims=True))


def spread(values: Float) -> float:
    """Standard deviation by the median of absolute deviations."""
    return float(1.4826 * np.median(np.abs(values - np.median(values))))
