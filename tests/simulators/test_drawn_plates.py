"""Named conditions: each holds what its name says, and parts and raw edges differ."""

from __future__ import annotations

import numpy as np
import pytest

from bench.drawn.plates import CONDITIONS, RAW_CONDITIONS, random_recipe
from workbench.errors import InputError
from workbench.synthetic import raycast, simulate_recording
from workbench.synthetic.scan import plan_motion, scan_pass
from workbench.synthetic.workpiece import build_truth

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


@pytest.mark.parametrize("condition", [*CONDITIONS, *RAW_CONDITIONS])
def test_the_edge_is_in_view(condition):
    recording, truth = simulate_recording(random_recipe(condition, 1))
    assert truth.seen.mean() > (0.3 if "clamps" in condition else 0.8)
    assert np.isfinite(recording.z_mm).mean() > 0.05


@pytest.mark.parametrize("condition", RAW_CONDITIONS)
def test_raw_edges_lie_within_the_stated_ranges_and_differ(condition):
    recipes = [random_recipe(condition, seed) for seed in MANY]
    assert random_recipe(condition, 3) == recipes[3]
    assert len({recipe.part.length_mm for recipe in recipes}) == len(recipes)
    for recipe in recipes:
        thickness = recipe.part.thickness_mm
        assert recipe.part.kind == "raw"
        assert 80 <= recipe.part.length_mm <= 160
        assert 4.8 < thickness.lowest <= thickness.highest < 12.4
        assert (recipe.scanner.noise.sd_mm, recipe.scanner.pitch_mm) == (0.012, 0.05)
        two_poses = any(scan.motion == "two_poses" for scan in recipe.passes)
        if condition != "raw_robot":
            assert recipe.robot.hand_eye_error_mm == recipe.robot.hand_eye_error_deg == 0
            assert not (two_poses and recipe.robot.pose_noise_mm)
    assert {scan.motion for recipe in recipes for scan in recipe.passes} >= {"stream"}
    assert {recipe.scanner.z_away for recipe in recipes} == {True, False}


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


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("condition", "shown"),
    [("raw_straight", {raycast.UPPER}), ("raw_below", {raycast.LOWER}), ("raw_square", set())],
)
def test_raw_edges_show_the_faces_that_they_should(condition, shown, seed):
    recipe = random_recipe(condition, seed)
    faces = np.concatenate([block.faces for _, block in scan_pass(recipe, plan_motion(recipe)[0], 0)])
    counts = np.bincount(faces.ravel(), minlength=8)
    assert counts[raycast.ROOT] > 10 * len(faces)
    for face in (raycast.UPPER, raycast.LOWER):
        assert (counts[face] > 10 * len(faces)) == (face in shown)


def test_unknown_condition_names_the_nearest():
    with pytest.raises(InputError, match="did you mean 'oblique'"):
        random_recipe("oblike", 0)
