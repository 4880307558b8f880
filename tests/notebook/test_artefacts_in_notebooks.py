"""What a notebook shows: short reprs, tables, charts; names that complete; files by position."""

from __future__ import annotations

import dataclasses
import importlib.util
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import workbench
from workbench import artefacts
from workbench.artefacts import Document
from workbench.errors import PipelineError

ROOT = Path(__file__).parents[2]
PART = ROOT / "data" / "synthetic" / "milled_edge.h5"


@pytest.fixture(scope="module")
def made():
    cloud = workbench.cloud.denoise(workbench.scan.fuse(workbench.read(str(PART))))
    edge = workbench.edge.segment(cloud)
    return cloud, edge, workbench.inspect.sections(edge)


def test_names_complete():
    names = dir(workbench)
    assert {"Pipeline", "read", "scan", "cloud", "edge", "inspect", "path", "report"} <= set(names)
    assert not {"Any", "TYPE_CHECKING", "importlib"} & set(names)
    for name in names:
        assert getattr(workbench, name) is not None
    with pytest.raises(AttributeError):
        _ = workbench.nothing


def test_import_stays_cheap():
    code = "import sys, workbench; print(sorted({'numpy', 'pydantic', 'h5py', 'open3d'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout == "[]\n"


def test_files_stand_behind_the_artefacts(tmp_path):
    recording = workbench.read(PART)
    with pytest.raises(artefacts_error(), match=r"no such file"):
        workbench.scan.fuse(recording, tmp_path / "handeye.json")
    with pytest.raises(PipelineError, match="expected at most these by position: recording"):
        workbench.read(PART, PART)
    with pytest.raises(PipelineError, match="expected at most these by position: cloud; got 2 values"):
        workbench.cloud.denoise(workbench.scan.fuse(recording), 5)


def artefacts_error():
    from workbench.errors import InputError

    return InputError


def test_reprs_are_short(made):
    for one in (*made, workbench.read(PART)):
        text = repr(one)
        assert text.startswith(type(one).__name__ + "(")
        assert len(text) < 3000
        assert "0.1" not in text.split("array")[0] or len(text) < 2000
        page = one._repr_html_()
        assert page.startswith("<table>")
        assert page.count("<tr>") <= len(dataclasses.fields(one))
    assert "array 309x600 float32" in repr(made[0])


def test_reprs_escape_what_comes_out_of_files():
    page = artefacts.PointSet(np.zeros((3, 3)), "<script>")._repr_html_()
    assert "<script>" not in page


def test_every_artefact_is_shown():
    kinds = [one for one in vars(artefacts).values() if isinstance(one, type) and dataclasses.is_dataclass(one)]
    assert len(kinds) > 30
    assert all(hasattr(one, "_repr_html_") for one in kinds)


def test_tables(made):
    _, edge, inspection = made
    rows = inspection.table()
    rows = rows.to_dict("records") if importlib.util.find_spec("pandas") else rows
    assert [row["index"] for row in rows] == list(range(1, 10))
    assert rows[0]["root_mm"] == inspection.sections[0].root_mm
    stations = edge.table()
    assert len(stations) == len(edge.arc_length_mm)


def test_charts(made):
    for one in made[1:]:
        figure = one.plot()
        assert figure._repr_png_().startswith(b"\x89PNG")


@pytest.mark.parametrize("wrong", [("a.txt", "text"), (1, b""), ("a.txt", None)])
def test_a_document_of_the_wrong_types_is_one_clear_line(wrong):
    with pytest.raises(PipelineError, match="expected name as str and content as bytes, got"):
        Document(*wrong)
