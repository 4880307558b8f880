"""Every shipped pipeline on small inputs, run without its pages; the inspection and the planning also rigidly moved."""

import dataclasses
import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench import Pipeline
from workbench.artefacts import Chapter, Provenance, Recording
from workbench.pipeline.run import Results, provenance, run_plan
from workbench.pipeline.terminal import Reporter
from workbench.pipeline.wiring import Plan, Step
from workbench.scan import write
from workbench.stage import Stage
from workbench.synthetic import parse_recipe, simulate_recording

PIPELINES = Path(__file__).parents[2] / "pipelines"
DATA = PIPELINES.parent / "data" / "synthetic"
SCANNED = {"format": "bevel-recipe", "version": 1, "seed": 11, "passes": [{"from_mm": 5.0, "to_mm": 45.0}]}
MILLED = SCANNED | {"scanner": {"columns": 400}}
RAW = SCANNED | {"scanner": {"columns": 500}, "part": {"kind": "raw", "length_mm": 50.0, "thickness_mm": 5.0}}
MOTION = np.eye(4)  # moved from base, in mm
MOTION[:3, :3] = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
MOTION[:3, 3] = [310.0, -220.0, 95.0]
STAND_INS = (Chapter("Stand-in", "<p>for the chapters, which the chains leave out</p>"),)
MILLED_ONCE = ("chatter", "optimise_posture")  # a layer of the shipped path is enough for them
LOOPS = ("closed_loop", "compensated_loop", "compound_loop", "j_loop", "measured_loop")  # they begin with a recipe
COMPARED = Path(__file__).parents[1] / "compare" / "data"
GIVEN: dict[str, dict[str, Any]] = {  # parameters of stages in no shipped pipeline that have no defaults
    "cloud.register": {"reference": str(DATA / "raw_edge.laz"), "voxel_mm": 3.0},
    "compare.mesh": {"mesh": str(COMPARED / "wedge.obj")},
}
SMALL: dict[str, dict[str, Any]] = {  # what a law asks for shows over few postures, stations and places as well
    "stiffness.posture": {"cutter_rotation_deg": [-10, 10], "turntable_deg": [0, 0], "sampled_points": 10},
    "stiffness.chatter": {"stations": 3},
    "stiffness.maps": {"steps": 9},
    "compare.deviation": {"spacing_mm": 3.0},
}


@dataclass(frozen=True)
class Chain:
    """A pipeline that has run: its plan and everything it made."""

    plan: Plan
    results: Results

    def step(self, stage: Stage) -> Step | None:
        """The step of a stage, if the pipeline has one."""
        return next((step for step in self.plan.steps if step.stage.name == stage.name), None)

    def offered(self, step: Step | None, name: str) -> list[Any]:
        """What the pipeline's step takes as source `name`; without a step, all that the pipeline made."""
        made = self.results.artefacts
        return [one for maker in (step.sources[name] if step else made) for one in made[maker]]

    @staticmethod
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
            yield from Chain.values(part, f"{place}.{key}")


@dataclass(frozen=True)
class Chains:
    """All of them; a stage is at home in the first that has it."""

    chains: tuple[Chain, ...]

    def parameters(self, stage: Stage) -> dict[str, Any]:
        """The pipeline's parameters for a stage or, outside all, the defaults."""
        step = next(filter(None, (chain.step(stage) for chain in self.chains)), None)
        return dict(step.parameters) if step else stage.validate(GIVEN.get(stage.name, {}))

    def sources(self, stage: Stage) -> dict[str, Any]:
        """The artefacts that a stage takes: those of its step, else the last of each type that one chain offers."""
        home = self.home(stage) or self.whole(stage)
        taken = {}
        for source in stage.sources:
            chains = [home] if home else self.chains
            found = [one for chain in chains for one in chain.offered(chain.step(stage), source.name)]
            found = [one for one in [*STAND_INS, *found] if isinstance(one, source.type)]
            if source.type is Provenance:
                found = [provenance(chains[0].plan, chains[0].results)]
            if found or source.required:
                taken[source.name] = tuple(found) if source.several else found[-1]
        return taken

    def made(self, stage: Stage) -> tuple[Any, ...] | None:
        """What a chain made of the same sources; None: in no chain, or its chapters are stand-ins here."""
        home = self.home(stage)
        if not home or any(issubclass(source.type, Chapter | Provenance) for source in stage.sources):
            return None
        return home.results.artefacts[home.step(stage).id]

    def run(self, stage: Stage) -> tuple[Any, ...]:
        """Run one stage again, on the chains' artefacts."""
        made = stage.function(**self.sources(stage), **self.parameters(stage))
        return made if isinstance(made, tuple) else () if made is None else (made,)

    values = staticmethod(Chain.values)

    def home(self, stage: Stage) -> Chain | None:
        """The first chain that has the stage, and all that it must be given."""
        return next((chain for chain in self.chains if chain.step(stage) and self.has_all(chain, stage)), None)

    def whole(self, stage: Stage) -> Chain | None:
        """The last chain that has all that a stage must be given: what belongs together stays together."""
        return next((chain for chain in self.chains[::-1] if self.has_all(chain, stage)), None)

    @staticmethod
    def has_all(chain: Chain, stage: Stage) -> bool:
        """Whether a chain made all that a stage must be given; the planning without a cell, say, has none to give."""
        wanted = [source.type for source in stage.sources if source.required and source.type is not Provenance]
        return all(any(isinstance(one, kind) for one in chain.results) for kind in wanted)


@pytest.fixture(scope="session")
def recording() -> Recording:
    return simulate_recording(parse_recipe(MILLED))[0]


@pytest.fixture(scope="session")
def recording_file(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "part.h5"
    write(recording, path)
    return path


@pytest.fixture(scope="session")
def chain(recording_file: Path) -> Chain:
    return run_chain("inspect_bevel", recording=recording_file)


@pytest.fixture(scope="session")
def moved_chain(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Chain:
    return run_chain("inspect_bevel", recording=moved_file(recording, tmp_path_factory.mktemp("moved")))


@pytest.fixture(scope="session")
def plan_chains(tmp_path_factory: pytest.TempPathFactory) -> tuple[Chain, Chain]:
    """The planning, as it is and moved."""
    recording, folder = simulate_recording(parse_recipe(RAW))[0], tmp_path_factory.mktemp("raw")
    write(recording, folder / "raw.h5")
    here = run_chain("plan_bevel", recording=folder / "raw.h5")
    turned = [float(x) for x in MOTION[:3, 2]]
    return here, run_chain("plan_bevel", recording=moved_file(recording, folder), upper_side=turned)


@pytest.fixture(scope="session")
def chains(chain: Chain, tmp_path_factory: pytest.TempPathFactory) -> Chains:
    folder = tmp_path_factory.mktemp("inputs")
    (folder / "raw.json").write_text(json.dumps(RAW))
    path = json.loads((DATA / "paths" / "raw_arc.json").read_text())
    (folder / "path.json").write_text(json.dumps(path | {"layers": path["layers"][-1:], "travels": []}))
    given = {name: {"recipe": folder / "raw.json"} for name in LOOPS}
    given |= {name: {"toolpath": folder / "path.json"} for name in MILLED_ONCE}
    others = sorted({path.stem for path in PIPELINES.glob("*.json")} - {"inspect_bevel", *LOOPS})
    return Chains((chain, *(run_chain(name, **given.get(name, {})) for name in (*LOOPS, *others))))


@pytest.fixture(scope="session")
def motion() -> Any:
    return MOTION


def moved_file(recording: Recording, folder: Path) -> Path:
    """The same recording with the robot's base elsewhere: positions and orientations of the flange moved by MOTION."""
    turn = Rotation.from_matrix(MOTION[:3, :3])
    turned = turn * Rotation.from_quat(recording.robot_quaternion_wxyz, scalar_first=True)
    moved = dataclasses.replace(
        recording,
        robot_position_mm=turn.apply(recording.robot_position_mm) + MOTION[:3, 3],
        robot_quaternion_wxyz=turned.as_quat(scalar_first=True),
    )
    write(moved, folder / "moved.h5")
    return folder / "moved.h5"


def run_chain(name: str, **inputs: Any) -> Chain:
    """A shipped pipeline without its pages, in memory; what it leaves to the defaults is SMALL."""
    pipeline = Pipeline.load(PIPELINES / f"{name}.json")
    stages = tuple(
        SMALL.get(entry["stage"], {}) | entry
        for entry in pipeline.document.stages
        if not entry["stage"].startswith("report.")
    )
    pipeline.document = dataclasses.replace(pipeline.document, stages=stages)
    plan = pipeline.plan(inputs)
    return Chain(plan, run_plan(plan, Reporter()))
