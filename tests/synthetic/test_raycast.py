"""Rays and shadows against cases computed by hand."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.synthetic import parse_recipe, raycast
from workbench.synthetic.scan import sensor_of
from workbench.synthetic.workpiece import build_surface, clamp_boxes

# A plate 10 mm thick over a table 20 mm below it; scanners look straight down from 100 mm above the lower surface.
PLATE = {"kind": "raw", "length_mm": 100, "thickness_mm": 10}


def plate(**more):
    return parse_recipe({"part": PLATE | more, "passes": [{"from_mm": 0, "to_mm": 1}]}).part


def sensor(**more):
    scanner = {"near_mm": 50, "standoff_mm": 110, "far_mm": 150, "baseline_mm": 0.0} | more
    return sensor_of(parse_recipe({"scanner": scanner, "passes": [{"from_mm": 0, "to_mm": 1}]}).scanner)


def looking_down(h, across=True):
    """part_from_profiler with the emitter at u = 50, h, z = 100; x points outwards, or (not `across`) along -t."""
    x, z = (
        (np.array([0.0, -1, 0]), np.array([0.0, 0, -1])) if across else (np.array([-1.0, 0, 0]), np.array([0, 0, -1]))
    )
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = 50, -h, 100
    return pose[None]


def seen_from(part, eye, pose, offsets):
    surface = build_surface(part)
    return raycast.cast(surface, clamp_boxes(part, surface), -20.0, eye, pose, np.asarray(offsets, float))


def test_ranges_and_faces_of_a_plate_from_above():
    ranges, faces, cosines, _ = seen_from(plate(), sensor(beam="parallel"), looking_down(0.0), [-5.0, 5.0])
    assert ranges[0] == pytest.approx([90.0, 120.0], abs=1e-9)
    assert list(faces[0]) == [raycast.UPPER, raycast.TABLE]
    assert cosines[0] == pytest.approx([1, 1])


def test_emitter_shadow_of_the_upper_edge():
    """Emitter 20 mm inside the plate: the ray over the corner (0, 10) meets the table at 20 * 120/90 - 20 = 6.667."""
    table = np.array([0.5, 3.0, 6.6, 6.7, 9.0]) + 20.0
    fan = seen_from(plate(), sensor(beam="fan"), looking_down(-20.0), table)[1][0]
    assert list(fan == raycast.TABLE) == [False, False, False, True, True]
    parallel = seen_from(plate(), sensor(beam="parallel"), looking_down(40.0), table - 60.0)[1][0]
    assert np.all(parallel == raycast.TABLE)


@pytest.mark.parametrize(("h", "visible"), [(14.9, False), (15.1, True)])
def test_camera_shadow_of_the_upper_edge(h, visible):
    """Camera 60 mm towards the plate: its line to the table at h passes z = 10 at h - 60 * 30/120 = h - 15."""
    pose = looking_down(h, across=False)
    towards_plate = 60.0 * np.sign(pose[0, 1, 1])  # +y of the part is inwards
    faces = seen_from(plate(), sensor(beam="parallel", baseline_mm=towards_plate), pose, [0.0])[1]
    assert (faces[0, 0] == raycast.TABLE) == visible
    faces = seen_from(plate(), sensor(beam="parallel", baseline_mm=-towards_plate), pose, [0.0])[1]
    assert faces[0, 0] == raycast.TABLE


def test_clamp_hides_what_is_below_and_shadows_the_camera():
    """A box to z = 15, h from -30 to 6; a camera at h = 0 loses 30 * 5/85 = 1.76 behind it, and 6 * 120/85 in front."""
    part = plate(clamps=[{"from_mm": 40, "to_mm": 60, "height_mm": 5, "reach_in_mm": 30, "reach_out_mm": 6}])
    offsets = [-31.8, -31.7, -29.0, 5.0, 8.4, 8.5]
    ranges, faces, _, _ = seen_from(part, sensor(beam="parallel"), looking_down(0.0), offsets)
    hidden = raycast.NOTHING
    assert list(faces[0]) == [raycast.UPPER, hidden, raycast.CLAMP, raycast.CLAMP, hidden, raycast.TABLE]
    assert ranges[0, [0, 2, 3, 5]] == pytest.approx([90, 85, 85, 120], abs=1e-9)

    # beside the clamp, 5 mm high: a camera 60 mm off, 90 mm up, loses 5 * 60/90 = 3.33 mm of the upper surface
    for u, visible in ((63.2, False), (63.5, True)):
        pose = looking_down(-10.0)
        pose[0, 0, 3] = u
        towards_clamp = 60.0 * -np.sign(pose[0, 0, 1])
        faces = seen_from(part, sensor(beam="parallel", baseline_mm=towards_clamp), pose, [0.0])[1]
        assert (faces[0, 0] == raycast.UPPER) == visible, u


def test_returns_beyond_the_range_or_too_grazing_are_missing():
    near = seen_from(plate(), sensor(beam="parallel", far_mm=115), looking_down(0.0), [-5.0, 5.0])[0]
    assert list(np.isnan(near[0])) == [False, True]
    angular = sensor(sampling="angular", max_incidence_deg=20)
    slanted = seen_from(plate(), angular, looking_down(0.0), np.tan(np.radians([-21.0, -19.0])))[0]
    assert list(np.isnan(slanted[0])) == [True, False]


def test_angular_columns_count_range_along_the_range_axis():
    ranges = seen_from(plate(), sensor(sampling="angular"), looking_down(0.0), [-0.2, 0.1])[0]
    assert ranges[0] == pytest.approx([90.0, 120.0], abs=1e-9)


def test_what_a_frame_sees_of_the_edge():
    """From 45 deg outside, the lowest return on the end face and where the frame crosses the edge."""
    w = np.array([0, 1.0, -1.0]) / np.sqrt(2)
    x = np.array([0, 1.0, 1.0]) / np.sqrt(2)
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(w, x), w], axis=1)
    pose[:3, 3] = np.array([30.0, 0, 0]) - 110 * w
    offsets = np.arange(-0.25, 20, 0.5)
    faces, sight = seen_from(plate(), sensor(beam="parallel"), pose[None], offsets)[1::2]
    on_face = offsets[faces[0] == raycast.ROOT] * np.sqrt(2)
    assert on_face.min() == pytest.approx(0.25 * np.sqrt(2))
    assert sight[0] == pytest.approx([len(on_face), 0, on_face.min(), 30.0])


def test_rays_meet_a_rough_and_burred_face():
    part = plate(roughness_mm=0.2, burrs=[{"from_mm": 30, "to_mm": 70, "height_mm": 0.3}])
    surface, near = build_surface(part), np.array([50.0, 0, 0, -1])
    heights = []
    for z in np.linspace(0.05, 9.5, 60):
        a, face, u, _, _ = raycast.enter(surface, near, (50.0, -12.0, z), (0.0, 1.0, 0.0), 0.0, 30.0)
        assert face == raycast.ROOT
        assert abs(raycast.body(surface, u, 12.0 - a, z)[0]) < 1e-8
        heights.append(12.0 - a)
    assert heights[0] > 0.1  # the burr at the lower edge
    assert np.std(heights[20:]) > 0.02
