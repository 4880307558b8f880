"""Points beside the edge: clamps against streaks of outliers, clearance against sampled cutters."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.poses import pose_from, rotation_from_vector
from workbench.geometry.stations import (
    Cuts,
    Scan,
    SectionTable,
    frame_stations,
    needed_heights,
    section_table,
    standing_layers,
    standing_out,
    supported,
)
from workbench.units import Float


def plate(frames: int = 80, columns: int = 60) -> tuple[Float, Float, Float]:
    """A scan from above of a plate's upper surface: x from the edge inwards, z down, a frame every 0.5 mm along y."""
    x = np.tile(np.linspace(0, 12, columns), (frames, 1)).astype(np.float32)
    z = np.full_like(x, 100.0)
    origin = np.stack([np.zeros(frames), 0.5 * np.arange(frames), np.full(frames, 108.0)], axis=1)
    poses = pose_from(np.tile(np.diag([-1.0, 1.0, -1.0]), (frames, 1, 1)), origin)
    return x, z, poses  # base: n = +x, t = +y, m = +z (t = m x n), upper surface at z = 8


def table(count: int = 41) -> SectionTable:
    ones = np.ones((count, 1))
    position = np.stack([np.zeros(count), np.arange(float(count)), np.zeros(count)], axis=1)
    t, n, m = (ones * np.eye(3)[k] for k in (1, 0, 2))
    return section_table(1.0, position, t, n, m, ones * [[0.0, 8.0]], ones * [[-1.0, 0.0]])


@pytest.mark.parametrize(("frames", "found"), [(4, False), (16, True)])
def test_a_clamp_is_found_and_a_streak_of_outliers_is_not(frames: int, found: bool) -> None:
    x, z, poses = plate()
    z[30 : 30 + frames, 10:40] -= 6.0  # 6 mm above the surface
    start = frame_stations(0.5 * np.arange(80.0), np.zeros(80, int), 1.0, 41)
    usable = np.ones(x.shape, bool)
    rows, columns = supported(standing_out(Scan(x, z, poses, start, table()), usable, np.full(41, 3.0)))
    assert bool(rows.size) == found
    if found:
        assert set(rows) == set(range(30, 46))
        assert rows.size == 16 * 30
        assert columns.min() == 10
    rows, _ = supported(standing_out(Scan(x, z, poses, start, table()), usable, np.full(41, 9.0)))
    assert rows.size == 0


@pytest.mark.parametrize("seed", range(3))
def test_the_cutter_is_lifted_over_what_any_point_asks_for(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, z, poses = plate()
    z += rng.choice([-9.0, 0.0, 40.0], (8, 6)).repeat(10, axis=0).repeat(10, axis=1)  # clamps, and a table far below
    turn = rotation_from_vector(np.array([0.0, 0.3, 0.02]) * rng.normal(1.0, 0.3, 3))
    bend = rotation_from_vector(np.linspace(0.0, 0.1, 45)[:, None] * np.array([0.0, 0.0, 1.0]))
    at = np.stack([np.full(45, -4.0), np.arange(-2.0, 43.0), np.full(45, 6.0)], axis=1)
    places, (radius, clearance, tip) = pose_from(bend @ turn @ np.diag([-1.0, 1.0, -1.0]), at), (5.0, 2.0, 3.0)
    start = frame_stations(0.5 * np.arange(80.0), np.zeros(80, int), 1.0, 41)
    marked = np.ones(x.shape, bool)
    found = needed_heights(Scan(x, z, poses, start, table()), marked, at[:, 1], places, (radius, clearance, tip))
    points = poses[:, None, :3, 0] * x[..., None] + poses[:, None, :3, 2] * z[..., None] + poses[:, None, :3, 3]
    seen = np.einsum("npi,nij->npj", points.reshape(1, -1, 3) - at[:, None], places[:, :3, :3])
    beyond = np.maximum(seen[..., 2] - tip, 0.0)
    reach = radius + np.sqrt(np.maximum(clearance**2 - beyond**2, 0.0))
    meets = (beyond < clearance) & (np.abs(seen[..., 1]) < reach)
    rise = -seen[..., 0] - radius + np.sqrt(np.maximum(reach**2 - seen[..., 1] ** 2, 0.0))
    needed = np.where(meets, rise, -np.inf).max(axis=1)
    assert (needed > 0.0).any()
    np.testing.assert_allclose(np.maximum(found, 0.0), np.maximum(needed, 0.0), atol=1e-9)


def test_layers_take_what_lies_above_their_face() -> None:
    x, z, poses = plate()
    z[:, 50:] -= 1.0  # 9 mm above the lower surface
    keep = np.ones(x.shape, bool)
    keep[0, 0] = False
    face = np.tile([4.5, 3.0], (41, 1))  # the bevel at 45 deg, finished face through the lower edge
    face[10:20] = np.inf
    half = np.sqrt(0.5)
    start = frame_stations(np.where(np.arange(80) == 40, np.nan, 0.5 * np.arange(80.0)), np.zeros(80, int), 1.0, 41)
    stands = standing_layers(
        Scan(x, z, poses, start, table()), keep, Cuts(half, half, 0.0, 0.0, face, np.full(41, 99.0))
    )
    height = half * (-x + 108.0 - z)
    true = np.where(height > 4.5, 1, np.where(height > 3.0, 2, np.where(height > 0, 65534, 65535)))
    uncut = (np.rint(0.5 * np.arange(80) + 1e-9) >= 10) & (np.rint(0.5 * np.arange(80) + 1e-9) < 20)
    true[uncut] = np.where(height[uncut] > 0, 65534, 65535)
    true[0, 0] = 0
    sure = np.abs(height - 3.0) > 1e-3
    inner = ~np.isin(0.5 * np.arange(80), [9.5, 19.5])[:, None] & sure  # half way between two stations
    np.testing.assert_array_equal(stands[inner], true[inner])
