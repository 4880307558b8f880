"""Small hostile recordings, and what a run on one left behind."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import pytest

from workbench.scan import write
from workbench.synthetic import parse_recipe, simulate_recording

ROOT = Path(__file__).resolve().parents[2]
SCANNED: dict[str, Any] = {
    "format": "bevel-recipe",
    "version": 1,
    "seed": 5,
    "robot": {"frame_pitch_mm": 0.5},
    "scanner": {"columns": 400},
    "part": {"kind": "milled", "length_mm": 40.0},
    "passes": [{"from_mm": 2.0, "to_mm": 38.0}],
}


@pytest.fixture(scope="session")
def part_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The recording of a small part."""
    path = tmp_path_factory.mktemp("milled") / "part.h5"
    write(simulate_recording(parse_recipe(SCANNED))[0], path)
    return path


@pytest.fixture
def hostile_part(part_file: Path, tmp_path: Path) -> Callable[..., Path]:
    """`hostile_part(name, file_name)`: a recording that carries a text wherever it may carry one."""

    def make(name: str, file_name: str = "part.h5") -> Path:
        path = tmp_path / file_name
        path.write_bytes(part_file.read_bytes())
        with h5py.File(path, "r+") as file:
            for key in ("part_id", "sensor", "robot", name[:60].replace("\x00", " ")):
                file.attrs[key] = name.replace("\x00", " ")
        return path

    return make


@pytest.fixture
def pipeline_file(tmp_path: Path) -> Callable[..., Path]:
    """`pipeline_file(stage, ..., title=...)`: a pipeline of these stages."""

    def make(*stages: dict[str, Any], title: str = "t", **inputs: Any) -> Path:
        path = tmp_path / "pipeline.json"
        path.write_text(json.dumps({"version": 1, "title": title, "inputs": inputs, "stages": stages}))
        return path

    return make
