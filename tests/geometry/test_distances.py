"""Distances to the stock against every point by hand, and against a k-d tree."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.distances import axis_distances, build_stock, index_lines, line_distances
from workbench.geometry.poses import pose_from, rotation_from_vector
from workbench.units import AnyArray, Float, Int


def place(x: Float, z: Float, poses: Float, rows: Int, columns: Int) -> Float:
    """Points (p, 3) of the grid in the base."""
    pose, x, z = poses[rows], x[rows, columns, None], z[rows, columns, None]
    return np.asarray(pose[:, :3, 0] * x + pose[:, :3, 2] * z + pose[:, :3, 3])


def to_segment(points: Float, start: Float, end: Float) -> Float:
    """Distances of points (n, 3) to a segment, by the book."""
    along = np.clip((points - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
    return np.linalg.norm(points - start - along[:, None] * (end - start), axis=1)


def grid(seed: int, frames: int = 90, columns: int = 70) -> tuple[Float, Float, Float, AnyArray]:
    """A rough surface under a wandering scanner, with holes; calibrations are rigid to 1e-6 only."""
    rng = np.random.default_rng(seed)
    x = np.tile(np.linspace(-20, 20, columns), (frames, 1)) + rng.normal(0, 0.1, (frames, columns))
    z = 150 + 4 * np.sin(x / 5) + rng.normal(0, 0.3, x.shape)
    turn = rotation_from_vector(np.cumsum(rng.normal(0, 0.004, (frames, 3)), axis=0) + rng.normal(0, 1, 3))
    place_mm = turn[:, :, 1] * np.arange(frames)[:, None] * 0.5 + [1500, -300, 800]
    stands = rng.integers(0, 5, x.shape).astype(np.uint16)
    stands[rng.random(x.shape) < 0.3] = 65535
    x[stands == 0] = np.nan
    return x.astype(np.float32), z.astype(np.float32), pose_from(turn * (1 + 2e-7), place_mm), stands


def axes_near(points: Float, count: int, rng: np.random.Generator) -> tuple[Float, Float]:
    start = points[rng.integers(0, len(points), count)] + rng.normal(0, 12, (count, 3))
    return start, start + rng.normal(0, 15, (count, 3))


@pytest.mark.parametrize("seed", range(4))
def test_distances_equal_those_to_every_point(seed: int) -> None:
    x, z, poses, stands = grid(seed)
    rng = np.random.default_rng(seed)
    rows, columns = np.nonzero(stands)
    points, until = place(x, z, poses, rows, columns), stands[rows, columns]
    start, end = axes_near(points, 200, rng)
    layer = rng.integers(0, 6, 200)
    found = axis_distances(build_stock(x, z, poses, stands), start, end, layer, np.full(200, np.inf))
    true = [to_segment(points[until > k], a, b).min() for a, b, k in zip(start, end, layer, strict=True)]
    np.testing.assert_allclose(found, true, atol=1e-6)


def test_bound_holds_and_nothing_left_is_infinitely_far() -> None:
    x, z, poses, stands = grid(2)
    start, end = axes_near(place(x, z, poses, *np.nonzero(stands)), 50, np.random.default_rng(0))
    stock = build_stock(x, z, poses, np.minimum(stands, 3))
    free = axis_distances(stock, start, end, np.zeros(50, int), np.full(50, np.inf))
    bounded = axis_distances(stock, start, end, np.zeros(50, int), np.full(50, 5.0))
    np.testing.assert_allclose(bounded, np.minimum(free, 5.0))
    assert np.isinf(axis_distances(stock, start, end, np.full(50, 3), np.full(50, np.inf))).all()


def test_lines_equal_finely_sampled_ones() -> None:
    rng = np.random.default_rng(3)
    a = np.cumsum(rng.normal(0, 1, (100, 3)), axis=0)
    b = a + rng.normal(0, 3, (100, 3))
    b[::10] = a[::10]  # points
    start = a[rng.integers(0, 100, 60)] + rng.normal(0, 5, (60, 3))
    end = start + rng.normal(0, 5, (60, 3))
    end[::7] = start[::7] + 2 * (b[1] - a[1])  # parallel to a line
    index = index_lines(a, b)
    assert index is not None
    fine = np.concatenate([a + f * (b - a) for f in np.linspace(0, 1, 1001)])
    true = np.array([to_segment(fine, p, q).min() for p, q in zip(start, end, strict=True)])
    found = line_distances(index, start, end)
    assert (found <= true + 1e-9).all()
    np.testing.assert_allclose(found, true, atol=0.01)
    assert index_lines(a[:0], b[:0]) is None
