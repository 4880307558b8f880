"""Laws that hold for every registered stage, plug-ins included; the examples of stages do what they say."""

import dataclasses
import doctest
import functools
import hashlib
import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic_core import to_jsonable_python

from tests.contracts.conftest import values
from workbench.artefacts import Document
from workbench.checks.limits import LIMITS, OF_EDGES
from workbench.errors import PipelineError, WorkbenchError
from workbench.pipeline.catalogue import every_stage, families, parameter_texts, said_in_docstring, summary, unit_of
from workbench.pipeline.run import run_files
from workbench.result_files import RESULT_FILES
from workbench.stage import Role, Stage

ROOT = Path(__file__).parents[2]
STAGES = every_stage()[0]
OPTIONS = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
WORDS = "number|count|how many|ratio|share|factor|fraction|multiples?|index|direction"
COUNTED = re.compile(rf"\b({WORDS})\b", re.IGNORECASE)
each_stage = pytest.mark.parametrize("stage", [pytest.param(stage, id=name) for name, stage in STAGES.items()])


@each_stage
def test_one_name_everywhere(stage: Stage) -> None:
    """`family.verb` is the function `verb` in a module that the family's entry point names."""
    family, verb = stage.name.split(".")
    assert stage.function.__name__.rstrip("_") == verb
    assert any(f"{stage.function.__module__}.".startswith(f"{module}.") for module in families()[family])


@each_stage
def test_hides_no_module(stage: Stage) -> None:
    """`workbench.family.verb` is the stage, whatever was imported before."""
    package, _, module = stage.function.__module__.rpartition(".")
    assert not (Path(sys.modules[package].__path__[0]) / f"{stage.function.__name__}.py").exists(), module


@each_stage
def test_says_what_it_does(stage: Stage) -> None:
    assert len(summary(stage)) > 20
    assert stage.produces


@each_stage
def test_numbers_have_units(stage: Stage) -> None:
    """A number carries its unit in its name, or its description says what it counts, compares or points at."""
    for text in parameter_texts(stage):
        if re.search(r"\b(number|integer)\b", text.type) and stage.parameters[text.name] is not Role.SEED:
            assert unit_of(text.name) or COUNTED.search(text.description), f"{text.name}: {text.description!r}"


@each_stage
def test_parameters_are_described(stage: Stage) -> None:
    assert [text.name for text in parameter_texts(stage) if not text.description] == []


@each_stage
def test_parameters_are_described_in_one_place(stage: Stage) -> None:
    """In the docstring, or by their type where several stages share it."""
    fields = stage.model.model_json_schema().get("properties", {})
    assert [name for name, one in fields.items() if "description" in one and said_in_docstring(stage.doc, name)] == []


@pytest.fixture(scope="module")
def called(calls: Any, chains: Any) -> Callable[[Stage], Any]:
    """The quickest call of a stage that made something, in a shipped pipeline or in its example."""

    def quickest(stage: Stage) -> Any:
        if not calls[stage.name]:
            follow_example(stage.name)
        every = calls[stage.name]
        return min(
            (one for one in every if one.made is not None and one.made != ()),
            key=lambda one: one.seconds,
            default=every[0],
        )

    return quickest


@each_stage
@pytest.mark.usefixtures("in_the_project")
def test_parameters_round_trip_through_json(stage: Stage, called: Any) -> None:
    known = stage.model.model_fields
    given = {name: one for name, one in called(stage).given.items() if name in known}
    text = json.dumps(to_jsonable_python(given), allow_nan=False)
    assert stage.validate(json.loads(text)) == given


SELDOM = {"pass_disagreement_mm", "not_confirmed", "fillet_misfit_mm", "land_tilt_deg"}  # of some recordings only


@pytest.mark.parametrize("name", ["scan.fuse", *OF_EDGES])
@pytest.mark.usefixtures("in_the_project")
def test_a_stage_takes_limits_of_the_checks_that_it_makes_and_of_no_other(name: str, called: Any) -> None:
    given, made, _ = called(stage := STAGES[name])
    parameters = {name: one for name, one in given.items() if name in stage.model.model_fields}
    before = {check.name for one in given.values() for check in getattr(one, "checks", ())}
    for check, limit in LIMITS.items():
        try:
            stage.validate(parameters | {"limits": {check: limit.bound}})
            taken = True
        except PipelineError as error:
            taken = "not judged by this stage" not in str(error)
        if check not in SELDOM:
            assert taken == (check in {one.name for one in made.checks} - before), check


WRONG = {
    "empty": b"",
    "table": b"# kN\na;b\n1,5;2\n",
    "words": b'{"format": "something", "version": 1}',
    "list": b"[1, 2, 3]",
    "utf16": '{"format": 1}'.encode("utf-16"),
    "binary": bytes(range(256)) * 40,
    "folder": None,
    "missing": None,
}


@pytest.mark.parametrize("name", [name for name, one in STAGES.items() if not any(x.required for x in one.sources)])
@pytest.mark.usefixtures("in_the_project")
def test_a_file_of_another_kind_is_refused_by_its_name(name: str, called: Any, calls: Any, tmp_path: Path) -> None:
    """By the stages that begin with a file."""
    first = called(stage := STAGES[name])
    for key, role in stage.parameters.items():
        if role is not Role.INPUT_FILE or key == "inspections":  # which stand for a study, in no shipped pipeline
            continue
        given = next((one for one in calls[name] if one.given.get(key) is not None), first).given
        for kind, content in WRONG.items():
            path = tmp_path / f"{key} {kind}"
            if content is not None:
                path.write_bytes(content)
            elif kind == "folder":
                path.mkdir()
            wrong = [path] * len(given[key]) if isinstance(given.get(key), list) else path
            with pytest.raises(WorkbenchError) as refused:
                stage.function.__wrapped__(**given | {key: wrong})
            assert refused.value.where.startswith(str(path))


SILENT = {"scan.next"}  # of a part that is decided there is nothing to tell
WITHOUT_FORMAT = {"handeye.json", "calibration_validation.json"}  # older than the rule; the contract names none


@each_stage
@pytest.mark.usefixtures("in_the_project")
def test_inputs_are_unchanged_and_bytes_repeat(stage: Stage, called: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """It changes none of its inputs, the same seed gives the same bytes, and a result file begins with its format."""
    given, first, _ = called(stage)
    before = digest(given)
    monkeypatch.setattr("workbench.children.subprocess", subprocess)  # as for a user, on all cores
    again = stage.function.__wrapped__(**given)
    assert digest(given) == before
    assert digest(first) == digest(again)
    made = again if isinstance(again, tuple) else () if again is None else (again,)
    kinds = [type(one) for one in made if one is not None]
    whole = len(kinds) == len(stage.produces) and all(map(issubclass, kinds, stage.produces))
    assert whole or set(kinds) <= set(stage.produces)  # of several ways, one
    assert made or stage.name in SILENT
    for one in made:
        if isinstance(one, Document) and one.name in RESULT_FILES.keys() - WITHOUT_FORMAT:
            assert list(json.loads(one.content))[:2] == ["format", "version"]


def digest(artefacts: Any) -> str:
    """A digest of all bytes inside artefacts."""
    found = hashlib.sha256()
    for place, value in values(artefacts):
        content = value.tobytes() if isinstance(value, np.ndarray) else repr(value).encode()
        found.update(f"{place} {getattr(value, 'dtype', '')} {getattr(value, 'shape', '')}".encode() + content)
    return found.hexdigest()


def test_digest_sees_a_single_bit(chain: Any) -> None:
    """The law above rests on it."""
    recording = chain.results["scan.read"]
    changed = np.array(recording.x_mm)
    changed.view(np.uint32)[0, 0] ^= 1
    assert digest(recording) == digest(dataclasses.replace(recording))
    assert digest(recording) != digest(dataclasses.replace(recording, x_mm=changed))


def test_every_result_file_says_whose_it_is(chains) -> None:
    """Each that a shipped pipeline makes, unless its model says why it is nobody's."""
    found = {}
    for chain in chains:
        for name, content in run_files(chain.plan, chain.results).items():
            if name in RESULT_FILES and "part" in RESULT_FILES[name].model_fields:
                found[name] = found.get(name, True) and {"part_id", "robot"} <= {*json.loads(content).get("part", {})}
    assert [name for name, said in found.items() if not said] == []
    assert {"correction.json", "tcp.json", "deviation.json", "program_check.json", "stiffness.json"} <= {*found}


@pytest.fixture
def in_the_project(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.chdir(ROOT)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))


@each_stage
@pytest.mark.usefixtures("in_the_project", "calls")
def test_the_example_of_a_stage(stage: Stage) -> None:
    follow_example(stage.name)


@functools.cache
def follow_example(name: str) -> None:
    stage = STAGES[name]
    module = sys.modules[stage.function.__module__]
    tests = doctest.DocTestFinder(recurse=False).find(stage.function, name, module, globs={})
    assert tests
    for test in tests:
        assert test.examples
        assert doctest.DocTestRunner(optionflags=OPTIONS).run(test).failed == 0, name


@pytest.mark.usefixtures("in_the_project", "calls")
@pytest.mark.parametrize("page", ["docs/open3d.md"])
def test_the_examples_of_a_page(page: str) -> None:
    test = doctest.DocTestParser().get_doctest((ROOT / page).read_text(), {}, page, page, 0)
    assert test.examples
    assert doctest.DocTestRunner(optionflags=OPTIONS).run(test).failed == 0
