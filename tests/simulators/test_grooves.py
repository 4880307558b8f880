"""Simulated grooves: returns against the exact section, sizes by type, what lies in them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.drawn.grooves import random_groove_recipe
from bench.simulators.swept import parse_groove_recipe, simulate_groove
from bench.simulators.swept.sweep import GROOVES
from tests.simulators.returns import in_sections
from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.synthetic import GrooveTruth


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
