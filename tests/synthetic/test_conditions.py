"""Named conditions: each holds what its name says, and parts differ."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.synthetic import CONDITIONS, random_recipe, raycast, simulate_recording
from workbench.synthetic.scan import plan_motion, scan_pass
from workbench.synthetic.truth import build_truth

MANY = range(40)


@pytest.mark.parametrize("condition", CONDITIONS)
def test_parts_lie_within_the_stated_ranges_and_differ(condition):
    recipes = [random_recipe(condition, seed) for seed in MANY]
    assert random_recipe(condition, 3) == recipes[3]
    assert len({recipe.part.bevel_deg.start for recipe in recipes}) == len(recipes)
    for recipe in recipes:
        truth, thickness = build_truth(recipe), recipe.part.thickness_mm
        assert 80 <= recipe.part.length_mm <= 160
        assert truth.root_mm.min() >= 0.8
        assert truth.root_mm.max() <= 3.0
        assert 30 <= truth.bevel_deg.min() <= truth.bevel_deg.max() <= 50
        assert 4.8 < thickness.lowest <= thickness.highest < 12.2
        assert recipe.scanner.noise.sd_mm == (0.036 if condition in ("noisy", "correlated") else 0.012)
        assert recipe.scanner.pitch_mm == (0.1 if condition == "coarse" else 0.05)


def test_paper_lies_inside_the_tolerances_and_limit_near_them():
    for seed in MANY:
        truth = build_truth(random_recipe("paper", seed))
        assert np.abs(truth.root_mm - 1.5).max() < 0.5
        assert np.abs(truth.bevel_deg - 40).max() < 1.0
        truth = build_truth(random_recipe("limit", seed))
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


@pytest.mark.parametrize("seed", range(6))
def test_partial_view_shows_end_face_and_bevel_only(seed):
    recipe = random_recipe("partial_view", seed)
    faces = np.concatenate([block.faces for _, block in scan_pass(recipe, plan_motion(recipe)[0], 0)])
    counts = np.bincount(faces.ravel(), minlength=8)
    assert counts[raycast.ROOT] > 5 * len(faces)
    assert counts[raycast.BEVEL] > 10 * len(faces)
    assert counts[raycast.UPPER] + counts[raycast.LOWER] == 0


@pytest.mark.parametrize("condition", CONDITIONS)
def test_the_edge_is_in_view(condition):
    recording, truth = simulate_recording(random_recipe(condition, 1))
    assert truth.seen.mean() > (0.3 if condition == "clamps" else 0.8)
    assert np.isfinite(recording.z_mm).mean() > 0.05


def test_unknown_condition_names_the_nearest():
    with pytest.raises(InputError, match="did you mean 'oblique'"):
        random_recipe("oblike", 0)
