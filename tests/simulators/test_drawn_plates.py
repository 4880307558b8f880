"""Named conditions: each holds what its name says, and parts and raw edges differ."""

from __future__ import annotations

import numpy as np
import pytest

from bench.drawn.plates import CONDITIONS, RAW_CONDITIONS, random_recipe
from workbench.errors import InputError
from workbench.synthetic import Workpiece, milled_truth, simulate_recording

MANY = range(40)


def test_paper_lies_inside_the_tolerances_and_limit_near_them():
    for seed in MANY:
        truth = milled_truth(Workpiece(random_recipe("paper", seed)))
        assert np.abs(truth.root_mm - 1.5).max() < 0.5
        assert np.abs(truth.bevel_deg - 40).max() < 1.0
        truth = milled_truth(Workpiece(random_recipe("limit", seed)))
        root, bevel = np.abs(truth.root_mm.mean() - 1.5), np.abs(truth.bevel_deg.mean() - 40)
        assert abs(root - 0.5) < 0.04 or abs(bevel - 1.0) < 0.2


def test_oblique_reversed_and_clamps_are_what_they_say():
    for seed in MANY:
        assert 8 <= abs(random_recipe("oblique", seed).passes[0].oblique_deg) <= 15
        scanner = random_recipe("reversed", seed).scanner
        assert not scanner.x_rises
        assert not scanner.z_away
        assert 1 <= len(random_recipe("clamps", seed).part.clamps) <= 3
        assert len(random_recipe("two_pass", seed).passes) == 2
        assert 300 <= random_recipe("arc", seed).part.curve.radius_mm <= 3000


@pytest.mark.parametrize("condition", [*CONDITIONS, *RAW_CONDITIONS])
def test_the_edge_is_in_view(condition):
    """In frames farther apart than drawn: a fifth of them tells it."""
    recipe = random_recipe(condition, 1)
    coarse = recipe.robot.model_copy(update={"frame_pitch_mm": 5 * recipe.robot.frame_pitch_mm})
    recording, truth = simulate_recording(recipe.model_copy(update={"robot": coarse}))
    assert truth.seen.mean() > (0.3 if "clamps" in condition else 0.8)
    assert np.isfinite(recording.z_mm).mean() > 0.05


def test_raw_conditions_are_what_they_say():
    bends = set()
    for seed in MANY:
        curve = random_recipe("raw_arc", seed).part.curve
        assert 300 <= curve.radius_mm <= 3000
        bends.add(curve.sense)
        assert 1.5 <= random_recipe("raw_wavy", seed).part.curve.amplitude_mm <= 3
        drift = random_recipe("raw_drift", seed).part.thickness_mm
        assert abs(drift.end - drift.start) / (drift.end + drift.start) * 2 == pytest.approx(0.05)
        assert random_recipe("raw_rough", seed).part.roughness_mm == 0.3
        assert 1 <= len(random_recipe("raw_burrs", seed).part.burrs) <= 4
        assert -70 <= random_recipe("raw_below", seed).passes[0].elevation_deg <= -20
        above, below = random_recipe("raw_two_pass", seed).passes
        assert above.elevation_deg > 0 > below.elevation_deg
    assert bends == {"convex", "concave"}


def test_unknown_condition_names_the_nearest():
    with pytest.raises(InputError, match="did you mean 'oblique'"):
        random_recipe("oblike", 0)
