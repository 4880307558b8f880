"""The readers that are fed mutated files, and the good files that the mutations start from."""

from __future__ import annotations

import json
import random
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from pkgutil import resolve_name

from bench.fuzz.mutate import mutated
from bench.fuzz.recordings import malformed_recording, mutated_recording
from bench.harness import ROOT

CORPUS = Path(__file__).with_name("corpus")


@dataclass(frozen=True)
class Target:
    """A reader: `read(path)` gives a result or raises a WorkbenchError."""

    name: str
    read: Callable[[Path], object]
    seeds: tuple[str, ...]  # globs below the project's folder
    share: float = 1.0  # of the executions, against a reader of short texts
    mutate: Callable[[bytes, str, random.Random], bytes] = mutated
    beside: tuple[str, ...] = ()  # what the files refer to: paths relative to their own folder, as in the project

    def files(self) -> list[Path]:
        """Good files, the shortest first, and what once made trouble."""
        shipped = [path for pattern in self.seeds for path in ROOT.glob(pattern)]
        return sorted(shipped, key=lambda path: path.stat().st_size) + sorted((CORPUS / self.name).glob("*"))

    def surroundings(self, scratch: Path) -> Path:
        """The folder for mutated files, made inside `scratch` with links to what stands beside a good one."""
        place = scratch / "files"
        place.mkdir()
        for name in self.beside:
            (place / name).symlink_to(next(ROOT.glob(self.seeds[0])).parent / name)
        return place


def reads(place: str, parameter: str = "") -> Callable[[Path], object]:
    """The function at `place` (module:name), imported when it is called; of a stage the parameter that is the file."""

    def read(path: Path) -> object:
        function = resolve_name(place)
        return function(**{parameter: path}) if parameter else function(path)

    return read


def _pipeline(path: Path) -> object:
    from workbench.pipeline import Pipeline

    return Pipeline.load(path).plan()


def _run(pipeline: str, path: Path) -> object:
    """The whole pipeline on a recording; what fails inside a stage is raised as it was."""
    from workbench.errors import PipelineError
    from workbench.pipeline import Pipeline

    try:
        return Pipeline.load(ROOT / "pipelines" / pipeline).run(inputs={"recording": str(path)}, report=False)
    except PipelineError as error:
        if error.__cause__ is not None:
            raise error.__cause__ from None
        raise


def _urdf(path: Path) -> object:
    from workbench.robot import cell

    shipped = json.loads((ROOT / "data/robot/cell.json").read_text())
    shipped["robot"]["urdf"] = str(path.resolve())
    with tempfile.TemporaryDirectory() as folder:
        around = Path(folder) / "cell.json"
        around.write_text(json.dumps(shipped))
        return cell(cell=around)


def _deflections(path: Path) -> object:
    from workbench.path import read
    from workbench.twin.mill_stage import read_deflections

    return read_deflections(path, read(toolpath=CORPUS / "toolpath" / "short.json").layers)


def _identify(path: Path) -> object:
    from workbench.plugins.stiffness import identify
    from workbench.robot import cell

    return identify(cell(cell=ROOT / "data/robot/cell.json"), loads=path)


def _source(path: Path, **parts: object) -> object:
    """A source of a recording, with a mapping whose parts are about the file."""
    from workbench.importing.kinds import read_source
    from workbench.importing.mapping import Mapping

    given = {"format": "import-mapping", "version": 1, **parts}
    return read_source(path, Mapping.model_validate(given).model_copy(update={"base_dir": ROOT}))


def _seven_corners(path: Path) -> object:
    from workbench.importing.text import read_text
    from workbench.look.seven_corners import read_corners

    return read_corners(read_text(path), str(path))


JOINTS = {
    "files": "*",
    "columns": ["j1", "j2", "j3", "j4", "j5", "j6"],
    "angle_unit": "deg",
    "time": "t",
    "time_unit": "s",
    "urdf": "data/robot/irb6700_150_320.urdf",
    "base_frame": "base_link",
    "flange_frame": "tool0",
}
TARGETS = (
    Target("pipeline", _pipeline, ("pipelines/*.json",), beside=("../data",)),
    Target(
        "recipe",
        reads("workbench.synthetic.recipe_file:read_any_recipe"),
        ("data/synthetic/*edge.json", "data/synthetic/sphere.json"),
    ),
    Target("cell", reads("workbench.robot:cell", "cell"), ("data/robot/cell.json",), beside=("irb6700_150_320.urdf",)),
    Target("urdf", _urdf, ("data/robot/*.urdf",), 0.3),
    Target("toolpath", reads("workbench.path:read", "toolpath"), ()),
    Target("hand_eye", reads("workbench.scan.checks:read_hand_eye"), ()),
    Target("stiffness", reads("workbench.plugins.stiffness:read", "stiffness"), ()),
    Target("loads", reads("workbench.plugins.stiffness.read_stage:read_loads"), ("data/synthetic/loads.csv",), 0.3),
    Target("identify", _identify, ("data/synthetic/loads.csv",), 0.02),
    Target("deflections", _deflections, ()),
    Target("recording", reads("workbench.scan:read", "recording"), (), 0.02),
    Target(
        "recording_form",
        reads("workbench.scan:read", "recording"),
        ("bench/fuzz/corpus/recording/*",),
        0.02,
        malformed_recording,
    ),
    Target("inspecting", partial(_run, "inspect_bevel.json"), (), 0.02, mutated_recording),
    Target("planning", partial(_run, "plan_bevel.json"), (), 0.02, mutated_recording),
    Target("mapping", reads("workbench.importing.mapping:read_mapping"), ()),
    Target("profiles", _source, ()),
    Target("poses", _source, ()),
    Target("scancontrol", _source, ()),
    Target("gocator", _source, ()),
    Target("gopxl", _source, ()),
    Target("arrays", _source, (), 0.1),
    Target("joints", partial(_source, joints=JOINTS), (), 0.1),
    Target("draft", lambda path: reads("workbench.importing.draft:drafted")([path]), (), 0.1),
    Target("forces", reads("workbench.force_file:read_forces"), ()),
    Target("seven_corners", _seven_corners, ()),
    Target("cloud", reads("workbench.cloud:read", "file"), (), 0.003),
    Target("inspection", reads("workbench.compare.measurements:read_inspection"), ()),
    Target("study", reads("workbench.compare:study", "study"), ()),
)
