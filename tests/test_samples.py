"""`workbench samples`: pipelines and data as the user's own files, all or none."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from workbench.errors import ArgumentError, InputError, OutputError
from workbench.pipeline import Pipeline
from workbench.samples import copy_samples, shipped_pipeline


def test_the_copied_pipelines_find_the_copied_data(tmp_path: Path) -> None:
    pipelines, data = copy_samples(tmp_path / "mine" / "here")
    assert (pipelines.name, data.name) == ("pipelines", "data")
    for path in pipelines.glob("*.json"):
        for record in (record for step in Pipeline.load(path).plan().steps for record in step.files):
            assert Path(record.path).resolve().is_relative_to(tmp_path), path


def test_what_is_there_stays(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    with pytest.raises(OutputError, match="data: is there already"):
        copy_samples(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["data"]


def test_a_place_that_takes_no_files(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="cannot be written"):
        copy_samples(tmp_path / "file" / "x")


def test_an_installation_without_them(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr("workbench.samples.__file__", str(tmp_path / "workbench" / "samples.py"))
    with pytest.raises(InputError, match="not whole"):
        copy_samples(tmp_path / "mine")
    assert not (tmp_path / "mine").exists()


def test_a_bare_name_is_a_shipped_pipeline_where_no_file_has_it(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.chdir(tmp_path)
    assert Pipeline.load(shipped_pipeline("inspect_bevel")).document.title == "Inspect a milled bevel"
    with pytest.raises(ArgumentError, match="did you mean"):
        shipped_pipeline("inspect_bevle")
    Path("inspect_bevel").write_text("{}")
    assert shipped_pipeline("inspect_bevel") == "inspect_bevel"
