"""The JSON Schema agrees with the checks, and the pages of the stages with their signatures."""

import contextlib
import io
import json
from pathlib import Path
from typing import Any

import pytest

from scripts.stage_pages import main, pages
from workbench import Pipeline
from workbench.cli import main as workbench
from workbench.errors import WorkbenchError

ROOT = Path(__file__).parents[2]
PIPELINES = sorted((ROOT / "pipelines").glob("*.json"))


@pytest.fixture(scope="module")
def schema() -> Any:
    """A validator that has looked at its schema once: `jsonschema.validate` looks every time, for seconds."""
    validators = pytest.importorskip("jsonschema")
    with contextlib.redirect_stdout(io.StringIO()) as printed:
        assert workbench(["schema"]) == 0
    document = json.loads(printed.getvalue())
    validators.Draft202012Validator.check_schema(document)
    return validators.Draft202012Validator(document)


@pytest.mark.parametrize("path", PIPELINES, ids=lambda path: path.stem)
def test_shipped_pipelines_fit_the_schema_and_the_checks(schema: Any, path: Path) -> None:
    schema.validate(json.loads(path.read_text()))
    Pipeline.load(path).plan()


@pytest.mark.parametrize(
    "stage",
    [
        {"stage": "cloud.denoise", "window_frames": 2},
        {"stage": "cloud.denoise", "window_frames": "5"},
        {"stage": "cloud.denoise", "windw_frames": 5},
        {"stage": "cloud.denoise", "from": {"clod": "scan.fuse"}},
        {"stage": "cloud.denoise", "id": "a b"},
        {"stage": "cloud.denose"},
        {"stage": "scan.read"},
        {"stge": "scan.fuse"},
    ],
)
def test_schema_refuses_what_the_checks_refuse(schema: Any, stage: dict[str, Any]) -> None:
    recording = str(ROOT / "data" / "synthetic" / "milled_edge.h5")
    document = {
        "version": 1,
        "stages": [{"stage": "scan.read", "recording": recording, "id": "r"}, {"stage": "scan.fuse"}],
    }
    schema.validate(document)
    Pipeline(document).plan()
    document["stages"].append(stage)  # type: ignore[attr-defined]
    assert not schema.is_valid(document)
    with pytest.raises(WorkbenchError):
        Pipeline(document).plan()


@pytest.mark.parametrize(
    "more", [{"seed": -1}, {"seed": 0.5}, {"version": 2}, {"stages": []}, {"seeds": 1}, {"inputs": {"a b": 1}}], ids=str
)
def test_schema_refuses_a_document_that_the_checks_refuse(schema: Any, more: dict[str, Any]) -> None:
    document = {"version": 1, "stages": [{"stage": "scan.fuse"}]} | more
    assert not schema.is_valid(document)
    with pytest.raises(WorkbenchError):
        Pipeline(document)


def test_pages_are_up_to_date() -> None:
    """If this fails: python -m scripts.stage_pages"""
    folder = ROOT / "docs" / "stages"
    assert {path.name: path.read_text(encoding="utf-8") for path in folder.glob("*.md")} == pages(folder)


def test_pages_of_stages_that_are_gone_are_removed(tmp_path: Path) -> None:
    (tmp_path / "old.stage.md").write_text("")
    main(tmp_path)
    assert {path.name for path in tmp_path.iterdir()} == set(pages())
