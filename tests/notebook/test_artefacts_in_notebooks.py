"""What a notebook shows: short reprs, tables, charts; names that complete; files by position."""

from __future__ import annotations

import dataclasses
import importlib.machinery
import importlib.util
import inspect
import subprocess
import sys
import types
from importlib.metadata import entry_points
from pathlib import Path

import pytest

import workbench
from workbench import api, artefacts
from workbench.errors import PipelineError
from workbench.stage import GROUP, REGISTRY

ROOT = Path(__file__).parents[2]
PART = ROOT / "data" / "synthetic" / "milled_edge.h5"


@pytest.fixture(scope="module")
def made():
    cloud = workbench.cloud.denoise(workbench.scan.fuse(workbench.read(str(PART))))
    edge = workbench.edge.segment(cloud)
    return cloud, edge, workbench.inspect.sections(edge)


def test_names_complete():
    names = dir(workbench)
    assert {"Pipeline", "Results", "read", "artefacts", "synthetic", "look", "errors"} <= set(names)
    assert not {"Any", "TYPE_CHECKING", "importlib"} & set(names)
    for name in names:
        assert getattr(workbench, name) is not None
    with pytest.raises(AttributeError):
        _ = workbench.nothing


def test_every_family_of_stages_completes():
    ours = {one.name: one.value for one in entry_points(group=GROUP) if one.value.startswith("workbench.")}
    assert ours == workbench.FAMILIES
    for family, place in ours.items():
        module = getattr(workbench, family)
        assert module is sys.modules[place]
        stages = {name for name, one in REGISTRY.items() if one.function.__module__.startswith(f"{place}.")}
        assert stages
        assert {name.partition(".")[2] for name in stages} <= set(dir(module))
    assert {"robot", "calibrate", "stiffness"} <= set(dir(workbench))


def in_a_process_of_its_own(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    return done.stdout.strip()


def test_import_stays_cheap():
    code = "import sys, workbench; dir(workbench); print(sorted(set(sys.modules) - before))"
    brought = in_a_process_of_its_own(f"import sys, importlib, typing; before = set(sys.modules); {code}")
    assert brought == "['workbench']"


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
        assert page.rpartition("<table>")[2].count("<tr>") <= len(dataclasses.fields(one))
    assert "array 309x600 float32" in repr(made[0])
    assert "data:image/png" in made[0]._repr_html_()  # a cloud shows itself
    assert made[2]._repr_html_().count(" ± ") == 18  # two sizes of nine sections


def test_nothing_public_shows_an_address(made):
    """No class keeps Python's own repr, `<... object at 0x...>`; what a session holds is told in a few lines."""
    packages = [getattr(workbench, name) for name in workbench.FAMILIES | workbench.OTHERS]
    public = [
        workbench.Pipeline,
        workbench.Results,
        *(getattr(p, n) for p in packages for n in getattr(p, "__all__", ())),
    ]
    own = {one for one in public if isinstance(one, type) and one.__module__.startswith("workbench.")}
    assert len(own) > 80
    assert [one for one in own if one.__repr__ is object.__repr__ and not inspect.isabstract(one)] == [api.Dialect]
    pipeline = workbench.Pipeline.load(ROOT / "pipelines" / "inspect_bevel.json")
    plan = pipeline.plan()
    cell = workbench.robot.cell(cell=ROOT / "data" / "robot" / "cell.json")
    screen = workbench.robot.CollisionScreen(cell)
    truth = workbench.synthetic.read_truth(PART.with_suffix(".truth.json"))
    content = workbench.look.command.content_of(PART)
    reading = workbench.checks.known_conventions()[0]
    shown = (pipeline, pipeline.document, plan, *plan.steps, *(step.stage for step in plan.steps), cell, cell.chain)
    for one in (*shown, screen, screen.model, truth, content, reading, *made[1].faces.values()):
        assert repr(one).startswith(type(one).__name__ + "(")
        assert " at 0x" not in repr(one)
        assert len(repr(one)) < 1000
    assert repr(pipeline).endswith(
        "inspect_bevel.json': 'Inspect a milled bevel'; stages scan.read, scan.fuse, cloud.denoise, edge.segment, "
        "inspect.sections, inspect.gate, scan.next, export.qif, report.inspection, report.html; "
        f"inputs {', '.join(pipeline.document.inputs)})"
    )


def test_every_artefact_is_shown():
    kinds = [one for one in vars(artefacts).values() if isinstance(one, type) and dataclasses.is_dataclass(one)]
    assert len(kinds) > 30
    assert all(hasattr(one, "_repr_html_") for one in kinds)


@pytest.mark.parametrize("there", [True, False])
def test_tables_are_data_frames_where_pandas_is_there(made, there, monkeypatch):
    """A stand-in, since the project does not need pandas."""

    class DataFrame:
        def __init__(self, rows):
            self.rows = rows

    pandas = types.ModuleType("pandas")
    pandas.__spec__ = importlib.machinery.ModuleSpec("pandas", None)
    pandas.DataFrame = DataFrame
    if there:
        monkeypatch.setitem(sys.modules, "pandas", pandas)
    else:
        monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    _, edge, inspection = made
    for one, count in ((inspection, 9), (edge, len(edge.arc_length_mm))):
        table = one.table()
        assert isinstance(table, DataFrame) is there
        rows = table.rows if there else table
        assert len(rows) == count
        assert all(row.keys() == rows[0].keys() for row in rows)


@pytest.mark.parametrize("wrong", [("a.txt", "text"), (1, b"")])
def test_a_document_of_the_wrong_types_is_one_clear_line(wrong):
    with pytest.raises(PipelineError, match="expected name as str and content as bytes, got"):
        artefacts.Document(*wrong)
