"""The worked example of docs/importing.md is what it says."""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import numpy as np
import pytest

from workbench.cli import main
from workbench.geometry.poses import CONVENTIONS
from workbench.importing.mapping import Mapping
from workbench.importing.mapping_parts import Part
from workbench.scan import read

PAGE = (Path(__file__).parents[2] / "docs" / "importing.md").read_text(encoding="utf-8")


def test_the_worked_example(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    scan, robot, mapping, printed = re.findall(r"```(?:text|json)\n(.*?)```", PAGE, re.DOTALL)[:4]
    for name, text in (("scan.csv", scan), ("robot.csv", robot), ("map.json", mapping)):
        assert f"`{name}`" in PAGE
        Path(name).write_text(text, encoding="utf-8")
    command = next(line.split() for line in PAGE.splitlines() if line.startswith("    workbench import scan.csv"))
    assert main(command[1:]) == 0
    assert capsys.readouterr().out.startswith(printed)
    made = read(recording=Path("part.h5"))
    np.testing.assert_allclose(made.time_s, [5.0, 5.04, 5.08])
    np.testing.assert_allclose(made.x_mm[0], [-3, -1, 1, 3])
    np.testing.assert_allclose(made.z_mm[0, :3], [81.2005, 81.19, 81.21], atol=1e-5)
    np.testing.assert_array_equal(np.argwhere(np.isnan(made.z_mm)), [[0, 3]])
    np.testing.assert_allclose(np.abs(made.robot_quaternion_wxyz), [[0, 1, 0, 0]] * 2, atol=1e-12)  # 180 deg about x
    assert made.part.part_id == "A-7"


def test_the_page_names_every_key_and_convention() -> None:
    for part in (Mapping, *(hint for hint in map(part_of, Mapping.model_fields.values()) if hint is not None)):
        for key in part.model_fields:
            assert f"`{key}`" in PAGE, key
    for convention in CONVENTIONS:
        assert f"`{convention}`" in PAGE or convention.startswith("euler_"), convention


def part_of(field: object) -> type[Part] | None:
    hints = get_args(field.annotation)  # type: ignore[attr-defined]
    return next((hint for hint in hints if isinstance(hint, type) and issubclass(hint, Part)), None)
