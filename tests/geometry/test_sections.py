"""Oblique frames in the section plane, against faces whose angle and place there are known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry.chains import FaceLines
from workbench.geometry.curves import Curve, fit_curve
from workbench.geometry.sections import crossing, in_section, on_line, section_lines
from workbench.units import DEG, Float

RADIUS_MM = 300.0


def straight() -> Curve:
    s = np.arange(-10, 60, 0.25)
    return fit_curve(np.outer(s, [1.0, 0, 0]), s + 10)


def arc() -> Curve:
    """Round the z axis, arc length 0 at angle -10 mm / RADIUS_MM."""
    u = np.arange(-10, 60, 0.25) / RADIUS_MM
    return fit_curve(RADIUS_MM * np.stack([np.sin(u), -np.cos(u), 0 * u], axis=1), u * RADIUS_MM + 10)


def poses(rng: np.random.Generator, edge: Float, tangent: Float, oblique_deg: float) -> Float:
    """Profilers whose laser plane cuts the edge at `edge` (n, 3), up to `oblique_deg` off square in both ways."""
    out = np.tile(np.eye(4), (len(edge), 1, 1))
    for i, (point, t) in enumerate(zip(edge, tangent, strict=True)):
        outward = np.cross(t, [0.0, 0.0, 1.0])  # of a convex edge round +z, or of y < 0
        square = np.stack([outward, t, np.cross(outward, t)], axis=1)
        tilted = Rotation.from_rotvec(rng.uniform(-1, 1, 3) * (oblique_deg, 40, oblique_deg), degrees=True)
        out[i, :3, :3] = square @ tilted.as_matrix()
        offset = out[i, :3, :3] @ np.array([rng.uniform(-10, 10), 0.0, rng.uniform(-150, -90)])
        out[i, :3, 3] = point + offset  # the edge lies in the plane y = 0 of the profiler
    return out


def plane_lines(pose: Float, points: Float, normals: Float, rng: np.random.Generator) -> tuple[FaceLines, Float]:
    """The lines in which planes (a point and a normal each) cut the laser planes; and their slopes."""
    n_x, n_z = (pose[:, :3, 0] * normals).sum(axis=1), (pose[:, :3, 2] * normals).sum(axis=1)
    level = ((points - pose[:, :3, 3]) * normals).sum(axis=1)
    slope, offset = -n_x / n_z, level / n_z
    x = rng.uniform(-5, 5, len(pose))
    sxx = rng.uniform(1, 50, len(pose))
    count = np.full(len(pose), 40)
    lines = FaceLines(count, x, slope * x + offset, sxx, slope * sxx, slope**2 * sxx, np.zeros((len(pose), 2), int))
    return lines, slope


@pytest.mark.parametrize("oblique_deg", [0.0, 5.0, 15.0])
def test_on_a_straight_edge_angle_and_place_are_exact(oblique_deg: float) -> None:
    """A plane along the edge has one direction in the section plane, however the frames cut it."""
    rng = np.random.default_rng(1)
    curve = straight()
    edge = np.outer(rng.uniform(5, 40, 60), [1.0, 0, 0])
    pose = poses(rng, edge, np.tile([1.0, 0, 0], (60, 1)), oblique_deg)
    lean = rng.uniform(-60, 60, 60) * DEG
    normal = np.stack([0 * lean, -np.cos(lean), np.sin(lean)], axis=1)
    through = np.stack([0 * lean, rng.uniform(-3, 3, 60), rng.uniform(-3, 3, 60)], axis=1)
    face, slope = plane_lines(pose, through, normal, rng)
    made = section_lines(face, slope, pose, np.ones(60), np.full(60, 0.01), curve, edge[:, 0] + 10)
    _, a, b = curve.frame(made.s)
    along = np.cross(normal, [1.0, 0, 0])
    expected = np.arctan2((along * b).sum(axis=1), (along * a).sum(axis=1))
    np.testing.assert_allclose(np.sin(made.angle - expected), 0, atol=1e-6)
    spot = curve.position(made.s) + made.place[:, :1] * a + made.place[:, 1:] * b
    np.testing.assert_allclose(((spot - through) * normal).sum(axis=1), 0, atol=1e-6)
    centroid = pose[:, :3, 3] + face.x_mean[:, None] * pose[:, :3, 0] + face.z_mean[:, None] * pose[:, :3, 2]
    np.testing.assert_allclose(spot, centroid, atol=1e-6)


def test_the_line_points_from_the_lower_to_the_upper_side() -> None:
    """The upper side lies towards falling side * x, whatever the slope."""
    rng = np.random.default_rng(2)
    curve, edge = straight(), np.array([[20.0, 0, 0]])
    pose = poses(rng, edge, np.array([[1.0, 0, 0]]), 10)
    face, slope = plane_lines(pose, edge, np.array([[0.0, -0.8, 0.6]]), rng)
    for side in (1.0, -1.0):
        made = section_lines(face, slope, pose, np.array([side]), np.array([0.01]), curve, np.array([30.0]))
        _, a, b = curve.frame(made.s)
        line = np.cos(made.angle) * a[0] + np.sin(made.angle) * b[0]
        assert np.sign(line @ pose[0, :3, 0]) == -side


def cone_lines(pose: Float, half_angle: float, centre_mm: float) -> tuple[FaceLines, Float]:
    """Least-squares lines in frames of a cone round z: radius RADIUS_MM + w sin, height w cos, w about centre_mm."""
    rows = np.empty((len(pose), 5))
    for i, p in enumerate(pose):
        lengths = centre_mm + np.linspace(-6, 6, 61)
        points = []
        for w in lengths:  # on each generator circle, the point in the laser plane, by Newton's method
            radius, z = RADIUS_MM + w * np.sin(half_angle), w * np.cos(half_angle)
            u = np.arctan2(p[0, 3], -p[1, 3])
            for _ in range(30):
                point = np.array([radius * np.sin(u), -radius * np.cos(u), z])
                slope = np.array([radius * np.cos(u), radius * np.sin(u), 0.0])
                u -= (point - p[:3, 3]) @ p[:3, 1] / (slope @ p[:3, 1])
            points.append(np.linalg.inv(p[:3, :3]) @ (point - p[:3, 3]))
        x, _, z = np.array(points).T
        dx, dz = x - x.mean(), z - z.mean()
        rows[i] = x.mean(), z.mean(), dx @ dx, dx @ dz, dz @ dz
    lines = FaceLines(np.full(len(pose), 61), *rows.T, np.zeros((len(pose), 2), int))
    return lines, lines.sxz / lines.sxx


def test_on_an_arc_the_bow_of_an_oblique_frame_is_taken_back() -> None:
    """A conical bevel of a round edge: the centroid of an oblique frame's points does not lie on the face."""
    rng = np.random.default_rng(3)
    curve, half_angle = arc(), 40 * DEG
    u = rng.uniform(5, 40, 12) / RADIUS_MM
    edge = RADIUS_MM * np.stack([np.sin(u), -np.cos(u), 0 * u], axis=1)
    tangent = np.stack([np.cos(u), np.sin(u), 0 * u], axis=1)
    pose = poses(rng, edge, tangent, 0)
    for i, turn in enumerate(np.linspace(-15, 15, 12)):  # about the outward direction: oblique by `turn`
        turned = Rotation.from_rotvec(turn * DEG * np.cross(tangent[i], [0, 0, 1.0])).as_matrix()
        pose[i, :3, 3] = edge[i] + turned @ (pose[i, :3, 3] - edge[i])
        pose[i, :3, :3] = turned @ pose[i, :3, :3]
    face, slope = cone_lines(pose, half_angle, 4.0)
    made = section_lines(face, slope, pose, np.ones(12), np.full(12, 0.01), curve, u * RADIUS_MM + 10)
    t, a, b = curve.frame(made.s)
    outward, up = np.cross(t, [0, 0, 1.0]), np.array([0, 0, 1.0])
    generator = np.sin(half_angle) * outward + np.cos(half_angle) * up
    expected = np.arctan2((generator * b).sum(axis=1), (generator * a).sum(axis=1))
    assert np.abs(np.sin(made.angle - expected)).max() < 0.01 * DEG
    spot = curve.position(made.s) + made.place[:, :1] * a + made.place[:, 1:] * b
    centroid = pose[:, :3, 3] + face.x_mean[:, None] * pose[:, :3, 0] + face.z_mean[:, None] * pose[:, :3, 2]
    true = RADIUS_MM * np.cos(half_angle)  # distance of the generators from the z axis, along the normal
    left, bowed = (
        np.hypot(p[:, 0], p[:, 1]) * np.cos(half_angle) - p[:, 2] * np.sin(half_angle) - true for p in (spot, centroid)
    )
    assert np.abs(bowed).max() > 5e-4
    assert np.abs(left).max() < 0.1 * np.abs(bowed).max()


def test_variances_are_those_of_noisy_points() -> None:
    rng = np.random.default_rng(4)
    curve, edge = straight(), np.tile([20.0, 0, 0], (3000, 1))
    one = poses(rng, edge[:1], np.array([[1.0, 0, 0]]), 15)
    pose = np.repeat(one, 3000, axis=0)
    exact, slope = plane_lines(pose, edge, np.tile([0.0, -0.8, 0.6], (3000, 1)), np.random.default_rng(5))
    sigma, x = 0.02, np.linspace(-2, 2, 40)
    z = slope[:, None] * x + rng.normal(0, sigma, (3000, 40))
    noisy = FaceLines(
        exact.count,
        np.full(3000, 1.0),
        slope * 1 + exact.z_mean - slope * exact.x_mean + z.mean(axis=1),
        np.full(3000, x @ x),
        z @ x,
        (z**2).sum(axis=1),
        exact.columns,
    )
    made = section_lines(noisy, slope, pose, np.ones(3000), np.full(3000, sigma), curve, np.full(3000, 30.0))
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


def test_crossing_of_lines() -> None:
    rng = np.random.default_rng(8)
    meet, angle_a = rng.uniform(-3, 3, (50, 2)), rng.uniform(-3, 3, 50)
    angle_b = angle_a + rng.uniform(0.2, 2.9, 50)
    far_a, far_b = rng.uniform(-5, 5, 50), rng.uniform(-5, 5, 50)
    place_a, place_b = on_line(meet, angle_a, far_a), on_line(meet, angle_b, far_b)
    np.testing.assert_allclose(np.linalg.norm(place_a - meet, axis=1), np.abs(far_a), atol=1e-12)
    np.testing.assert_allclose(crossing(place_a, angle_a, place_b, angle_b), -far_a, atol=1e-9)
