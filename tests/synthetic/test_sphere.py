"""Synthetic calibration recordings: points lie on the sphere that the truth names, poses err as the recipe says."""

from __future__ import annotations

import json

import numpy as np
import pytest

from bench.drawn.spheres import SOUND, random_sphere_recipe
from workbench.api import inverse, rotation_from_quaternion, vector_from_rotation
from workbench.cli import main
from workbench.errors import InputError
from workbench.scan import read
from workbench.synthetic import parse_sphere_recipe, read_any_recipe, simulate_sphere

QUIET = {"noise": {"sd_mm": 0.0}, "columns": 600}
EXACT = {"pose_noise_mm": 0.0, "pose_noise_deg": 0.0}
PASSES = [{"sphere_mm": [-6, 2, -8], "turn_deg": [20, 0, 5]}, {"sphere_mm": [5, -3, 9], "turn_deg": [-15, 12, -4]}]


def recipe(**more):
    return parse_sphere_recipe({"format": "sphere-recipe", "scanner": QUIET, "robot": EXACT, "passes": PASSES} | more)


def in_base(recording, frame, hand_eye):
    """Points of a frame in the base, by the recorded pose of its pass."""
    k = int(np.flatnonzero(recording.robot_pass == recording.pass_index[frame])[0])
    x, z = recording.x_mm[frame].astype(float), recording.z_mm[frame].astype(float)
    here = np.isfinite(z)
    flange = np.column_stack([x, np.zeros_like(x), z])[here] @ hand_eye[:3, :3].T + hand_eye[:3, 3]
    turn = rotation_from_quaternion(recording.robot_quaternion_wxyz[k])
    return flange @ turn.T + recording.robot_position_mm[k]


@pytest.mark.parametrize("z_away", [True, False])
@pytest.mark.parametrize("sampling", ["lateral", "angular"])
def test_points_lie_on_the_sphere(z_away, sampling):
    made = recipe(scanner=QUIET | {"z_away": z_away, "sampling": sampling, "zero_range_mm": 150, "x_offset_mm": 3})
    recording, truth = simulate_sphere(made)
    for frame in range(2):
        points = in_base(recording, frame, truth.flange_from_profiler)
        distance = np.linalg.norm(points - made.sphere.center_mm, axis=1)
        assert len(points) > 60
        assert distance == pytest.approx(5.0, abs=1e-4)  # float32 in the profiler frame


def test_the_sphere_is_where_the_recipe_says():
    """The view: x lateral, range from the stand-off, away from the sensor; its near side is what returns."""
    made = recipe()
    recording, truth = simulate_sphere(made)
    assert truth.centre_mm == pytest.approx(np.array([[-6, 2, 142], [5, -3, 159]]), abs=1e-9)
    radius = np.sqrt(25 - 4)
    assert np.nanmin(recording.z_mm[0]) == pytest.approx(142 - radius, abs=1e-3)
    turned = inverse(truth.base_from_flange[:1]) @ truth.base_from_flange
    assert np.linalg.norm(vector_from_rotation(turned[1, :3, :3])) > np.radians(20)


def test_table_and_stem_stand_behind():
    made = recipe(sphere={"table_gap_mm": 10, "stem_diameter_mm": 4, "table_tilt_deg": [5, 60]})
    recording, truth = simulate_sphere(made)
    points = in_base(recording, 0, truth.flange_from_profiler)
    off = points - made.sphere.center_mm
    on_sphere = np.abs(np.linalg.norm(off, axis=1) - 5) < 1e-3
    table = off[np.linalg.norm(off, axis=1) > 16]
    assert on_sphere.sum() > 60
    assert len(table) > 100
    again, other_truth = simulate_sphere(made)
    other = in_base(again, 1, other_truth.flange_from_profiler) - made.sphere.center_mm
    both = np.concatenate([table, other[np.linalg.norm(other, axis=1) > 16]])
    normal = np.linalg.svd(both - both.mean(axis=0))[2][2]
    assert np.abs(both @ normal) == pytest.approx(15.0, abs=1e-3)  # one plane of the base, 10 mm below the sphere
    stem = off[~on_sphere & (np.linalg.norm(off, axis=1) <= 14)]
    across = np.linalg.norm(stem - np.outer(stem @ normal, normal), axis=1)
    assert len(stem) > 5
    assert across == pytest.approx(2.0, abs=1e-3)


def test_clock_runs_ahead_by_its_offset():
    scan = [{"sphere_mm": [0, -5.5, 0], "to_mm": [0, 5.5, 0], "seconds": 2}]
    made = recipe(robot=EXACT | {"clock": "own", "clock_offset_s": 0.4}, passes=scan)
    recording, truth = simulate_sphere(made)
    middle = int(np.argmax(np.isfinite(recording.z_mm).sum(axis=1)))  # the plane cuts the sphere in its largest circle
    at = recording.time_s[middle] - 0.4
    position = [np.interp(at, recording.robot_time_s, column) for column in recording.robot_position_mm.T]
    assert position == pytest.approx(truth.base_from_flange[middle, :3, 3], abs=1e-6)
    assert abs(truth.centre_mm[middle, 1]) < 0.35  # a column less does not show


def test_file_is_read_as_a_calibration_recording(tmp_path, capsys):
    path = tmp_path / "ball.json"
    document = {
        "format": "sphere-recipe",
        "robot": {"clock": "own"},
        "passes": [PASSES[0] | {"repeats": 3}, PASSES[1]],
        "sphere": {"stated_diameter_mm": 10.1},
    }
    path.write_text(json.dumps(document))
    assert main(["simulate", str(path), "--out", str(tmp_path / "ball.h5")]) == 0
    found = read(recording=tmp_path / "ball.h5")
    assert (found.sphere_diameter_mm, found.clock, len(found.time_s)) == (10.1, "own", 4)
    recording, _ = simulate_sphere(read_any_recipe(path))
    assert np.array_equal(found.z_mm, recording.z_mm, equal_nan=True)
    truth = json.loads((tmp_path / "ball.truth.json").read_text())
    assert truth["sphere_diameter_mm"] == 10.0
    assert truth["time_offset_s"] == 0.0


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"sphere": {"diameter": 3}}, "did you mean 'diameter_mm'"),
        ({"robot": {"clock_offset_s": 1}}, "needs clock 'own'"),
        ({"passes": []}, "passes"),
        ({"format": "bevel-recipe"}, "sphere-recipe"),
    ],
)
def test_bad_recipes_are_refused(change, words):
    with pytest.raises(InputError, match=words):
        recipe(**change)


@pytest.mark.parametrize("condition", [*SOUND][::4])
def test_conditions_show_the_sphere_in_every_pass(condition):
    made = random_sphere_recipe(condition, 3)
    assert made == random_sphere_recipe(condition, 3) != random_sphere_recipe(condition, 4)
    recording, _ = simulate_sphere(made)
    returns = np.isfinite(recording.z_mm).sum(axis=1)
    assert all(returns[recording.pass_index == number].max() > 40 for number in set(recording.pass_index.tolist()))
