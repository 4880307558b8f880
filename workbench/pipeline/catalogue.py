"""All stages: found, in words and as a schema, which is kept until a source changes, since importing takes long.

Families are found by entry point and imported only when a pipeline names them. Group `workbench.stages`: the entry
point's name is the family, its value the module that defines the stages. The project's own families come by the same
door as a stranger's plug-in; should the installation's metadata be stale or absent (a plain checkout on the path), they
are found by their names.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import json
import re
import sys
import traceback
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import entry_points
from pathlib import Path
from typing import Any

from workbench import user_folder
from workbench.errors import PipelineError, nearest
from workbench.pipeline.document import ID, NAME
from workbench.stage import GROUP, REGISTRY, Role, Source, Stage, bring
from workbench.user_folder import package_digest

FILES: dict[str, str] = {}  # SHA-256 of plug-ins of one file, by module: run.json names them
BUILT_IN = ("scan", "cloud", "edge", "path", "program", "inspect", "twin", "report")
GONE = {"report.csv": ': it is gone; \'export.inspection\' with "format": "csv" writes its rows'}
FURTHER = {"scan": ("workbench.scan_next", "workbench.scan_plan")}  # of the same families


@functools.cache
def families() -> dict[str, tuple[str, ...]]:
    """Modules by family name: the project's own first, then those of plug-ins."""
    found = {family: [f"workbench.{family}"] for family in BUILT_IN}
    for family, further in FURTHER.items():
        found[family].extend(further)
    for entry in sorted(entry_points(group=GROUP), key=lambda entry: (entry.name, entry.value)):
        modules = found.setdefault(entry.name, [])
        if entry.value not in modules:
            modules.append(entry.value)
    return {family: tuple(modules) for family, modules in found.items()}


def find(name: str, where: str) -> Stage:
    """The stage `name`; raises PipelineError at `where` with the nearest known name."""
    family = name.partition(".")[0]
    if name not in REGISTRY and family in families():
        load(family, name)
    if name not in REGISTRY:
        known, broken = every_stage()
        hint = f" ({broken[family]})" if family in broken else GONE.get(name) or nearest(name, known)
        raise PipelineError(where, f"unknown stage '{name}'{hint}")
    return REGISTRY[name]


def load_file(path: str | Path) -> None:
    """Run a file of stages (`--plugin FILE.py`): a plug-in that is not installed.

    Raises:
        PipelineError: no such file, no Python, it fails while it runs, or it defines no stage.
    """
    where, before = Path(path), set(REGISTRY)
    name = f"workbench_plugin_{where.stem}"
    if where.suffix != ".py" or not name.isidentifier():
        raise PipelineError(f"--plugin {path}", "expected a file NAME.py, its name letters, digits and _")
    spec = importlib.util.spec_from_file_location(name, where)
    if not where.is_file() or spec is None or spec.loader is None:
        raise PipelineError(f"--plugin {path}", "no such file")
    FILES[name] = hashlib.sha256(where.read_bytes()).hexdigest()
    sys.modules[name] = module = importlib.util.module_from_spec(spec)
    try:
        spec.loader.exec_module(module)
    except PipelineError:
        raise
    except Exception as error:  # a plug-in may fail in any way while it is imported
        line = next(
            (
                frame.lineno
                for frame in reversed(traceback.extract_tb(error.__traceback__))
                if frame.filename == str(where)
            ),
            getattr(error, "lineno", None),
        )
        place = f"--plugin {path}" + (f": line {line}" if line else "")
        raise PipelineError(place, f"cannot be run: {type(error).__name__}: {error}") from error
    if not set(REGISTRY) - before and not any(one.function.__module__ == name for one in REGISTRY.values()):
        raise PipelineError(f"--plugin {path}", "defines no stage: expected a function under @stage('family.verb')")


def load(family: str, name: str = "") -> None:
    """Import the modules of one family, or until one brings the stage `name`.

    Raises:
        PipelineError: one cannot be imported.
    """
    for module in families()[family]:
        if name in REGISTRY:
            return
        try:
            bring(importlib.import_module(module), name.partition(".")[2])
        except PipelineError:
            raise
        except Exception as error:  # a plug-in may fail in any way while it is imported
            why = f"cannot be imported: {type(error).__name__}: {error}"
            raise PipelineError(f"stages '{family}.*' ({module})", why) from error


def every_stage() -> tuple[dict[str, Stage], dict[str, str]]:
    """All stages by name, and by family why one cannot be had."""
    broken = {}
    for family in families():
        try:
            load(family)
        except PipelineError as error:
            broken[family] = str(error)
    return dict(sorted(REGISTRY.items())), broken


# Suffix of a name -> unit, longest first: `v_slow_mm_s` is in mm/s, not in s.
UNITS = {
    "_k": "K",
    "_c": "°C",
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


REFERENCE = {"type": "string", "pattern": r"\$\{[A-Za-z_][A-Za-z0-9_]*\}"}


def pipeline_schema(stages: Mapping[str, Stage]) -> dict[str, Any]:
    """JSON Schema (draft 2020-12) of a pipeline of these stages; parameters and values in them may be references."""
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
    for name, found in schema.pop("$defs", {}).items():
        inner = {key: {"anyOf": [one, REFERENCE]} for key, one in found.get("properties", {}).items()}
        definitions[f"{stage.name}.{name}"] = found | ({"properties": inner} if inner else {})
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
    """All stages, one a row, in 80 columns; what a stage takes and makes is told of each by its name."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    for name, *_, what in found.rows:
        table.add_row(Text(name), Text(what))
    Console(highlight=False).print(table)


def _digest() -> str:
    """Of all that the stages are made of."""
    sources = [(name, package_digest(name)) for name in _packages()]
    return hashlib.sha256(repr((sys.version, sorted(families().items()), sources)).encode()).hexdigest()[:32]


def _packages() -> list[str]:
    """Whose stages there are."""
    return sorted({module.partition(".")[0] for modules in families().values() for module in modules})


def _made() -> Catalogue:
    known, broken = every_stage()
    rows = [
        [name, ", ".join(map(source_text, stage.sources)), makes(stage), summary(stage)]
        for name, stage in known.items()
    ]
    return Catalogue(rows, pipeline_schema(known), broken)
