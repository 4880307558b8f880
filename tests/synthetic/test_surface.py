"""The part as built against geometry worked out here: sections, curves, arc length, placement."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.synthetic import parse_recipe, raycast
from workbench.synthetic.workpiece import build_surface

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
