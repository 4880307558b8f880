"""The readers that are fed mutated files, and the good files that the mutations start from."""

from __future__ import annotations

import random
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from bench.fuzz.mutate import mutated
from bench.fuzz.recordings import mutated_recording

ROOT = Path(__file__).resolve().parents[2]
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


def _recipe(path: Path) -> object:
    from workbench.synthetic.recipe_file import read_any_recipe

    return read_any_recipe(path)


def _cell(path: Path) -> object:
    from workbench.robot import cell

    return cell(cell=path)


def _urdf(path: Path) -> object:
    import json

    from workbench.robot import cell

    shipped = json.loads((ROOT / "data/robot/cell.json").read_text())
    shipped["robot"]["urdf"] = str(path.resolve())
    with tempfile.TemporaryDirectory() as folder:
        around = Path(folder) / "cell.json"
        around.write_text(json.dumps(shipped))
        return cell(cell=around)


def _toolpath(path: Path) -> object:
    from workbench.path import read

    return read(toolpath=path)


def _hand_eye(path: Path) -> object:
    from workbench.scan.checks import read_hand_eye

    return read_hand_eye(path)


def _stiffness(path: Path) -> object:
    from workbench.plugins.stiffness import read

    return read(stiffness=path)


def _loads(path: Path) -> object:
    from workbench.plugins.stiffness.read import read_loads

    return read_loads(path)


def _deflections(path: Path) -> object:
    from workbench.path import read
    from workbench.twin.mill import read_deflections

    return read_deflections(path, read(toolpath=CORPUS / "toolpath" / "short.json").layers)


def _identify(path: Path) -> object:
    from workbench.plugins.stiffness import identify
    from workbench.robot import cell

    return identify(cell(cell=ROOT / "data/robot/cell.json"), loads=path)


def _recording(path: Path) -> object:
    from workbench.scan import read

    return read(recording=path)


def _mapping(path: Path) -> object:
    from workbench.importing.mapping import read_mapping

    return read_mapping(path)


def _source(path: Path) -> object:
    from workbench.importing.kinds import read_source
    from workbench.importing.mapping import no_mapping

    return read_source(path, no_mapping())


def _with(**parts: object) -> Callable[[Path], object]:
    """A reader of sources with a mapping whose one part is about the file."""

    def read(path: Path) -> object:
        from workbench.importing.kinds import read_source
        from workbench.importing.mapping import Mapping

        given = {"format": "import-mapping", "version": 1, **parts}
        return read_source(path, Mapping.model_validate(given).model_copy(update={"base_dir": ROOT}))

    return read


def _draft(path: Path) -> object:
    from workbench.importing.draft import drafted

    return drafted([path])


def _forces(path: Path) -> object:
    from workbench.force_file import read_forces

    return read_forces(path)


def _seven_corners(path: Path) -> object:
    from workbench.importing.text import read_text
    from workbench.look.seven_corners import read_corners

    return read_corners(read_text(path), str(path))


def _bag(path: Path) -> object:
    from workbench.importing import bags
    from workbench.importing.mapping import Mapping

    frames = {"poses": "/flange", "flange_frame": "tool0", "profiler_frame": "laser"}
    return bags.read(path, Mapping.model_validate({"format": "import-mapping", "version": 1, "bag": frames}))


def _cloud(path: Path) -> object:
    from workbench.cloud import read

    return read(file=path)


def _inspection(path: Path) -> object:
    from workbench.compare.measurements import read_inspection

    return read_inspection(path)


def _study(path: Path) -> object:
    from workbench.compare import study

    return study(study=path)


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
    Target("recipe", _recipe, ("data/synthetic/*edge.json", "data/synthetic/sphere.json")),
    Target("cell", _cell, ("data/robot/cell.json",), beside=("irb6700_150_320.urdf",)),
    Target("urdf", _urdf, ("data/robot/*.urdf",), 0.3),
    Target("toolpath", _toolpath, ()),
    Target("hand_eye", _hand_eye, ()),
    Target("stiffness", _stiffness, ()),
    Target("loads", _loads, ("data/synthetic/loads.csv",), 0.3),
    Target("identify", _identify, ("data/synthetic/loads.csv",), 0.02),
    Target("deflections", _deflections, ()),
    Target("recording", _recording, (), 0.02),
    Target("inspecting", partial(_run, "inspect_bevel.json"), (), 0.02, mutated_recording),
    Target("planning", partial(_run, "plan_bevel.json"), (), 0.02, mutated_recording),
    Target("mapping", _mapping, ()),
    Target("profiles", _source, ()),
    Target("poses", _source, ()),
    Target("scancontrol", _source, ()),
    Target("gocator", _source, ()),
    Target("gopxl", _source, ()),
    Target("arrays", _source, (), 0.1),
    Target("joints", _with(joints=JOINTS), (), 0.1),
    Target("draft", _draft, (), 0.1),
    Target("forces", _forces, ()),
    Target("seven_corners", _seven_corners, ()),
    Target("bag", _bag, (), 0.02),
    Target("cloud", _cloud, (), 0.003),
    Target("inspection", _inspection, ()),
    Target("study", _study, ()),
)
