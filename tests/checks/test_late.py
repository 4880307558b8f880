"""Poses that come late: told by the turn of the face, in scans that sway, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.checks.late import Late, late_check, late_of
from workbench.units import DEG, Float

FRAMES = 300
TIME = np.arange(FRAMES) / 100.0
S = 25.0 * TIME


def sway(time_s: Float) -> Float:
    """Orientations (n, 3, 3) that sway by about a degree, each axis in its own time."""
    return Rotation.from_rotvec(DEG * np.sin(time_s[:, None] / [0.21, 0.16, 0.3] + [0.0, 1.0, 2.0])).as_matrix()


def late(offset_s: Float, twist: Float | float = 0.0, noise_deg: float = 0.03) -> Late:
    """Of a plate along x whose face's direction the scanner tells by poses that come late."""
    pose = np.tile(np.eye(4), (FRAMES, 1, 1))
    pose[:, :3, :3] = sway(TIME)
    pose[:, 0, 3], pose[:, 2, 3] = S, 150.0
    true, rng = sway(TIME - offset_s), np.random.default_rng(5)
    turned = Rotation.from_matrix(pose[:, :3, :3] @ np.swapaxes(true, 1, 2)).as_rotvec()[:, 0]
    angle = 1.0 + turned + twist + rng.normal(0.0, noise_deg * DEG, FRAMES)
    tangent, place = np.tile([1.0, 0.0, 0.0], (FRAMES, 1)), np.stack([S, 0.0 * S, 0.0 * S], axis=1)
    return late_of(S, angle, tangent, place, pose, TIME, np.zeros(FRAMES, np.int64))


@pytest.mark.parametrize("offset_s", [-0.04, 0.03])
def test_a_lag_is_told_and_refused(offset_s: float) -> None:
    found = late(np.full(FRAMES, offset_s))
    assert np.median(found.offset_s) == pytest.approx(offset_s, abs=0.01)
    assert not late_check(found).passed
    assert np.abs(found.place_mm[:, 1:]).max() > 0.05  # by the lever


def test_clocks_that_walk_apart_are_refused() -> None:
    found = late(0.05 * np.sin(TIME), noise_deg=0.01)
    assert np.corrcoef(found.offset_s, np.sin(TIME))[0, 1] > 0.8
    assert not late_check(found).passed


def test_a_lag_that_costs_little_is_no_reason_to_refuse() -> None:
    found = late(np.full(FRAMES, 0.004), noise_deg=0.005)
    assert late_check(found).passed
    assert found.turn.any()


def test_a_lag_counts_where_one_that_walks_would_be_of_seconds(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = np.linalg.lstsq
    monkeypatch.setattr(np.linalg, "lstsq", lambda a, b, rcond: (fit(a, b, rcond)[0] + 5.0 * (a.shape[1] > 1),))
    monkeypatch.setattr("workbench.checks.late.SURE_WALK", -np.inf)  # as certain as can be
    assert np.median(late(np.full(FRAMES, 0.03)).offset_s) == pytest.approx(0.03, abs=0.01)


def test_a_face_that_waves_under_poses_that_hardly_turn_is_no_clock() -> None:
    assert not late(np.zeros(FRAMES), 0.3 * np.sin(TIME / 0.21)).turn.any()


@pytest.mark.parametrize("twist", [0.0, 3.0 * DEG * (S / 75.0) ** 2, 2.0 * DEG * np.sin(S / 60.0)])
def test_plates_are_twisted_without_a_lag(twist: Float | float) -> None:
    found = late(np.zeros(FRAMES), twist)
    assert not found.turn.any()
    assert not found.place_mm.any()
    assert late_check(found).value == 0.0
