"""Simulated grooves: returns against the exact section, sizes by type, what lies in them."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.drawn.grooves import random_groove_recipe
from bench.simulators.swept import parse_groove_recipe, simulate_groove, simulate_swept_file
from bench.simulators.swept.sweep import GROOVES
from tests.simulators.returns import base_points
from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.scan import read
from workbench.synthetic import GrooveTruth
from workbench.units import Float


def simulated(**part: Any) -> tuple[Recording, GrooveTruth]:
    """80 mm without noise, frames 1 mm apart, from straight above unless the groove has a square side."""
    return simulate_groove(parse_groove_recipe(document(**part)))


def document(**part: Any) -> dict[str, Any]:
    return {
        "simulator": "swept",
        "part": {"kind": "groove", "thickness_mm": 12, "spine": {"length_mm": 80}} | part,
        "passes": [{"way_mm": [2, 78], "elevation_deg": 86, "aim_mm": [0, 8]}],
        "scanner": {"columns": 400, "pitch_mm": 0.09, "noise": {"sd_mm": 0, "speckle": 0}, "mixed_share": 0},
        "robot": {"frame_pitch_mm": 1.0, "pose_rate_hz": 2000},
    }


def in_sections(recording: Recording, truth: GrooveTruth) -> tuple[Float, Float, Float]:
    """All returns: base points (k, 3), a and b in their sections."""
    base = base_points(recording)
    off = base - truth.at(base, truth.position_mm)
    return base, (off * truth.at(base, truth.normal)).sum(axis=1), (off * truth.at(base, truth.across)).sum(axis=1)


def between(truth: GrooveTruth, base: Float, a: Float, b: Float, first: str, last: str) -> Float:
    """Distances of the returns that lie over the face between two corners from that face."""
    start, stop = (truth.at(base, truth.sizes.corners[name]) for name in (first, last))
    way = stop - start
    width = np.linalg.norm(way, axis=1, keepdims=True)
    way /= width
    off = np.stack([a, b], axis=1) - start
    along, over = (off * way).sum(axis=1), off[:, 0] * way[:, 1] - off[:, 1] * way[:, 0]
    near = (along > 0.3) & (along < width[:, 0] - 0.3) & (np.abs(over) < 0.2)
    return np.asarray(over[near])


@pytest.mark.parametrize("groove", ["V", "Y", "X", "HV", "HY", "K"])
def test_returns_lie_on_the_flanks_and_surfaces(groove: str) -> None:
    drift = {
        "gap_mm": {"start": 2, "end": 3, "amplitude": 0.2},
        "bevel_left_deg": {"start": 30, "end": 32},
        "misalignment_mm": {"start": 0.5, "end": -0.5},
        "spine": {"shape": "arc", "radius_mm": 200, "length_mm": 80},
    }
    recording, truth = simulated(groove=groove, **drift)
    base, a, b = in_sections(recording, truth)
    flank = between(truth, base, a, b, "left_root", "left_upper")
    assert len(flank) > 1000
    assert np.abs(flank).max() < 5e-4
    if groove in "VYX":
        flank = between(truth, base, a, b, "right_root", "right_upper")
        assert len(flank) > 1000
        assert np.abs(flank).max() < 5e-4
    left = a < truth.at(base, truth.sizes.corners["left_upper"])[:, 0] - 0.2
    right = a > truth.at(base, truth.sizes.corners["right_upper"])[:, 0] + 0.2
    assert np.abs(b[left] - 12).max() < 5e-4
    assert np.abs(b[right] - 12 - truth.at(base, truth.sizes.misalignment_mm)[right]).max() < 5e-4


@pytest.mark.parametrize("groove", ["U", "J"])
def test_the_root_of_a_u_is_round(groove: str) -> None:
    recording, truth = simulated(groove=groove, root_radius_mm=4, bevel_left_deg=15, bevel_right_deg=15)
    _, a, b = in_sections(recording, truth)
    middle = np.array([-1.0, 2.0 + 4.0])  # above the root face's upper edge
    turn = np.arctan2(middle[0] - a, middle[1] - b)
    on = (turn > 0.1) & (turn < math.radians(60)) & (a < 0) & (b < 6)  # above, a footprint is bent itself
    off = np.hypot(a[on] - middle[0], b[on] - middle[1]) - 4.0
    assert on.sum() > 500
    assert np.abs(off).max() < 5e-4
    upper = truth.sizes.corners["left_upper"][0]
    foot = np.array([-1 - 4 * math.cos(math.radians(15)), 6 - 4 * math.sin(math.radians(15))])
    assert math.degrees(math.atan2(foot[0] - upper[0], upper[1] - foot[1])) == pytest.approx(15, abs=1e-6)


def test_sizes_are_those_of_the_type() -> None:
    sizes = simulated(groove="Y", gap_mm=2, bevel_left_deg=30, bevel_right_deg=35, misalignment_mm=0.5)[1].sizes
    assert sizes.included_deg[0] == pytest.approx(65)
    assert sizes.depth_mm[0] == pytest.approx(10)
    assert sizes.width_mm[0] == pytest.approx(2 + 10 * (math.tan(math.radians(30)) + math.tan(math.radians(35))))
    assert sizes.corners["right_root"][0] == pytest.approx([1, 2.5])
    none = simulated(groove="I")[1].sizes
    assert np.isnan(none.included_deg).all()
    assert np.isnan(none.depth_mm).all()
    assert none.width_mm[0] == pytest.approx(2)
    half = simulated(groove="HV", bevelled="right")[1].sizes
    assert np.isnan(half.bevel_left_deg).all()
    assert half.included_deg[0] == pytest.approx(30)
    assert np.isnan(half.root_face_right_mm).all()
    double = simulated(groove="X")[1].sizes
    assert double.depth_mm[0] == pytest.approx(12 - 4 - 2)
    assert double.corners["left_lower"][0] == pytest.approx([-1, 4])


def test_background_tacks_spatter_and_reflections_are_seen() -> None:
    base_part = {"groove": "V", "bevel_left_deg": 30}
    clean, truth = simulated(**base_part)
    assert in_sections(clean, truth)[2].min() > -0.1
    base, a, b = in_sections(*simulated(**base_part, background_mm=6))
    assert (np.abs(b + 6) < 1e-3).sum() > 100
    tack = {"at_mm": 40, "length_mm": 10, "width_mm": 5, "height_mm": 2}
    recording, truth = simulated(**base_part, tacks=[tack])
    base, a, b = in_sections(recording, truth)
    above = (np.abs(a) < 0.5) & (b > 0.5)
    along = truth.arc_length_mm_at(base[above])
    assert b[above].max() == pytest.approx(2, abs=0.05)
    assert 34.5 < along.min() < 37
    assert 43 < along.max() < 45.5
    _, a, b = in_sections(*simulated(**base_part, spatter={"per_100_mm": 60}))
    assert (b[np.abs(a) > 8.5] > 12.1).sum() > 20
    recording, truth = simulated(**base_part, reflections={"share": 0.2, "flank": "left"})
    off = (recording.z_mm - clean.z_mm)[np.isfinite(recording.z_mm) & np.isfinite(clean.z_mm)]
    assert 0.02 < (off > 0.2).mean() < 0.2
    assert off.min() > -0.5


def test_from_a_file_to_a_file(tmp_path: Path) -> None:
    recipe = tmp_path / "groove.json"
    recipe.write_text(json.dumps(document(groove="U")), encoding="utf-8")
    simulate_swept_file(recipe, tmp_path / "u.h5")
    assert read(recording=tmp_path / "u.h5").x_mm.shape == (77, 400)
    truth = json.loads((tmp_path / "u.truth.json").read_text(encoding="utf-8"))
    assert (truth["format"], truth["type"]) == ("groove-truth", "U")
    count = len(truth["arc_length_mm"])
    assert truth["root_radius_mm"] == [6.0] * count
    assert len(truth["corners"]["left_root"]["position_mm"]) == count


@pytest.mark.parametrize("groove", GROOVES)
def test_random_grooves_are_seen(groove: str) -> None:
    recipe = random_groove_recipe(groove, 5)
    assert recipe == random_groove_recipe(groove, 5)
    _, truth = simulate_groove(recipe)
    assert truth.seen.mean() > 0.8


def test_refusals() -> None:
    with pytest.raises(InputError, match=r"part\.gap: .*did you mean 'gap_mm'"):
        parse_groove_recipe(document(gap=3))
    with pytest.raises(InputError, match="root_face_left_mm must stay within"):
        parse_groove_recipe(document(groove="Y", root_face_left_mm=20))
    with pytest.raises(InputError, match="groove 'W'"):
        random_groove_recipe("W", 1)
