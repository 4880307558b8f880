"""The chain's links: what each costs, and what to improve first."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest

from workbench.artefacts import Chapter, Document
from workbench.errors import InputError
from workbench.pipeline import Pipeline
from workbench.report.error_chain import Link, needs, thermal_mm
from workbench.result_files import ToolFile, TurntableFile

ROOT = Path(__file__).resolve().parents[2]
BEVEL = math.radians(30.0)  # sin = 1/2
CHAIN = (
    Link("hand-eye", "", 0.12, 0.04, 0.0, ""),
    Link("robot", "", 0.05, 0.03, 1.0, ""),
)

TOOL = ToolFile(
    format="tool-calibration",
    version=1,
    frame="flange",
    points=[{"name": "tip", "position_mm": (0, 0, 250), "u_mm": 0.03}],
    axis={"direction": (0, 0, 1), "u_deg": 0.02},
)
TABLE = TurntableFile(
    format="turntable-calibration",
    version=1,
    frame="base",
    base_from_turntable=((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1)),
    axis_point_mm=(0, 0, 0),
    axis_direction=(0, 0, 1),
    u_mm=0.04,
    direction_u_deg=0.01,
)


def test_squares_add_and_the_dearest_link_comes_first() -> None:
    root, bevel = needs(CHAIN, False, BEVEL, 0.4, 0.05)
    assert root.u == pytest.approx((0.24, 0.10))
    assert root.total == pytest.approx(0.26)
    assert not root.holds
    assert CHAIN[root.worst].name == "hand-eye"
    assert root.share(0) == pytest.approx(0.24**2 / 0.26**2)
    assert root.without(0) == pytest.approx(0.10)
    assert root.allowed(0) == pytest.approx(math.sqrt(0.2**2 - 0.1**2))
    assert root.allowed(1) is None  # the other alone is too much
    assert bevel.total == pytest.approx(0.05)
    assert not bevel.holds


def test_a_measured_cut_leaves_what_is_new() -> None:
    root, bevel = needs(CHAIN, True, BEVEL, 0.4, 0.05)
    assert (root.total, bevel.total) == (pytest.approx(0.10), pytest.approx(0.03))
    assert root.holds


def test_steel_grows() -> None:
    assert thermal_mm(3.0, 1500.0) == pytest.approx(11.5e-6 * 3 * 1500 / math.sqrt(3))


def test_the_shipped_pipeline_names_the_link_to_improve(tmp_path: Path) -> None:
    load = Pipeline.load(ROOT / "pipelines" / "sensitivity.json").run
    results = load(tmp_path)
    document = json.loads((tmp_path / "sensitivity.json").read_text())
    told = {(c["way"], c["name"]): c for c in document["characteristics"]}
    root = told["blind", "root face"]
    assert sum(link["u"] ** 2 for link in root["links"]) == pytest.approx(root["u"] ** 2)
    assert root["improve_first"] == "hand-eye"  # 0.41 mm: the paper's
    assert not root["holds"]
    assert told["corrected", "root face"]["holds"]
    assert told["corrected", "root face"]["improve_first"] == "robot, random"
    assert "hand-eye" in results.last(Chapter).summary
    bad_tool = load(None, inputs={"tool_mm": 1.0})
    found = next(one for one in bad_tool if isinstance(one, Document) and one.name == "sensitivity.json")
    assert json.loads(found.content)["characteristics"][0]["improve_first"] == "tool"


def test_calibrations_take_the_place_of_given_numbers(tmp_path: Path) -> None:
    load = Pipeline.load(ROOT / "pipelines" / "sensitivity.json").run
    tool, table = tmp_path / "tcp.json", tmp_path / "turntable.json"
    tool.write_bytes(TOOL.model_dump_json().encode())
    table.write_bytes(TABLE.model_dump_json().encode())
    load(tmp_path / "out", inputs={"tool": str(tool), "turntable": str(table)})
    links = {one["name"]: one for one in json.loads((tmp_path / "out" / "sensitivity.json").read_text())["links"]}
    assert (links["tool"]["along_b_u_mm"], links["tool"]["tilt_u_deg"]) == (0.03, 0.02)
    assert (links["turntable"]["along_b_u_mm"], links["turntable"]["source"]) == (0.04, "its calibration")
    with pytest.raises(InputError, match="expected 'tool-calibration'"):
        load(None, inputs={"tool": str(table)})
    tool.write_text(TOOL.model_dump_json().replace("0.03", '"x"'))
    with pytest.raises(InputError, match=r"points\[0\].u_mm: expected a valid number"):
        load(None, inputs={"tool": str(tool)})
