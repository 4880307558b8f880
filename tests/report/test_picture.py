"""What a report computes itself, because loading SciPy for it takes longer than the report may: as SciPy has it."""

from __future__ import annotations

import dataclasses
import tracemalloc

import numpy as np
import pytest
import scipy

from workbench.artefacts import BEVEL_FACE, Cloud
from workbench.report.along import _hermite
from workbench.report.html import pitch_mm
from workbench.report.scene import _widened, overview


@pytest.mark.parametrize("seed", range(4))
def test_curves_through_stations_are_cubic_hermite_splines(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y, slope = np.sort(rng.random(9)) * 9, rng.random((9, 3)), rng.random((9, 3))
    at = np.concatenate([rng.uniform(x[0], x[-1], 200), x])
    expected = scipy.interpolate.CubicHermiteSpline(x, y, slope)(at)
    np.testing.assert_allclose(_hermite(at, x, y, slope), expected, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_gaps_between_points_hide_as_well(seed: int) -> None:
    near = np.random.default_rng(seed).random((31, 47))
    near[near < 0.3] = -np.inf
    np.testing.assert_array_equal(_widened(near, 7), scipy.ndimage.maximum_filter(near, 7))


@pytest.mark.parametrize("count", [2, 3, 70, 450])
def test_the_pitch_is_that_of_nearest_neighbours(count: int) -> None:
    """Up to the sample's size every point is looked at."""
    points = np.random.default_rng(count).random((count, 3)) * [77.0, 9.0, 3.0]
    points[-1] = points[0]  # a point that stands twice
    nearest = scipy.spatial.cKDTree(points).query(points, k=2)[0][:, 1]
    assert pitch_mm(points) == pytest.approx(np.percentile(nearest, 90.0))


def test_a_large_cloud_is_not_copied(part):
    p = part(frames=50, columns=50)
    frames, columns = 200_000, 400  # 0.3 GB an array, were it materialised
    big = Cloud(
        np.broadcast_to(np.linspace(0, 20, columns, dtype=np.float32), (frames, columns)),
        np.broadcast_to(np.float32(200.0), (frames, columns)),
        np.broadcast_to(True, (frames, columns)),
        np.broadcast_to(np.eye(4), (frames, 4, 4)),
        np.broadcast_to(0.0, frames),
        np.broadcast_to(np.int64(0), frames),
    )
    labels = np.broadcast_to(np.uint8(BEVEL_FACE), (frames, columns))
    edge = dataclasses.replace(p.edge, labels=labels)
    tracemalloc.start()
    points = overview(big, edge, 100_000)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 0 < len(points.frame) < 150_000
    assert peak < 100e6
