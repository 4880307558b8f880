"""The part as built against geometry worked out here: sections, curves, arc length, placement."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import minimize_scalar

from workbench.synthetic import parse_recipe, raycast
from workbench.synthetic.workpiece import arc_length, build_surface, edge_frames, pose

CURVES = {
    "straight": {"shape": "straight"},
    "convex": {"shape": "arc", "radius_mm": 300, "sense": "convex"},
    "concave": {"shape": "arc", "radius_mm": 300, "sense": "concave"},
    "wavy": {"shape": "wavy", "amplitude_mm": 3, "wavelength_mm": 130, "phase_deg": 50},
}
ROOT = {"start": 1.0, "end": 2.2, "amplitude": 0.2, "wavelength_mm": 35, "phase_deg": 20}
BEVEL = {"start": 33.0, "end": 44.0, "amplitude": 1.5, "wavelength_mm": 50, "phase_deg": -40}
THICKNESS = {"start": 7.8, "end": 8.4, "amplitude": 0.1, "wavelength_mm": 60}
LENGTH = 90.0


def part_of(curve, **more):
    part = {"length_mm": LENGTH, "curve": CURVES[curve], "root_mm": ROOT, "bevel_deg": BEVEL, "thickness_mm": THICKNESS}
    return parse_recipe({"part": part | more, "passes": [{"from_mm": 0, "to_mm": 1}]}).part


def expected(course, u):
    wave = course["amplitude"] * math.sin(2 * math.pi * u / course["wavelength_mm"] + math.radians(course["phase_deg"]))
    return course["start"] + (course["end"] - course["start"]) * u / LENGTH + wave


def plan_curve(curve, u):
    """The lower edge as docs/simulation.md states it, in closed form."""
    if curve == "straight":
        return np.array([u, 0.0])
    if curve == "wavy":
        k, phase = 2 * math.pi / 130, math.radians(50)
        return np.array([u, 3 * (math.sin(k * u + phase) - math.sin(phase))])
    side = 1 if curve == "convex" else -1
    return np.array([300 * math.sin(u / 300), side * 300 * (1 - math.cos(u / 300))])


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize(("tilt_deg", "twist_deg"), [(0.0, 0.0), (4.0, 0.0), (-2.0, 20.0)])
@pytest.mark.parametrize("u", [11.0, 47.3, 80.0])
def test_section_plane_cuts_root_and_bevel_as_ordered(curve, tilt_deg, twist_deg, u):
    """Rays in the section plane meet two straight lines: the root's width and the bevel's angle are the recipe's."""
    surface = build_surface(part_of(curve, end_face_tilt_deg=tilt_deg, end_face_twist_deg=twist_deg))
    tangent = (plan_curve(curve, u + 1e-5) - plan_curve(curve, u - 1e-5)) / 2e-5
    tangent /= np.linalg.norm(tangent)
    outward = np.array([tangent[1], -tangent[0], 0.0])  # t = up x outward
    origin = np.array([*plan_curve(curve, u), 0.0])
    tilt = math.radians(tilt_deg + twist_deg * (u / LENGTH - 0.5))
    normal = math.cos(tilt) * outward - math.sin(tilt) * np.array([0, 0, 1.0])
    across = math.cos(tilt) * np.array([0, 0, 1.0]) + math.sin(tilt) * outward
    near = np.array([origin[0], origin[1], outward[0], outward[1]])

    found = {raycast.ROOT: [], raycast.BEVEL: []}
    for height in np.linspace(0.05, 7.6, 120):
        start = origin + 12 * outward + [0, 0, height]
        a, face, at, _, _ = raycast.enter(surface, near, tuple(start), tuple(-outward), 0.0, 40.0)
        point = start - a * outward - origin
        assert at == pytest.approx(u, abs=1e-8)
        found[face].append((point @ across, point @ normal))

    root, bevel = (np.array(found[face]) for face in (raycast.ROOT, raycast.BEVEL))
    assert len(root) > 10
    assert np.abs(root[:, 1]).max() < 1e-6
    slope, intercept = np.polyfit(bevel[:, 0], bevel[:, 1], 1)
    assert np.abs(bevel[:, 1] - slope * bevel[:, 0] - intercept).max() < 1e-6
    assert -intercept / slope == pytest.approx(expected(ROOT, u), abs=1e-6)
    assert math.degrees(math.atan(-slope)) == pytest.approx(expected(BEVEL, u), abs=1e-5)


@pytest.mark.parametrize("curve", CURVES)
def test_projection_is_the_nearest_point_of_the_edge(curve):
    surface = build_surface(part_of(curve))
    rng = np.random.default_rng(5)
    for x, y in rng.uniform((10, -15), (80, 15), (25, 2)):
        nearest = minimize_scalar(
            lambda u, p=(x, y): np.sum((plan_curve(curve, u) - p) ** 2),
            bounds=(x - 12, x + 12),
            method="bounded",
            options={"xatol": 1e-9},
        )
        u, h, *_ = raycast.project(surface, x, y)
        assert u == pytest.approx(nearest.x, abs=1e-5)
        assert abs(h) == pytest.approx(math.sqrt(nearest.fun), abs=1e-8)


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("twist_deg", [0.0, -25.0])
def test_gradient_of_the_body_matches_differences(curve, twist_deg):
    face = {"end_face_tilt_deg": 3, "end_face_twist_deg": twist_deg, "roughness_mm": 0.2}
    surface = build_surface(part_of(curve, burrs=[{"from_mm": 20, "to_mm": 60}], **face))
    rng, step = np.random.default_rng(6), 1e-6
    for u, h, z in rng.uniform((5, -12, -2), (85, 3, 10), (200, 3)):
        _, face, *slopes = raycast.body(surface, u, h, z)
        for axis, slope in enumerate(slopes):
            ends = [np.array([u, h, z]) + sign * step * np.eye(3)[axis] for sign in (1, -1)]
            (high, above, *_), (low, below, *_) = (raycast.body(surface, *end) for end in ends)
            if above == below == face != raycast.UPPER:
                assert slope == pytest.approx((high - low) / (2 * step), abs=1e-5)


@pytest.mark.parametrize("curve", CURVES)
def test_edge_frames_are_right_handed_and_lie_on_the_edge(curve):
    frames = edge_frames(build_surface(part_of(curve)), np.array([3.0, 50.0]))
    for u, frame in zip((3.0, 50.0), frames, strict=True):
        assert frame[:2, 3] == pytest.approx(plan_curve(curve, u), abs=1e-12)
        assert np.cross(frame[:3, 2], frame[:3, 0]) == pytest.approx(frame[:3, 1], abs=1e-12)  # t = m x n
        ahead = plan_curve(curve, u + 1e-3) - plan_curve(curve, u)
        assert ahead @ frame[:2, 1] > 0


def test_arc_length_of_a_wave():
    surface, k = build_surface(part_of("wavy")), 2 * math.pi / 130
    exact, _ = quad(lambda u: math.hypot(1, 3 * k * math.cos(k * u + math.radians(50))), 0, 90, epsabs=1e-12)
    assert arc_length(surface, np.linspace(0, 90, 181))[-1] == pytest.approx(exact, abs=1e-9)


def test_rpy_is_the_papers():
    """R = Rz(roll) Ry(pitch) Rx(yaw), against scipy's intrinsic zyx."""
    from scipy.spatial.transform import Rotation

    recipe = parse_recipe({"passes": [{"from_mm": 0, "to_mm": 1}]})
    matrix = pose(recipe.robot.flange_from_profiler)
    assert matrix[:3, :3] == pytest.approx(
        Rotation.from_euler("ZYX", [60.489, -3.813, -2.024], degrees=True).as_matrix(), abs=1e-12
    )
    assert matrix[:3, 3] == pytest.approx([126.92, 9.44, 41.48])


def test_roughness_stays_near_its_bound_and_depends_on_the_seed():
    part = part_of("straight", kind="raw", roughness_mm=0.3)
    surface = build_surface(part, 1)
    rng = np.random.default_rng(0)
    heights = [raycast._rough(surface, u, v)[0] for u, v in rng.uniform((0, 0), (90, 8), (4000, 2))]
    assert np.std(heights) == pytest.approx(0.1, rel=0.25)
    assert np.abs(heights).max() < 0.45
    assert not np.array_equal(surface.roughness, build_surface(part, 2).roughness)
