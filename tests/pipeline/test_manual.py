"""docs/pipelines.md: what it shows is valid."""

import json
import re
from pathlib import Path

import pytest

from workbench import Pipeline

DOCS = Path(__file__).parents[2] / "docs"
MANUAL = (DOCS / "pipelines.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("text", re.findall(r"```json\n(.*?)```", MANUAL, re.DOTALL))
def test_pipelines_shown_are_valid(text: str) -> None:
    assert Pipeline(json.loads(text), base_dir=DOCS).plan().steps


@pytest.mark.parametrize("path", sorted((DOCS / "examples").glob("*.json")), ids=lambda path: path.stem)
def test_example_pipelines_are_valid(path: Path, tmp_path: Path) -> None:
    document = json.loads(path.read_text(encoding="utf-8"))
    mesh = tmp_path / "nominal.stl"
    mesh.write_text("")
    document["inputs"] |= {"mesh": str(mesh)} if "mesh" in document["inputs"] else {}
    assert Pipeline(document, base_dir=path.parent).plan().steps


def test_every_shipped_pipeline_is_listed() -> None:
    listed = MANUAL.partition("## Shipped pipelines")[2].partition("\n## ")[0]
    told = {name for line in listed.splitlines() for name in re.findall(r"`(\w+\.json)`", line.partition(": ")[0])}
    assert {path.name for path in (DOCS.parent / "pipelines").glob("*.json")} == told - {"handeye.json"}


def test_every_key_of_the_document_is_explained(command) -> None:
    keys = json.loads(command("schema").out)["properties"]
    assert {"stages", "inputs"} <= set(keys)
    assert all(f"- `{key}`: " in MANUAL for key in keys)
