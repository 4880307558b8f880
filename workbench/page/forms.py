"""What a pipeline asks for, as fields of a form: kind, unit, range and help come from the stages' own parameters."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, NamedTuple

from workbench.pipeline.catalogue import UNITS, find, parameter_texts, unit_of
from workbench.pipeline.document import read_document, references
from workbench.stage import RESERVED, Role

FIRST = 8  # inputs that stand open: files, and what the drawing says; the others are under "more"


class Field(NamedTuple):
    """One input of a pipeline."""

    name: str
    kind: Literal["file", "number", "choice", "text", "json"]
    default: Any
    unit: str
    range: str
    help: str
    choices: tuple[str, ...]
    first: bool  # stands open


def fields_of(pipeline: Path) -> tuple[str, list[Field]]:
    """The title of a pipeline file, and its inputs.

    Raises:
        PipelineError: no pipeline, or a stage that is not known.
    """
    document = read_document(pipeline)
    used: dict[str, tuple[Mapping[str, Any], str, str, bool]] = {}
    for i, entry in enumerate(document.stages):
        stage = find(entry["stage"], f"{pipeline}: stages[{i}]")
        texts = {one.name: one for one in parameter_texts(stage)}
        schema: Mapping[str, Any] = stage.model.model_json_schema()
        for key, value in entry.items():
            if key in RESERVED or key not in texts:
                continue
            for name in references([{key: value}]):
                is_file = value == f"${{{name}}}" and stage.parameters[key] is Role.INPUT_FILE
                own = _schema_of(name, value, schema["properties"][key], schema.get("$defs", {}))
                used.setdefault(name, (own, texts[key].range, texts[key].description, is_file))
    made, said = [], ""
    for number, (name, default) in enumerate(document.inputs.items()):
        schema, bounds, description, is_file = used.get(name, ({}, "", "", False))
        choices = tuple(str(one) for one in schema.get("enum", ()))
        kind = "file" if is_file else "choice" if choices else _kind(default, schema)
        first = name == "part_id" or (default is not None and (is_file or number < FIRST))
        text = description.replace("`", "") if description != said else ""  # of several values of one object, once
        said = description
        made.append(Field(name, kind, default, unit_of(name), bounds, text, choices, first))
    return document.title, made


def _schema_of(
    name: str, value: Any, schema: Mapping[str, Any], definitions: Mapping[str, Mapping[str, Any]]
) -> Mapping[str, Any]:
    """What may stand where an input is referred to: in the place of a parameter, or of one of an object's values."""
    if value == f"${{{name}}}":
        return schema
    whole = definitions.get(str(schema.get("$ref", "")).rpartition("/")[2], {})
    items = value.items() if isinstance(value, dict) else ()
    key = next((key for key, one in items if one == f"${{{name}}}"), None)
    found: Mapping[str, Any] = whole.get("properties", {}).get(key, {})
    return found


def _kind(default: Any, schema: Mapping[str, Any]) -> Literal["number", "text", "json"]:
    if isinstance(default, bool | list | dict):
        return "json"
    types = {one.get("type") for one in (schema, *schema.get("anyOf", ()))}
    if isinstance(default, int | float) or types & {"number", "integer"}:
        return "number"
    return "text" if types & {"string", None} else "json"


def label(name: str) -> str:
    """An input's name for people: blanks for underscores, its unit left to the unit's own place."""
    suffix = next((one for one in UNITS if name.endswith(one)), "")
    return name.removesuffix(suffix).replace("_", " ")
