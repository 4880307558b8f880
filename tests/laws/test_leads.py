"""Scans that lean along a twisted edge: one model of both, whichever way they lean."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from workbench import cloud, edge, scan
from workbench.artefacts import MilledEdge
from workbench.synthetic import Truth, parse_recipe, simulate_recording

DOCUMENT: dict[str, Any] = {
    "part": {"kind": "milled", "length_mm": 100, "end_face_twist_deg": 4, "table_gap_mm": 80},
    "robot": {"pose_noise_mm": 0.01, "pose_noise_deg": 0.001},
    "disturbances": {},
}
WAY = {"from_mm": 1, "to_mm": 99, "aim_mm": [-2, 4]}


@cache
def seen(elevation_deg: int, *leads_deg: int) -> tuple[MilledEdge, Truth]:
    passes = [{**WAY, "elevation_deg": elevation_deg, "lead_deg": one} for one in leads_deg]
    recording, truth = simulate_recording(parse_recipe({**DOCUMENT, "seed": 3, "passes": passes}, "leads"))
    return edge.segment(cloud.denoise(scan.fuse(recording))), truth


@pytest.mark.parametrize("elevation_deg", [-25, 20])
@pytest.mark.parametrize("leads_deg", [(15,), (-15,), (15, -15)])
def test_a_lead_turns_nothing(elevation_deg: int, leads_deg: tuple[int, ...]) -> None:
    """u of the bevel is at most 1.3 times that without a lead, and errors are within 2.5 u."""
    found, truth = seen(elevation_deg, *leads_deg)
    square, _ = seen(elevation_deg, 0)
    on = found.seen
    near = np.abs(truth.position_mm[None] - found.position_mm[on][:, None]).sum(axis=2).argmin(axis=1)
    assert np.median(found.bevel.u[on]) < 1.3 * np.median(square.bevel.u[square.seen])
    for size, true in ((found.root, truth.root_mm), (found.bevel, truth.bevel_deg)):
        assert np.abs((size.value[on] - true[near]) / size.u[on]).max() < 2.5
