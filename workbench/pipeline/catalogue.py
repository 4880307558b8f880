"""All stages in words and as a schema, plug-ins included: kept until a source changes, since importing takes long."""

from __future__ import annotations

import hashlib
import json
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Any

from workbench import user_folder
from workbench.pipeline.registry import families
from workbench.pipeline.sources import package_digest
from workbench.stage import REGISTRY


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
    from workbench.pipeline.describe import makes, source_text, summary
    from workbench.pipeline.registry import every_stage
    from workbench.pipeline.schema import pipeline_schema

    known, broken = every_stage()
    rows = [
        [name, ", ".join(map(source_text, stage.sources)), makes(stage), summary(stage)]
        for name, stage in known.items()
    ]
    return Catalogue(rows, pipeline_schema(known), broken)
