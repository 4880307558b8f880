"""The JSON Schema of a pipeline, for editors: every stage with its parameters, their bounds and descriptions."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from workbench.pipeline.describe import parameter_texts, summary
from workbench.pipeline.document import ID, NAME
from workbench.stage import Stage

REFERENCE = {"type": "string", "pattern": r"\$\{[A-Za-z_][A-Za-z0-9_]*\}"}


def pipeline_schema(stages: Mapping[str, Stage]) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a pipeline of the given stages; any parameter may be a `${reference}`."""
    definitions: dict[str, Any] = {}
    entries = [_stage_schema(stage, definitions) for stage in stages.values()]
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "workbench pipeline",
        "type": "object",
        "required": ["version", "stages"],
        "additionalProperties": False,
        "properties": {
            "version": {"const": 1},
            "title": {"type": "string", "description": "What the pipeline is for, in a few words."},
            "seed": {"type": "integer", "minimum": 0, "default": 0, "description": "Seed of stages that draw numbers."},
            "inputs": {
                "type": "object",
                "description": "Names with default values; `--input NAME=VALUE` replaces them, ${NAME} refers to them.",
                "propertyNames": {"pattern": f"^{NAME.pattern}$"},
            },
            "stages": {"type": "array", "minItems": 1, "items": _any_stage(stages, entries)},
        },
        "$defs": definitions,
    }


def _any_stage(stages: Mapping[str, Stage], entries: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "type": "object",
        "required": ["stage"],
        "properties": {"stage": {"enum": list(stages), "description": "Name of the stage."}},
        "allOf": [
            {"if": {"properties": {"stage": {"const": name}}, "required": ["stage"]}, "then": entry}
            for name, entry in zip(stages, entries, strict=True)
        ],
    }


def _stage_schema(stage: Stage, definitions: dict[str, Any]) -> dict[str, Any]:
    """What may stand in the object of one stage; named sub-schemas go into `definitions`."""
    template = f"#/$defs/{stage.name}.{{model}}"
    schema = stage.model.model_json_schema(ref_template=template)
    definitions |= {f"{stage.name}.{name}": found for name, found in schema.pop("$defs", {}).items()}
    texts = {one.name: one for one in parameter_texts(stage)}
    properties = {
        name: {
            "description": " ".join(
                filter(None, [texts[name].description, texts[name].unit and f"({texts[name].unit})"])
            ),
            "anyOf": [{k: v for k, v in found.items() if k != "title"}, REFERENCE],
        }
        for name, found in schema.get("properties", {}).items()
    }
    one_id = {"type": "string", "pattern": f"^{ID.pattern}$"}
    sources = {source.name: {"anyOf": [one_id, {"type": "array", "items": one_id}]} for source in stage.sources}
    own = {
        "stage": {"const": stage.name},
        "id": {**one_id, "description": "Name of this step, where a pipeline branches or repeats a stage."},
        "from": {"type": "object", "properties": sources, "additionalProperties": False},
        "write": {"type": "boolean", "description": "false: what it makes becomes no result file."},
    }
    return {
        "description": summary(stage),
        "properties": own | properties,
        "required": ["stage", *schema.get("required", [])],
        "additionalProperties": False,
    }
