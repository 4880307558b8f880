"""Errors of a path and an edge that are made by formula, with known errors in them, are found as what they are."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from bench.drawn.plates import RAW_CONDITIONS
from bench.metrology.planning import GOALS, compare_path
from workbench.api import quaternion_from_rotation
from workbench.artefacts import Cutter, Layer, Toolpath
from workbench.synthetic import Workpiece, milled_truth, parse_recipe

BETA, ROOT = math.radians(40), 1.5


@pytest.fixture(scope="module", params=["straight", "convex", "concave"])
def truth(request):
    curve = {"shape": "straight"} if request.param == "straight" else {"shape": "arc", "sense": request.param}
    part = {"kind": "raw", "length_mm": 60, "curve": curve | {"radius_mm": 300}, "end_face_tilt_deg": 2}
    part["base_from_part"] = {"position_mm": [900, -700, 300], "rpy_deg": [100, 40, -120]}
    return milled_truth(Workpiece(parse_recipe({"part": part, "passes": [{"from_mm": 0, "to_mm": 60}]}, source="test")))


def toolpath(truth, every=2, lift_mm=0.0, turn=0.0, cutting=None, mirrored=False):
    """The finished bevel's path at every second station (1 mm), `lift_mm` above it, axis turned about x by `turn`."""
    e, t, n, m = (v[::every] for v in (truth.position_mm, truth.tangent, truth.normal, truth.across))
    m = -m if mirrored else m
    b, z = n * math.cos(BETA) + m * math.sin(BETA), n * math.sin(BETA) - m * math.cos(BETA)
    position = e + ROOT * m - 3.0 * z + lift_mm * b  # anywhere on the face
    y, z = t * math.cos(turn) + z * math.sin(turn), z * math.cos(turn) - t * math.sin(turn)
    frames = np.stack([np.cross(y, z), y, z], axis=2)
    k = len(e)
    cutting = np.ones(k, bool) if cutting is None else cutting
    layer = Layer(
        index=1,
        height_mm=0.0,
        arc_length_mm=truth.arc_length_mm[::every],
        position_mm=position,
        quaternion_wxyz=quaternion_from_rotation(frames),
        feed_mm_s=np.ones(k),
        cutting=cutting,
        measured=np.ones(k, bool),
        width_mm=np.full(k, 8.0),
    )
    return Toolpath(Cutter(), (layer,), (), ROOT, 40.0, 1.0, 1.0, float(truth.arc_length_mm[-1]))


def compared(truth, **changes):
    return compare_path(toolpath(truth, **changes), truth)


def test_a_true_path_has_no_error(truth):
    found = compared(truth)
    assert found["distance_mm"] < 0.001
    assert found["axis_deg"] < 1e-3
    assert found["spacing"] < 0.001
    assert [found[name] for name in ("lost", "reachable_lost", "wrong_side", "blind")] == [0.0, 0.0, False, 0]


def test_errors_are_found_as_large_as_they_are(truth):
    found = compared(truth, lift_mm=-0.03, turn=math.radians(0.2))
    assert found["distance_mm"] == pytest.approx(0.03, abs=0.001)
    assert found["axis_deg"] == pytest.approx(0.2, abs=0.001)
    assert compared(truth, every=4)["spacing"] == pytest.approx(1.0, abs=0.01)


def test_what_is_not_cut_is_not_covered(truth):
    cutting = np.ones(61, bool)
    cutting[20:41] = False
    found = compared(truth, cutting=cutting)
    assert found["lost"] == pytest.approx(20 / 60, abs=0.03)
    hidden = dataclasses.replace(truth, seen=np.abs(truth.arc_length_mm - 30) > 9)
    found = compared(hidden, cutting=cutting)
    assert 0 < found["lost"] < 0.1
    assert found["reachable_lost"] == 0.0
    assert compared(hidden)["blind"] > 10


def test_wrong_sides_are_wrong(truth):
    assert compared(truth, mirrored=True)["wrong_side"]
    assert compared(truth, turn=math.pi)["wrong_side"]


def test_every_raw_condition_has_its_goal():
    assert set(GOALS) == set(RAW_CONDITIONS)
