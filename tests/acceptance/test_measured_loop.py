"""The measured loop as it is shipped: an error of the tool that no plan knows, found in the first cut and taken out."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tests.printing import sheets
from workbench.artefacts import Inspection, PathCorrection
from workbench.pipeline import Pipeline
from workbench.synthetic import milled_truth

ROOT = Path(__file__).resolve().parents[2]
TOOL_ERROR_MM, TURN_DEG = [0.25, -0.2, 0.25], [0.15, 0.1, 0.0]


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("loop") / "out"


@pytest.fixture(scope="module")
def results(out: Path) -> Any:
    """0.41 mm of tool error and 0.18 deg of turn; the robot's error repeats; a part of 42 mm, a third of the frames."""
    recipe = json.loads((ROOT / "data" / "synthetic" / "raw_arc.json").read_text())
    recipe["part"]["length_mm"], recipe["passes"][0]["to_mm"], recipe["robot"]["frame_pitch_mm"] = 42, 40, 1.0
    (out.parent / "raw.json").write_text(json.dumps(recipe))
    turn = {f"{stage}.rotation_deg": TURN_DEG for stage in ("blind_part", "first_cut", "finished")}
    return Pipeline.load(ROOT / "pipelines" / "measured_loop.json").run(
        out,
        inputs={
            **{"recipe": out.parent / "raw.json", "tool_error_mm": TOOL_ERROR_MM, "sections": 3, "passes": 1},
            **{"robot_noise_mm": 0.002, "robot_repeating_mm": 0.03},
        },
        settings=turn | {"scan.plan.frame_rate_hz": 80.0},
    )


def test_a_tool_error_unknown_to_the_plan_is_taken_out(results: Any, out: Path) -> None:
    finished, blind = results["inspect.sections"], results["blind"]
    assert isinstance(finished, Inspection)
    assert results.passed
    assert blind.verdict == "fail"
    found = results.last(PathCorrection)
    assert found.refused is None
    corrected, _ = results["finished"]
    truth = milled_truth(corrected)
    inside = (truth.arc_length_mm > 8) & (truth.arc_length_mm < 32)
    assert np.abs(truth.root_mm[inside] - 1.5).max() < 0.05
    assert np.abs(truth.bevel_deg[inside] - 40.0).max() < 0.1
    document = json.loads((out / "correction.json").read_text())
    assert document["format"] == "path-correction"
    assert document["refused"] is None
    station = document["stations"][len(document["stations"]) // 2]
    along = np.hypot(station["along_n_mm"], station["along_m_mm"])
    assert along == pytest.approx(abs(found.displacement_mm[found.cut].mean()), abs=0.1)
    assert "Measured correction" in (out / "report.html").read_text()


def test_its_report_prints_on_few_pages(results: Any, out: Path, browser: Any) -> None:
    """Pictures, provenance and the planned scan's page included."""
    assert 1 < sheets(browser, out / "report.html") <= 9
