"""A compound bevel: its two paths leave both bevels, milled one after the other in the twin."""

from __future__ import annotations

import numpy as np
import pytest

from workbench import cloud, edge, path, scan, twin
from workbench.artefacts import RawEdge, Toolpath
from workbench.errors import InputError
from workbench.synthetic import Workpiece, parse_recipe

WANTED = {"root_mm": 1.5, "bevel_deg": 30.0, "upper_bevel_deg": 50.0, "lower_bevel_mm": 2.0}
RECIPE = {
    "format": "bevel-recipe",
    "version": 1,
    "seed": 5,
    "part": {"kind": "raw", "length_mm": 40, "thickness_mm": 8},
    "scanner": {"columns": 600, "pitch_mm": 0.05},
    "passes": [{"from_mm": 1, "to_mm": 39, "elevation_deg": 45, "lead_deg": 3, "aim_mm": [-2, 4.5]}],
}


@pytest.fixture(scope="module")
def part() -> Workpiece:
    return Workpiece(parse_recipe(RECIPE))


@pytest.fixture(scope="module")
def raw(part):
    points = cloud.denoise(scan.fuse(twin.scan(part)))
    return edge.segment_raw(points, upper_side=[0, 0, 1]), points


def planned(raw, mill: str, **changed: object) -> Toolpath:
    return path.layers(*raw, **{**WANTED, "mill": mill, **changed})


def test_both_paths_leave_both_bevels(part, raw) -> None:
    for mill in ("upper", "lower"):
        plan = planned(raw, mill)
        gate = path.check(plan, *raw, workpiece=part, rests_milled=mill == "lower")
        assert gate.clean, gate.cause
        part, engagement = twin.mill(part, plan)
        assert engagement.warnings == ()
    found = edge.segment_preparation(cloud.denoise(scan.fuse(twin.scan(part))), root_nominal_mm=1.5)
    assert found.type == "compound"
    for name, wanted, most in (
        ("root_face_mm", 1.5, 0.03),
        ("bevel_deg", 30.0, 0.1),
        ("upper_bevel_deg", 50.0, 0.1),
        ("lower_bevel_mm", 2.0, 0.03),
    ):
        middle = found.sizes[name].value[8:-8]  # away from the ends of the part
        assert np.nanmax(np.abs(middle - wanted)) < most, name


def test_the_lower_path_begins_under_the_upper_bevel(raw: tuple[RawEdge, object]) -> None:
    upper, lower = planned(raw, "upper"), planned(raw, "lower")
    root = 1.5 + 2.0 * (1.0 - np.tan(np.radians(30.0)) / np.tan(np.radians(50.0)))
    assert (upper.root_mm, upper.bevel_deg) == pytest.approx((root, 50.0))
    assert lower.layers[0].height_mm < (root - 1.5) * np.sin(np.radians(30.0))


def test_nothing_shows_that_the_upper_bevel_is_milled(part, raw) -> None:
    gate = path.check(planned(raw, "lower"), *raw, workpiece=part)
    assert gate.passed
    assert not gate.clean
    assert gate.cause.startswith("NOT CHECKED: that the upper bevel of 50 deg has been milled")
    assert path.check(planned(raw, "upper"), *raw, workpiece=part).clean


@pytest.mark.parametrize(
    ("changed", "told"),
    [
        ({"upper_bevel_deg": 20.0}, "expected more than the lower bevel's 30 deg.*hollow"),
        ({"upper_bevel_deg": None}, "lower_bevel_mm: expected upper_bevel_deg beside it"),
        ({"lower_bevel_mm": None}, "upper_bevel_deg: expected lower_bevel_mm beside it"),
        ({"upper_bevel_deg": None, "lower_bevel_mm": None, "mill": "upper"}, "mill: 'upper' expects upper_bevel_deg"),
        ({"lower_bevel_mm": 14.0}, "lower_bevel_mm: leaves nothing to the upper bevel"),
    ],
)
def test_what_no_cylindrical_cutter_can_mill_is_refused(raw, changed, told) -> None:
    with pytest.raises(InputError, match=told):
        path.layers(*raw, **{**WANTED, **changed})
