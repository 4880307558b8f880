"""One model a result file: it checks what is written, it reads it back, and it is the schema that is printed."""

from __future__ import annotations

import json
import re
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

from tests.conftest import inspection
from tests.made import files_of
from workbench.artefacts import Check, Inspection, Part
from workbench.cli import main
from workbench.errors import InputError
from workbench.result_files import RESULT_FILES, HandEyeFile, InspectionFile, ResultFile, result_schema


@pytest.fixture
def a_result() -> Inspection:
    checks = (Check("obliquity_deg", 3.0, (0.0, 20.0), True, "why"),)
    return replace(inspection(1.5, False), part=Part(part_id="A-7"), checks=checks)


@pytest.mark.parametrize("name", RESULT_FILES)
def test_the_schema_is_one(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    jsonschema = pytest.importorskip("jsonschema")
    assert main(["schema", name]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == result_schema(name)
    jsonschema.Draft202012Validator.check_schema(printed)


def test_what_is_written_is_read_back(tmp_path: Path, a_result: Inspection) -> None:
    files = files_of(a_result)
    path = tmp_path / "inspection.json"
    path.write_bytes(files["inspection.json"])
    found = InspectionFile.read(path)
    assert [row.root_mm for row in found.sections] == [s.values["root_mm"] for s in a_result.sections]
    assert found.part == a_result.part
    assert found.profile.root_mm[1] is None  # NaN in memory, null in the file


def test_a_file_of_another_shape_is_refused_with_its_place(tmp_path: Path, a_result: Inspection) -> None:
    document = json.loads(files_of(a_result)["inspection.json"])
    path = tmp_path / "inspection.json"
    for change, place in (
        (lambda d: d["sections"][1].pop("verdict"), "$.sections[1]: expected 'verdict'"),
        (lambda d: d["sections"][0].update(root_mm="1.5"), "$.sections[0].root_mm"),
        (lambda d: d.update(version=2), "$.version: expected 1"),
    ):
        wrong = json.loads(json.dumps(document))
        change(wrong)
        path.write_text(json.dumps(wrong))
        with pytest.raises(InputError, match=r"inspection\.json") as caught:
            InspectionFile.read(path)
        assert place in str(caught.value)


def test_keys_may_be_added(tmp_path: Path) -> None:
    path = tmp_path / "handeye.json"
    pose = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]
    path.write_text(json.dumps({"flange_from_profiler": pose, "from_elsewhere": 1, "part": {"robot": "R", "new": 2}}))
    assert HandEyeFile.read(path).part.robot == "R"


def test_what_the_model_refuses_is_not_written() -> None:
    with pytest.raises(ValidationError):
        HandEyeFile.written({"flange_from_profiler": [[1]]})


@pytest.mark.parametrize(("name", "model"), RESULT_FILES.items())
def test_a_result_file_says_whose_it_is_or_why_not(name: str, model: type[ResultFile]) -> None:
    assert ("part" in model.model_fields) != bool(re.search(r"\bOf no\b", model.__doc__ or "")), name
