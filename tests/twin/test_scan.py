"""Scans of raw and milled parts: a raw one is its recipe's own, a milled one looks like the part made analytically."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from tests.seldom import seldom
from tests.twin.conftest import CURVES, SCAN, perfect_path, raw_recipe
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import Workpiece, milled_truth, parse_recipe, simulate_recording
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


def test_passes_can_aim_elsewhere():
    """From below, the bevel is out of sight: the same robot looks from above."""
    recipe = raw_recipe(passes=[SCAN | {"elevation_deg": -50.0, "aim_mm": [-2.0, 2.0]}])
    made, _ = mill(Workpiece(recipe), perfect_path(recipe))
    assert not scan_workpiece(made)[1].seen.any()
    recording = scan(made, elevation_deg=40.0, aim_mm=(-2.0, 4.0))
    expected = scan(dataclasses.replace(made, recipe=raw_recipe()))
    assert same(recording, expected, "z_mm")


@pytest.mark.parametrize(
    ("part", "errors"),
    [
        (CURVES["leaning"], {"offset_mm": (0.2, 0.3, -0.2), "rotation_deg": (0.3, 0.2, 0.1)}),
        *seldom(({}, {}), (CURVES["concave"], {"wear_mm": 0.1})),
        (CURVES["wavy"], {"robot_noise_mm": 0.1, "robot_noise_length_mm": 60.0}),
    ],
)
def test_the_inspection_finds_what_was_milled(part, errors):
    """Each section within two standard uncertainties of its own truth, but for one of nine."""
    passes = [SCAN | {"to_mm": 89}]
    recipe = raw_recipe(part | {"length_mm": 90}, passes=passes, scanner={"columns": 600})
    made, _ = mill(Workpiece(recipe), perfect_path(recipe), **errors)
    inspection = sections(segment(denoise(fuse(scan(made)))))
    truth, found = milled_truth(made), inspection.sections
    places = np.array([section.origin_mm for section in found])
    root = np.array([(s.root_mm, s.root_u_mm) for s in found], float).T
    bevel = np.array([(s.bevel_deg, s.bevel_u_deg) for s in found], float).T
    assert np.sum(np.abs(root[0] - truth.root_mm_at(places)) > 2 * root[1]) <= 1
    assert np.sum(np.abs(bevel[0] - truth.bevel_deg_at(places)) > 2 * bevel[1]) <= 1
    assert np.abs(root[0] - truth.root_mm_at(places)).max() < 0.05
    assert np.abs(bevel[0] - truth.bevel_deg_at(places)).max() < 0.1
