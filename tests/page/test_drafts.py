"""Doubts of a draft as questions, and a preset that answers them for the next scan of the cell."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from workbench.importing.draft import drafted
from workbench.importing.mapping import Mapping
from workbench.page.drafts import answered, questions


@pytest.fixture
def draft(tmp_path: Path) -> dict[str, Any]:
    """Of a scan of two frames and two poses of a KUKA; their clocks differ."""
    rows = [f"{k};{7000 + 100 * k};{x},5;{150 + x},25" for k in range(2) for x in range(20)]
    (tmp_path / "scan.csv").write_text("Profile;Timestamp [ms];X (mm);Z\n" + "\n".join(rows) + "\n")
    poses = [f"{t},1500.5,{t},900,10,20,30" for t in (0, 0.5, 1)]
    (tmp_path / "robot.csv").write_text("time_s,X,Y,Z,A,B,C\n" + "\n".join(poses) + "\n")
    return drafted([tmp_path / "scan.csv", tmp_path / "robot.csv"])[0]


def test_every_doubt_is_a_question_with_the_choices_that_a_mapping_allows(draft: dict[str, Any]) -> None:
    asked = questions(draft)
    assert [one.doubt for one in asked] == draft["uncertain"]
    by_place = {each.place: each for one in asked for each in one.asked}
    assert set(by_place["poses.length_unit"].choices) > {"mm", "m", "inch"}
    convention = by_place["poses.convention"]
    assert convention.value == "kuka_abc"
    assert {"kuka_abc", "fanuc_wpr", "ur"} <= set(convention.choices)
    assert "quaternion_wxyz" not in convention.choices  # of four numbers
    assert by_place["times.clock_offset_s"].choices == ()
    for place, one in by_place.items():  # what may be chosen, a mapping may say
        part, name = place.split(".")
        for value in one.choices:
            Mapping.model_validate_json(json.dumps({**draft, part: {**draft[part], name: value}}))


def test_a_preset_answers_what_belongs_to_the_cell(draft: dict[str, Any]) -> None:
    """The unit is the cell's; names of files and the clocks' offset are this recording's, and asked again."""
    preset = {**draft, "hand_eye": {"translation_mm": [1, 2, 3]}, "uncertain": [], "times": {"clock_offset_s": 99.0}}
    preset["poses"] = {**draft["poses"], "files": "old.csv", "length_unit": "m"}
    made = answered(draft, preset)
    assert made["poses"]["length_unit"] == "m"
    assert made["poses"]["files"] == "robot.csv"
    assert made["times"] == draft["times"]
    assert made["hand_eye"] == {"translation_mm": [1, 2, 3]}
    assert not any(text.startswith("hand_eye") for text in made["lacking"])
    assert [text.split(":")[0] for text in made["uncertain"]] == ["times.clock_offset_s"]
    alone = {name: value for name, value in draft.items() if name != "poses"}
    assert "poses" not in answered(alone, preset)
