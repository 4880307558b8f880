"""Recipes: defaults, strictness, and errors that name place, expectation and nearest known key."""

from __future__ import annotations

import json

import pytest

from workbench.errors import InputError
from workbench.synthetic import parse_recipe, read_recipe

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
        ({"passes": [PASS], "sead": 3}, r"sead: no such key; did you mean 'seed'\?"),
        ({"passes": [PASS], "part": {"thicknes_mm": 3}}, r"part\.thicknes_mm: .*'thickness_mm'"),
        ({"passes": [PASS | {"elevation": 3}]}, r"passes\[0\]\.elevation: .*'elevation_deg'"),
        ({"passes": [PASS], "part": {"root_mm": {"start": 1, "end": 1, "amplitud": 0}}}, "'amplitude'"),
        ({"passes": [PASS], "scanner": {"noise": {"sd": 1}}}, r"scanner\.noise\.sd: .*'sd_mm'"),
        ({"passes": []}, "passes: .*at least 1"),
        ({}, "passes: Field required"),
        ({"passes": [PASS], "version": 2}, "version: "),
        ({"passes": [PASS], "part": {"root_mm": 9, "thickness_mm": 8}}, "root_mm must stay .* below thickness_mm"),
        ({"passes": [PASS], "part": {"bevel_deg": {"start": 1, "end": 1, "amplitude": 2}}}, "bevel_deg must stay"),
        ({"passes": [PASS | {"follow": "edge"}]}, "two_poses is a straight line"),
        ({"passes": [{"from_mm": 4, "to_mm": 4}]}, "must differ"),
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


def test_missing_and_binary_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="readable recipe"):
        read_recipe(tmp_path / "none.json")
    (tmp_path / "binary.json").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(InputError, match="UTF-8"):
        read_recipe(tmp_path / "binary.json")
