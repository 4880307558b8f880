"""The calibration as a whole: accurate, honest about it, and silent about nothing."""

from __future__ import annotations

import dataclasses
import json
import re
import subprocess
import sys
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.calibration import faces
from tests.plugins.calibration.conftest import CENTER, RADIUS, cell, off_design, postures, recording
from workbench.api import InputError, Recording, rotation_from_quaternion, vector_from_rotation
from workbench.plugins.calibration import circles, hand_eye, hand_eye_faces
from workbench.scan import fuse, read_hand_eye

CHECKER = Path(__file__).parents[3].parent / "shared" / "tools" / "check_contract.py"


def made(seed: int, k: int = 9, design: Any = "off", **how: Any) -> tuple[Recording, Any]:
    """A recording of k random postures, and the true sphere centres in the profiler frame."""
    rng = np.random.default_rng(seed)
    turns, centre = postures(rng, k)
    start = off_design(rng) if isinstance(design, str) else design
    return recording(rng, cell(rng, turns, centre), start, **how), centre


def calibrated(seed: int, k: int = 9, **how: Any) -> Any:
    rec, _ = made(seed, k, **how)
    return hand_eye(circles(rec), rec)[1]


@cache
def sound(seed: int, k: int = 9) -> tuple[Recording, Any, Any, Any]:
    """Of `made`: the recording, and what `calibrate.hand_eye` hands on of it."""
    rec, _ = made(seed, k)
    return rec, *hand_eye(circles(rec), rec)


def distance(found: Any) -> float:
    return faces.squared(found.hand_eye)


def moved(rec: Recording, which: Any, by_mm: Any) -> Recording:
    position = rec.robot_position_mm.copy()
    position[which] += by_mm
    return dataclasses.replace(rec, robot_position_mm=position)


def test_errors_are_as_large_as_predicted() -> None:
    """12 recordings, designs off by 20 deg and 50 mm: Mahalanobis distances of six unknowns, and all is well."""
    found = [calibrated(seed) for seed in range(12)]
    assert 3.5 < np.mean([distance(one) for one in found]) < 9.0  # chi-square with 6 degrees of freedom: 6 +- 1
    assert [one.warnings for one in found] == [()] * 12
    assert np.median([one.volume_u_mm for one in found]) < 0.2
    for one in found:
        assert np.linalg.norm(one.sphere_center_mm - CENTER) < 1.0
        assert one.sphere_radius_mm == pytest.approx(RADIUS, abs=0.15)


def test_the_verdict_is_that_of_points_over_the_field() -> None:
    """U of a root face and of a bevel angle, as drawn poses displace and turn them; good enough up to half of each."""
    rec, rng = made(3)[0], np.random.default_rng(0)
    profiles = circles(rec)
    found = hand_eye(profiles, rec)[1]
    off = rng.multivariate_normal(np.zeros(6), found.covariance, 40_000)
    at = found.view.middle_mm + rng.uniform(-1, 1, (len(off), 2)) * found.view.half_mm
    turn = found.hand_eye.flange_from_profiler[:3, :3]
    moved_mm = off[:, :3] + np.cross(off[:, 3:], at[:, :1] * turn[:, 0] + at[:, 1:] * turn[:, 2])
    root, bevel = (2 * np.sqrt(np.linalg.eigvalsh(v.T @ v / len(v))[-1]) for v in (moved_mm, off[:, 3:]))
    root, bevel = root / np.sin(np.radians(40)), np.degrees(bevel)
    said = [float(v) for v in re.findall(r"([\d.]+) (?:mm|deg) of a", found.verdict)]
    assert said == pytest.approx([root, bevel], rel=0.03)

    def good(root_share: float, bevel_share: float) -> bool:
        tolerances = {"root_tolerance_mm": root / root_share, "bevel_tolerance_deg": bevel / bevel_share}
        return hand_eye(profiles, rec, **tolerances)[1].good_enough

    assert [good(0.48, 0.48), good(0.52, 0.48), good(0.48, 0.52)] == [True, False, False]


def test_no_design_is_needed() -> None:
    assert distance(calibrated(3, design=None)) < 22.5  # 99.9 %


def test_background_outliers_and_a_wrong_diameter() -> None:
    rng = np.random.default_rng(5)
    turns, centre = postures(rng, 9)
    sphere = dataclasses.replace(cell(rng, turns, centre), radius=RADIUS + 0.4)
    rec = recording(rng, sphere, off_design(rng), background=True, outliers=0.03)
    found = hand_eye(circles(rec), rec, max_u_mm=2)[1]
    assert found.view.half_mm[0] > 25  # the table fills the field of view
    assert distance(found) < 22.5
    assert found.sphere_radius_mm == pytest.approx(RADIUS + 0.4, abs=0.15)
    assert any(
        "the sphere's diameter is 10." in text and "stated 10.000 mm: set free" in text for text in found.warnings
    )


def test_gross_postures_are_rejected_and_named() -> None:
    rec, _ = made(0, k=15)
    found = hand_eye(circles(rec), moved(rec, [4, 11], [[3.0, -2.0, 1.0], [-1.0, 2.5, 3.0]]))[1]
    assert [one.frame for one in found.frames_rejected] == [4, 11]
    assert found.frames_rejected[0].cause.startswith("gross pose: the sphere is off by ")
    assert found.warnings == ("2 of 15 postures rejected as gross (frames 4, 11)",)
    assert distance(found) < 22.5


def test_a_misfit_is_told_and_widens_the_uncertainty() -> None:
    rec, _ = made(1, k=12)
    bad = moved(rec, slice(None), np.random.default_rng(2).normal(0, 0.4, (12, 3)))
    good, found = hand_eye(circles(rec), rec)[1], hand_eye(circles(bad), bad)[1]
    assert found.warnings[0].startswith("misfit that repeatability cannot explain: chi-square")
    assert found.volume_u_mm > 3 * good.volume_u_mm
    assert distance(found) < 22.5
    with pytest.raises(
        InputError, match=r"the postures do not determine .* residuals ask for pose errors of 0\.\d\d mm"
    ):
        hand_eye(circles(bad), bad, max_u_mm=0.5)  # which the stated noise alone would allow


def test_errors_that_near_postures_share_need_the_correlated_mode() -> None:
    """Position errors that grow with the turn: independent noise takes most of them for hand-eye pose."""
    rec, _ = made(0, k=15)
    rotation = rotation_from_quaternion(rec.robot_quaternion_wxyz)
    turn = vector_from_rotation(rotation[0].T @ rotation)
    bad = moved(rec, slice(None), turn @ np.random.default_rng(500).normal(0, 1.2, (3, 3)))
    profiles = circles(bad)
    assert distance(hand_eye(profiles, bad, max_u_mm=10)[1]) > 22.5
    assert distance(hand_eye(profiles, bad, robot_error="correlated", max_u_mm=10)[1]) < 12.6  # 95 %


@pytest.mark.parametrize(("axis", "factor"), [("x", 0.98), ("z", 1.08)])
def test_a_wrong_scale_is_named_and_taken_out(axis: str, factor: float) -> None:
    rec, _, right, _ = sound(8, 12)
    bad = dataclasses.replace(rec, **{f"{axis}_mm": getattr(rec, f"{axis}_mm") * np.float32(factor)})
    _, found, document = hand_eye(circles(bad), bad)
    assert json.loads(document.content)["sensor_scale"] == list(found.hand_eye.sensor_scale)
    which = "xz".index(axis)
    assert right.hand_eye.sensor_scale == (1.0, 1.0)
    assert found.hand_eye.sensor_scale[1 - which] == 1.0
    assert found.hand_eye.sensor_scale[which] == pytest.approx(factor, abs=3 * found.sensor_scale_u[which])
    assert found.sensor_scale_u[which] < 0.01
    assert any(f"the profiler's {axis} is " in text for text in found.warnings)
    off = found.hand_eye.flange_from_profiler[:3, 3] - right.hand_eye.flange_from_profiler[:3, 3]
    assert np.abs(off).max() < 0.3  # with the scale left in, z is off by 8 % of the sphere's place in the view
    assert found.volume_u_mm < 1.3 * right.volume_u_mm


def test_repeats_are_averaged_not_counted() -> None:
    """Five frames a posture share the posture's pose error: hardly more is known than from one."""
    rec, _ = made(2)
    rows = np.repeat(np.arange(9), 5)
    again = dataclasses.replace(rec, time_s=np.arange(45.0), x_mm=rec.x_mm[rows], z_mm=rec.z_mm[rows], pass_index=rows)
    one, five = (hand_eye(circles(r, limits={"repeated_run": 100.0}), r)[1] for r in (rec, again))
    assert 0.9 * one.volume_u_mm < five.volume_u_mm <= one.volume_u_mm
    assert five.frames[3] == (15, 16, 17, 18, 19)


def test_document_and_what_later_stages_make_of_it(tmp_path: Path) -> None:
    rec, pose, found, document = sound(4)
    rec_two = dataclasses.replace(rec, pass_index=np.zeros(9, int), robot_pass=np.zeros(9, int))
    (tmp_path / "handeye.json").write_bytes(document.content)
    content = json.loads(document.content)
    assert content["frames_used"] == list(range(9))
    assert content["method"] == "bundle"
    assert (content["time_offset_s"], content["warnings"], content["frames_rejected"]) == (None, [], [])
    read = read_hand_eye(tmp_path / "handeye.json")
    np.testing.assert_array_equal(read.flange_from_profiler, pose.flange_from_profiler)
    cloud = fuse(rec_two, hand_eye=tmp_path / "handeye.json")
    np.testing.assert_array_equal(cloud.hand_eye_covariance, found.covariance)


@pytest.mark.skipif(not CHECKER.exists(), reason="the contract's checker is not here")
def test_document_is_as_the_contract_says(tmp_path: Path) -> None:
    for made_by in (sound(4)[3], hand_eye_faces(faces.still(np.random.default_rng(1), 12))[1]):
        (tmp_path / "handeye.json").write_bytes(made_by.content)
        done = subprocess.run([sys.executable, CHECKER, tmp_path], capture_output=True, text=True, check=False)
        assert (done.returncode, done.stdout.strip()) == (0, "1 files as the contract says")
