"""Programs of planned scans: judged as written, with the profiler's signal around the pass."""

from __future__ import annotations

import json
from typing import Any

import pytest

from tests.scan_plan.test_plan import CELL, EDGE, HAND_EYE, SENSOR
from tests.seldom import seldom
from workbench import robot
from workbench.artefacts import Chapter, Document, Gate
from workbench.scan_plan import ScanPlan, plan, program


@pytest.fixture(scope="module")
def planned() -> ScanPlan:
    made = plan(robot.cell(cell=CELL), edge=EDGE, sensor=SENSOR, hand_eye=HAND_EYE, tool_stays=False)
    assert isinstance(made[0], ScanPlan)
    return made[0]


def documents(made: Any) -> dict[str, bytes]:
    return {one.name: one.content for one in made if isinstance(one, Document)}


def test_the_pass_is_driven_with_the_profiler_on(planned: ScanPlan) -> None:
    made = program(planned, robot.cell(cell=CELL), scanner_mass_kg=3)
    gate, files = made[-1], documents(made)
    assert isinstance(gate, Gate)
    assert gate.clean
    text = files["ScanEdge1.mod"].decode()
    on, off = text.index("SetDO doScan,1"), text.index("SetDO doScan,0")
    assert on < text.index("WaitDI diScanReady,1") < text.index("MoveL p1") < off < text.rindex("jHome")
    assert "Scanning pass 1 of" in text
    assert "EGM" in text
    (chapter,) = [one for one in made if isinstance(one, Chapter)]
    assert "root face" not in chapter.html
    check = json.loads(files["scan_check_1.json"])
    assert check["passed"]
    assert check["deviation_mm"] < 0.1


@pytest.mark.parametrize(
    ("controller", "file"),
    [
        *(("kuka", "ScanEdge1.src"), ("ur", "ScanEdge1.script")),
        *seldom(("fanuc", "SCANEDGE1.ls"), ("trajectory", "ScanEdge1.csv")),
    ],
)
def test_other_languages(planned: ScanPlan, controller: Any, file: str) -> None:
    made = program(planned, robot.cell(cell=CELL), controller=controller, scanner_mass_kg=3)
    assert made[-1].passed
    assert made[-1].loosened  # the cell's words are for another controller
    assert file in documents(made)


def test_what_is_not_known_is_not_checked(planned: ScanPlan) -> None:
    gate = program(planned, robot.cell(cell=CELL))[-1]
    assert gate.passed
    assert any("load of the scanner" in text for text in gate.loosened)
    assert not documents(program(planned, None))
    assert not program(planned, None, controller="abb")[-1].clean
