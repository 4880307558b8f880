"""Result files: a milling path as the contract's JSON, and nothing that is not JSON."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made import files_of
from workbench.artefacts import Cutter, Engagement, Layer, LayerEngagement, Rework, Stretch, Toolpath, Travel
from workbench.result_files import RESULT_FILES

ROOT = Path(__file__).parents[2]


def layer(index: int, height_mm: float) -> Layer:
    turn = np.tile([0.5, 0.5, -0.5, 0.5], (3, 1))
    place = np.array([[-1.0, 0, height_mm], [0, 0, height_mm], [1, 0, height_mm]])
    return Layer(
        index,
        height_mm,
        np.array([-1.0, 0, 1]),
        place,
        turn,
        np.array([20.0, 1, 1]),
        np.array([False, True, False]),
        np.array([True, True, False]),
        np.array([0.0, 4, 0]),
    )


@pytest.fixture
def path() -> Toolpath:
    travel = Travel(np.zeros((1, 3)), np.array([[1.0, 0, 0, 0]]), np.array([20.0]))
    return Toolpath(Cutter(), (layer(1, 1.0), layer(2, 0.0)), (travel,) * 3, 1.5, 40.0, 1.0, 1.0, 1.0)


def test_a_path_has_the_contracts_keys(path: Toolpath) -> None:
    document = json.loads(files_of(path)["toolpath.json"])
    assert (document["format"], document["version"], document["frame"]) == ("bevel-toolpath", 1, "base")
    assert document["cutter"]["diameter_mm"] == 10
    assert document["cutter"]["flutes"] == 4
    assert [one["index"] for one in document["layers"]] == [1, 2]
    assert document["layers"][0]["points"][1] == {
        "arc_length_mm": 0.0,
        "position_mm": [0.0, 0.0, 1.0],
        "quaternion_wxyz": [0.5, 0.5, -0.5, 0.5],
        "feed_mm_s": 1.0,
        "cutting": True,
        "measured": True,
        "width_mm": 4.0,
    }
    assert "base_from_workobject" not in document
    assert len(document["travels"]) == 3


def test_a_path_in_a_work_object_says_where_that_is(path: Toolpath) -> None:
    moved = Toolpath(path.cutter, path.layers, path.travels, 1.5, 40.0, 1.0, 1.0, 1.0, base_from_workobject=np.eye(4))
    document = json.loads(files_of(moved)["toolpath.json"])
    assert document["frame"] == "workobject"
    assert document["base_from_workobject"] == np.eye(4).tolist()


def test_rework_and_engagement(path: Toolpath) -> None:
    engagement = Engagement((LayerEngagement(1, *(np.array([0.0, np.nan]),) * 4),))
    rework = Rework(path, (Stretch(3.0, 9.5, "root 2.1 mm"),), (), "one stretch to mill again")
    files = {name: json.loads(content) for name, content in files_of(path, engagement, rework).items()}
    assert files["engagement.json"]["layers"][0]["chip_area_mm2"] == [0.0, None]
    assert set(files["engagement.json"]["part"]) >= {"part_id", "drawing", "simulated"}
    assert RESULT_FILES["engagement.json"].model_validate(files["engagement.json"]).part is not None
    assert files["rework.json"]["too_much_material"] == [{"from_mm": 3.0, "to_mm": 9.5, "reason": "root 2.1 mm"}]
    assert files["rework.json"]["toolpath"] == files["toolpath.json"]
    nothing = Rework(None, (), (), "nothing to rework")
    assert json.loads(files_of(nothing)["rework.json"])["toolpath"] is None


def test_inspections_on_the_way_are_told_in_a_line_with_their_name(command: Any, tmp_path: Path) -> None:
    otherwise = {"write": False, "root_nominal_mm": 1.0, "root_tolerance_mm": [-0.1, 0.1]}
    stages = [
        {"stage": "scan.read", "recording": str(ROOT / "data" / "synthetic" / "milled_edge.h5")},
        {"stage": "scan.fuse"},
        {"stage": "edge.segment"},
        {"stage": "inspect.sections", "id": "first", **otherwise},
        {"stage": "inspect.gate", "id": "first_check"},
        {"stage": "inspect.sections", "id": "last"},
        {"stage": "inspect.gate", "id": "last_check"},
    ]
    (tmp_path / "p.json").write_text(json.dumps({"version": 1, "stages": stages}))
    ended = command("run", tmp_path / "p.json", "--out", tmp_path / "out")
    told = ended.out
    assert ended.status == 1, ended.err
    assert re.search(r"first: root face 1\.4\d\d to 1\.[56]\d\d mm, .*; as a finished part: fail", told)
    assert told.count("\npart: ") == 1
    assert "gate first_check: rejected" in told
    assert "gate last_check: passed" in told
