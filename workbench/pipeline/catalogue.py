"""All stages in words and as a schema, plug-ins included: kept until a source changes, since importing takes long."""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from workbench import user_folder
from workbench.pipeline.describe import parameter_texts, summary
from workbench.pipeline.document import ID, NAME
from workbench.pipeline.registry import families
from workbench.stage import REGISTRY, Stage
from workbench.user_folder import package_digest

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


@dataclass(frozen=True)
class Catalogue:
    """What `workbench stages` and `workbench schema` print."""

    rows: list[list[str]]  # of each stage: name, takes, makes, what it does
    schema: dict[str, Any]  # JSON Schema of a pipeline
    broken: dict[str, str]  # by family, why it cannot be had


def catalogue() -> Catalogue:
    """The one that was kept for these sources, or made anew; with stages of this process alone (a notebook's) anew."""
    if any(stage.function.__module__.partition(".")[0] not in _packages() for stage in REGISTRY.values()):
        return _made()
    where = user_folder.folder().path
    path = where / f"stages-{_digest()}.json" if where else None
    with suppress(OSError, ValueError, TypeError):  # nothing kept, or damaged
        return Catalogue(**json.loads(path.read_bytes() if path else b""))
    made = _made()
    if path and not made.broken:  # what is missing may be installed
        user_folder.keep(path, json.dumps(asdict(made)).encode())
        user_folder.forget("stages-*.json")
    return made


def print_stages(found: Catalogue) -> None:
    """All stages, one a row."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table("stage", "takes", "makes", "what it does")
    for row in found.rows:
        table.add_row(*map(Text, row))
    Console(highlight=False).print(table)


def _digest() -> str:
    """Of all that the stages are made of."""
    sources = [(name, package_digest(name)) for name in _packages()]
    return hashlib.sha256(repr((sys.version, sorted(families().items()), sources)).encode()).hexdigest()[:32]


def _packages() -> list[str]:
    """Whose stages there are."""
    return sorted({module.partition(".")[0] for modules in families().values() for module in modules})


def _made() -> Catalogue:
    from workbench.pipeline.catalogue import pipeline_schema
    from workbench.pipeline.describe import makes, source_text, summary
    from workbench.pipeline.registry import every_stage

    known, broken = every_stage()
    rows = [
        [name, ", ".join(map(source_text, stage.sources)), makes(stage), summary(stage)]
        for name, stage in known.items()
    ]
    return Catalogue(rows, pipeline_schema(known), broken)
