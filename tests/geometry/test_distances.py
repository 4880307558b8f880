"""Distances between lines. Those to the stock: tests/path/test_feed.py, against every point."""

from __future__ import annotations

import numpy as np

from workbench.geometry.distances import index_lines, line_distances
from workbench.units import Float


def to_segment(points: Float, start: Float, end: Float) -> Float:
    """Distances of points (n, 3) to a segment, by the book."""
    along = np.clip((points - start) @ (end - start) / ((end - start) @ (end - start)), 0, 1)
    return np.linalg.norm(points - start - along[:, None] * (end - start), axis=1)


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
