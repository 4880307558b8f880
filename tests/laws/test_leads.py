"""Scans that lean along a twisted edge: one model of both, whichever way they lean."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest

from bench.simulators.swept import parse_swept_recipe, simulate_swept
from workbench import cloud, edge, scan
from workbench.artefacts import MilledEdge
from workbench.synthetic import Truth, parse_recipe, simulate_recording

DOCUMENT: dict[str, Any] = {
    "part": {"kind": "milled", "length_mm": 100, "end_face_twist_deg": 4, "table_gap_mm": 80},
    "robot": {"pose_noise_mm": 0.01, "pose_noise_deg": 0.001, "frame_pitch_mm": 0.4},
    "disturbances": {},
}
WAY = {"from_mm": 1, "to_mm": 99, "aim_mm": [-2, 4]}


@cache
def seen(elevation_deg: int, *leads_deg: int) -> tuple[MilledEdge, Truth]:
    passes = [{**WAY, "elevation_deg": elevation_deg, "lead_deg": one} for one in leads_deg]
    recording, truth = simulate_recording(parse_recipe({**DOCUMENT, "seed": 3, "passes": passes}, "leads"))
    return edge.segment(cloud.denoise(scan.fuse(recording))), truth


@pytest.mark.parametrize("elevation_deg", [-25, 20])
@pytest.mark.parametrize("leads_deg", [(15,), (15, -15)])
def test_a_lead_turns_nothing(elevation_deg: int, leads_deg: tuple[int, ...]) -> None:
    """u of the bevel is at most 1.3 times that without a lead, and errors are within 2.5 u."""
    found, truth = seen(elevation_deg, *leads_deg)
    square, _ = seen(elevation_deg, 0)
    on = found.seen
    near = np.abs(truth.position_mm[None] - found.position_mm[on][:, None]).sum(axis=2).argmin(axis=1)
    assert np.median(found.bevel.u[on]) < 1.3 * np.median(square.bevel.u[square.seen])
    for size, true in ((found.root, truth.root_mm), (found.bevel, truth.bevel_deg)):
        assert np.abs((size.value[on] - true[near]) / size.u[on]).max() < 2.5


@pytest.mark.parametrize("oblique_deg", [20, -20])
def test_an_oblique_pass_shifts_neither_the_lower_edge_nor_the_root_face(oblique_deg: int) -> None:
    """Of a twisted edge whose root face grows, so that the line of the corners is not parallel to the lower edge."""
    part = {**DOCUMENT["part"], "thickness_mm": 12, "root_mm": {"start": 2, "end": 4}}
    passes = [{**WAY, "elevation_deg": -20, "oblique_deg": oblique_deg}]
    scanner = {"noise": {"sd_mm": 0.003}}
    recipe = {**DOCUMENT, "part": part, "scanner": scanner, "robot": {}, "seed": 5, "passes": passes}
    recording, truth = simulate_recording(parse_recipe(recipe, "oblique"))
    found = edge.segment(cloud.denoise(scan.fuse(recording)))
    off = found.position_mm[found.seen] - truth.position_mm[0]
    root_mm = np.interp(off @ truth.tangent[0], truth.arc_length_mm, truth.root_mm)
    assert abs(np.mean(found.root.value[found.seen] - root_mm)) < 0.002
    assert abs(np.mean(off @ truth.across[0])) < 0.003


def test_passes_oblique_to_either_side_measure_one_preparation() -> None:
    """Of a twisted plate whose root face grows: where one of them ends, what turned it was taken for the plate's."""
    way = {"way_mm": [1, 79], "elevation_deg": 20}
    recipe = {
        "simulator": "swept",
        "seed": 9999,
        "part": {
            "spine": {"length_mm": 80},
            "preparation": "nose",
            "thickness_mm": 10,
            "root_mm": {"start": 1.5, "end": 3},
            "land_mm": 1.5,
            "twist_deg": {"start": -3, "end": 3},
        },
        "scanner": {"noise": {"sd_mm": 0.003}},
        "robot": {"frame_pitch_mm": 0.6, "pose_noise_mm": 0.003, "pose_noise_deg": 0.001},
        "passes": [{**way, "oblique_deg": 20}, {**way, "oblique_deg": -20}],
    }
    recording, truth = simulate_swept(parse_swept_recipe(recipe))
    found = edge.segment_preparation(cloud.denoise(scan.fuse(recording)))
    assert truth.preparation is not None
    for name, most in (("bevel_deg", 0.01), ("depth_mm", 0.005), ("width_mm", 0.005), ("land_mm", 0.005)):
        size, true = found.sizes[name], np.broadcast_to(truth.preparation[name], len(truth.position_mm))
        on = found.seen & np.isfinite(size.value)
        off = size.value[on] - truth.at(found.origin_mm[on], true)
        assert np.abs(off).max() < most
        assert np.abs(off / size.u[on]).max() < 2.5
