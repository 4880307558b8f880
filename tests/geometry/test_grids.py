"""The compiled grid kernels against plain numpy in float64."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry import grids, poses
from workbench.units import Float, Float32


def scene(frames: int = 40, columns: int = 77) -> tuple[Float32, Float32, Float]:
    """A grid 80 mm wide at 250 to 330 mm of range with gaps, 5 m from the base, each frame posed at random."""
    rng = np.random.default_rng(5)
    x = rng.uniform(-40, 40, (frames, columns)).astype(np.float32)
    z = rng.uniform(250, 330, (frames, columns)).astype(np.float32)
    x[rng.random(x.shape) < 0.05] = np.nan
    z[rng.random(z.shape) < 0.05] = np.nan
    position = np.array([4000.0, -2500.0, 1700.0]) + rng.uniform(-100, 100, (frames, 3))
    return x, z, poses.pose_from(Rotation.random(frames, random_state=rng).as_matrix(), position)


def exact(x: Float32, z: Float32, base_from_profiler: Float) -> Float:
    local = np.stack([x, np.zeros_like(x), z, np.ones_like(x)], axis=-1).astype(float)
    return np.einsum("nij,nmj->nmi", base_from_profiler, local)[..., :3]


def test_fused_points_err_by_less_than_a_tenth_of_a_micrometre_5_m_from_the_base() -> None:
    x, z, pose = scene()
    origin = np.array([4000.0, -2500.0, 1700.0])
    points = grids.fuse(x, z, pose, origin)
    assert points.dtype == np.float32
    truth = exact(x, z, pose)
    assert np.nanmax(np.abs(points.astype(float) + origin - truth)) < 1e-4
    assert np.nanmax(np.abs(truth.astype(np.float32) - truth)) > 1e-4  # what float32 in base coordinates would cost
    np.testing.assert_array_equal(np.isnan(points), np.isnan(x + z)[..., None].repeat(3, axis=2))


def test_returns_and_census_tell_finite_missing_and_infinite_apart() -> None:
    x, z, _ = scene()
    x[0, :4] = (np.inf, -np.inf, np.nan, -0.0)
    z[0, :4] = (1.0, np.nan, np.inf, 1e-45)
    finite = np.isfinite(x) & np.isfinite(z)
    np.testing.assert_array_equal(grids.returns(x, z), finite)
    assert finite[0, 3]
    x[1, :3] = (100.0, np.nextafter(np.float32(100), np.float32(200)), -3e38)
    finite = np.isfinite(x) & np.isfinite(z)
    beyond = int(sum((np.abs(grid) > 100.0).sum() for grid in (x, z)))
    assert grids.census(x, z, 100.0) == (int(finite.sum()), beyond)
    assert grids.census(x[:0], z[:0], 100.0) == (0, 0)


@pytest.mark.parametrize("seed", range(4))
def test_the_extent_is_that_of_the_returns(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, z = (rng.normal(3.0 * sign, 20.0, (50, 31)).astype(np.float32) for sign in (-1, 1))
    x[rng.random(x.shape) < 0.3], z[rng.random(z.shape) < 0.3] = np.nan, np.nan
    x[3, 4], z[5, 6] = np.inf, -np.inf
    seen = np.isfinite(x) & np.isfinite(z)
    assert grids.extent(x, z) == (float(np.ptp(x[seen])), float(np.abs(z[seen]).max()))
    assert np.isnan(grids.extent(np.full_like(x, np.nan), z)).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_frames_have_one_digest_only_if_they_are_the_same(dtype: type) -> None:
    frames = np.random.default_rng(8).normal(size=(20_000, 5)).astype(dtype)
    frames[7, 2] = np.nan
    frames[11] = frames[3]
    digest = grids.frame_digests(frames)
    assert len(np.unique(digest)) == len(frames) - 1
    assert digest[11] == digest[3]
    np.testing.assert_array_equal(grids.frame_digests(frames[5:9]), digest[5:9])


def test_blind_columns_lie_between_others_that_measure() -> None:
    keep = np.ones((40, 60), bool)
    keep[:, 20:26] = False  # blind
    keep[:, 50:] = False  # beyond it nothing: the end of the part, or of the window
    keep[1:, 40:44] = False  # hardly ever seen, yet no blind ones
    assert grids.blind_columns(keep) == 6
    ends = np.array([19, -26, 18, 49, 39, -44, 0])
    assert grids.columns_to_next(np.where(keep, 1.0, np.nan), ends).tolist() == [7, 7, 1, 1, 1, 1, 1]
    assert grids.widest_blind(keep) == 6
    keep[::4, 19] = False  # a face's end, which moves: a shadow beside it
    assert grids.blind_columns(keep) == 0
    keep[:, 19] = True
    keep &= np.random.default_rng(4).random(keep.shape) > 0.1  # single losses are no end
    assert grids.blind_columns(keep) == 6
    keep[12:, 26] = keep[:, 27:50] = False  # beyond it an end that seldom reaches as far
    assert grids.blind_columns(keep) == 6
    keep[:, 26:50] = False  # more than one grain of dust, and beyond it nothing
    assert grids.blind_columns(keep) == 0
