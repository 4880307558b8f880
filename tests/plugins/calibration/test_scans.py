"""Scans over the sphere: poses between poses, and the offset of the profiler's clock."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.calibration.faces import TRUE, squared
from bench.drawn.spheres import random_sphere_recipe
from tests.plugins.calibration.conftest import off_design, scan_recording, scans_over
from tests.seldom import seldom
from workbench.api import InputError, estimator, vector_from_rotation
from workbench.plugins.calibration import circles, hand_eye
from workbench.synthetic import simulate_sphere


def calibrated(rec: Any) -> Any:
    return hand_eye(circles(rec), rec)[1]


@pytest.mark.parametrize("rate_hz", [25.0, 1 / 1.6], ids=["dense", "two poses a pass"])
def test_scans_on_the_robots_clock(rate_hz: float) -> None:
    rng = np.random.default_rng(2)
    found = calibrated(
        scan_recording(rng, scans_over(rng, 7), own=False, rate_hz=rate_hz, frames=30, design=off_design(rng))
    )
    assert squared(found.hand_eye) < 22.5
    assert found.time_offset_s is None
    assert found.volume_u_mm < 0.3


@pytest.mark.parametrize("offset_s", [*seldom(-0.15), 1.7e9])
def test_clock_offset(offset_s: float) -> None:
    rng = np.random.default_rng(int(abs(10 * offset_s)) % 900)
    found = calibrated(scan_recording(rng, scans_over(rng, 5), offset_s, frames=15, design=off_design(rng)))
    assert found.time_offset_u_s < 3e-3
    assert abs(found.time_offset_s - offset_s) < 4 * found.time_offset_u_s + 1e-6
    assert squared(found.hand_eye) < 22.5


def test_errors_that_a_scan_has_in_common() -> None:
    """Told by the data, and the uncertainty is that of six scans, not of hundreds of frames; no misfit."""
    rec, truth = simulate_sphere(random_sphere_recipe("sphere_scans_common", 7300011))
    found = calibrated(rec)
    pose, true = found.hand_eye.flange_from_profiler, truth.flange_from_profiler
    off = np.append(true[:3, 3] - pose[:3, 3], vector_from_rotation(true[:3, :3] @ pose[:3, :3].T))
    assert off @ np.linalg.solve(found.covariance, off) < 22.5
    assert found.noise.common > 0.4
    assert found.volume_u_mm > 0.05
    assert not found.warnings


@pytest.mark.slow
@pytest.mark.parametrize(("condition", "seed"), [("sphere_scans", 9102), ("sphere_weaved", 9100)])
def test_errors_new_in_every_pose_are_neither_common_nor_a_misfit(condition: str, seed: int) -> None:
    found = calibrated(simulate_sphere(random_sphere_recipe(condition, seed))[0])
    assert not found.warnings
    if condition == "sphere_weaved":  # a few plain scans cannot tell
        assert found.noise.common < 0.05
        assert found.volume_u_mm < 0.03


def test_weaved_scans() -> None:
    """The flange swings by 8 deg while it scans: rotation to 0.1 deg from three scans, seldom as much as 0.2."""
    rng = np.random.default_rng(4)
    scans = scans_over(rng, 3, weave_deg=8.0)
    for scan in scans:
        scan.seconds = 3.0
    found = calibrated(scan_recording(rng, scans, 0.11, frames=60, rate_hz=100.0, design=off_design(rng)))
    assert squared(found.hand_eye) < 22.5
    assert found.time_offset_s == pytest.approx(0.11, abs=2e-3)
    assert not found.warnings  # errors new in every pose are neither common nor a misfit
    assert found.noise.common < 0.05
    assert found.volume_u_mm < 0.06
    pose = found.hand_eye.flange_from_profiler
    assert np.degrees(np.linalg.norm(vector_from_rotation(TRUE[:3, :3] @ pose[:3, :3].T))) < 0.2


def test_scans_that_move_alike_do_not_tell_the_offset(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is said at the starts: nobody walks the valley in which every answer fits."""
    monkeypatch.setattr(estimator, "sound", None)
    rng = np.random.default_rng(1)
    scans = scans_over(rng, 6)
    for scan in scans:
        scan.start = np.array([scan.start[0], -5.5, scan.start[2]])
        scan.end = scan.start + np.array([1.0, 11.0, 0.5])
    alike = scan_recording(rng, scans, 0.1, frames=30)
    with pytest.raises(InputError, match="all scans move alike"):
        calibrated(alike)


def test_times_that_no_offset_explains() -> None:
    rng = np.random.default_rng(1)
    rec = scan_recording(rng, scans_over(rng, 3), frames=20)
    time = rec.time_s.copy()
    time[rec.pass_index == 1] += 5.0
    broken = type(rec)(**{name: getattr(rec, name) for name in rec.__slots__} | {"time_s": time})
    with pytest.raises(InputError, match="no clock offset puts the frames of all scans within the robot's poses"):
        calibrated(broken)
