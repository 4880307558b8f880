"""The chain's links: what each costs, and what to improve first."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.made import files_of
from tests.report.conftest import text_of
from workbench.artefacts import Chapter, Document
from workbench.edge import segment
from workbench.errors import InputError
from workbench.inspect import sections
from workbench.pipeline import Pipeline
from workbench.report import sensitivity
from workbench.result_files import RobotFile, ToolFile, TurntableFile
from workbench.scan import fuse, read
from workbench.strict_json import strict_json

ROOT = Path(__file__).resolve().parents[2]
SINE = math.sin(math.radians(40.0))
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

ROBOT = RobotFile(
    format="robot-calibration", version=1, frame="base", parameters=[], covariance=[], left_as_built=[], u_mm=0.06
)


@pytest.fixture(scope="module")
def planned(tmp_path_factory: pytest.TempPathFactory) -> tuple[Any, Path]:
    """What the shipped pipeline makes, and where it stands."""
    folder = tmp_path_factory.mktemp("sensitivity")
    return Pipeline.load(ROOT / "pipelines" / "sensitivity.json").run(folder), folder


@pytest.fixture(scope="module")
def told(planned: tuple[Any, Path]) -> Callable[..., dict[str, Any]]:
    """`told(tool=...)`: the document of the same path and edge, by other numbers."""
    results, _ = planned

    def document(**inputs: Any) -> dict[str, Any]:
        chapter, made = sensitivity(results["path.layers"], results["edge.segment_raw"], **inputs)
        return {**json.loads(made.content), "page": text_of(chapter)}

    return document


def test_the_shipped_pipeline_names_the_link_to_improve(planned: tuple[Any, Path], told: Any) -> None:
    results, folder = planned
    document = json.loads((folder / "sensitivity.json").read_text())
    links = {(c["way"], c["name"]): c for c in document["characteristics"]}
    root = links["blind", "root face"]
    assert sum(link["u"] ** 2 for link in root["links"]) == pytest.approx(root["u"] ** 2)
    assert root["improve_first"] == "hand-eye"
    paper = by_name(document)["hand-eye"]  # its section 7: 0.41 mm as a length
    assert (paper["source"], paper["along_b_u_mm"]) == ("the paper's", pytest.approx(0.41 / math.sqrt(3.0)))
    assert not root["holds"]
    assert links["corrected", "root face"]["holds"]
    assert links["corrected", "root face"]["improve_first"] == "robot, random"
    assert "hand-eye" in results.last(Chapter).summary
    assert told(tool_mm=1.0)["characteristics"][0]["improve_first"] == "tool"


@given(
    tool=st.floats(0.01, 1.0), robot=st.floats(0.01, 1.0), half=st.floats(0.05, 2.0), bevel_half=st.floats(0.02, 2.0)
)
@settings(max_examples=20)
def test_squares_add_and_the_dearest_link_comes_first(told, tool, robot, half, bevel_half):
    """A cut measured leaves of each what is new, one may have what others leave; the page says so, dearest first."""
    asked = {"root_tolerance_mm": (-half, 2.0 * half), "bevel_tolerance_deg": (-3.0 * bevel_half, bevel_half)}
    document = told(tool_mm=tool, robot_accuracy_mm=robot, **asked)
    for made in document["characteristics"]:
        root, blind = made["name"] == "root face", made["way"] == "blind"
        links = document["links"][: -1 if blind else None]
        own = [link["along_b_u_mm"] / SINE if root else link["tilt_u_deg"] for link in links]
        u = np.array([one * (1.0 if blind else link["left"]) for one, link in zip(own, links, strict=True)])
        assert [one["u"] for one in made["links"]] == pytest.approx(u)
        assert made["u"] == pytest.approx(np.linalg.norm(u))
        assert made["tolerance_half_width"] == pytest.approx(half if root else bevel_half)
        assert made["holds"] == (2.0 * made["u"] <= made["tolerance_half_width"])
        assert made["improve_first"] == links[int(np.argmax(u))]["name"]
        unit, way = "mm" if root else "deg", "Milled without correction" if blind else "Corrected by a measured cut"
        shown = document["page"].split(f"{way}: {made['name']} ")[1]
        said = f"U = 2 u = {2 * made['u']:.3f} {unit} {'is within' if made['holds'] else 'exceeds'} the tolerance of ± "
        assert f"{said}{made['tolerance_half_width']:g} {unit}. Largest contribution: {made['improve_first']}" in shown
        rows = sorted(made["links"], key=lambda one: -one["u"])
        places = [shown.find(f" {one['name']} {one['u']:.4f} {100 * one['share']:.0f} % ") for one in rows]
        assert places == sorted(places)
        assert -1 not in places
        for k, one in enumerate(made["links"]):
            assert one["share"] == pytest.approx(u[k] ** 2 / (u**2).sum())
            left = (made["tolerance_half_width"] / 2.0) ** 2 - (np.delete(u, k) ** 2).sum()
            assert one["allowed_u"] == (pytest.approx(math.sqrt(left), rel=1e-6) if left > 0.0 else None)


def test_steel_grows(planned: tuple[Any, Path], told: Any) -> None:
    path = planned[0]["path.layers"]
    reach_mm = np.linalg.norm(path.in_base(path.layers[-1].position_mm), axis=1).mean()
    warm = by_name(told(temperature_k=6.0))["temperature"]["along_b_u_mm"]
    assert warm == pytest.approx(11.5e-6 * 6.0 * reach_mm / math.sqrt(3.0))


def test_calibrations_take_the_place_of_given_numbers(tmp_path: Path, told: Any) -> None:
    tool, table, robot = (tmp_path / name for name in ("tcp.json", "turntable.json", "robot.json"))
    tool.write_bytes(TOOL.model_dump_json().encode())
    table.write_bytes(TABLE.model_dump_json().encode())
    robot.write_bytes(ROBOT.model_dump_json().encode())
    links = by_name(told(tool=tool, turntable=table, robot_calibration=robot, robot_accuracy_mm=9))
    assert (links["tool"]["along_b_u_mm"], links["tool"]["tilt_u_deg"]) == (0.03, 0.02)
    assert (links["turntable"]["along_b_u_mm"], links["turntable"]["source"]) == (0.04, "its calibration")
    assert links["robot, systematic"]["along_b_u_mm"] == 0.06
    with pytest.raises(InputError, match="expected 'tool-calibration'"):
        told(tool=table)
    tool.write_text(TOOL.model_dump_json().replace("0.03", '"x"'))
    with pytest.raises(InputError, match=r"points\[0\].u_mm: expected a valid number"):
        told(tool=tool)


def by_name(document: dict[str, Any]) -> dict[str, Any]:
    return {one["name"]: one for one in document["links"]}


def test_the_hand_eye_counts_by_its_covariance_at_this_edge(tmp_path: Path) -> None:
    """A shift that is unknown alike along all axes displaces the face by as much; a turn tilts it, and by its lever."""
    load = Pipeline.load(ROOT / "pipelines" / "sensitivity.json").run
    pose = read(recording=ROOT / "data" / "synthetic" / "raw_arc.h5").flange_from_profiler
    assert pose is not None
    found = []
    for shift_mm, turn_deg in ((0.1, 0.0), (0.1, 0.2)):
        spread = np.repeat([shift_mm**2, math.radians(turn_deg) ** 2], 3)
        path = tmp_path / "handeye.json"
        path.write_bytes(strict_json({"flange_from_profiler": pose, "covariance": np.diag(spread)}))
        results = load(None, inputs={"hand_eye": str(path)})
        made = next(one for one in results if isinstance(one, Document) and one.name == "sensitivity.json")
        found.append(by_name(json.loads(made.content)))
    without, turned = (one["hand-eye"] for one in found)
    assert (without["source"], without["tilt_u_deg"]) == ("its calibration", pytest.approx(0.0, abs=1e-9))
    assert without["along_b_u_mm"] == pytest.approx(0.1, rel=1e-6)
    assert turned["tilt_u_deg"] == pytest.approx(0.2, rel=1e-6)
    assert turned["along_b_u_mm"] > 0.11
    for key in ("along_b_u_mm", "tilt_u_deg"):  # the scan's own u is not the hand-eye's
        assert found[0]["sensor"][key] == pytest.approx(found[1]["sensor"][key], rel=1e-3)


def test_an_inspection_says_how_well_a_cut_is_measured(tmp_path: Path, told: Any) -> None:
    found = sections(segment(fuse(read(recording=ROOT / "data" / "synthetic" / "milled_edge.h5"))))
    path = tmp_path / "inspection.json"
    path.write_bytes(files_of(found)["inspection.json"])
    u = np.array([(one.values["root_u_mm"], one.values["bevel_u_deg"]) for one in found.sections], float)
    link = by_name(told(inspection=path))["measurement of the cut"]
    root, bevel = np.sqrt(np.mean(u**2, axis=0))
    assert link["along_b_u_mm"] == pytest.approx(root * math.sin(math.radians(40.0)))
    assert (link["tilt_u_deg"], link["source"]) == (pytest.approx(bevel), "an inspection")
    assumed = by_name(told())["measurement of the cut"]
    assert assumed["along_b_u_mm"] >= link["along_b_u_mm"]  # no better than what is measured
    assert assumed["tilt_u_deg"] >= link["tilt_u_deg"]
    for one in (document := json.loads(path.read_bytes()))["sections"]:
        one["root_u_mm"] = None
    path.write_text(json.dumps(document))
    with pytest.raises(InputError, match="expected one that was measured"):
        told(inspection=path)
