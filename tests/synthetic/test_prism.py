"""Grooves of the package's simulator: exact returns, sizes, and the same ranges as the swept simulator's."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.drawn.grooves import random_prism_recipe
from bench.simulators.swept import parse_swept_recipe, simulate_groove, simulate_swept
from tests.simulators.returns import in_sections
from workbench.api import interpolate_poses
from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.synthetic import (
    PrismRecipe,
    parse_as,
    parse_recipe,
    simulate_file,
    simulate_prism,
    simulate_recording,
)

DRIFT = {
    "gap_mm": {"start": 2, "end": 3, "amplitude": 0.2},
    "bevel_left_deg": {"start": 30, "end": 32},
    "misalignment_mm": {"start": 0.5, "end": -0.5},
}
PLACE = {"position_mm": [1200, 300, 500], "rpy_deg": [20, 5, -8]}
LOOK = {"elevation_deg": 83, "aim_mm": [0, 8], "oblique_deg": 3, "lead_deg": 4}
TYPES = ("I", "V", "Y", "HV", "HY", "X", "K", "U", "J")


def document(kind: str, **groove: Any) -> dict[str, Any]:
    return {
        "format": "groove-recipe",
        "groove": {"type": kind, "thickness_mm": 12, "length_mm": 60, "base_from_part": PLACE} | groove,
        "passes": [{"from_mm": 3, "to_mm": 57, **LOOK}],
        "scanner": {"columns": 400, "pitch_mm": 0.09, "noise": {"sd_mm": 0}, "beam": "fan"},
        "robot": {"frame_pitch_mm": 1.5},
    }


@pytest.mark.parametrize("kind", ["V", "Y", "HV", "HY", "X", "K"])
def test_returns_lie_on_the_section(kind: str) -> None:
    recording, truth = simulate_prism(parse_as(PrismRecipe, document(kind, **DRIFT)))
    base, a, b = in_sections(recording, truth)
    start, stop = (truth.at(base, truth.sizes.corners[f"left_{name}"]) for name in ("root", "upper"))
    way = (stop - start) / np.linalg.norm(stop - start, axis=1, keepdims=True)
    over = (a - start[:, 0]) * way[:, 1] - (b - start[:, 1]) * way[:, 0]
    on = (b > start[:, 1] + 0.1) & (b < 11.9) & (np.abs(over) < 0.1)
    assert on.sum() > 800
    assert np.abs(over[on]).max() < 1e-4  # single precision of x and z, linear truth between stations
    top = a > truth.at(base, truth.sizes.corners["right_upper"])[:, 0] + 0.1
    assert np.abs(b - 12 - truth.at(base, truth.sizes.misalignment_mm))[top].max() < 1e-4


def swept_document(kind: str, **groove: Any) -> dict[str, Any]:
    """The same scan for the swept simulator."""
    names = {"thickness_mm": 12, "spine": {"length_mm": 60}, "base_from_part": PLACE, "reach_mm": 60}
    return {
        "simulator": "swept",
        "part": {"kind": "groove", "groove": kind} | names | groove,
        "passes": [{"way_mm": [3, 57], "follow": "line", "motion": "two_poses", **LOOK}],
        "scanner": {
            "columns": 400,
            "pitch_mm": 0.09,
            "noise": {"sd_mm": 0, "speckle": 0},
            "apex_mm": None,
            "footprint": 0,
            "max_incidence_deg": 85,
        },
        "robot": {"frame_pitch_mm": 1.5},
    }


@pytest.mark.parametrize("kind", TYPES)
def test_both_simulators_see_the_same_groove(kind: str) -> None:
    first, truth = simulate_prism(parse_as(PrismRecipe, document(kind, **DRIFT)))
    second, other = simulate_groove(parse_swept_recipe(swept_document(kind, **DRIFT)))
    agree(first, second)
    for name, corner in truth.sizes.corners.items():
        np.testing.assert_allclose(corner, other.sizes.corners[name], atol=1e-9)
    for name in ("gap_mm", "bevel_left_deg", "bevel_right_deg", "included_deg", "depth_mm", "width_mm"):
        np.testing.assert_allclose(getattr(truth.sizes, name), getattr(other.sizes, name), atol=1e-9)


@pytest.mark.parametrize("kind", ["milled", "raw"])
def test_both_simulators_see_the_same_plate(kind: str) -> None:
    sizes = {"thickness_mm": {"start": 8, "end": 8.1}}
    if kind == "milled":
        sizes |= {"root_mm": {"start": 1.2, "end": 1.8}, "bevel_deg": {"start": 38, "end": 42, "amplitude": 0.3}}
    look = {"elevation_deg": 40, "aim_mm": [-2, 4], "oblique_deg": 5, "lead_deg": -4}
    first, truth = simulate_recording(
        parse_recipe(
            {
                "part": {"kind": kind, "length_mm": 60, "base_from_part": PLACE, **sizes},
                "passes": [{"from_mm": 3, "to_mm": 57, **look}],
                "scanner": {"columns": 400, "noise": {"sd_mm": 0}},
                "robot": {"frame_pitch_mm": 1.5},
            }
        )
    )
    document = swept_document("V")
    document["part"] = {"kind": kind, "spine": {"length_mm": 60}, "base_from_part": PLACE, "reach_mm": 150, **sizes}
    document["passes"][0] |= look
    document["scanner"]["pitch_mm"] = 0.05
    second, other = simulate_swept(parse_swept_recipe(document))
    agree(first, second)
    at = truth.position_mm[5:-5:10]
    np.testing.assert_allclose(other.at(at, other.position_mm), at, atol=1e-6)
    np.testing.assert_allclose(other.at(at, other.normal), truth.normal[5:-5:10], atol=1e-6)
    if kind == "milled":
        np.testing.assert_allclose(other.root_mm_at(at), truth.root_mm_at(at), atol=1e-4)
        np.testing.assert_allclose(other.bevel_deg_at(at), truth.bevel_deg_at(at), atol=1e-3)


def agree(first: Recording, second: Recording) -> None:
    """The same poses, and returns in the same columns but at the very ends of faces."""
    poses = [
        interpolate_poses(one.time_s, one.robot_time_s, one.robot_position_mm, one.robot_quaternion_wxyz)
        for one in (first, second)
    ]
    np.testing.assert_allclose(*poses, atol=1e-9)
    one, two = np.isfinite(first.z_mm), np.isfinite(second.z_mm)
    assert (one != two).mean() < 1e-3
    both = one & two
    assert both.mean() > 0.3
    off = np.abs(first.z_mm - second.z_mm)[both]
    assert np.mean(off > 1e-3) < 1e-3
    assert np.quantile(off, 0.99) < 5e-4


def test_a_mound_and_a_background() -> None:
    mound = {"at_mm": 30, "z_mm": 1, "half_mm": [5, 2.5, 2]}
    recording, truth = simulate_prism(parse_as(PrismRecipe, document("V", mounds=[mound], background_mm=6)))
    base, a, b = in_sections(recording, truth)
    along = truth.arc_length_mm_at(base)
    off = ((along - 30) / 5) ** 2 + (a / 2.5) ** 2 + ((b - 1) / 2) ** 2
    on = (np.abs(a) < 0.9) & (np.abs(along - 30) < 4) & (b > 0)
    assert on.sum() > 30
    assert np.abs(off[on] - 1).max() < 1e-4
    assert (np.abs(b + 6) < 1e-4).sum() > 50


def test_from_a_file_to_a_file(tmp_path: Path) -> None:
    recipe = tmp_path / "u.json"
    recipe.write_text(json.dumps(document("U")), encoding="utf-8")
    simulate_file(recipe, tmp_path / "u.h5")
    truth = json.loads((tmp_path / "u.truth.json").read_text(encoding="utf-8"))
    assert (truth["format"], truth["type"], truth["simulator"]) == ("groove-truth", "U", "analytic")
    width = 2 + 2 * (6 * math.cos(math.radians(30)) + (12 - 2 - 6 + 3) * math.tan(math.radians(30)))
    assert truth["width_mm"][0] == pytest.approx(width, abs=1e-6)


def test_refusals() -> None:
    with pytest.raises(InputError, match=r"groove\.gap: .*did you mean 'gap_mm'"):
        parse_as(PrismRecipe, document("V", gap=3))
    with pytest.raises(InputError, match="root_face_mm must stay below"):
        parse_as(PrismRecipe, document("Y", root_face_mm=11))
    with pytest.raises(InputError, match="groove 'W'"):
        random_prism_recipe("W", 1)
