"""A small synthetic recording, as it is and rigidly moved, and what the shipped inspection makes of both."""

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench import Pipeline
from workbench.artefacts import Chapter, Provenance, Recording
from workbench.pipeline.progress import Reporter
from workbench.pipeline.run import Results, provenance, run_plan
from workbench.pipeline.wiring import Plan, Step
from workbench.scan import write
from workbench.stage import Stage
from workbench.synthetic import parse_recipe, simulate_recording

PIPELINE = Path(__file__).parents[2] / "pipelines" / "inspect_bevel.json"
RECIPE = {
    "format": "bevel-recipe",
    "version": 1,
    "seed": 11,
    "scanner": {"columns": 400},
    "passes": [{"from_mm": 5.0, "to_mm": 45.0}],
}
MOTION = np.eye(4)  # moved from base, in mm
MOTION[:3, :3] = Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix()
MOTION[:3, 3] = [310.0, -220.0, 95.0]
STAND_INS = (Chapter("Stand-in", "<p>for the chapters, which the chain leaves out</p>"),)


@dataclass(frozen=True)
class Chain:
    """A pipeline that has run: its plan and everything it made."""

    plan: Plan
    results: Results

    def step(self, stage: Stage) -> Step | None:
        """The step of a stage, if the pipeline has one."""
        return next((step for step in self.plan.steps if step.stage.name == stage.name), None)

    def parameters(self, stage: Stage) -> dict[str, Any]:
        """The pipeline's parameters for a stage or, outside it, the defaults."""
        step = self.step(stage)
        return dict(step.parameters) if step else stage.validate({})

    def sources(self, stage: Stage) -> dict[str, Any]:
        """The artefacts that a stage takes: those of its step, else the last of each type."""
        step, taken = self.step(stage), {}
        for source in stage.sources:
            makers = step.sources[source.name] if step else self.results.artefacts
            found = [one for maker in makers for one in self.results.artefacts[maker] if isinstance(one, source.type)]
            if source.type is Provenance:
                found = [provenance(self.plan, self.results)]
            found = found or [one for one in STAND_INS if isinstance(one, source.type)]
            if found or source.required:
                taken[source.name] = tuple(found) if source.several else found[-1]
        return taken

    def run(self, stage: Stage) -> tuple[Any, ...]:
        """Run one stage again, on the chain's artefacts."""
        made = stage.function(**self.sources(stage), **self.parameters(stage))
        return made if isinstance(made, tuple) else (made,)

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


@pytest.fixture(scope="session")
def recording() -> Recording:
    return simulate_recording(parse_recipe(RECIPE))[0]


@pytest.fixture(scope="session")
def recording_file(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("recording") / "part.h5"
    write(recording, path)
    return path


@pytest.fixture(scope="session")
def chain(recording_file: Path) -> Chain:
    return run_chain(recording_file)


@pytest.fixture(scope="session")
def moved_chain(recording: Recording, tmp_path_factory: pytest.TempPathFactory) -> Chain:
    """The same recording with the robot's base elsewhere: positions and orientations of the flange moved by MOTION."""
    turn = Rotation.from_matrix(MOTION[:3, :3])
    turned = turn * Rotation.from_quat(recording.robot_quaternion_wxyz, scalar_first=True)
    moved = dataclasses.replace(
        recording,
        robot_position_mm=turn.apply(recording.robot_position_mm) + MOTION[:3, 3],
        robot_quaternion_wxyz=turned.as_quat(scalar_first=True),
    )
    path = tmp_path_factory.mktemp("moved") / "part.h5"
    write(moved, path)
    return run_chain(path)


@pytest.fixture(scope="session")
def motion() -> Any:
    return MOTION


def run_chain(recording_file: Path) -> Chain:
    """The shipped inspection without its pages, in memory."""
    pipeline = Pipeline.load(PIPELINE)
    stages = tuple(entry for entry in pipeline.document.stages if not entry["stage"].startswith("report."))
    pipeline.document = dataclasses.replace(pipeline.document, stages=stages)
    plan = pipeline.plan({"recording": recording_file})
    return Chain(plan, run_plan(plan, Reporter()))
