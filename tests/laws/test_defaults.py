"""A number that a shipped pipeline gives a parameter is the stage's own default: a user cannot tell the two apart."""

import json
from pathlib import Path
from typing import Any

import pytest

from workbench import Pipeline
from workbench.errors import PipelineError

PIPELINES = Path(__file__).parents[2] / "pipelines"
VARIANTS = {"compensated_loop", "compound_loop", "j_loop", "measured_loop", "sensitivity"}  # they show other values
NAMES = sorted({path.stem for path in PIPELINES.glob("*.json")} - VARIANTS)


def is_number(value: Any) -> bool:
    many = value if isinstance(value, list | tuple) else [value]
    return bool(many) and all(isinstance(one, int | float) and not isinstance(one, bool) for one in many)


@pytest.mark.parametrize("name", NAMES)
def test_a_number_that_a_pipeline_gives_is_the_stage_s_default(name: str) -> None:
    document = json.loads((PIPELINES / f"{name}.json").read_text())
    for k, step in enumerate(Pipeline(document, base_dir=PIPELINES).plan().steps):
        for key in filter(lambda key: is_number(step.parameters[key]), step.given):
            stages = [one | {} for one in document["stages"]]
            del stages[k][key]
            try:
                alone = Pipeline(document | {"stages": stages}, base_dir=PIPELINES).plan().steps[k].parameters[key]
            except PipelineError:  # it has none
                continue
            assert alone in (None, step.parameters[key]), f"{step.id}.{key}"


@pytest.mark.parametrize(
    "name", ["closed_loop", *(f"inspect_{one}" for one in ("bevel", "groove", "preparation")), "plan_bevel"]
)
def test_what_no_recording_shows_can_be_said_of_every_edge_that_is_judged_or_milled(name: str) -> None:
    document = json.loads((PIPELINES / f"{name}.json").read_text())
    edges = [step for step in document["stages"] if step["stage"].startswith("edge.segment")]
    said = {key: f"${{{key}}}" for key in ("edge_condition", "sensor", "robot_noise_mm", "robot_noise_length_mm")}
    assert edges
    assert said.keys() <= document["inputs"].keys()
    assert all(said.items() <= step.items() for step in edges)
