"""Random parts, cells and faults through the command: where a program is written, an outsider finds no fault in it."""

import copy
import dataclasses
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, seed, settings
from hypothesis import strategies as st

from tests.conftest import forget_strangers
from tests.seldom import seldom
from workbench.api import Toolpath, inverse, stage
from workbench.cli import main
from workbench.pipeline import Pipeline
from workbench.program.rapid import Module
from workbench.robot import read_cell, turntable_pose

from .postured import by_an_outsider

ROOT = Path(__file__).resolve().parents[2]
CELL = json.loads((ROOT / "data/robot/cell.json").read_text())
RECIPE = json.loads((ROOT / "data/synthetic/raw_arc.json").read_text())
FLUTE_MM, RADIUS_MM = 13.0, 5.0


@pytest.fixture(autouse=True)
def fault():
    """A stage that spoils a path as a bug in planning would."""

    @stage("fault.sink")
    def sink(toolpath: Toolpath, *, layer: int, by_mm: float) -> Toolpath:
        """Push one layer along its points' x, into the material."""
        from workbench.api import rotation_from_quaternion

        parts = list(toolpath.layers)
        one = parts[layer % len(parts)]
        into = rotation_from_quaternion(one.quaternion_wxyz)[:, :, 0]
        parts[layer % len(parts)] = dataclasses.replace(one, position_mm=one.position_mm + by_mm * into)
        return dataclasses.replace(toolpath, layers=tuple(parts))

    yield
    forget_strangers()


def stages(case: dict[str, Any]) -> list[dict[str, Any]]:
    return [
        {"stage": "scan.read", "recording": "part.h5"},
        {"stage": "scan.fuse"},
        {"stage": "cloud.denoise"},
        {"stage": "edge.segment_raw", "upper_side": [0, 0, 1]},
        {
            "stage": "path.layers",
            "root_mm": case["root_mm"],
            "bevel_deg": case["bevel_deg"],
            "depth_of_cut_mm": 2,
            "flute_length_mm": FLUTE_MM,
            "v_slow_mm_s": 2,
        },
        {"stage": "path.feed"},
        *([{"stage": "fault.sink", "layer": case["layer"], "by_mm": case["sink_mm"]}] if case["sink_mm"] else []),
        {"stage": "path.check"},
        {"stage": "robot.cell", "cell": "cell.json"},
        {"stage": "robot.plate"},
        {"stage": "stiffness.read"},
        {"stage": "stiffness.force"},
        {
            "stage": "stiffness.posture",
            "step_deg": 10,
            "sampled_points": 12,
            "whole_map": False,
            "turntable_deg": [-90, 90],
        },
        {"stage": "path.simplify"},
        {"stage": "program.write", "root_tolerance_mm": 3},
    ]


def run(case: dict[str, Any], folder: Path) -> int:
    """Exit status of the simulated scan, its plan and its program."""
    recipe, cell = copy.deepcopy(RECIPE), copy.deepcopy(CELL)
    recipe["part"] |= {
        "length_mm": 40,
        "thickness_mm": case["thickness_mm"],
        "curve": {"shape": "arc", "radius_mm": case["radius_mm"], "sense": case["sense"]},
    }
    place = np.array(recipe["part"]["base_from_part"]["position_mm"]) + case["place_mm"]
    recipe["part"]["base_from_part"] = {"position_mm": place.tolist(), "rpy_deg": [case["turn_deg"], 2.5, -1.5]}
    recipe["seed"], recipe["scanner"]["columns"], recipe["passes"][0]["to_mm"] = case["seed"], 400, 38
    recipe["robot"]["frame_pitch_mm"] = 1.0
    cell["robot"]["urdf"] = str(ROOT / "data/robot" / CELL["robot"]["urdf"])
    cell["turntable"]["limits_deg"] = case["limits_deg"]
    cell["turntable"]["shapes"] += case["table"]
    for i, (off, size) in enumerate(case["boxes"]):
        cell["fixtures"].append({"name": f"box {i}", "pose": {"position_mm": (place + off).tolist()}, "box_mm": size})
    for name, content in (("recipe", recipe), ("cell", cell), ("run", {"version": 1, "stages": stages(case)})):
        (folder / f"{name}.json").write_text(json.dumps(content))
    assert main(["simulate", str(folder / "recipe.json"), "--out", str(folder / "part.h5")]) == 0
    return main(["run", str(folder / "run.json"), "--out", str(folder / "out")])


def least_above_mm(folder: Path, *finished: tuple[float, float]) -> list[float]:
    """How far the driven cutter stays above bevels of the true part, root face mm and angle deg; clear on its way."""
    cell = read_cell(folder / "cell.json")
    program = Module(cell).program({"BevelPath.mod": (folder / "out" / "BevelPath.mod").read_text()})
    _, outsider, joints, tables = by_an_outsider(cell, program)
    truth = json.loads((folder / "part.truth.json").read_text())
    low, n, m, t = (np.array(truth[key], float) for key in ("position_mm", "normal", "across", "tangent"))
    least = [np.inf] * len(finished)
    tool = program.tools[program.moves[0].tool].flange_from_tool
    tips = outsider.links(joints)[:, 6] @ outsider.tip @ inverse(tool) @ cell.flange_from_cutter
    for at, angle in zip(tips, np.radians(tables), strict=True):
        tip = turntable_pose(cell, 0.0) @ inverse(turntable_pose(cell, angle)) @ at
        middle = tip[:3, 3] - FLUTE_MM / 2 * tip[:3, 2]
        i = int(np.argmin(np.linalg.norm(low - middle, axis=1)))
        if i in (0, len(low) - 1) and abs((middle - low[i]) @ t[i]) > 1:
            continue  # beyond the part
        for k, (root_mm, bevel_deg) in enumerate(finished):
            normal = n[i] * np.cos(np.radians(bevel_deg)) + m[i] * np.sin(np.radians(bevel_deg))
            least[k] = min(least[k], (middle - low[i] - root_mm * m[i]) @ normal - RADIUS_MM)
    return least


SOUND: dict[str, Any] = {
    "thickness_mm": 7.0,
    "radius_mm": 900,
    "sense": "convex",
    "place_mm": [0, 0, 0],
    "turn_deg": 35,
    "seed": 1,
    "limits_deg": [-180, 180],
    "boxes": [],
    "table": [],
    "root_mm": 1.5,
    "bevel_deg": 40,
    "sink_mm": 0.0,
    "layer": 0,
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A sound part in an empty cell and its program."""
    folder = tmp_path_factory.mktemp("sound")
    assert run(SOUND, folder) == 0
    return folder


def test_an_outsider_who_drives_the_program_finds_the_bevel_that_was_asked_for(made):
    """And sees the fault of one that was made for another part."""
    right, other = least_above_mm(made, (SOUND["root_mm"], SOUND["bevel_deg"]), (2.5, SOUND["bevel_deg"]))
    assert -0.05 < right < 0.05
    assert other < -0.5


@pytest.mark.parametrize(
    ("change", "status", "words"),
    [
        ({"sink_mm": 0.3, "layer": -1}, 1, "lies below the finished bevel"),
        ({"place_mm": [3000, 0, 0], "limits_deg": [-1, 1]}, 2, "envelope, workpiece"),
        # free at 0, which it does not reach, the table is in a post wherever it can turn
        *seldom(
            (
                {
                    "table": [{"pose": {"position_mm": [0, 0, -130]}, "box_mm": [1600, 200, 60]}],
                    "boxes": [([550, 750, -530], [300, 300, 400])],
                    "limits_deg": [85, 95],
                },
                2,
                "turntable, box 0",
            )
        ),
    ],
)
def test_a_fault_gives_no_program_and_the_reason(change, status, words, tmp_path, capsys):
    assert run(SOUND | change, tmp_path) == status
    assert not (tmp_path / "out" / "BevelPath.mod").exists()
    assert words in "".join(capsys.readouterr())


@pytest.mark.parametrize("pipeline", sorted((ROOT / "pipelines").glob("*.json")), ids=lambda path: path.stem)
def test_every_shipped_program_has_a_gate_on_its_path(pipeline):
    """Where a shipped pipeline knows the robot, that is the gate of its postures, and of the program for the table."""
    steps = {step.id: step for step in Pipeline.load(pipeline).plan().steps}
    for step in steps.values():
        if not step.stage.name.startswith("program."):
            continue
        gate = steps[step.sources["gate"][0]].stage.name
        known = any(one.stage.name == "robot.cell" for one in steps.values())
        written = step.stage.name == "program.csv" and any(one.stage.name == "program.write" for one in steps.values())
        assert gate == ("program.write" if written else "stiffness.posture" if known else "path.check")


def vectors(low: float, high: float) -> st.SearchStrategy[list[float]]:
    return st.lists(st.floats(low, high), min_size=3, max_size=3)


CASES = st.fixed_dictionaries(
    {
        "thickness_mm": st.floats(4, 8),
        "radius_mm": st.floats(400, 2000),
        "sense": st.sampled_from(["convex", "concave"]),
        "place_mm": vectors(-120, 120),
        "turn_deg": st.floats(0, 70),
        "seed": st.integers(0, 10**6),
        "limits_deg": st.sampled_from([[-180, 180], [-60, 60], [0, 30]]),
        "table": st.just([]),
        "boxes": st.lists(st.tuples(vectors(-500, 500), vectors(40, 400)), max_size=3),
        "root_mm": st.floats(0.5, 4.5),
        "bevel_deg": st.floats(20, 50),
        "sink_mm": st.sampled_from([0, 0, 0, 0.2, 1.0]),
        "layer": st.integers(0, 5),
    }
)


@pytest.mark.slow
@seed(20261120)
@settings(
    max_examples=25,
    deadline=None,
    database=None,
    derandomize=False,
    print_blob=False,
    suppress_health_check=list(HealthCheck),
)
@given(case=CASES)
def test_whatever_is_written_mills_nothing_that_must_remain(case, tmp_path_factory):
    folder = tmp_path_factory.mktemp("case")
    status = run(case, folder)
    assert (status == 0) == (folder / "out" / "BevelPath.mod").exists()
    assert status or least_above_mm(folder, (case["root_mm"], case["bevel_deg"]))[0] > -0.15
