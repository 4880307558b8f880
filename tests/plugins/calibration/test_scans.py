"""Scans over the sphere: poses between poses, and the offset of the profiler's clock."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from bench.drawn.spheres import random_sphere_recipe
from tests.plugins.calibration.conftest import drawn
from tests.seldom import seldom
from workbench.api import Float, InputError, vector_from_rotation
from workbench.plugins.calibration import circles, hand_eye


def calibrated(rec: Any) -> Any:
    return hand_eye(circles(rec), rec)[1]


def off(found: Any, truth: Any) -> Float:
    """Truth less answer (6,): translation mm, rotation vector rad."""
    pose, true = found.hand_eye.flange_from_profiler, truth.flange_from_profiler
    return np.append(true[:3, 3] - pose[:3, 3], vector_from_rotation(true[:3, :3] @ pose[:3, :3].T))


def squared(found: Any, truth: Any) -> float:
    """Of the error by its covariance: chi-square of six."""
    return float(off(found, truth) @ np.linalg.solve(found.covariance, off(found, truth)))


@pytest.mark.parametrize("rate_hz", [25.0, 1 / 1.6], ids=["dense", "two poses a pass"])
def test_scans_on_the_robots_clock(rate_hz: float) -> None:
    robot = {"clock": "robot", "clock_offset_s": 0.0, "pose_rate_hz": rate_hz, "frame_rate_hz": 8.0}
    rec, truth = drawn("sphere_scans", 2, robot=robot)
    found = calibrated(rec)
    assert squared(found, truth) < 22.5
    assert found.time_offset_s is None
    assert found.volume_u_mm < 0.3


@pytest.mark.parametrize("offset_s", [*seldom(-0.15), 1.7e9])
def test_clock_offset(offset_s: float) -> None:
    rec, truth = drawn("sphere_scans", 1, robot={"clock_offset_s": 0.0, "frame_rate_hz": 6.0})
    found = calibrated(replace(rec, time_s=rec.time_s + offset_s))
    assert found.time_offset_u_s < 3e-3
    assert abs(found.time_offset_s - offset_s) < 4 * found.time_offset_u_s + 1e-6
    assert squared(found, truth) < 22.5


def test_errors_that_a_scan_has_in_common() -> None:
    """Told by the data, and the uncertainty is that of six scans, not of hundreds of frames; no misfit."""
    rec, truth = drawn("sphere_scans_common", 7300011, robot={"frame_rate_hz": 8.0})
    found = calibrated(rec)
    assert squared(found, truth) < 22.5
    assert found.noise.common > 0.4
    assert found.volume_u_mm > 0.05
    assert not found.warnings


@pytest.mark.slow
@pytest.mark.parametrize(("condition", "seed"), [("sphere_scans", 9102), ("sphere_weaved", 9100)])
def test_errors_new_in_every_pose_are_neither_common_nor_a_misfit(condition: str, seed: int) -> None:
    found = calibrated(drawn(condition, seed)[0])
    assert not found.warnings
    if condition == "sphere_weaved":  # a few plain scans cannot tell
        assert found.noise.common < 0.05
        assert found.volume_u_mm < 0.03


def test_weaved_scans() -> None:
    """The flange swings by 8 deg while it scans: rotation to 0.1 deg from three scans, seldom as much as 0.2."""
    passes = random_sphere_recipe("sphere_weaved", 4).model_dump(mode="json")["passes"][:3]
    passes = [one | {"weave_deg": 8.0, "seconds": 3.0} for one in passes]
    rec, truth = drawn("sphere_weaved", 4, passes=passes, robot={"clock_offset_s": 0.11, "pose_rate_hz": 100.0})
    found = calibrated(rec)
    assert squared(found, truth) < 22.5
    assert found.time_offset_s == pytest.approx(0.11, abs=2e-3)
    assert not found.warnings  # errors new in every pose are neither common nor a misfit
    assert found.noise.common < 0.05
    assert found.volume_u_mm < 0.06
    assert np.degrees(np.linalg.norm(off(found, truth)[3:])) < 0.2


@pytest.mark.slow
def test_scans_that_move_alike_do_not_tell_the_offset() -> None:
    passes = random_sphere_recipe("sphere_scans", 1).model_dump(mode="json")["passes"]
    for one in passes:
        x, _, z = one["sphere_mm"]
        one |= {"sphere_mm": (x, -5.5, z), "to_mm": (x + 1.0, 5.5, z + 0.5)}
    with pytest.raises(InputError, match="all scans move alike"):
        calibrated(drawn("sphere_scans", 1, passes=passes, robot={"frame_rate_hz": 6.0})[0])


def test_times_that_no_offset_explains() -> None:
    rec, _ = drawn("sphere_scans", 1, robot={"frame_rate_hz": 20.0})
    broken = replace(rec, time_s=rec.time_s + 5.0 * (rec.pass_index == 1))
    with pytest.raises(InputError, match="no clock offset puts the frames of all scans within the robot's poses"):
        calibrated(broken)
