"""What a run tells of its results and writes of them."""

import json
import re
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.made import files_of
from workbench.artefacts import Document
from workbench.path import read

ROOT = Path(__file__).parents[2]


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


def test_a_path_is_told_with_its_layers_points_time_and_what_it_saves(command: Any, tmp_path: Path) -> None:
    path = read(toolpath=ROOT / "data" / "synthetic" / "paths" / "raw_arc.json")
    moves = [one for pair in zip_longest(path.travels, path.layers) for one in pair if one is not None]
    step = np.linalg.norm(np.diff(np.vstack([one.position_mm for one in moves]), axis=0), axis=1)
    time_s = (step / np.concatenate([one.feed_mm_s for one in moves])[1:]).sum()
    saved = 100 * (1 - time_s * path.v_slow_mm_s / step.sum())
    stages = [{"stage": "path.read", "toolpath": str(ROOT / "data" / "synthetic" / "paths" / "raw_arc.json")}]
    (tmp_path / "p.json").write_text(json.dumps({"version": 1, "stages": stages}))
    told = command("run", tmp_path / "p.json", "--out", tmp_path / "out").out
    layers, points = len(path.layers), sum(len(one.feed_mm_s) for one in path.layers)
    assert (
        f"path: {layers} layers, {points} points on {path.edge_length_mm:.1f} mm of edge, {time_s / 60:.1f} min" in told
    )
    assert f"({saved:.0f} % less than at {path.v_slow_mm_s:g} mm/s throughout)" in told


def test_a_file_of_a_stage_under_the_name_of_a_result_file_is_one() -> None:
    """A stranger's stage that writes another tcp.json than calibrate.tcp does not deceive whoever reads it."""
    with pytest.raises(ValueError, match="validation error"):
        files_of(Document("tcp.json", b'{"position_mm": [1, 2, 3]}'))
    assert files_of(Document("mine.json", b'{"position_mm": [1, 2, 3]}')) == {
        "mine.json": b'{"position_mm": [1, 2, 3]}'
    }
