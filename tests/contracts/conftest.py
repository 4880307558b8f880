"""Every shipped pipeline on small inputs, run without its pages; the inspection and the planning also rigidly moved."""

import dataclasses
import functools
import json
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench import Pipeline
from workbench.artefacts import Recording
from workbench.pipeline.catalogue import every_stage
from workbench.pipeline.run import Results, run_plan
from workbench.pipeline.terminal import Reporter
from workbench.pipeline.wiring import Plan
from workbench.scan import read, write
from workbench.stage import Role, Stage
from workbench.synthetic import parse_recipe, simulate_recording

PIPELINES = Path(__file__).parents[2] / "pipelines"
DATA = PIPELINES.parent / "data" / "synthetic"
SCANNED = {"format": "bevel-recipe", "version": 1, "seed": 11, "passes": [{"from_mm": 5.0, "to_mm": 29.0}]}
SCANNED["robot"] = {"frame_pitch_mm": 0.8}
MILLED = SCANNED | {"scanner": {"columns": 400}}
RAW = SCANNED | {"scanner": {"columns": 400}, "part": {"kind": "raw", "length_mm": 34.0, "thickness_mm": 5.0}}
MOTION = np.eye(4)  # moved from base, in mm
MOTION[:3, :3] = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
MOTION[:3, 3] = [310.0, -220.0, 95.0]
MILLED_ONCE = ("chatter", "optimise_posture")  # a layer of the shipped path is enough for them
PLANS = ("plan_bevel", "milling_force", "sensitivity")  # they begin with a raw edge
LOOPS = ("closed_loop", "compensated_loop", "compound_loop", "j_loop", "measured_loop")  # they begin with a recipe
SMALL: dict[str, dict[str, Any]] = {  # what a law asks for shows over few postures, stations and places as well
    "stiffness.posture": {"cutter_rotation_deg": [-10, 10], "turntable_deg": [0, 0], "sampled_points": 10},
    "stiffness.chatter": {"stations": 3, "speed_change": 0.05},
    "stiffness.maps": {"steps": 9},
    "compare.deviation": {"spacing_mm": 6.0},
    "scan.plan": {"frame_rate_hz": 80.0},
}


@dataclass(frozen=True)
class Chain:
    """A pipeline that has run: its plan and everything it made."""

    plan: Plan
    results: Results


def values(artefact: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    """Everything inside an artefact, by place: arrays and plain values."""
    if dataclasses.is_dataclass(artefact):
        artefact = {field.name: getattr(artefact, field.name) for field in dataclasses.fields(artefact)}
    if isinstance(artefact, tuple | list):
        artefact = dict(enumerate(artefact))
    if not isinstance(artefact, Mapping):
        yield place, artefact
        return
    for key, part in artefact.items():
        yield from values(part, f"{place}.{key}")


class Call(NamedTuple):
    """One of a stage: its artefacts and parameters by name, what it made, and how long that took."""

    given: dict[str, Any]
    made: Any
    seconds: float


@pytest.fixture(scope="session")
def recording() -> Recording:
    return simulate_recording(parse_recipe(MILLED))[0]


@pytest.fixture(scope="session")
def recording_file(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "part.h5"
    write(recording, path)
    return path


@pytest.fixture(scope="session")
def raw_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("raw") / "raw.h5"
    write(simulate_recording(parse_recipe(RAW))[0], path)
    return path


@pytest.fixture(scope="session")
def chain(recording_file: Path) -> Chain:
    return run_chain("inspect_bevel", recording=recording_file)


@pytest.fixture(scope="session")
def moved_chain(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Chain:
    return run_chain("inspect_bevel", recording=moved_file(recording, tmp_path_factory.mktemp("moved")))


@pytest.fixture(scope="session")
def plan_chains(raw_file: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Chain, Chain]:
    """The planning, as it is and moved."""
    turned = [float(x) for x in MOTION[:3, 2]]
    moved = moved_file(read(recording=raw_file), tmp_path_factory.mktemp("raw moved"))
    there = {"recording": moved, "upper_side": turned}
    return run_chain("plan_bevel", "path.feed", recording=raw_file), run_chain("plan_bevel", "path.feed", **there)


@pytest.fixture(scope="module")
def calls() -> Iterator[dict[str, list[Call]]]:
    """Of every stage, in their order; it runs once for the same artefacts and parameters: pipelines begin alike."""
    made: dict[str, list[Call]] = {}
    with pytest.MonkeyPatch.context() as patch:
        for name, stage in every_stage()[0].items():
            patch.setitem(vars(stage), "function", once(stage, made.setdefault(name, [])))
        yield made


def once(stage: Stage, calls: list[Call]) -> Callable[..., Any]:
    function, made = stage.function, {}

    @functools.wraps(function)
    def run(*sources: Any, **named: Any) -> Any:
        given = dict(zip((one.name for one in stage.sources), sources, strict=False)) | named
        key = known({name: one for name, one in given.items() if stage.parameters.get(name) is not Role.PROGRESS})
        if key not in made:
            begun = time.process_time()
            found = function(**given)
            made[key] = Call(given, found, time.process_time() - begun)  # kept, so that no other object has their ids
            calls.append(made[key])
        return made[key].made

    return run


def known(value: Any) -> Any:
    if isinstance(value, dict):
        return tuple(sorted((name, known(one)) for name, one in value.items() if one is not None))
    if isinstance(value, tuple | list):
        return tuple(map(known, value))
    if isinstance(value, Path):
        return str(value.resolve())
    return repr(value) if isinstance(value, str | int | float | None) else id(value)


@pytest.fixture(scope="module")
def chains(calls: Any, recording_file: Path, raw_file: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Chain]:
    """Every shipped pipeline."""
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "raw.json").write_text(json.dumps(RAW))
    path = json.loads((DATA / "paths" / "raw_arc.json").read_text())
    (folder / "path.json").write_text(json.dumps(path | {"layers": path["layers"][-1:], "travels": []}))
    given: dict[str, Any] = {name: {"recording": recording_file} for name in ("inspect_bevel", "export_inspection")}
    given |= {name: {"recording": raw_file} for name in PLANS}
    given |= {name: {"recipe": folder / "raw.json"} for name in LOOPS}
    given["measured_loop"] |= (once_over := {"passes": 1})
    given["plan_scan"] = once_over
    given |= {name: {"toolpath": folder / "path.json"} for name in MILLED_ONCE}
    return [run_chain(path.stem, **given.get(path.stem, {})) for path in sorted(PIPELINES.glob("*.json"))]


@pytest.fixture(scope="session")
def motion() -> Any:
    return MOTION


def moved_file(recording: Recording, folder: Path) -> Path:
    """The same recording with the robot's base elsewhere: positions and orientations of the flange moved by MOTION."""
    turn = Rotation.from_matrix(MOTION[:3, :3])
    turned = turn * Rotation.from_quat(np.array(recording.robot_quaternion_wxyz), scalar_first=True)
    moved = dataclasses.replace(
        recording,
        robot_position_mm=recording.robot_position_mm @ MOTION[:3, :3].T + MOTION[:3, 3],
        robot_quaternion_wxyz=turned.as_quat(scalar_first=True),
    )
    write(moved, folder / "moved.h5")
    return folder / "moved.h5"


def run_chain(name: str, until: str | None = None, **inputs: Any) -> Chain:
    """A shipped pipeline without its pages, or up to a stage, in memory; what it leaves to the defaults is SMALL."""
    pipeline = Pipeline.load(PIPELINES / f"{name}.json")
    every = [one for one in pipeline.document.stages if not one["stage"].startswith("report.")]
    last = next((k for k, one in enumerate(every, 1) if one["stage"] == until), None)
    stages = tuple(SMALL.get(one["stage"], {}) | one for one in every[:last])
    pipeline.document = dataclasses.replace(pipeline.document, stages=stages)
    plan = pipeline.plan(inputs)
    return Chain(plan, run_plan(plan, Reporter()))
