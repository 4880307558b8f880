"""What a clamp hides, against cases computed by hand."""

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


def looking_down(h):
    """part_from_profiler with the emitter at u = 50, h, z = 100; x points outwards."""
    x, z = np.array([0.0, -1, 0]), np.array([0.0, 0, -1])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([x, np.cross(z, x), z], axis=1)
    pose[:3, 3] = 50, -h, 100
    return pose[None]


def seen_from(part, eye, pose, offsets):
    surface = build_surface(part)
    return raycast.cast(surface, clamp_boxes(part, surface), -20.0, eye, pose, np.asarray(offsets, float))


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
