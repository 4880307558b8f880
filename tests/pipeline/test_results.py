"""Result files: a milling path as the contract's JSON, and nothing that is not JSON."""

import json
import re
from pathlib import Path
from typing import Any

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
