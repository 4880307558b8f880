"""Oblique frames in the section plane: how far noise turns a face there, and its bow (angle and place: tests/laws)."""

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


@pytest.mark.parametrize("oblique_deg", [-15.0, 15.0])
def test_on_an_arc_the_bow_of_an_oblique_frame_is_taken_back(oblique_deg: float) -> None:
    """The centroid of an oblique frame's points lies behind the end face of a round edge; the place does not."""
    u, oblique = 20.0 / RADIUS_MM, np.radians(oblique_deg)
    outward, tangent = np.array([np.sin(u), -np.cos(u), 0.0]), np.array([np.cos(u), np.sin(u), 0.0])
    down = -np.cos(oblique) * np.array([0.0, 0.0, 1.0]) - np.sin(oblique) * tangent
    pose = np.eye(4)
    pose[:3, :3] = np.stack([down, np.cross(-outward, down), -outward], axis=1)
    pose[:3, 3] = (RADIUS_MM + 100.0) * outward
    x = np.linspace(-8.0, 0.0, 81)
    z = RADIUS_MM + 100.0 - np.sqrt(RADIUS_MM**2 - (x * np.sin(oblique)) ** 2)
    dx, dz = x - x.mean(), z - z.mean()
    sums = np.array([[x.mean(), z.mean(), dx @ dx, dx @ dz, dz @ dz]]).T
    lines, curve, one = FaceLines(np.array([81]), *sums, np.zeros((1, 2), int)), arc(), np.ones(1)
    made = section_lines(lines, lines.sxz / lines.sxx, pose[None], one, 0.01 * one, curve, 30.0 * one)
    _, a, b = curve.frame(made.s)
    spot = curve.position(made.s) + made.place[:, :1] * a + made.place[:, 1:] * b
    centroid = pose[:3] @ [x.mean(), 0.0, z.mean(), 1.0]
    assert np.hypot(*centroid[:2]) < RADIUS_MM - 5e-4
    assert np.hypot(*spot[0, :2]) == pytest.approx(RADIUS_MM, abs=5e-5)


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
