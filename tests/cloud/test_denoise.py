"""`cloud.denoise` on simulated faces: outliers go, corners and steep faces stay, and nothing else changes."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from workbench.artefacts import Cloud
from workbench.cloud import denoise
from workbench.units import Bool, Float

FRAMES, COLUMNS, NOISE_MM = 200, 500, 0.012


def profile() -> Float:
    """Ranges of upper surface, bevel, root face and lower surface in the columns, with corners of 50, 40 and 90 deg."""
    u = np.arange(COLUMNS) * 0.05
    return np.asarray(
        150
        - 0.4 * np.minimum(u, 8)
        + 0.7 * np.clip(u - 8, 0, 8)
        + 2.5 * np.clip(u - 16, 0, 1.5)
        - 0.5 * np.maximum(u - 17.5, 0)
    )


def cloud(z: Float, keep: Bool | None = None) -> Cloud:
    z = z.astype(np.float32)
    kept = np.isfinite(z) if keep is None else keep
    return Cloud(
        x_mm=np.broadcast_to(np.arange(z.shape[1], dtype=np.float32) * 0.05, z.shape),
        z_mm=z,
        keep=kept,
        base_from_profiler=np.tile(np.eye(4), (len(z), 1, 1)),
        time_s=np.arange(len(z)) * 0.01,
        pass_index=np.zeros(len(z), np.int64),
        source="simulated",
        rejected={"earlier": 3},
    )


def clean(rng: np.random.Generator, vibration_mm: float = 0.05) -> Float:
    """Independent range noise, and frames that jump about as the robot vibrates."""
    z = np.tile(profile(), (FRAMES, 1)) + rng.normal(0, vibration_mm, (FRAMES, 1))
    return np.asarray(z + rng.normal(0, NOISE_MM, z.shape))


@pytest.mark.parametrize("missing", [0.0, 0.2])
def test_faces_and_their_corners_stay(missing: float) -> None:
    rng = np.random.default_rng(1)
    z = clean(rng)
    z[rng.random(z.shape) < missing] = np.nan
    made = denoise(cloud(z))
    lost = np.isfinite(z) & ~made.keep
    assert lost.sum() < 1e-3 * np.isfinite(z).sum()
    corners = np.flatnonzero(np.abs(np.diff(profile(), 2)) > 0.01) + 1
    near = np.unique(corners[:, None] + np.arange(-2, 3))
    assert lost[:, near].sum() < 0.01 * np.isfinite(z)[:, near].sum()


@pytest.mark.parametrize("share", [0.005, 0.05])
def test_isolated_outliers_go(share: float) -> None:
    rng = np.random.default_rng(2)
    z = clean(rng)
    wild = rng.random(z.shape) < share
    z[wild] += rng.choice([-1, 1], wild.sum()) * rng.uniform(0.5, 5, wild.sum())
    made = denoise(cloud(z))
    assert (wild & ~made.keep).sum() > 0.9 * wild.sum()
    assert (~wild & ~made.keep).sum() < 2e-3 * wild.size
    assert made.rejected["isolated returns"] + made.rejected["short streaks"] == (~made.keep).sum()


def test_short_streaks_go() -> None:
    """Three columns return from 3 mm nearer, in frames side by side: they support each other, but are no surface."""
    z = clean(np.random.default_rng(3), vibration_mm=0.0)
    z[50:60, 200:203] -= 3
    made = denoise(cloud(z))
    assert not made.keep[50:60, 200:203].any()
    assert made.rejected["short streaks"] >= 30
    assert (~made.keep).sum() < 30 + 1e-3 * z.size


def test_every_third_return_of_a_face_stays() -> None:
    """Each has one neighbour in reach on either side, and the frames beside it jump about."""
    z = clean(np.random.default_rng(6), vibration_mm=1.0)
    z[:, np.arange(COLUMNS) % 3 > 0] = np.nan
    made = denoise(cloud(z))
    assert (np.isfinite(z) & ~made.keep).sum() < 0.03 * np.isfinite(z).sum()  # at corners


def test_what_was_rejected_before_stays_so() -> None:
    z = clean(np.random.default_rng(4))
    keep = np.ones(z.shape, bool)
    keep[100] = keep[:, 250] = False
    made = denoise(cloud(z, keep))
    assert not made.keep[~keep].any()
    assert made.rejected["earlier"] == 3


def test_a_smaller_tolerance_rejects_more_and_positions_stay() -> None:
    given = cloud(clean(np.random.default_rng(5)))
    counts = [int((~denoise(given, tolerance_mm=value).keep).sum()) for value in (0.02, 0.05, 0.5)]
    assert counts[0] > counts[1] > counts[2]
    made = denoise(given)
    for name in {field.name for field in dataclasses.fields(Cloud)} - {"keep", "rejected"}:
        assert getattr(made, name) is getattr(given, name)


def test_frames_without_a_return() -> None:
    made = denoise(cloud(np.full((4, 30), np.nan)))
    assert not made.keep.any()
    assert made.rejected["isolated returns"] == made.rejected["short streaks"] == 0
