"""The recordings of data/synthetic are what their recipes give."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from bench.simulators.swept import simulate_swept_file
from scripts.synthetic_data import make_library, recipes_in
from workbench.synthetic import Recipe, read_any_recipe, read_truth, truth_path

DATA = Path(__file__).parents[2] / "data" / "synthetic"
SWEPT_RECIPES = Path(__file__).parents[2] / "bench" / "simulators" / "swept" / "recipes"
RECIPES = recipes_in(DATA)


def test_every_recipe_has_its_recording_and_truth():
    names = {path.stem for path in RECIPES}
    assert names >= {
        "milled_edge",
        "milled_arc",
        "milled_edge_clamped",
        "milled_two_pass",
        "raw_edge",
        "raw_wavy",
        "sphere",
    }
    for path in RECIPES:
        assert path.with_suffix(".h5").exists()
        recipe, truth = read_any_recipe(path), truth_path(path.with_suffix(".h5"))
        if isinstance(recipe, Recipe):
            assert read_truth(truth).recipe == recipe
        else:
            assert json.loads(truth.read_text())["recipe"] == recipe.model_dump(mode="json")
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 7e6


@pytest.mark.parametrize("name", ["milled_edge", "milled_two_pass", "sphere"])
def test_recordings_are_made_anew_from_their_recipes(name, tmp_path):
    shutil.copy(DATA / f"{name}.json", tmp_path)
    made = make_library(tmp_path)
    assert made == [tmp_path / f"{name}.h5"]
    with h5py.File(made[0]) as new, h5py.File(DATA / f"{name}.h5") as old:
        for field in ("profiles/time", "profiles/x", "profiles/z", "robot/position", "robot/quaternion_wxyz"):
            assert np.allclose(new[field][:], old[field][:], rtol=0, atol=1e-4, equal_nan=True), field


@pytest.mark.parametrize("path", recipes_in(SWEPT_RECIPES), ids=lambda path: path.stem)
def test_what_the_swept_simulator_made_is_what_it_makes(path, tmp_path):
    # single precision picks the triangle that a ray meets: on another processor a return may move by 1e-4 mm
    simulate_swept_file(path, tmp_path / "made.h5")
    with h5py.File(tmp_path / "made.h5") as new, h5py.File(DATA / f"{path.stem}.h5") as old:
        for field in ("profiles/x", "profiles/z", "robot/position"):
            assert np.allclose(new[field][:], old[field][:], rtol=0, atol=5e-4, equal_nan=True), field
