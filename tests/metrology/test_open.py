"""The open benchmark: sets by key, files that say the same in every format, methods behind one interface."""

import hashlib
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bench.open.rivals import FROZEN, NAMES, rival
from bench.open.table import table
from bench.open.tracks import SETS, TRACKS, arrays, drawn, entries, keys, rounds, truth, write
from bench.score.parts import Part, part
from workbench.result_files import SubmissionFile, TruthFile
from workbench.score.judge import judged
from workbench.score.scorer import compare


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("open")


@pytest.fixture(scope="module")
def plain(folder: Path) -> Part:
    return part("outside", "sharp", 3, folder)


@pytest.mark.parametrize("track", TRACKS)
def test_a_key_draws_a_set_and_no_other(track: str) -> None:
    sets = [entries(track, chosen, key) for chosen, key in keys("2026.1").items()]
    assert [len(some) for some in sets] == list(SETS.values())
    assert sets[1] == entries(track, "blind", keys("2026.1")["blind"])
    assert not {one.seed for one in sets[1]} & {one.seed for one in entries(track, "blind", "another")}
    assert {one.simulator for some in sets for one in some} == set(TRACKS[track])
    odd = sum(one.group == "odd" for some in sets for one in some)
    assert odd == (7 if track == "milled" else 0)


def test_published_digests_are_those_of_the_keys_and_a_sealed_round_has_none() -> None:
    for version, known in rounds().items():
        assert len(bytes.fromhex(known["key_sha256"])) == 32
        assert (known["key"] is None) == (known["opened"] is None)
        if known["key"] is None:
            assert set(keys(version)) == {"practice"}
            with pytest.raises(ValueError, match="not the key"):
                keys(version, "guessed")
        else:
            assert hashlib.sha256(known["key"].encode()).hexdigest() == known["key_sha256"]


def test_every_format_says_the_same(folder: Path, plain: Part) -> None:
    write(folder / "out", {"one": plain}, ("h5", "npz", "csv"))
    columns = arrays(folder / "out" / "one.h5")
    with np.load(folder / "out" / "one.npz") as packed:
        for name, column in columns.items():
            np.testing.assert_array_equal(packed[name], column)
    rows = np.loadtxt(folder / "out" / "one.profiles.csv", delimiter=",", skiprows=1)
    frame, column = rows[:, 0].astype(int), rows[:, 3].astype(int)
    assert len(rows) == np.isfinite(columns["profiles_z"]).sum()
    assert rows[:, 5] == pytest.approx(columns["profiles_z"][frame, column], abs=1e-4)
    poses = np.loadtxt(folder / "out" / "one.poses.csv", delimiter=",", skiprows=1)
    assert poses[:, 2:5] == pytest.approx(columns["robot_position"], abs=1e-4)
    assert json.loads((folder / "out" / "declared.json").read_text())["one"]["kind"] == "milled"
    path = folder / "truth.json"
    path.write_text(json.dumps(truth("2026.1", "milled", "practice", {"one": plain})))
    assert TruthFile.read(path).recordings.keys() == {"one"}


@pytest.mark.parametrize("name", NAMES)
def test_every_method_measures_a_plain_part(name: str, plain: Part, tmp_path: Path) -> None:
    method = rival(name)
    answer = dict(method.measure(plain.recording, plain.declared))
    head = {"format": "edge-benchmark-submission", "version": 1, "method": method.title, "track": "milled"}
    document = head | {"recordings": {"one": answer}}
    (tmp_path / "s.json").write_text(json.dumps(document))
    SubmissionFile.read(tmp_path / "s.json")
    found = compare(plain.truth, answer)
    assert np.median(np.abs(found["root_mm"].error)) < 0.15  # a wrong face or end is off by more
    assert np.median(np.abs(found["bevel_deg"].error)) < 1.0
    card = judged(document, truth("2026.1", "milled", "practice", {"one": plain}))
    assert table({"milled": [card]}).count(f"| {method.title} |") == 1


@pytest.mark.parametrize("simulator", TRACKS["hand_eye"])
def test_spheres_of_every_simulator_have_their_pose(simulator: str, folder: Path) -> None:
    for seed in (2, 3):  # ordinary ones
        one = part(simulator, "sphere", seed, folder)
        found = compare(one.truth, rival("product").measure(one.recording, one.declared))
        for name in ("translation_mm", "rotation_deg"):
            assert np.max(np.abs(found[name].error) / found[name].u) < 4.5  # of six values


def test_kept_results_are_of_the_recordings_of_their_round() -> None:
    for path in FROZEN.glob("*.json"):
        found: Any = SubmissionFile.read(path)
        names = {one.name for chosen, key in keys("2026.1").items() for one in entries(found.track, chosen, key)}
        assert found.recordings.keys() == names


def test_what_is_declared_of_a_group_is_told(folder: Path) -> None:
    sharp = next(one for one in entries("hand_eye", "practice", "k") if one.simulator == "sections")
    assert drawn(sharp, folder).declared["kind"] == "sphere"
