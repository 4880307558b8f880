"""A number that a shipped pipeline gives a parameter is the stage's own default: a user cannot tell the two apart."""

import json
from pathlib import Path
from typing import Any

import pytest

from workbench.pipeline.catalogue import find

PIPELINES = Path(__file__).parents[2] / "pipelines"
VARIANTS = {"compensated_loop", "compound_loop", "j_loop", "measured_loop", "sensitivity"}  # they show other values
NAMES = sorted({path.stem for path in PIPELINES.glob("*.json")} - VARIANTS)


def is_number(value: Any) -> bool:
    many = value if isinstance(value, list | tuple) else [value]
    return bool(many) and all(isinstance(one, int | float) and not isinstance(one, bool) for one in many)


@pytest.mark.parametrize("name", NAMES)
def test_a_number_that_a_pipeline_gives_is_the_stage_s_default(name: str) -> None:
    document = json.loads((PIPELINES / f"{name}.json").read_text())
    for entry in document["stages"]:
        for key, field in find(entry["stage"], name).model.model_fields.items():
            if key in entry and not field.is_required() and is_number(own := field.get_default()):
                given = entry[key]
                given = document["inputs"][given[2:-1]] if isinstance(given, str) else given
                assert given == json.loads(json.dumps(own)), f"{entry['stage']}.{key}"
