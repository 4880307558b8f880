"""The peers on faces without trouble: what they get wrong elsewhere is the method's doing, not a mistake in it."""

import numpy as np
import pytest

from bench.metrology.information import exact_rays, frame_information, informative
from bench.metrology.others import with_open3d, with_per_profile
from workbench.synthetic import parse_recipe, simulate_recording


def measured(method, sd_mm, oblique_deg=0):
    of = parse_recipe(
        {
            "part": {"length_mm": 12, "root_mm": 2.0, "bevel_deg": 40},
            "scanner": {"columns": 200, "pitch_mm": 0.03, "noise": {"sd_mm": sd_mm}},
            "robot": {"frame_pitch_mm": 0.03},
            "passes": [
                {"from_mm": 1, "to_mm": 11, "elevation_deg": 40, "aim_mm": [-1.0, 2.0], "oblique_deg": oblique_deg}
            ],
        },
        source="test",
    )
    recording, truth = simulate_recording(of)
    rays = exact_rays(of)
    frames = frame_information(of, rays, informative(of, rays, recording), recording.pass_index)
    found = method(recording, truth, rays, frames)
    return np.array(found["root_mm"], dtype=float), np.array(found["bevel_deg"], dtype=float)


@pytest.mark.parametrize(("method", "tolerance_mm"), [(with_per_profile, 0.04), (with_open3d, 0.12)])
def test_all_but_exact_without_noise(method, tolerance_mm):
    """To a column step; but on clean faces the statistical filter takes off the outermost rows, being sparser."""
    root, bevel = measured(method, sd_mm=0.0005)
    assert np.abs(root).max() < tolerance_mm
    assert np.abs(bevel).max() < 0.3
    assert len(root) == len(bevel) >= 7


def test_an_oblique_laser_plane_shows_another_angle():
    """What the simple method cannot know, however quiet the scan."""
    _, bevel = measured(with_per_profile, oblique_deg=12, sd_mm=0.0005)
    assert 0.3 < np.abs(bevel).min() < 3
