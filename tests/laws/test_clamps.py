"""A clamp hides a stretch of the edge; what is seen beside it is measured as elsewhere, from every view."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from tests.seldom import seldom
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.scan import fuse
from workbench.synthetic import parse_recipe, simulate_recording

ROOT_MM, BEVEL_DEG = 2.43, 34.2


def clamped(from_mm: float, lead_deg: float) -> Any:
    """60 mm of an arc seen from below with a lead, and square to its root face, past a clamp of 19 mm."""
    clamp = {"from_mm": from_mm, "to_mm": from_mm + 19.0, "reach_in_mm": 40.0, "reach_out_mm": 5.9, "height_mm": 12.0}
    views = [{"elevation_deg": -34.8, "lead_deg": lead_deg}, {"elevation_deg": 0.0}]
    document = {
        "format": "bevel-recipe",
        "version": 1,
        "seed": 1,
        "part": {
            "kind": "milled",
            "length_mm": 60.0,
            "curve": {"shape": "arc", "radius_mm": 800.0},
            "thickness_mm": 7.64,
            "root_mm": ROOT_MM,
            "bevel_deg": BEVEL_DEG,
            "clamps": [clamp],
        },
        "scanner": {
            "columns": 1280,
            "pitch_mm": 0.0191,
            "standoff_mm": 150.0,
            "baseline_mm": -70.0,
            "near_mm": 115.0,
            "far_mm": 185.0,
        },
        "robot": {"pose_noise_mm": 0.01, "pose_noise_deg": 0.001},
        "disturbances": {"dropout_share": 0.003, "outlier_share": 0.002},
        "passes": [{"from_mm": 0.0, "to_mm": 60.0, **view} for view in views],
    }
    return simulate_recording(parse_recipe(document, "a clamped part"))


@pytest.mark.parametrize(("from_mm", "lead_deg"), [(20.1, -15.0), *seldom((20.2, 15.0))])
def test_two_views_past_a_clamp_are_one_edge(from_mm: float, lead_deg: float) -> None:
    """A frame in which clamp and root face make a corner, or faces side by side in a plane, is taken for no edge."""
    recording, _ = clamped(from_mm, lead_deg)
    edge = segment(denoise(fuse(recording)), root_nominal_mm=ROOT_MM, bevel_nominal_deg=BEVEL_DEG)
    seen = edge.seen
    assert edge.arc_length_mm[-1] == pytest.approx(60.0, abs=1.5)
    assert seen.mean() > 0.55
    assert np.median(edge.root.u[seen]) < 0.01
    assert edge.root.u[seen].max() < 0.3
    assert np.abs(edge.root.value[seen] - ROOT_MM).max() < 0.03
    assert np.abs(edge.bevel.value[seen] - BEVEL_DEG).max() < 0.2
