"""The notebooks of docs/notebooks are executed, whole and what their sources say."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pytest

from scripts.notebooks import cells, executed

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
SOURCES = sorted(FOLDER.glob("*.py"))
HEAVY = {"paper"}  # its posture is that of the stage's example


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_it_is_what_its_source_says(source: Path) -> None:
    notebook = nbformat.read(source.with_suffix(".ipynb"), 4)
    nbformat.validate(notebook)
    assert [(cell.cell_type == "code", cell.source) for cell in notebook.cells] == cells(source.read_text())
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert [cell.execution_count for cell in code] == list(range(1, len(code) + 1))
    outputs = [one for cell in code for one in cell.outputs]
    assert all(one.output_type != "error" for one in outputs)
    assert sum("image/png" in one.data for one in outputs) >= 4


@pytest.mark.parametrize(
    "source",
    [pytest.param(one, id=one.stem, marks=[pytest.mark.slow] if one.stem in HEAVY else []) for one in SOURCES],
)
def test_it_runs(source: Path) -> None:
    """Every cell, to its end, and each shows what the kept one shows."""
    known, made = nbformat.read(source.with_suffix(".ipynb"), 4), executed(source.read_text())
    assert [told(cell) for cell in made.cells] == [told(cell) for cell in known.cells]


def told(cell: Any) -> tuple[str, list[list[str]]]:
    """A cell's source, and the kinds of what it shows."""
    return cell.source, [sorted(one.data) for one in cell.get("outputs", ())]
