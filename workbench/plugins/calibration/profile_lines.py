"""What a profile shows of a fixed part: one straight line, two that meet, or the points that a tracker found itself."""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from workbench.api import TO_SD, Bool, Float, InputError, Int, Recording, Shaped
from workbench.plugins.calibration.values import Rejected

Target = Literal["edge", "plane", "points"]
LEAST_POINTS = 10  # on a line
FAR = 4.0  # standard deviations beyond which a point does not belong to its line
ROUNDS = 4  # of leaving such points out
MOST_STRAY = 0.5  # share of a side's points, with more it shows no line
MOST_CORRELATION = 0.9  # of neighbours
STRAIGHT = 1e-3  # of a line's length, its residuals' rms at most
MOST_LINES = 8  # columns of a recording in which each is a point of its own


class Marks(NamedTuple):
    """k frames: Q points each, with their covariance. A line is told by two points, one standard deviation apart."""

    frame: Shaped[Int, " k"]
    point_mm: Shaped[Float, "k Q 2"]  # x, z
    covariance: Shaped[Float, "k Q 2 2"]
    rejected: tuple[Rejected, ...]


_Line = tuple[Float, Float]  # two points (2, 2) that tell it, their covariance (2, 2, 2)


def marks_of(recording: Recording, target: Target, noise_mm: float, corner_mm: float) -> Marks:
    """What every frame shows of the target; frames that do not show it are rejected with the cause."""
    if target == "points" and recording.x_mm.shape[1] > MOST_LINES:
        said = f"target 'points' is for a tracker's points, a column each, found {recording.x_mm.shape[1]} columns"
        raise InputError(f"{recording.source}: /profiles", said)
    frames, points, covariance, rejected = [], [], [], []
    for frame, (x, z) in enumerate(zip(recording.x_mm, recording.z_mm, strict=True)):
        xz = np.column_stack([x, z]).astype(float)
        seen = np.isfinite(xz).all(axis=1)
        if target == "points":
            if not seen.all():
                rejected.append(Rejected(frame, f"{(~seen).sum()} of its {len(seen)} points are missing"))
                continue
            found, spread = xz, np.tile(noise_mm**2 * np.eye(2), (len(xz), 1, 1))
        else:
            lines = _lines(xz[seen], 2 if target == "edge" else 1, noise_mm, corner_mm)
            if isinstance(lines, str):
                rejected.append(Rejected(frame, lines))
                continue
            found, spread = map(np.concatenate, zip(*lines, strict=True))
        frames.append(frame)
        points.append(found)
        covariance.append(spread)
    return Marks(np.array(frames, int), np.array(points), np.array(covariance), tuple(rejected))


def _lines(xz: Float, count: int, noise_mm: float, corner_mm: float) -> list[_Line] | str:
    """The straight lines, in the order of the columns; or why the profile does not show them."""
    if len(xz) < count * LEAST_POINTS:
        return f"{len(xz)} returns, expected at least {count * LEAST_POINTS}"
    sides = [xz]
    if count == 2:
        at = _corner(xz)
        corner = xz[at]
        sides = [
            side[np.linalg.norm(side - corner, axis=1) > corner_mm] for side in (xz[: at + 1], xz[at + 1 :])
        ]  # the edge may be rounded
    found = [_line(side, noise_mm) for side in sides]
    return next((one for one in found if isinstance(one, str)), [one for one in found if not isinstance(one, str)])


def _corner(xz: Float) -> int:
    """The point before the corner: two lines by least squares along z, each to one side, fit best there."""
    x, z = (xz - xz.mean(axis=0)).T
    one = np.ones_like(x)
    sums = np.cumsum(np.stack([one, x, z, x * x, x * z, z * z], axis=1), axis=0)

    def left_over(s: Float) -> Float:
        n = s[:, 0]
        xx, xz_, zz = s[:, 3] - s[:, 1] ** 2 / n, s[:, 4] - s[:, 1] * s[:, 2] / n, s[:, 5] - s[:, 2] ** 2 / n
        return zz - xz_**2 / np.maximum(xx, 1e-12)

    at = np.arange(LEAST_POINTS - 1, len(xz) - LEAST_POINTS)
    return int(at[(left_over(sums[at]) + left_over(sums[-1] - sums[at])).argmin()])


def _line(xz: Float, noise_mm: float) -> _Line | str:
    """A straight line by total least squares, points far off it left out.

    Its two points lie one standard deviation from its middle; their errors across it are independent, each twice the
    middle's.
    """
    if len(xz) < LEAST_POINTS:
        return f"{len(xz)} points beside the corner, expected at least {LEAST_POINTS}"
    near: Bool = np.ones(len(xz), bool)
    for _ in range(ROUNDS):
        middle = xz[near].mean(axis=0)
        direction = np.linalg.svd(xz[near] - middle, full_matrices=False)[2][0]
        direction = direction * np.sign(direction @ (xz[-1] - xz[0]))
        off = (xz - middle) @ np.array([-direction[1], direction[0]])
        scale = max(noise_mm, TO_SD * np.median(np.abs(off[near])))
        near = np.abs(off) <= FAR * scale
        if near.sum() < max(LEAST_POINTS, MOST_STRAY * len(xz)):
            return "the points beside the corner lie on no straight line"
    along, off = (xz[near] - middle) @ direction, off[near]
    rms = max(noise_mm, np.sqrt(np.mean(off**2)))
    if rms > max(3.0 * noise_mm, STRAIGHT * np.ptp(along)):
        return f"no straight line: its points lie {rms:.3f} mm (rms) off, over {np.ptp(along):.1f} mm"
    alike = np.clip((off[1:] @ off[:-1]) / max(off @ off, 1e-30), 0.0, MOST_CORRELATION)
    variance = rms**2 * (1 + alike) / (1 - alike) / len(along)
    normal = np.array([-direction[1], direction[0]])
    ends = middle + np.outer([-1.0, 1.0], along.std() * direction)
    return ends, np.tile(2.0 * variance * np.outer(normal, normal), (2, 1, 1))
