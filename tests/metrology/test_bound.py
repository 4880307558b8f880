"""The bound against cases whose answer is known, and against brute force."""

import math

import numpy as np
import pytest

from bench.metrology.bound import bounds_at, posterior_sd
from bench.metrology.information import COUNT, exact_rays, frame_information, informative
from workbench.synthetic import parse_recipe, simulate_recording
from workbench.units import DEG


def test_plain_measures_give_the_cramer_rao_bound():
    sigma = np.array([0.01, 0.02, 0.02, 0.05])
    expected = (1 / sigma**2).sum() ** -0.5
    assert posterior_sd(np.zeros(4), np.zeros(4), sigma) == pytest.approx(expected, rel=1e-3)


def test_frames_of_one_phase_know_no_more_than_the_column_step():
    low, step = np.full(200, -0.02), np.full(200, 0.05)
    assert posterior_sd(low, step, np.full(200, 1e-5)) == pytest.approx(0.05 / 12**0.5, rel=0.02)


def test_frames_of_many_phases_know_far_more():
    n, step, sigma = 400, 0.05, 0.005
    low = -step * (np.arange(n) + 0.5) / n
    fisher = 0.7979 * 2 / (step * sigma)  # of one frame; 2 phi(0) / Phi(0) from the two limits
    found = posterior_sd(low, np.full(n, step), np.full(n, sigma))
    assert found == pytest.approx((n * fisher) ** -0.5, rel=0.03)


def recipe(**changes):
    document = {
        "seed": 1,
        "part": {"length_mm": 24, "root_mm": 2.0, "bevel_deg": 40},
        "scanner": {"columns": 300, "pitch_mm": 0.05, "noise": {"sd_mm": 0.012, "grazing_power": 0}},
        "robot": {"frame_pitch_mm": 0.5},
        "passes": [{"from_mm": 1, "to_mm": 23, "elevation_deg": 45, "skew_mm": [-0.6, 0.7]}],
    }
    return parse_recipe(document | changes, source="test")


def information(of):
    recording, _ = simulate_recording(of)
    rays = exact_rays(of)
    return frame_information(of, rays, informative(of, rays, recording), recording.pass_index), rays, recording


def test_bevel_bound_is_the_scatter_of_straight_lines_through_the_faces():
    """Angles of many noisy scans, each from least squares within frames, scatter as the bound says."""
    of = recipe()
    frames, rays, _ = information(of)
    bound = bounds_at(of, frames, np.array([12.0])).bevel_deg[0]
    rng = np.random.default_rng(0)
    near = np.abs(frames.bevel[:, 4] - 12.0) <= 10.0
    angles = [
        (direction(rays, 2, near, noise) - direction(rays, 1, near | True, noise)) / DEG
        for noise in (rng.normal(0, 0.012, rays.z_mm.shape) for _ in range(300))
    ]
    assert np.std(angles) == pytest.approx(bound, rel=0.1)


def direction(rays, face, frames, noise):
    """Direction of a face in the section plane (the laser plane here): common slope, each frame with its own offset."""
    mine = (rays.faces == face) & frames[:, None]
    x = np.where(mine, rays.x_mm, np.nan)
    z = np.where(mine, rays.z_mm + noise, np.nan)
    dx, dz = (v[frames] - np.nanmean(v[frames], axis=1, keepdims=True) for v in (x, z))
    return math.atan(np.nansum(dx * dz) / np.nansum(dx * dx))


def test_bound_falls_with_noise_and_with_points():
    of = recipe()
    frames, _, _ = information(of)
    once = bounds_at(of, frames, np.array([12.0]))
    quiet = recipe(scanner={"columns": 300, "pitch_mm": 0.05, "noise": {"sd_mm": 0.006, "grazing_power": 0}})
    dense = recipe(robot={"frame_pitch_mm": 0.125})
    for other in (quiet, dense):
        frames, _, _ = information(other)
        better = bounds_at(other, frames, np.array([12.0]))
        assert better.bevel_deg[0] == pytest.approx(once.bevel_deg[0] / 2, rel=0.05)
        assert better.root_mm[0] < once.root_mm[0]


def test_correlated_noise_tells_less():
    of = recipe()
    noise = {"sd_mm": 0.012, "grazing_power": 0, "correlation_columns": 5}
    alike = recipe(scanner={"columns": 300, "pitch_mm": 0.05, "noise": noise})
    white, correlated = (bounds_at(r, information(r)[0], np.array([12.0])) for r in (of, alike))
    ratio = correlated.bevel_deg[0] / white.bevel_deg[0]
    keep = math.exp(-1 / 5)
    assert 1.5 < ratio < math.sqrt((1 + keep) / (1 - keep))  # the long-run factor, not reached on a short face


def test_lost_returns_do_not_count():
    _, rays, _ = information(of := recipe())
    lost = recipe(disturbances={"dropout_share": 0.5})
    recording, _ = simulate_recording(lost)
    half = frame_information(lost, rays, informative(lost, rays, recording), recording.pass_index)
    whole, _, _ = information(of)
    assert half.bevel[:, COUNT].sum() == pytest.approx(whole.bevel[:, COUNT].sum() / 2, rel=0.05)
