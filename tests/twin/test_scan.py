"""Scans of raw and milled parts: a raw one is its recipe's own, a milled one looks like the part made analytically."""

from __future__ import annotations

import numpy as np
import pytest

from tests.twin.conftest import CURVES, perfect_path, raw_recipe
from workbench.synthetic import Workpiece, parse_recipe, simulate_recording
from workbench.synthetic.simulate import scan_workpiece
from workbench.twin import mill, scan

NOISE = {"scanner": {"columns": 400, "pitch_mm": 0.05, "noise": {"sd_mm": 0.0}}, "robot": {"hand_eye_error_mm": 0.4}}
FIELDS = ("time_s", "x_mm", "z_mm", "robot_position_mm", "robot_quaternion_wxyz", "flange_from_profiler")


def same(one, other, field):
    return np.array_equal(getattr(one, field), getattr(other, field), equal_nan=True)


def test_a_raw_part_gives_what_its_recipe_gives(recipe):
    recording, expected = scan(Workpiece(recipe)), simulate_recording(recipe)[0]
    assert all(same(recording, expected, field) for field in FIELDS)


@pytest.mark.parametrize("name", CURVES)
def test_a_perfectly_milled_part_looks_like_the_analytic_one(name):
    """Without noise, range by range, within what the path's chords and the cutter's steps leave: 2 micrometres."""
    recipe = raw_recipe(CURVES[name], **NOISE)
    document = recipe.model_dump(mode="json")
    document["part"]["kind"] = "milled"
    analytic, _ = simulate_recording(parse_recipe(document))
    made, _ = mill(Workpiece(recipe), perfect_path(recipe))
    milled, truth = scan_workpiece(made)
    seen = np.isfinite(milled.z_mm) & np.isfinite(analytic.z_mm)
    either = np.isfinite(milled.z_mm) | np.isfinite(analytic.z_mm)
    assert seen.sum() > 0.999 * either.sum()
    difference = np.abs(milled.z_mm.astype(float) - analytic.z_mm)[seen]
    assert np.quantile(difference, 0.999) < 0.002
    assert truth.seen[4:-4].all()


def test_each_milling_draws_new_noise_but_the_hand_eye_error_stays(recipe):
    recipe = raw_recipe(robot={"hand_eye_error_mm": 0.4, "pose_noise_mm": 0.05})
    once, _ = mill(Workpiece(recipe), perfect_path(recipe, heights=(3.0,)))
    twice, _ = mill(once, perfect_path(recipe, heights=(3.0,)))
    recordings = [scan(workpiece) for workpiece in (Workpiece(recipe), once, twice)]
    for one, other in ((0, 1), (1, 2)):
        assert same(recordings[one], recordings[other], "flange_from_profiler")
        assert not same(recordings[one], recordings[other], "robot_position_mm")
        assert np.abs(recordings[one].robot_position_mm - recordings[other].robot_position_mm).max() < 0.5
        assert not same(recordings[one], recordings[other], "z_mm")
    assert same(scan(twice), recordings[2], "z_mm")
