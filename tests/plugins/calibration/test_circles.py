"""The sphere's circle in a profile: unbiased, with an honest covariance, whatever else is in view."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

from tests.plugins.calibration.conftest import RADIUS, Cell, cell, postures, recording
from workbench.api import InputError, Recording
from workbench.plugins.calibration import circles


def frames_at(rng: np.random.Generator, centre: Any, **how: Any) -> Recording:
    """A recording of one frame a sphere centre (k, 3) in the profiler frame."""
    turns, _ = postures(rng, len(centre))
    return recording(rng, cell(rng, turns, np.asarray(centre, float)), **how)


def truth(centre: Any) -> Any:
    centre = np.asarray(centre, float)
    return np.column_stack([centre[:, 0], centre[:, 2], RADIUS**2 - centre[:, 1] ** 2])


@pytest.mark.parametrize("how", [{}, {"background": True, "outliers": 0.03}, {"sense": 1}, {"noise_mm": 0.06}], ids=str)
def test_errors_are_as_large_as_the_covariance_says(rng: np.random.Generator, how: Any) -> None:
    _, centre = postures(rng, 60)
    found = circles(frames_at(rng, centre, **how))
    assert len(found.frame) == 60
    error = found.circle - truth(centre)
    squared = np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.covariance), error)
    assert 2.4 < squared.mean() < 3.6  # chi-square with 3 degrees of freedom, 60 times: 3 +- 0.3
    score = error / np.sqrt(np.diagonal(found.covariance, axis1=1, axis2=2))
    assert np.abs(score.mean(axis=0)).max() < 4 / np.sqrt(60)  # no bias
    assert found.sense == how.get("sense", -1)
    assert found.noise_mm == pytest.approx(how.get("noise_mm", 0.015), rel=0.1)


def test_noise_that_neighbours_share_widens_the_covariance(rng: np.random.Generator) -> None:
    _, centre = postures(rng, 60)
    plain = frames_at(rng, centre, noise_mm=1e-6)
    white = rng.normal(0, 0.02, (60, 1203))
    smooth = sum(white[:, k : k + 1200] for k in range(4)) / 2  # correlation 3/4 between neighbours
    smoothed = dataclasses.replace(plain, z_mm=(plain.z_mm + smooth).astype(np.float32))
    found = circles(smoothed)
    assert found.correlation == pytest.approx(0.75, abs=0.05)
    error = found.circle - truth(centre)
    squared = np.einsum("ki,kij,kj->k", error, np.linalg.inv(found.covariance), error)
    assert squared.mean() < 4.5  # without it: about 12


def test_streaks_across_the_arc_do_not_count(rng: np.random.Generator) -> None:
    centre = np.array([[0.0, 2.0, 5.0]] * 6)
    plain = frames_at(rng, centre, background=True)
    z = plain.z_mm.copy()
    streak = np.abs(plain.x_mm[0] - 1.5) < 0.4  # a reflection: a line of 16 points above the sphere
    z[:, streak] -= 1.0
    found = circles(dataclasses.replace(plain, z_mm=z))
    assert not found.on_arc[:, streak].any()
    np.testing.assert_allclose(found.circle, truth(centre), atol=0.12)
    np.testing.assert_allclose(found.circle[:, :2], truth(centre)[:, :2], atol=0.02)


def test_frames_without_an_arc_are_rejected_with_the_cause(rng: np.random.Generator) -> None:
    made = frames_at(rng, [[0.0, 2.0, 0.0]] * 4, background=True)
    z = made.z_mm.copy()
    z[1] = np.nan
    z[2] = 20.0 + 0.1 * made.x_mm[2] + rng.normal(0, 0.015, z.shape[1])  # the table only
    z[3, np.abs(made.x_mm[3]) > 0.8] = np.nan  # a tip of 1.6 mm
    found = circles(dataclasses.replace(made, z_mm=z))
    assert found.frame.tolist() == [0]
    assert [(one.frame, one.cause.split(",")[0].split(":")[0]) for one in found.rejected][:2] == [
        (1, "0 returns"),
        (2, "no arc of the sphere in view"),
    ]
    assert found.rejected[2].frame == 3


def test_a_larger_ball_is_not_the_sphere(rng: np.random.Generator) -> None:
    centre = postures(rng, 3)[1]
    made = Cell(*[np.tile(np.eye(4), (3, 1, 1))] * 2, centre=centre * [1, 0.3, 1], radius=2 * RADIUS)
    with pytest.raises(InputError, match="no arc of the sphere in any frame"):
        circles(recording(rng, made), limits={"reach_mm": (0.0, 30000.0)})


def test_an_ordinary_recording_is_refused(rng: np.random.Generator) -> None:
    made = dataclasses.replace(frames_at(rng, [[0.0, 2.0, 0.0]]), sphere_diameter_mm=None)
    with pytest.raises(InputError, match="not a calibration recording"):
        circles(made)
