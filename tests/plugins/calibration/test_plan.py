"""Planned postures: within their limits, worth what is predicted, and better than random ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from workbench.api import DEG, InputError, inverse, vector_from_rotation
from workbench.plugins.calibration import circles, hand_eye, plan
from workbench.synthetic import parse_sphere_recipe, simulate_sphere

CELL = Path(__file__).parents[3] / "data" / "robot" / "cell.json"
PASSES = [
    {"sphere_mm": [-8, 2, -9], "turn_deg": [20, 3, -7]},
    {"sphere_mm": [7, -3, 8], "turn_deg": [-15, 12, 5]},
    {"sphere_mm": [3, 3, -4], "turn_deg": [4, -22, 10]},
    {"sphere_mm": [-6, -2, 12], "turn_deg": [-19, -8, -12]},
    {"sphere_mm": [1, 4, 2], "turn_deg": [9, 17, 16]},
    {"sphere_mm": [9, -4, -10], "turn_deg": [13, -14, -18]},
]


@pytest.fixture(scope="module")
def made():
    recipe = parse_sphere_recipe({"format": "sphere-recipe", "seed": 4, "passes": PASSES})
    recording, truth = simulate_sphere(recipe)
    profiles = circles(recording)
    return profiles, recording, hand_eye(profiles, recording)[1], truth


def test_postures_lie_within_the_limits(made):
    profiles, recording, found, _ = made
    proposed, _ = plan(
        found, profiles, recording, postures=6, cone_deg=12, roll_deg=5, half_width_mm=4, half_height_mm=6
    )
    off = np.abs(proposed.centre_mm[:, ::2] - proposed.middle_mm)
    assert (off <= np.array([4, 6]) + 1e-9).all()
    hand_eye_pose = found.hand_eye.flange_from_profiler
    axes = (proposed.base_from_flange @ hand_eye_pose)[:, :3, 2]
    recorded = np.array([p[:3, :3] for p in made[3].base_from_flange])
    U, _, V = np.linalg.svd(recorded.sum(axis=0))
    mean = U @ V @ hand_eye_pose[:3, :3]
    assert np.degrees(np.arccos(axes @ mean[:, 2])).max() < 12.1
    # the sphere's centre comes to lie where the table says, by the true geometry within the calibration's error
    there = inverse(proposed.base_from_flange @ made[3].flange_from_profiler) @ np.array([1890.33, 241.48, 1079.72, 1])
    assert there[:, :3] == pytest.approx(proposed.centre_mm, abs=1.0)


def test_going_there_makes_the_calibration_as_good_as_predicted(made):
    """The planned postures are simulated, added to the recording, and the whole is calibrated anew."""
    profiles, recording, found, _ = made
    proposed, _ = plan(found, profiles, recording, postures=4)
    first = parse_sphere_recipe({"format": "sphere-recipe", "passes": [{"sphere_mm": [0, 0, 0]}]})
    nominal = simulate_sphere(first)[1].base_from_flange[0, :3, :3]
    more = []
    for pose, centre in zip(proposed.base_from_flange, proposed.centre_mm, strict=True):
        turn = vector_from_rotation(nominal.T @ pose[:3, :3]) / DEG
        more.append({"sphere_mm": (centre - [0, 0, 150]).tolist(), "turn_deg": turn.tolist()})
    again, _ = simulate_sphere(parse_sphere_recipe({"format": "sphere-recipe", "seed": 4, "passes": PASSES + more}))
    better = hand_eye(circles(again), again)[1]
    assert better.volume_u_mm == pytest.approx(proposed.volume_u_mm[-1], rel=0.12)
    assert proposed.volume_u_mm[-1] < 0.8 * proposed.volume_u_mm[0]
    assert (np.diff(proposed.volume_u_mm) < 0).all()


def test_the_robot_must_reach_the_postures(made):
    profiles, recording, found, _ = made
    proposed, _ = plan(found, profiles, recording, cell=CELL)
    from workbench.api import inverse_kinematics, read_cell, within_limits

    chain = read_cell(CELL).chain
    joints = within_limits(chain, inverse_kinematics(chain, proposed.base_from_flange))
    assert np.isfinite(joints).all(axis=-1).any(axis=-1).all()


def test_a_sphere_out_of_reach_is_refused(made):
    profiles, _, _, _ = made
    far = parse_sphere_recipe(
        {"format": "sphere-recipe", "seed": 4, "passes": PASSES, "sphere": {"center_mm": [9000, 0, 1000]}}
    )
    recording, _ = simulate_sphere(far)
    found = hand_eye(circles(recording), recording)[1]
    with pytest.raises(InputError, match=r"reaches 0 of .* postures"):
        plan(found, profiles, recording, cell=CELL)
