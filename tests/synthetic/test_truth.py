"""Truth: frames, lookups by position, what was seen, and the file that holds it."""

from __future__ import annotations

import json

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.synthetic import Workpiece, milled_truth, parse_recipe, read_truth, simulate_recording

PART = {
    "length_mm": 60,
    "root_mm": {"start": 1.2, "end": 1.8},
    "bevel_deg": {"start": 38, "end": 41},
    "end_face_tilt_deg": 3,
    "base_from_part": {"position_mm": [1300, -700, 900], "rpy_deg": [130, 40, -70]},
}
SCAN = {"from_mm": 10, "to_mm": 50}
CURVES = ({}, {"shape": "arc", "radius_mm": 300, "sense": "concave"}, {"shape": "wavy", "wavelength_mm": 100})


def recipe_of(part=None, **more):
    return parse_recipe({"part": PART | (part or {}), "passes": [SCAN], "scanner": {"columns": 200}} | more)


@pytest.mark.parametrize("curve", CURVES)
def test_frames_are_orthonormal_and_t_is_m_cross_n(curve):
    truth = milled_truth(Workpiece(recipe_of({"curve": curve})))
    assert np.abs(np.cross(truth.across, truth.normal) - truth.tangent).max() < 1e-12
    for axis in (truth.tangent, truth.normal, truth.across):
        assert np.abs(np.linalg.norm(axis, axis=1) - 1).max() < 1e-12
    steps, lengths = np.diff(truth.position_mm, axis=0), np.diff(truth.arc_length_mm)
    assert np.all(lengths > 0.45)
    assert np.abs(np.linalg.norm(steps, axis=1) - lengths).max() < 1e-4
    assert np.all(np.sum(steps * truth.tangent[:-1], axis=1) > 0.999 * lengths)


def test_seen_is_what_the_scan_covered():
    _, truth = simulate_recording(recipe_of())
    covered = (truth.arc_length_mm > 10.5) & (truth.arc_length_mm < 49.5)
    assert truth.seen[covered].all()
    assert not truth.seen[(truth.arc_length_mm < 9) | (truth.arc_length_mm > 51)].any()
    assert np.array_equal(truth.seen_at(truth.position_mm), truth.seen)
    assert not truth.seen_at(truth.position_mm[0] - 5 * truth.tangent[0])


def test_a_raw_edge_has_neither_root_nor_bevel():
    _, truth = simulate_recording(recipe_of({"kind": "raw"}))
    assert np.isnan(truth.root_mm).all()
    assert np.isnan(truth.bevel_deg_at(truth.position_mm)).all()
    assert set(truth.document()["root_mm"]) == {None}
    assert truth.seen.mean() > 0.6


def test_file_gives_the_truth_back(tmp_path):
    _, truth = simulate_recording(recipe_of({"curve": CURVES[2]}, seed=9))
    path = tmp_path / "part.truth.json"
    path.write_text(json.dumps(truth.document(), allow_nan=False))
    again, document = read_truth(path), json.loads(path.read_text())
    assert np.array_equal(again.seen, truth.seen)
    assert np.array_equal(again.position_mm, truth.position_mm)
    assert again.recipe == truth.recipe
    assert (document["format"], document["version"], document["seed"]) == ("bevel-truth", 1, 9)
    assert np.abs(np.array(document["position_mm"]) - truth.position_mm).max() < 1e-8


@pytest.mark.parametrize("content", ["{", "[]", '{"format": "bevel-truth", "version": 2}', None])
def test_what_is_no_truth_file_is_refused(tmp_path, content):
    path = tmp_path / "part.truth.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=r"part\.truth\.json"):
        read_truth(path)
