"""Damaged bags, seeded: every one is read or refused in one line, and none crashes, hangs or warns."""

import random
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.fuzz.mutate import mutated
from tests.importing.bag_files import CLOUD, KINDS, LZ4, POSE, TF, TRANSFORM, ZSTD, Entry, Kind, Ros
from workbench.errors import InputError
from workbench.importing import bags
from workbench.importing.mapping import Mapping

MUTATIONS = 60  # of each kind of bag
BAG = {"poses": "/flange", "flange_frame": "tool0", "profiler_frame": "laser"}
MAPPING = Mapping.model_validate({"format": "import-mapping", "version": 1, "bag": BAG})


def small_bag(path: Path, kind: Kind, compressed: bool) -> Path:
    """Two profiles, two poses, a fixed frame."""
    ros, x, q = Ros(kind), np.linspace(-0.01, 0.01, 6).astype("f4"), np.array([1.0, 0, 0, 0])
    entries: list[Entry] = [("/tf_static", TF, 0, ros.tf(ros.pose(TRANSFORM, 0.0, np.ones(3), q, "tool0", "laser")))]
    for k in range(2):
        entries.append(("/profiles", CLOUD, k, ros.cloud(1.0 + k, {"x": x, "z": x + np.float32(0.2)})))
        entries.append(("/flange", POSE, k, ros.pose(POSE, 1.0 + k, np.array([1.0, 0.01 * k, 1.0]), q)))
    return ros.write(path, entries, {"mcap": ZSTD, "rosbag1": LZ4}.get(kind, ()) if compressed else ())


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_bags(tmp_path: Path, kind: Kind) -> None:
    damage(tmp_path, kind, 0, MUTATIONS, compressed=False)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(1, 21))
@pytest.mark.parametrize("kind", KINDS)
def test_many_damaged_bags(tmp_path: Path, kind: Kind, seed: int) -> None:
    damage(tmp_path, kind, seed, 300, compressed=seed % 2 == 0)


def damage(folder: Path, kind: Kind, seed: int, count: int, *, compressed: bool) -> None:
    """Read `count` damaged bags; some damage lies within the numbers, some does not."""
    path = small_bag(folder / ("b.bag" if kind == "rosbag1" else "b"), kind, compressed)
    rng = random.Random(seed)
    files = [path] if path.is_file() else sorted(path.iterdir())
    contents = {file: file.read_bytes() for file in files}
    assert refusal(path) is None
    refusals = []
    for _ in range(count):
        file = rng.choice(files)
        file.write_bytes(mutated(contents[file], ".bag", rng))
        refusals.append(refusal(path))
        file.write_bytes(contents[file])
    said = [text for text in refusals if text is not None]
    assert 0 < len(said) < count
    assert all(text.startswith(str(path)) and len(text.splitlines()) == 1 for text in said)


def refusal(path: Path) -> str | None:
    """What is said of a bag that is refused; of one that is read, what came out has the form of a recording's parts."""
    try:
        found = bags.read(path, MAPPING)
    except InputError as error:
        return str(error)
    values: list[Any] = []
    if found.profiles is not None:
        assert found.profiles.x_mm.shape == found.profiles.z_mm.shape
        values += [np.nan_to_num(found.profiles.x_mm, posinf=np.inf), found.profiles.time_s]
    if found.poses is not None:
        values += [found.poses.position_mm, found.poses.quaternion_wxyz, found.poses.time_s]
    assert all(np.isfinite(value).all() for value in values)
    return None
