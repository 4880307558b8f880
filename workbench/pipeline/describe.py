"""A stage in words, from its signature: for `workbench stages` and the docs pages."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from typing import Any

from workbench.stage import Role, Source, Stage

# Suffix of a name -> unit, longest first: `v_slow_mm_s` is in mm/s, not in s.
UNITS = {
    "_k": "K",
    "_nm_per_rad": "Nm/rad",
    "_mm_per_s": "mm/s",
    "_mm_s2": "mm/s²",
    "_mm_s": "mm/s",
    "_deg_s2": "deg/s²",
    "_per_mm": "1/mm",
    "_mm2": "mm²",
    "_mm": "mm",
    "_deg": "deg",
    "_rad": "rad",
    "_g_cm3": "g/cm³",
    "_kg": "kg",
    "_percent": "%",
    "_hz": "Hz",
    "_rpm": "rpm",
    "_nm": "Nm",
    "_n": "N",
    "_s": "s",
    "_frames": "frames",
    "_columns": "columns",
    "_factor": "ratio",
}
TYPES = {
    "integer": "integer",
    "number": "number",
    "string": "text",
    "boolean": "true or false",
    "null": "null",
    "object": "object",
}


@dataclass(frozen=True)
class ParameterText:
    """One parameter of a stage, in words."""

    name: str
    type: str
    unit: str
    default: str
    range: str
    description: str


def parameter_texts(stage: Stage) -> list[ParameterText]:
    """The parameters of a stage that a pipeline can give."""
    schema = stage.model.model_json_schema()
    required = schema.get("required", [])
    return [
        ParameterText(
            name=name,
            type=_type(found, schema) if stage.parameters[name] is not Role.INPUT_FILE else _path_type(found),
            unit=unit_of(name),
            default="required" if name in required else json.dumps(found.get("default")),
            range=_range(found),
            description=found.get("description")
            or said_in_docstring(stage.doc, name)
            or ROLE_TEXT[stage.parameters[name]],
        )
        for name, found in schema.get("properties", {}).items()
    ]


ROLE_TEXT: dict[Role | None, str] = {
    Role.INPUT_FILE: "A file, relative to the pipeline's own file; its SHA-256 goes into run.json.",
    Role.SEED: "Seed of the random numbers; the pipeline's unless given here.",
    None: "",
}


def unit_of(name: str) -> str:
    """The unit that a name carries, or ''."""
    return next((unit for suffix, unit in UNITS.items() if name.endswith(suffix)), "")


def source_text(source: Source) -> str:
    """The type of an artefact that a stage takes, with how many."""
    text = f"several {source.type.__name__}" if source.several else source.type.__name__
    return text if source.required else f"{text} (optional)"


def summary(stage: Stage) -> str:
    """The first paragraph of its docstring, on one line."""
    return " ".join(stage.doc.split("\n\n")[0].split())


def prose(stage: Stage) -> str:
    """Its docstring without the list of arguments, which `parameter_texts` holds."""
    return re.sub(r"\n*^Args:\n(?:(?: +.*)?(?:\n|$))*", "\n\n", stage.doc, flags=re.MULTILINE).strip()


def makes(stage: Stage) -> str:
    """What a stage returns."""
    return ", ".join(made.__name__ for made in stage.produces) or "nothing"


def said_in_docstring(doc: str, name: str) -> str:
    """What the docstring says after `name:` at the beginning of a line, with the deeper indented lines below it."""
    found = re.search(rf"^( *){name}:\s*(.+(?:\n\1 +.+)*)", doc, re.MULTILINE)
    return " ".join(found[2].split()) if found else ""


def _path_type(schema: dict[str, Any]) -> str:
    return "path or null" if "anyOf" in schema else "path"


def _type(schema: dict[str, Any], root: dict[str, Any]) -> str:
    if "$ref" in schema:
        return _type(root["$defs"][schema["$ref"].rsplit("/", 1)[-1]], root)
    if "enum" in schema or "const" in schema:
        return " or ".join(json.dumps(value) for value in schema.get("enum", [schema.get("const")]))
    if "anyOf" in schema:
        return " or ".join(_type(part, root) for part in schema["anyOf"])
    if "prefixItems" in schema:
        return "[" + ", ".join(_type(part, root) for part in schema["prefixItems"]) + "]"
    if schema.get("type") == "array":
        return f"list of {_type(schema.get('items', {}), root)}"
    return TYPES.get(schema.get("type", ""), "any value")


def _range(schema: dict[str, Any]) -> str:
    """Bounds in mathematical notation, e.g. '3 <= value <= 31'."""
    for part in schema.get("anyOf", []):
        if _range(part):
            return _range(part)
    low = next(
        (f"{schema[key]:g} {sign} " for key, sign in (("minimum", "<="), ("exclusiveMinimum", "<")) if key in schema),
        "",
    )
    high = next(
        (f" {sign} {schema[key]:g}" for key, sign in (("maximum", "<="), ("exclusiveMaximum", "<")) if key in schema),
        "",
    )
    return f"{low}value{high}" if low or high else ""
