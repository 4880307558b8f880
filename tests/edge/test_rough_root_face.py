"""Milled edges of raw plates whose root face stays rough: which direction the bevel angle counts from, and its u."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from bench.drawn.swept import random_swept_recipe
from bench.simulators.swept import simulate_swept
from tests.seldom import seldom
from workbench import cloud, edge, inspect, scan
from workbench.synthetic import parse_recipe, simulate_recording


def inspected(seed: int, roughness_mm: float, *burrs: dict[str, Any]) -> tuple[Any, Any]:
    """Inspection and truth of 120 mm of an edge whose root face is rough."""
    recording, truth = simulate_recording(
        parse_recipe(
            {
                "format": "bevel-recipe",
                "version": 1,
                "seed": seed,
                "part": {"kind": "milled", "length_mm": 120, "roughness_mm": roughness_mm, "burrs": burrs},
                "robot": {"frame_pitch_mm": 0.6},
                "passes": [{"from_mm": 1, "to_mm": 119, "elevation_deg": 40, "lead_deg": 3}],
            }
        )
    )
    return inspect.sections(edge.segment(cloud.denoise(scan.fuse(recording)))), truth


@pytest.mark.parametrize(("seed", "roughness_mm"), [(102, 0.2), *seldom((101, 0.1), (103, 0.3))])
def test_a_rough_face_is_known_as_well_as_it_turns(seed: int, roughness_mm: float) -> None:
    """Its direction turns by degrees from place to place; the smooth face's bevel angle lies within 3 u everywhere."""
    inspection, truth = inspected(seed, roughness_mm)
    at = np.array([section.origin_mm for section in inspection.sections])
    off = np.array([section.values["bevel_deg"] for section in inspection.sections]) - truth.bevel_deg_at(at)
    u = np.array([section.values["bevel_u_deg"] for section in inspection.sections])
    assert np.abs(off / u).max() < 3.0
    assert np.median(u) < 12.0 * roughness_mm  # deg: no more than its waves can turn a face of 1.5 mm
    root = np.array([section.values["root_mm"] for section in inspection.sections]) - truth.root_mm_at(at)
    assert np.abs(root / np.array([section.values["root_u_mm"] for section in inspection.sections])).max() < 3.0


def test_beside_burrs_a_rough_face_is_known_as_well() -> None:
    burrs = [
        {"edge": "lower", "from_mm": at, "to_mm": at + 22.0, "height_mm": 0.15, "width_mm": 0.2}
        for at in (5.0, 45.0, 85.0)
    ]
    inspection, truth = inspected(102, 0.2, *burrs)
    for section in inspection.sections:
        found = section.sizes["bevel_deg"]
        assert abs(found.value - truth.bevel_deg_at(section.origin_mm)) < 3.0 * found.u


def test_a_smooth_face_has_no_such_u() -> None:
    inspection, _ = inspected(104, 0.0)
    assert max(section.values["bevel_u_deg"] for section in inspection.sections) < 0.1


def test_the_end_of_a_hollow_face_turns_it() -> None:
    """A sagitta of 0.03 mm, and 0.1 mm of the end that may be rounded: 0.21 deg off at 4.5 u."""
    recording, truth = simulate_swept(random_swept_recipe("swept_bowed", 17930003))
    for section in inspect.sections(edge.segment(cloud.denoise(scan.fuse(recording)))).sections:
        found = section.sizes["bevel_deg"]
        assert abs(found.value - truth.bevel_deg_at(section.origin_mm)) < 2.0 * found.u
