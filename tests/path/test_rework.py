"""Rework of milled parts whose root face and bevel angle run out of tolerance, against their truth."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest

from tests.path.conftest import Raw
from workbench.api import rotation_from_quaternion
from workbench.artefacts import Cloud, Edge, Inspection, Toolpath
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.errors import InputError
from workbench.inspect import sections
from workbench.path import layers, rework
from workbench.scan import fuse
from workbench.synthetic import Truth, parse_recipe, simulate_recording
from workbench.units import DEG

LENGTH = {"part": {"length_mm": 94.0}, "passes": [{"from_mm": 2.0, "to_mm": 92.0}]}


@dataclass(frozen=True)
class Milled:
    edge: Edge
    inspection: Inspection
    cloud: Cloud
    truth: Truth


@pytest.fixture(scope="module")
def plan(request: pytest.FixtureRequest) -> Toolpath:
    scan: Raw = request.getfixturevalue("raw")(**LENGTH)
    return layers(scan.edge, scan.cloud)


def milled(**part: Any) -> Milled:
    """The same plate, milled with the given root face and bevel angle."""
    recipe = {
        "format": "bevel-recipe",
        "version": 1,
        "seed": 3,
        "scanner": {"columns": 500},
        "robot": {"frame_pitch_mm": 0.4},
        "part": {"length_mm": 94.0, **part},
        "passes": LENGTH["passes"],
    }
    recording, truth = simulate_recording(parse_recipe(recipe))
    cloud = denoise(fuse(recording))
    edge = segment(cloud)
    return Milled(edge, sections(edge), cloud, truth)


def test_too_large_a_root_is_milled_where_it_fails_and_only_there(plan: Toolpath) -> None:
    part = milled(root_mm={"start": 1.2, "end": 3.6})
    found = rework(part.edge, part.inspection, plan, part.cloud)
    assert found.too_little_material == ()
    assert found.reason.startswith("too much material on 1 stretches")
    stretch = found.too_much_material[0]
    root = np.interp(np.array([stretch.from_mm, stretch.to_mm]) + 2.0, part.truth.arc_length_mm, part.truth.root_mm)
    profile = part.inspection.profile
    guard = part.inspection.guard_factor * np.interp(stretch.from_mm, profile.arc_length_mm, profile.root_u_mm)
    assert root[0] == pytest.approx(2.0 + guard, abs=0.1)  # the tolerance ends at 1.5 + 0.5; beyond it for certain
    assert guard < 0.2
    assert "1.3" in stretch.reason  # (3.55 - 1.5) sin 40 deg = 1.32 mm above
    assert [layer.height_mm for layer in found.toolpath.layers] == [1.0, 0.0]
    final = found.toolpath.layers[-1]
    cut = final.arc_length_mm[final.cutting]
    assert stretch.from_mm - 4 <= cut[0] <= stretch.from_mm
    assert cut[-1] == pytest.approx(stretch.to_mm, abs=1e-3)
    n, m, p = part.truth.normal[0], part.truth.across[0], part.truth.position_mm[0]
    b = n * math.cos(40 * DEG) + m * math.sin(40 * DEG)
    height = (final.position_mm - p - 1.5 * m) @ b
    assert np.abs(height[final.cutting]).max() < 0.04
    assert height.min() > -0.04  # never below the required face
    axis = rotation_from_quaternion(final.quaternion_wxyz)[:, :, 2]
    assert np.degrees(np.arccos(np.clip(axis @ (n * math.sin(40 * DEG) - m * math.cos(40 * DEG)), -1, 1))).max() < 0.2
    idle = final.arc_length_mm < stretch.from_mm - 10
    assert (height[idle & (final.arc_length_mm > 5)] > 5).all()
    assert found.toolpath.layers[-1].feed_mm_s[idle].max() > 5


def test_what_counts_is_what_was_inspected_for(plan: Toolpath) -> None:
    """A part milled to 1.5 mm and asked for 1.0 +- 0.2 mm: the rework mills to 1.0 mm."""
    part = milled(root_mm=1.5, bevel_deg=40)
    strict = sections(part.edge, root_nominal_mm=1.0, root_tolerance_mm=(-0.2, 0.2))
    found = rework(part.edge, strict, plan, part.cloud)
    assert (found.toolpath.root_mm, found.toolpath.bevel_deg) == (1.0, pytest.approx(40))


def test_a_good_part_is_left_alone(plan: Toolpath) -> None:
    part = milled(root_mm=1.5, bevel_deg=40)
    found = rework(part.edge, part.inspection, plan, part.cloud)
    assert found.toolpath is None
    assert found.reason == "nothing to rework"
    assert found.too_much_material == found.too_little_material == ()
    profile = part.inspection.profile
    by_station = ("arc_length_mm", "position_mm", "root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg")
    short = replace(profile, **{name: getattr(profile, name)[:-1] for name in by_station})
    with pytest.raises(InputError, match="expected the milled edge"):
        rework(part.edge, replace(part.inspection, profile=short), plan, part.cloud)


@pytest.mark.parametrize(
    ("part", "above", "below"),
    [
        ({"root_mm": 0.8}, False, True),  # too much is gone
        ({"bevel_deg": 38.2}, True, False),  # too steep: material is left towards the upper surface
        ({"bevel_deg": 42.0}, False, True),  # too flat: the upper edge is gone
    ],
)
def test_what_cannot_be_mended_is_said(plan: Toolpath, part: dict[str, float], above: bool, below: bool) -> None:
    made = milled(**part)
    found = rework(made.edge, made.inspection, plan, made.cloud)
    assert bool(found.too_much_material) == above
    assert (found.toolpath is not None) == above
    assert bool(found.too_little_material) == below
    if below:
        assert "cannot be mended" in found.reason
        high = (8 - 1.5) * math.sin(40 * DEG)
        root, angle = part.get("root_mm", 1.5), part.get("bevel_deg", 40.0) * DEG
        lack = max((1.5 - root) * math.sin(40 * DEG), (8 - root) * math.tan(angle) * math.cos(40 * DEG) - high)
        words = found.too_little_material[0].reason
        assert float(words.split(" up to ")[1].split(" mm")[0]) == pytest.approx(lack, abs=0.06)


def spoilt(part: Milled, *stretches: tuple[float, float]) -> Inspection:
    """The inspection with a root face of 2.6 mm on these stretches of the edge."""
    profile, s = part.inspection.profile, part.inspection.profile.arc_length_mm
    there = np.any([(s >= low) & (s <= high) for low, high in stretches], axis=0)
    return replace(part.inspection, profile=replace(profile, root_mm=np.where(there, 2.6, profile.root_mm)))


@pytest.mark.parametrize(("gap_mm", "rises"), [(16.0, False), (20.0, True)])
def test_the_cutter_rises_between_two_stretches_where_there_is_room(plan: Toolpath, gap_mm: float, rises: bool) -> None:
    """Room for ramps up and down of 5 mm each and a cut that is not too short, beside 3 mm that each stretch gains."""
    part = milled(root_mm=1.5)
    found = rework(part.edge, spoilt(part, (20.0, 35.0), (35.0 + gap_mm, 75.0)), plan, part.cloud)
    assert len(found.too_much_material) == 2
    assert found.toolpath is not None, found.warnings
    final = found.toolpath.layers[-1]
    between = (final.arc_length_mm > 40.0) & (final.arc_length_mm < 30.0 + gap_mm)
    height = (final.position_mm - final.position_mm[final.cutting].mean(axis=0))[between] @ part.truth.across[0]
    assert bool(height.max() > 4.0) == rises


def test_what_the_cutter_left_is_not_judged_within_its_radius(plan: Toolpath) -> None:
    part = milled(root_mm=1.5)
    final = plan.layers[-1]
    left = replace(final, cutting=final.cutting & ((final.arc_length_mm < 30.0) | (final.arc_length_mm > 45.0)))
    found = rework(part.edge, spoilt(part, (0.0, 90.0)), replace(plan, layers=(*plan.layers[:-1], left)), part.cloud)
    told = [re.findall(r"[\d.]+(?= to| mm was not milled)", said) for said in found.warnings if "not milled" in said]
    radius = plan.cutter.diameter_mm / 2.0
    assert [float(one) for one in next(one for one in told if float(one[0]) > 10)] == pytest.approx(
        [30.0 - radius, 45.0 + radius], abs=1.5
    )
    assert all(one.to_mm < 31.0 - radius or one.from_mm > 44.0 + radius for one in found.too_much_material)
    assert not any("from 3" in said for said in rework(part.edge, spoilt(part, (0, 90)), plan, part.cloud).warnings)
