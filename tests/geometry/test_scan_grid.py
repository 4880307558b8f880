"""A scanner's lines and grid, found again in the order of its points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry.scan_grid import scan_grid, scan_lines
from workbench.units import Float, Int

PITCH_MM = 0.05


@dataclass(frozen=True)
class Written:
    """What a scanner saw, and where in its own grid."""

    points: Float
    frame: Int
    column: Int
    pose: Float  # (N, 4, 4)


def written(
    frames: int = 60,
    columns: int = 200,
    step_mm: float = 0.2,
    noise_mm: float = 0.02,
    lost: float = 0.05,
    turn_deg: float = 5.0,
    sense: float = 1.0,
    offset_mm: float = 0.0,
) -> Written:
    """A ridge of two planes scanned by a profiler that slowly turns, from anywhere; some returns missing or stray."""
    rng = np.random.default_rng(4)
    x = (np.arange(columns) - columns / 2) * PITCH_MM
    i, j = np.nonzero(rng.random((frames, columns)) > lost)
    z = np.abs(x[j]) * 0.8 + noise_mm * rng.standard_normal(len(i)) + 5.0 * (rng.random(len(i)) < 0.01)
    start = Rotation.from_euler("xyz", [20, 50, -70], degrees=True)
    pose = np.tile(np.eye(4), (frames, 1, 1))
    pose[:, :3, :3] = (
        start * Rotation.from_euler("z", np.linspace(0, turn_deg, frames)[:, None], degrees=True)
    ).as_matrix()
    travel = start.apply([0.02, 1.0, 0.05]) * sense
    pose[:, :3, 3] = [1500.0, -300.0, 800.0] + (offset_mm + step_mm * np.arange(frames))[:, None] * travel
    points = pose[i, :3, 3] + x[j, None] * pose[i, :3, 0] + z[:, None] * pose[i, :3, 2]
    return Written(points, i, j, pose)


def test_every_line_is_found():
    w = written()
    lines = scan_lines(w.points)
    assert lines is not None
    np.testing.assert_array_equal(lines.first[:-1], np.searchsorted(w.frame, np.arange(60)))
    assert np.abs(np.einsum("ij,ij->i", lines.normal, w.pose[:, :3, 1])).min() > 1 - 1e-12
    assert np.ptp(lines.pass_index) == 0


@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_second_pass_is_told_from_the_first(sense: float):
    first, second = written(), written(turn_deg=-3.0, sense=sense, offset_mm=0.0 if sense > 0 else -12.0)
    lines = scan_lines(np.concatenate([first.points, second.points]))
    assert lines is not None
    np.testing.assert_array_equal(lines.pass_index, np.repeat([0, 1], 60))


def test_the_grid_is_the_scanners():
    w = written()
    lines = scan_lines(w.points)
    assert lines is not None
    grid = scan_grid(w.points, lines)
    frame, column = np.nonzero(np.isfinite(grid.x_mm))
    assert np.abs(np.einsum("ij,ij->i", grid.base_from_profiler[:, :3, 2], w.pose[:, :3, 2])).min() > np.cos(1e-3)
    np.testing.assert_array_equal(frame, w.frame)
    shift = column - w.column
    shift = shift if np.ptp(shift) == 0 else column + w.column
    assert np.ptp(shift) == 0, "columns but for a shift, and their sense"
    pose, x, z = grid.base_from_profiler[frame], grid.x_mm[frame, column, None], grid.z_mm[frame, column, None]
    back = pose[:, :3, 3] + x * pose[:, :3, 0] + z * pose[:, :3, 2]
    np.testing.assert_allclose(back, w.points, atol=1e-5)


@pytest.mark.parametrize("how", ["shuffled", "sorted", "thin"])
def test_where_the_order_shows_no_lines_there_are_none(how: str):
    points = written().points
    if how == "shuffled":
        points = np.random.default_rng(0).permutation(points)
    elif how == "sorted":
        points = points[np.argsort(points @ [0.6, 0.64, 0.48])]
    else:
        points = points[::37]
    assert scan_lines(points) is None


def test_few_points_are_no_lines():
    assert scan_lines(np.zeros((0, 3))) is None
    assert scan_lines(np.zeros((200, 3))) is None
    assert scan_lines(np.random.default_rng(0).normal(size=(50, 3))) is None
