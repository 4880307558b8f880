"""Poses that come late: told by the turn of the face, in scans that sway, and by nothing else."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.checks.residuals import UNSEEN_S, FaceAlong, Late, late_check, late_of
from workbench.units import DEG, Float

FRAMES = 300
TIME = np.arange(FRAMES) / 100.0
S = 25.0 * TIME


def sway(time_s: Float, phase: float = 0.0) -> Float:
    """Orientations (n, 3, 3) that sway by about a degree, each axis in its own time."""
    return Rotation.from_rotvec(DEG * np.sin(time_s[:, None] / [0.21, 0.16, 0.3] + [phase, 1.0, 2.0])).as_matrix()


def scan(
    offset_s: Float,
    twist: Float | float = 0.0,
    noise_deg: float = 0.03,
    noise_mm: float = 1.0,
    phase: float = 0.0,
) -> tuple[FaceAlong, Float]:
    """A plate along x whose face's direction, and place, the scanner tells by poses that come late; and these."""
    pose = np.tile(np.eye(4), (FRAMES, 1, 1))
    pose[:, :3, :3] = sway(TIME, phase)
    pose[:, 0, 3], pose[:, 2, 3] = S, 150.0
    true, rng = sway(TIME - offset_s, phase), np.random.default_rng(5)
    turned = Rotation.from_matrix(pose[:, :3, :3] @ np.swapaxes(true, 1, 2)).as_rotvec()[:, 0]
    angle = 1.0 + turned + twist + rng.normal(0.0, noise_deg * DEG, FRAMES)
    tangent, normal = (np.tile(one, (FRAMES, 1)) for one in np.eye(3)[:2])
    seen = pose[:, :3, 3] + np.einsum("nij,nkj,nk->ni", pose[:, :3, :3], true, [0.0, 0.0, -150.0] + 0.0 * normal)
    place = np.stack([S, seen[:, 1] + rng.normal(0.0, noise_mm, FRAMES), 0.0 * S], axis=1)
    return FaceAlong(S, angle, tangent, normal, place), pose


def late(
    offset_s: Float, twist: Float | float = 0.0, noise_deg: float = 0.03, noise_mm: float = 1.0, passes: int = 1
) -> Late:
    """What it tells by some passes, in which the scanner sways differently."""
    each = [scan(offset_s, twist, noise_deg, noise_mm, float(k)) for k in range(passes)]
    face = FaceAlong(*(np.concatenate(of) for of in zip(*(one for one, _ in each), strict=True)))
    time_s = np.concatenate([TIME + 10.0 * k for k in range(passes)])
    return late_of(face, np.concatenate([pose for _, pose in each]), time_s, np.repeat(np.arange(passes), FRAMES))


@pytest.mark.parametrize("offset_s", [-0.04, 0.03])
def test_a_lag_is_told_and_refused(offset_s: float) -> None:
    found = late(np.full(FRAMES, offset_s))
    assert np.median(found.offset_s) == pytest.approx(offset_s, abs=0.01)
    assert not late_check(found).passed
    assert np.abs(found.off_s[:, None] * found.flow_mm_s).max() > 0.05  # by the lever


@pytest.mark.parametrize("walk", [np.sin(2.0 * TIME), TIME / 1.5 - 1.0], ids=["to and fro", "rate"])
def test_clocks_that_walk_apart_are_refused(walk: Float) -> None:
    """Though they agree on average."""
    found = late(0.05 * (walk - walk.mean()), noise_deg=0.01)
    assert np.corrcoef(found.offset_s, walk)[0, 1] > 0.8
    assert not late_check(found).passed


def test_a_lag_that_costs_little_is_no_reason_to_refuse() -> None:
    found = late(np.full(FRAMES, 0.004), noise_deg=0.005)
    assert late_check(found).passed
    assert found.offset_s.any()


def test_a_lag_that_the_place_alone_shows_is_in_the_uncertainty() -> None:
    found = late(np.full(FRAMES, 0.03), noise_deg=1.0, noise_mm=0.01)
    assert np.median(found.offset_s) == pytest.approx(0.03, abs=0.005)
    assert late_check(found).passed  # an edge may wave
    assert "would if poses came +3" in late_check(found).finding


def test_what_nothing_tells_is_in_the_uncertainty_and_named() -> None:
    blind = late(np.zeros(FRAMES), noise_deg=10.0, noise_mm=3.0)
    told = late(np.zeros(FRAMES), noise_deg=0.01, noise_mm=0.01)
    assert blind.unsure_s.mean() > 0.8 * UNSEEN_S
    assert told.unsure_s.mean() < 0.2 * UNSEEN_S
    assert "does not show whether the clocks agree" in late_check(blind).finding
    assert "follows the rate" in late_check(told).finding


def test_a_face_that_waves_under_poses_that_hardly_turn_is_no_clock() -> None:
    assert not late(np.zeros(FRAMES), 0.3 * np.sin(TIME / 0.21)).offset_s.any()


@pytest.mark.parametrize("twist", [0.0, 3.0 * DEG * (S / 75.0) ** 2, 2.0 * DEG * np.sin(S / 60.0)])
def test_plates_are_twisted_without_a_lag(twist: Float | float) -> None:
    found = late(np.zeros(FRAMES), twist)
    assert not found.offset_s.any()
    assert late_check(found).value == 0.0
