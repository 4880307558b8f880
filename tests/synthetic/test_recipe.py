"""Recipes: defaults, strictness, and errors that name place, expectation and nearest known key."""

from __future__ import annotations

import csv
import json
import re
from pathlib import Path

import pytest

from bench.simulators.swept.recipe import GrooveRecipe, SweptRecipe
from workbench.errors import InputError
from workbench.synthetic import PrismRecipe, Recipe, parse_recipe, read_any_recipe, read_recipe

PASS = {"from_mm": 0, "to_mm": 10}


def refused(document, match):
    with pytest.raises(InputError, match=match):
        parse_recipe(document)


def test_a_number_stands_for_a_constant_course():
    part = parse_recipe({"passes": [PASS], "part": {"root_mm": 2}}).part
    assert (part.root_mm.start, part.root_mm.end, part.root_mm.amplitude) == (2, 2, 0)


def test_a_recipe_survives_json():
    recipe = parse_recipe({"passes": [PASS], "part": {"curve": {"shape": "arc", "radius_mm": 300}}})
    assert parse_recipe(json.loads(recipe.model_dump_json())) == recipe


@pytest.mark.parametrize(
    ("document", "match"),
    [
        ({"passes": [PASS], "sead": 3}, r"sead: unknown key; did you mean 'seed'\?"),
        ({"passes": [PASS], "part": {"thicknes_mm": 3}}, r"part\.thicknes_mm: .*'thickness_mm'"),
        ({"passes": [PASS | {"elevation": 3}]}, r"passes\[0\]\.elevation: .*'elevation_deg'"),
        ({"passes": [PASS], "part": {"root_mm": {"start": 1, "end": 1, "amplitud": 0}}}, "'amplitude'"),
        ({"passes": [PASS], "scanner": {"noise": {"sd": 1}}}, r"scanner\.noise\.sd: .*'sd_mm'"),
        ({"passes": []}, "passes: .*1 values at least"),
        ({}, "passes: is required"),
        ({"format": "robot-cell"}, "format: expected 'bevel-recipe', this is a file of another kind: 'robot-cell'"),
        ({"passes": [PASS], "version": 2}, "version: "),
        ({"passes": [PASS], "part": {"root_mm": 9, "thickness_mm": 8}}, "root_mm must stay .* below thickness_mm"),
        ({"passes": [PASS], "part": {"bevel_deg": {"start": 1, "end": 1, "amplitude": 2}}}, "bevel_deg must stay"),
        ({"passes": [PASS | {"follow": "edge"}]}, "two_poses is a straight line"),
        ({"passes": [{"from_mm": 4, "to_mm": 4}]}, "must differ"),
        ({"passes": [PASS], "robot": {"frame_pitch_mm": 1e-6}}, "at most 1000000 frames"),
        ({"passes": [PASS], "robot": {"frame_rate_hz": 1e-3, "pose_rate_hz": 1e5}}, "5000000 poses"),
        (
            {"passes": [PASS], "part": {"curve": {"shape": "wavy", "wavelength_mm": 50}}},
            r"part\.curve: .*at least 50 mm",
        ),
        ({"passes": [PASS], "part": {"length_mm": 400, "curve": {"shape": "arc", "radius_mm": 100}}}, "3 radius_mm"),
        ({"passes": [PASS], "scanner": {"columns": 8000}}, "2 standoff_mm"),
        ({"passes": [PASS], "part": {"table_gap_mm": 1e300}}, r"part\.table_gap_mm: .*100000"),
        ({"passes": [PASS], "scanner": {"standoff_mm": 500}}, "near_mm < standoff_mm < far_mm"),
        ({"passes": [PASS], "seed": float("nan")}, "seed: "),
        ([1], "a JSON object"),
    ],
)
def test_what_is_wrong_is_named(document, match):
    refused(document, match)


def test_json_errors_name_line_and_column(tmp_path):
    path = tmp_path / "recipe.json"
    path.write_text('{"seed": 1,\n "passes": [,]}')
    with pytest.raises(InputError, match=r"recipe\.json: line 2, column 13"):
        read_recipe(path)


def test_a_recipe_of_the_swept_simulator_is_refused_with_where_it_is_read(tmp_path):
    path = tmp_path / "nose.json"
    path.write_text('{"simulator": "swept", "passes": []}')
    with pytest.raises(InputError, match=r"nose\.json: simulator: .*python -m bench\.simulators\.swept"):
        read_any_recipe(path)


def test_documentation_names_every_key_and_no_other():
    text = (Path(__file__).parents[2] / "docs" / "tables" / "simulation_keys.csv").read_text(encoding="utf-8")
    schemas = [model.model_json_schema() for model in (Recipe, PrismRecipe, SweptRecipe, GrooveRecipe)]
    keys = {key for schema in schemas for one in (schema, *schema["$defs"].values()) for key in one["properties"]}
    assert {key for key in keys if not re.search(rf"\b{key}\b", text)} == set()
    assert {key for row in csv.DictReader(text.splitlines()) for key in row["key"].split(", ")} - keys == set()
