"""A run: results in memory and on disk, run.json, and failures that name the stage."""

import hashlib
import json
import warnings
from pathlib import Path
from typing import Any

import pytest

from workbench import Pipeline
from workbench.artefacts import Document, Gate, HandEye, Inspection
from workbench.errors import InputError, PipelineError
from workbench.stage import stage

Doc = dict[str, Any]


def test_results_by_stage_and_by_type(demo_document: Doc, tmp_path: Path) -> None:
    results = Pipeline(demo_document, base_dir=tmp_path).run()
    assert results["demo.turn"].source == "part-1/0>20x1"
    assert results.last(Inspection).verdict == "undecided"
    assert results.passed
    assert results.files == ()
    with pytest.raises(KeyError, match="no Edge"):
        results.last(type("Edge", (), {}))
    assert not Pipeline(demo_document, base_dir=tmp_path).run(inputs={"fail": True}).passed


def test_files_of_a_run(demo_document: Doc, tmp_path: Path) -> None:
    """Of a recording of several blocks, as far as digests go."""
    with (tmp_path / "part.txt").open("ab") as file:
        file.write(bytes(range(32, 127)) * 40_000)
    results = Pipeline(demo_document | {"seed": 5}, base_dir=tmp_path).run(tmp_path / "out")
    assert sorted(path.name for path in results.files) == ["inspection.json", "report.html", "run.json"]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["inspection.json", "report.html", "run.json"]
    digest = hashlib.sha256((tmp_path / "part.txt").read_bytes()).hexdigest()
    run = strict(tmp_path / "out" / "run.json")
    assert run["inputs"] == [{"name": "recording", "path": "part.txt", "sha256": digest}]
    assert run["seed"] == 5
    assert {"workbench", "python", "numpy"} <= set(run["versions"])
    assert [entry["name"] for entry in run["stages"]] == [entry["stage"] for entry in demo_document["stages"]]
    assert all(entry["seconds"] >= 0 for entry in run["stages"])
    assert run["files"] == ["inspection.json", "report.html", "run.json"]
    assert (tmp_path / "out" / "report.html").read_text() == f"undecided {digest}"


def strict(path: Path) -> Any:
    """A JSON file, read by a parser that knows no NaN."""
    return json.loads(path.read_text(), parse_constant=lambda text: pytest.fail(f"{path.name} holds {text}"))


def test_resolved_pipeline_runs_again(demo_document: Doc, tmp_path: Path) -> None:
    """`run.json` holds the whole pipeline: inputs substituted, defaults and sources spelt out."""
    Pipeline(demo_document, base_dir=tmp_path).run(tmp_path / "out", inputs={"angle_deg": 7})
    again = strict(tmp_path / "out" / "run.json")["pipeline"]
    turn = {"stage": "demo.turn", "id": "demo.turn", "from": {"pose": "demo.read"}, "angle_deg": 7, "steps": 1}
    assert again["stages"][1] == turn
    assert Pipeline(again, base_dir=tmp_path).run()["demo.turn"].source == "part-1/0>7x1"


def test_failure_inside_a_stage_is_one_line_with_its_cause(demo_document: Doc, tmp_path: Path) -> None:
    @stage("demo.break")
    def break_(pose: HandEye) -> HandEye:
        """Fail."""
        raise ValueError("first\nsecond")

    demo_document["stages"].insert(1, {"stage": "demo.break"})
    with pytest.raises(PipelineError, match=r"pipeline: demo\.break: failed inside: ValueError: first") as caught:
        Pipeline(demo_document, base_dir=tmp_path).run(tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value.__cause__, ValueError)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("where", ["edge", "demo.refuse", "demo.refuse.depth_mm", "FILE: line 3"])
def test_what_a_stage_refuses_is_found_by_a_file(demo_document: Doc, tmp_path: Path, where: str) -> None:
    @stage("demo.refuse")
    def refuse(pose: HandEye) -> HandEye:
        """Refuse."""
        raise InputError(where.replace("FILE", str(tmp_path / "part.txt")), "expected more")

    demo_document["stages"].insert(1, {"stage": "demo.refuse"})
    with pytest.raises(InputError) as caught:
        Pipeline(demo_document, base_dir=tmp_path).run()
    place, stands = (
        {
            "edge": ": edge",
            "demo.refuse": "",
            "demo.refuse.depth_mm": ": depth_mm",
            "FILE: line 3": None,
        }[where],
        f"{tmp_path / 'part.txt'}: line 3",
    )
    assert str(caught.value) == f"{stands if place is None else f'pipeline: demo.refuse{place}'}: expected more"


@pytest.mark.parametrize("when", [0, 1])
@pytest.mark.parametrize("how", ["written", "replaced", "removed"])
def test_recording_that_changes_during_the_run(demo_document: Doc, tmp_path: Path, how: str, when: int) -> None:
    """Before it is read, or behind that."""
    part = tmp_path / "part.txt"

    @stage("demo.change")
    def change() -> Gate:
        """Change the recording that was checked at the start."""
        if how == "written":
            part.write_text("part-2, and more\n")
        elif how == "replaced":
            (tmp_path / "other").write_bytes(part.read_bytes())
            (tmp_path / "other").replace(part)
        else:
            part.unlink()
        return Gate(True, "")

    demo_document["stages"].insert(when, {"stage": "demo.change"})
    with pytest.raises((InputError, PipelineError), match=r"changed while|cannot be read any more|No such file"):
        Pipeline(demo_document, base_dir=tmp_path).run(tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_python_warnings_of_a_stage_are_results(demo_document: Doc, tmp_path: Path) -> None:
    @stage("demo.warn")
    def warn(pose: HandEye) -> HandEye:
        """Warn twice of the same."""
        for _ in range(2):
            warnings.warn("few points", stacklevel=1)
        return pose

    demo_document["stages"].insert(1, {"stage": "demo.warn"})
    for _ in range(2):  # a second run in the same process says it again
        assert Pipeline(demo_document, base_dir=tmp_path).run().warnings == ["demo.warn: few points"]


def test_document_cannot_take_another_file_s_place(demo_document: Doc, tmp_path: Path) -> None:
    """Names that leave the folder: tests/security/test_names.py."""

    @stage("demo.rogue")
    def rogue(inspection: Inspection) -> Document:
        """Name a file that is not its own."""
        return Document("inspection.json", b"")

    demo_document["stages"].append({"stage": "demo.rogue"})
    with pytest.raises(PipelineError, match="expected a file name of its own"):
        Pipeline(demo_document, base_dir=tmp_path).run(tmp_path / "out")
    assert [path.name for path in tmp_path.iterdir()] == ["part.txt"]


def test_progress_reaches_the_reporter(demo_document: Doc, tmp_path: Path) -> None:
    class Notes:
        """A reporter that keeps what it is told."""

        def __init__(self) -> None:
            self.seen: list[object] = []
            self.end = self.known = self.compiling = lambda *_: None

        def begin(self, index: int, count: int, name: str) -> None:
            self.seen.append((index, count, name))

        def fraction(self, done: float) -> None:
            self.seen.append(done)

    notes = Notes()
    Pipeline(demo_document, base_dir=tmp_path).run(reporter=notes)
    assert notes.seen[:3] == [(0, 5, "demo.read"), (1, 5, "demo.turn"), 0.5]
