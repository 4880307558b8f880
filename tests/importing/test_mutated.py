"""Every importer on damaged files: a recording, or one line that names the file; nothing else."""

from __future__ import annotations

import json
import random
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bench.fuzz.mutate import mutated
from tests.importing import makers
from tests.importing.conftest import MAPPING, poses_part, profiles_part, write_poses, write_profiles
from tests.importing.test_times import some_frames
from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.importing.command import import_files
from workbench.scan.read import read

AXIS = {"linear_axis": {"direction": [0, 1, 0], "speed_mm_s": 50}}
PITCH = {"times": {"source": "pose_each", "pitch_mm": makers.STEP_MM}}
Cell = tuple[Callable[..., Path], dict[str, Any]]
KINDS: dict[str, Cell] = {
    "scancontrol": (makers.write_scancontrol, AXIS),
    "gocator": (makers.write_gocator, AXIS),
    "gopxl": (makers.write_gopxl, {**AXIS, **PITCH}),
}


def outcome(sources: list[Path], damaged: Path, mapping: Path, out: Path) -> bool:
    """Whether a recording was made, and one that can be read; else one line naming a source, and no file."""
    out.unlink(missing_ok=True)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            import_files(sources, out, mapping)
    except InputError as error:
        line = str(error)
    else:
        read(recording=out)
        return True
    assert line.isprintable(), line
    assert str(damaged) in line or any(str(source) in line for source in sources), line
    assert not list(out.parent.glob(f"{out.name}*")), "something half-written was left"
    return False


def tried(folder: Path, clean: list[Path], which: int, mapping: dict[str, Any], count: int, seed: int) -> int:
    """How many of `count` mutations of one of the sources still gave a recording."""
    rng, content = random.Random(seed), clean[which].read_bytes()
    made = folder / "map.json"
    made.write_text(json.dumps({**MAPPING, **mapping}))
    assert outcome(clean, clean[which], made, folder / "out.h5"), "the undamaged file is good"
    good = 0
    for _ in range(count):
        clean[which].write_bytes(mutated(content, clean[which].suffix, rng))
        good += outcome(clean, clean[which], made, folder / "out.h5")
    return good


@pytest.mark.parametrize("kind", KINDS)
def test_makers_files(kind: str, tmp_path: Path, count: int, seed: int) -> None:
    write, mapping = KINDS[kind]
    paths = [write(tmp_path / "a.dat")]
    if PITCH.items() <= mapping.items():  # one frame a file
        paths.append(write(tmp_path / "b.dat"))
    assert tried(tmp_path, paths, 0, mapping, count, seed) < count


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize("convention", ["quaternion_wxyz", "kuka_abc"])
def test_tables(which: int, convention: str, tmp_path: Path, milled: Recording, count: int, seed: int) -> None:
    light = some_frames(milled, slice(0, 300, 60))
    paths = [write_profiles(tmp_path / "scan.csv", light), write_poses(tmp_path / "robot.csv", light, convention)]
    mapping = {"profiles": profiles_part(), "poses": poses_part(convention)}
    assert tried(tmp_path, paths, which, mapping, count, seed) < count


@pytest.fixture(params=[pytest.param((25, 3), id="few"), pytest.param((1000, 4), id="many", marks=pytest.mark.slow)])
def effort(request: pytest.FixtureRequest) -> tuple[int, int]:
    return request.param  # type: ignore[no-any-return]


@pytest.fixture
def count(effort: tuple[int, int]) -> int:
    return effort[0]


@pytest.fixture
def seed(effort: tuple[int, int]) -> int:
    return effort[1]
