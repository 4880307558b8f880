"""Oblique frames in the section plane: how far noise turns a face there (angle and place themselves: tests/laws)."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry.chains import FaceLines
from workbench.geometry.curves import Curve, fit_curve
from workbench.geometry.sections import in_section, section_lines

RADIUS_MM, FRAMES = 300.0, 3000


def arc() -> Curve:
    """Round the z axis, arc length 0 at angle -10 mm / RADIUS_MM."""
    u = np.arange(-10, 60, 0.25) / RADIUS_MM
    return fit_curve(RADIUS_MM * np.stack([np.sin(u), -np.cos(u), 0 * u], axis=1), u * RADIUS_MM + 10)


def test_variances_are_those_of_noisy_points() -> None:
    """A profiler 15 deg oblique over a straight edge along x sees a face through it, in 40 columns of 0.02 mm noise."""
    s = np.arange(-10, 60, 0.25)
    curve = fit_curve(np.outer(s, [1.0, 0, 0]), s + 10)
    pose = np.eye(4)
    square = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    pose[:3, :3] = square @ Rotation.from_rotvec([9.0, 25.0, -12.0], degrees=True).as_matrix()
    pose[:3, 3] = [20.0, 0.0, 0.0] + pose[:3, :3] @ [4.0, 0.0, -120.0]
    normal = np.array([0.0, -0.8, 0.6]) @ pose[:3, :3]
    slope, at = -normal[0] / normal[2], -(np.array([0.0, -0.8, 0.6]) @ (pose[:3, 3] - [20.0, 0.0, 0.0])) / normal[2]
    sigma, x = 0.02, np.linspace(-2, 2, 40)
    z = slope * x + np.random.default_rng(4).normal(0, sigma, (FRAMES, 40))
    each = np.ones(FRAMES)
    middle = slope * 1.0 + at + z.mean(axis=1)
    columns = np.zeros((FRAMES, 2), int)
    lines = FaceLines(np.full(FRAMES, 40), each, middle, x @ x * each, z @ x, (z**2).sum(axis=1), columns)
    poses = np.repeat(pose[None], FRAMES, axis=0)
    made = section_lines(lines, slope * each, poses, each, sigma * each, curve, 30.0 * each)
    assert np.var(made.angle) == pytest.approx(made.angle_variance[0], rel=0.12)
    lean = np.array([-np.sin(made.angle.mean()), np.cos(made.angle.mean())])
    assert np.var(made.place @ lean) == pytest.approx(made.offset_variance[0], rel=0.12)


def test_points_in_their_own_section_plane() -> None:
    """Beside an arc: radial distance and height, at the arc length of the radius through the point."""
    curve = arc()
    rng = np.random.default_rng(7)
    u, radial, height = rng.uniform(0, 50, 40) / RADIUS_MM, rng.uniform(-5, 5, 40), rng.uniform(-5, 5, 40)
    radius = RADIUS_MM + radial
    points = np.stack([radius * np.sin(u), -radius * np.cos(u), height], axis=1)
    s, place = in_section(points, curve, u * RADIUS_MM + 10 + rng.normal(0, 1, 40))
    assert np.ptp(s - u * RADIUS_MM) < 5e-3
    np.testing.assert_allclose(np.hypot(*place.T), np.hypot(radial, height), atol=5e-3)
    _, a, b = curve.frame(s)
    back = curve.position(s) + place[:, :1] * a + place[:, 1:] * b
    np.testing.assert_allclose(back, points, atol=1e-6)
