"""A J preparation: scanned, planned, milled by a ball end in the twin, and measured again."""

from __future__ import annotations

import math

import numpy as np
import pytest

from tests.twin.test_compound import RECIPE as COMPOUND
from workbench import cloud, edge, path, scan, twin
from workbench.synthetic import Workpiece, milled_truth, parse_recipe

ROOT, RADIUS, ANGLE = 1.5, 3.0, math.radians(20.0)
RECIPE = {**COMPOUND, "seed": 11}


@pytest.fixture(scope="module")
def milled() -> Workpiece:
    part = Workpiece(parse_recipe(RECIPE))
    points = cloud.denoise(scan.fuse(twin.scan(part)))
    raw = edge.segment_raw(points, upper_side=[0, 0, 1])
    plan = path.layers(
        raw, points, root_mm=ROOT, bevel_deg=20.0, root_radius_mm=RADIUS, cutter_diameter_mm=2.0 * RADIUS
    )
    gate = path.check(plan, raw, points, workpiece=part)
    assert gate.clean, gate.cause
    part, engagement = twin.mill(part, plan)
    assert engagement.warnings == ()
    assert max(layer.radial_depth_mm.max() for layer in engagement.layers) < 1.02
    return part


def test_what_is_left_is_root_face_fillet_and_bevel_face(milled) -> None:
    """In a section, in coordinates of the end face: a circle about (0, c + r), then the line that touches it."""
    cut = milled.cut
    assert cut is not None
    column = len(cut.u) // 2
    b, up = np.array([math.cos(ANGLE), math.sin(ANGLE)]), np.array([-math.sin(ANGLE), math.cos(ANGLE)])
    on = cut.stock_mm[column] - cut.height_mm[column] > 1e-3
    n, m = (cut.w_mm[on, None] * up + cut.height_mm[column, on, None] * b + [0.0, cut.root_mm]).T
    off = np.stack([n, m - ROOT - RADIUS], axis=1)
    beside = off @ up > 0.0  # above where the fillet ends
    left = np.where(beside, -off @ b, np.hypot(*off.T)) - RADIUS
    assert beside.any()
    assert (~beside).any()
    assert np.abs(left).max() < 0.02  # of the path: the raw edge is known so well
    assert np.ptp(m[~beside]) > 0.9 * RADIUS * (1.0 - math.sin(ANGLE))


def test_it_is_measured_as_it_was_asked_for(milled) -> None:
    found = edge.segment_preparation(cloud.denoise(scan.fuse(twin.scan(milled))), root_nominal_mm=ROOT)
    assert found.type == "J"
    for name, wanted, most in (
        ("root_face_mm", ROOT, 0.03),
        ("bevel_deg", 20.0, 0.15),
        ("root_radius_mm", RADIUS, 0.03),
    ):
        middle = found.sizes[name].value[8:-8]  # away from the ends of the part
        assert np.nanmax(np.abs(middle - wanted)) < most, name


def test_its_truth_tells_no_root_face_and_bevel_angle_of_a_bevel(milled) -> None:
    truth = milled_truth(milled)
    assert np.isnan(truth.bevel_deg).all()
    assert np.isnan(truth.root_mm).all()
