"""A raw part from a recipe file; anything else is refused."""

from __future__ import annotations

import pytest

from tests.twin.conftest import raw_recipe
from workbench.errors import InputError
from workbench.twin import part


def test_a_raw_recipe_becomes_a_workpiece(tmp_path):
    path = tmp_path / "raw.json"
    path.write_text(raw_recipe().model_dump_json())
    workpiece = part(recipe=path)
    assert workpiece.recipe == raw_recipe()
    assert workpiece.cut is None


def test_a_milled_part_is_refused(tmp_path):
    path = tmp_path / "milled.json"
    path.write_text(raw_recipe({"kind": "milled"}).model_dump_json())
    with pytest.raises(InputError, match=r"milled\.json: part\.kind: 'raw'.*not 'milled'"):
        part(recipe=path)


def test_what_is_no_recipe_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"gone\.json"):
        part(recipe=tmp_path / "gone.json")
