"""Recordings in memory and as files: the contract's form, same seed same bytes, whole or not at all."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest

from workbench.errors import InputError, OutputError
from workbench.synthetic import (
    parse_recipe,
    read_truth,
    simulate_file,
    simulate_recording,
    truth_path,
    write_simulation,
)

DOCUMENT = {
    "seed": 11,
    "part_id": "a part",
    "part": {"length_mm": 70, "table_gap_mm": 20},
    "scanner": {"columns": 80, "pitch_mm": 0.3, "intensity": True},
    "disturbances": {"outlier_share": 0.01, "dropout_share": 0.01, "mixed_pixel_probability": 0.5},
    "passes": [{"from_mm": 2, "to_mm": 66}, {"from_mm": 66, "to_mm": 40, "elevation_deg": -30, "motion": "stream"}],
}


def changed(**more):
    return parse_recipe(DOCUMENT | more)


def test_file_has_the_contracts_form(tmp_path):
    write_simulation(changed(), tmp_path / "part.h5")
    with h5py.File(tmp_path / "part.h5") as file:
        attributes = {"format": "profile-recording", "version": 1, "length_unit": "mm", "time_unit": "s"}
        assert {name: file.attrs[name] for name in attributes} == attributes
        assert file.attrs["part_id"] == "a part"
        frames, columns = file["profiles/z"].shape
        assert (frames, columns) == (321 + 131, 80)
        types = {"time": "f8", "x": "f4", "z": "f4", "intensity": "u2", "pass": "i4"}
        assert {name: file["profiles"][name].dtype for name in file["profiles"]} == types
        assert not np.isinf(file["profiles/z"][:]).any()
        poses = len(file["robot/time"])
        shapes = {"time": (poses,), "position": (poses, 3), "quaternion_wxyz": (poses, 4), "pass": (poses,)}
        assert {name: file["robot"][name].shape for name in file["robot"]} == shapes
        assert np.linalg.norm(file["robot/quaternion_wxyz"][:], axis=1) == pytest.approx(1, abs=1e-12)
        assert file["hand_eye/flange_from_profiler"].shape == (4, 4)
        for index in (0, 1):
            time = file["profiles/time"][:][file["profiles/pass"][:] == index]
            pose_time = file["robot/time"][:][file["robot/pass"][:] == index]
            assert np.all(np.diff(time) > 0)
            assert pose_time[0] <= time[0] < time[-1] <= pose_time[-1]


def test_file_and_memory_hold_the_same(tmp_path, monkeypatch):
    """Blocks of frames join without a seam."""
    recipe = changed()
    monkeypatch.setattr("workbench.synthetic.scan.BLOCK_FRAMES", 50)
    recording, truth = simulate_recording(recipe)
    assert len(recording.time_s) > 50
    written = write_simulation(recipe, tmp_path / "part.h5")
    with h5py.File(tmp_path / "part.h5") as file:
        for name, value in (
            ("profiles/time", recording.time_s),
            ("profiles/x", recording.x_mm),
            ("profiles/z", recording.z_mm),
            ("profiles/intensity", recording.intensity),
            ("profiles/pass", recording.pass_index),
            ("robot/position", recording.robot_position_mm),
            ("robot/pass", recording.robot_pass),
        ):
            assert np.array_equal(file[name][:], value, equal_nan=value.dtype.kind == "f"), name
    assert np.array_equal(written.seen, truth.seen)


def test_same_recipe_same_bytes_other_seed_other_noise(tmp_path):
    names = ("one.h5", "two.h5", "other.h5")
    for name, seed in zip(names, (11, 11, 12), strict=True):
        write_simulation(changed(seed=seed), tmp_path / name)
    one, two, other = ((tmp_path / name).read_bytes() for name in names)
    assert one == two != other
    assert truth_path(tmp_path / "one.h5").read_bytes() == truth_path(tmp_path / "two.h5").read_bytes()


def test_a_truth_belongs_to_its_recording(tmp_path):
    for name, seed in (("one", 11), ("two", 12)):
        write_simulation(changed(seed=seed), tmp_path / f"{name}.h5")
    read_truth(tmp_path / "one.truth.json")
    (tmp_path / "one.h5").replace(tmp_path / "two.h5")
    with pytest.raises(InputError, match=r"two\.truth\.json: recording_sha256: expected the digest of two\.h5"):
        read_truth(tmp_path / "two.truth.json")


def test_command_reads_the_recipe_and_tells_progress(tmp_path):
    path, told = tmp_path / "part.json", []
    path.write_text(json.dumps(DOCUMENT))
    simulate_file(path, tmp_path / "part.h5", progress=lambda done, total: told.append((done, total)))
    assert told[-1] == (452, 452)
    assert sorted(p.name for p in tmp_path.iterdir()) == ["part.h5", "part.json", "part.truth.json"]
    truth = json.loads((tmp_path / "part.truth.json").read_text())
    assert truth["recipe"]["part"]["length_mm"] == 70


def test_an_interrupted_run_leaves_nothing(tmp_path):
    def interrupt(done, total):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_simulation(changed(), tmp_path / "part.h5", progress=interrupt)
    assert not list(tmp_path.iterdir())


def test_unusable_arguments_are_refused(tmp_path):
    with pytest.raises(OutputError, match=r"part\.h5"):
        write_simulation(changed(), tmp_path / "no folder" / "part.h5")
    with pytest.raises(InputError):
        simulate_file(tmp_path / "no.json", tmp_path / "part.h5")
    assert not list(tmp_path.iterdir())


def test_neither_folders_nor_the_recipe_are_overwritten(tmp_path):
    recipe = tmp_path / "part.truth.json"
    recipe.write_text(json.dumps(DOCUMENT))
    (tmp_path / "folder.h5").mkdir()
    for out, match in (
        ("part.truth.json", "ending in .h5"),
        ("values.csv", "ending in .h5"),
        ("part.h5", "overwrite"),
        ("folder.h5", "folder"),
    ):
        with pytest.raises(OutputError, match=match):
            simulate_file(recipe, tmp_path / out)
    assert json.loads(recipe.read_text()) == DOCUMENT
    assert sorted(path.name for path in tmp_path.iterdir()) == ["folder.h5", "part.truth.json"]
