"""Wiring: sources by type or by name, values from outside, and every mistake refused before anything runs."""

import json
from pathlib import Path
from typing import Any

import pytest

from workbench import Pipeline
from workbench.errors import InputError, PipelineError

Doc = dict[str, Any]


def load(document: Doc, directory: Path) -> Pipeline:
    (directory / "p.json").write_text(json.dumps(document))
    return Pipeline.load(directory / "p.json")


def test_nearest_earlier_artefact_of_the_type(demo_document: Doc, tmp_path: Path) -> None:
    steps = load(demo_document, tmp_path).plan().steps
    assert [dict(step.sources) for step in steps] == [
        {},
        {"pose": ("demo.read",)},
        {"pose": ("demo.turn",)},
        {"inspection": ("demo.inspect",)},
        {"inspection": ("demo.inspect",), "provenance": ()},
    ]


def test_branches_by_name(demo_document: Doc, tmp_path: Path) -> None:
    demo_document["stages"] = [
        {"stage": "demo.read", "recording": "${recording}"},
        {"stage": "demo.turn", "id": "left", "angle_deg": -5},
        {"stage": "demo.turn", "id": "right", "from": {"pose": "demo.read"}, "angle_deg": 5},
        {"stage": "demo.merge", "from": {"poses": ["right", "left"]}},
    ]
    results = load(demo_document, tmp_path).run()
    assert results["demo.merge"].content == b"part-1/0>5x1+part-1/0>-5x1"
    del demo_document["stages"][3]["from"]  # all of them, in order
    assert load(demo_document, tmp_path).plan().steps[3].sources["poses"] == ("demo.read", "left", "right")


def test_a_stage_that_refines_a_result_has_the_last_word(demo_document: Doc, tmp_path: Path) -> None:
    demo_document["stages"][3:] = [{"stage": "demo.refine"}, {"stage": "demo.refine", "id": "again", "root_mm": 1.3}]
    load(demo_document, tmp_path).run(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "inspection.json").read_text())["reason"] == "refined to 1.3"
    demo_document["stages"][4]["from"] = {"inspection": "demo.inspect"}  # the first refinement would be lost
    with pytest.raises(PipelineError, match=r"again and demo\.refine would both write"):
        load(demo_document, tmp_path).plan()


def test_a_stage_that_writes_nothing_stands_in_nobodys_way(demo_document: Doc, tmp_path: Path) -> None:
    demo_document["stages"][3:] = [
        {"stage": "demo.refine", "id": "aside", "write": False},
        {"stage": "demo.refine", "id": "kept", "root_mm": 1.3, "from": {"inspection": "demo.inspect"}},
        {"stage": "demo.refine", "id": "unseen", "root_mm": 1.4, "write": False},
    ]
    load(demo_document, tmp_path).run(tmp_path / "out")
    assert json.loads((tmp_path / "out" / "inspection.json").read_text())["reason"] == "refined to 1.3"
    resolved = json.loads((tmp_path / "out" / "run.json").read_text())["pipeline"]["stages"]
    assert [stage.get("write", True) for stage in resolved[3:]] == [False, True, False]
    demo_document["stages"][3]["write"] = "no"
    with pytest.raises(PipelineError, match=r"stages\[3\]\.write: expected true or false"):
        load(demo_document, tmp_path).plan()


def test_inputs_and_settings_replace_values(demo_document: Doc, tmp_path: Path) -> None:
    pipeline = load(demo_document, tmp_path)
    assert pipeline.run(inputs={"angle_deg": 30})["demo.turn"].source == "part-1/0>30x1"
    assert pipeline.run(settings={"demo.turn.steps": 4})["demo.turn"].source == "part-1/0>20x4"
    demo_document["stages"][1]["id"] = "turn.a"
    assert load(demo_document, tmp_path).run(settings={"turn.a.steps": 2})["turn.a"].source == "part-1/0>20x2"


def test_seed_of_the_pipeline_reaches_the_stage_that_asks(demo_document: Doc, tmp_path: Path) -> None:
    assert load(demo_document | {"seed": 7}, tmp_path).run()["demo.read"].source == "part-1/7"
    demo_document["stages"][0]["seed"] = 3
    assert load(demo_document | {"seed": 7}, tmp_path).run()["demo.read"].source == "part-1/3"


def test_relative_paths(demo_document: Doc, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the document they start at its own directory, from outside at the working directory."""
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    (elsewhere / "part.txt").write_text("other\n")
    pipeline = load(demo_document, tmp_path)
    monkeypatch.chdir(elsewhere)
    assert pipeline.run()["demo.read"].source == "part-1/0"
    assert pipeline.run(inputs={"recording": "part.txt"})["demo.read"].source == "other/0"
    assert pipeline.run(settings={"demo.read.recording": "part.txt"})["demo.read"].source == "other/0"


def change(path: str, value: Any) -> Any:
    """A change of the document: `path` like 'stages.1.angle_deg'."""

    def apply(document: Doc) -> None:
        *way, last = path.split(".")
        for key in way:
            document = document[int(key) if key.isdigit() else key]
        document[int(last) if last.isdigit() else last] = value

    return apply


@pytest.mark.parametrize(
    ("apply", "message"),
    [
        (
            change("stages.1.stage", "demo.trun"),
            "stages[1].stage: unknown stage 'demo.trun'; did you mean 'demo.turn'?",
        ),
        (
            change("stages.1.stage", "report.csv"),
            "stages[1].stage: unknown stage 'report.csv': it is gone; 'export.inspection' with \"format\": \"csv\" "
            "writes its rows",
        ),
        (
            change("stages.1.stage", "dmeo.turn"),
            "stages[1].stage: unknown stage 'dmeo.turn'; did you mean 'demo.turn'?",
        ),
        (
            change("stages.1.angel_deg", 3),
            "stages[1].angel_deg: demo.turn has no such parameter; did you mean 'angle_deg'?",
        ),
        (change("stages.1.form", {}), "stages[1].form: demo.turn has no such parameter; did you mean 'from'?"),
        (change("stages.1.progress", 1), "stages[1].progress: demo.turn has no such parameter"),
        (change("stages.1.angle_deg", "${angel_deg}"), "stages[1].angle_deg: unknown input 'angel_deg'"),
        (change("inputs.angle_deg", 200), "stages[1].angle_deg: expected less than or equal to 90, got 200"),
        (change("inputs.angle_deg", "20"), "stages[1].angle_deg: expected a valid number, got '20'"),
        (change("inputs.fail", 0), "stages[2].fail: expected a valid boolean, got 0"),
        (change("stages.4.stage", "demo.gate"), "stages[4].id: 'demo.gate' is taken"),
        (
            change("stages.1.from", {"pose": "demo.inspect"}),
            "stages[1].from.pose: stage 'demo.inspect' does not come before",
        ),
        (change("stages.1.from", {"pose": "demo.turn"}), "stages[1].from.pose: stage 'demo.turn' does not come before"),
        (change("stages.3.from", {"inspection": "demo.read"}), "stage 'demo.read' makes no Inspection; did you mean"),
        (change("stages.1.from", {"pose": "demo.raed"}), "no stage has the id 'demo.raed'; did you mean 'demo.read'?"),
        (
            change("stages.1.from", {"pse": "demo.read"}),
            "stages[1].from.pse: demo.turn takes no 'pse'; did you mean 'pose'?",
        ),
        (change("stages.1.from", {"pose": ["demo.read", "demo.read"]}), "stages[1].from.pose: expected one id, got 2"),
        (change("stages.0", {"stage": "demo.turn", "id": "x"}), "stages[0]: demo.turn needs a HandEye for 'pose'"),
        (change("stages.0", {"stage": "demo.read"}), "stages[0].recording: is required"),
        (change("stages.4", {"stage": "demo.inspect", "id": "b"}), "would both write inspection.json"),
    ],
)
def test_mistake_names_path_expectation_and_nearest_name(demo_document, tmp_path, apply, message):
    apply(demo_document)
    with pytest.raises(PipelineError) as caught:
        load(demo_document, tmp_path).plan()
    assert message in str(caught.value)
    assert str(tmp_path / "p.json") in str(caught.value)


@pytest.mark.parametrize("given", ["missing.txt", "", "part.txt/x", "nul\0", "x" * 300])
def test_input_file_that_is_not_there(demo_document: Doc, tmp_path: Path, given: str) -> None:
    demo_document["inputs"]["recording"] = given
    with pytest.raises(InputError, match=r"cannot be read: .*'recording' of .*p\.json: stages\[0\]"):
        load(demo_document, tmp_path).plan()


@pytest.mark.parametrize(
    ("inputs", "settings", "message"),
    [
        ({"recoding": 1}, {}, "no input 'recoding'; did you mean 'recording'?"),
        ({"angle_deg": None}, {}, "stages[1].angle_deg: expected a valid number, got None"),
        ({}, {"demo.trun.steps": 1}, "setting 'demo.trun.steps': "),
        ({}, {"demo.turn.step": 1}, "stages[1].step: demo.turn has no such parameter; did you mean 'steps'?"),
        ({}, {"steps": 1}, "setting 'steps': "),
        ({}, {"demo.turn.id": "x"}, "'id' belongs to the document"),
        ({}, {"demo.turn.steps": 0}, "stages[1].steps: expected greater than or equal to 1, got 0"),
    ],
)
def test_bad_value_from_outside(demo_document: Doc, tmp_path: Path, inputs: Doc, settings: Doc, message: str) -> None:
    with pytest.raises(PipelineError) as caught:
        load(demo_document, tmp_path).plan(inputs, settings)
    assert message in str(caught.value)


def test_setting_of_a_repeated_stage_needs_its_id(demo_document: Doc, tmp_path: Path) -> None:
    demo_document["stages"][1]["id"] = "a"
    demo_document["stages"].insert(2, {"stage": "demo.turn", "id": "b"})
    pipeline = load(demo_document, tmp_path)
    assert pipeline.run(settings={"b.steps": 5})["b"].source.endswith(">20x1>10x5")
    with pytest.raises(PipelineError, match=r"2 stages 'demo.turn': name one by its id \(a, b\)"):
        pipeline.plan(settings={"demo.turn.steps": 5})


def test_unused_input_is_a_warning(demo_document: Doc, tmp_path: Path) -> None:
    demo_document["inputs"]["spare_mm"] = 1
    assert load(demo_document, tmp_path).plan().warnings == ("input 'spare_mm' is used by no stage",)
