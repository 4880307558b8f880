"""The notebooks of docs/notebooks are executed, whole and what their sources say."""

from __future__ import annotations

from pathlib import Path

import nbformat
import pytest

from scripts.notebooks import cells, executed

FOLDER = Path(__file__).parents[2] / "docs" / "notebooks"
SOURCES = sorted(FOLDER.glob("*.py"))


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


@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_its_first_cells_run(source: Path) -> None:
    """Those before the first pipeline; all of it is run by the test below."""
    text = source.read_text().split("eye = run(")[0].rsplit("# %%", 1)[0]
    assert executed(text).cells


@pytest.mark.slow
@pytest.mark.parametrize("source", SOURCES, ids=lambda path: path.stem)
def test_it_runs(source: Path) -> None:
    known = nbformat.read(source.with_suffix(".ipynb"), 4)
    assert [cell.source for cell in executed(source.read_text()).cells] == [cell.source for cell in known.cells]
