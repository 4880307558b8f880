"""A recipe in, a profile recording and its exact truth out: in memory, or as files written block by block."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Protocol, TypeVar

import numpy as np

from workbench.artefacts import Recording, ScanCourse
from workbench.errors import OutputError
from workbench.recording_file import Frames, fill
from workbench.storage import digest_of, partial_path
from workbench.synthetic.groove_truth import GrooveTruth
from workbench.synthetic.prism_scan import simulate_prism
from workbench.synthetic.recipe import PrismRecipe, Recipe, SphereRecipe
from workbench.synthetic.recipe_file import read_any_recipe
from workbench.synthetic.scan import plan_motion, recorded, recorded_hand_eye, scan_pass
from workbench.synthetic.sphere import SphereTruth, simulate_sphere
from workbench.synthetic.workpiece import DIGEST, Truth, Workpiece, build_truth
from workbench.units import Float

Progress = Callable[[int, int], None]
AnyTruth = Truth | SphereTruth | GrooveTruth
T = TypeVar("T", bound="Written")
PACKING = "gzip"


class Written(Protocol):
    """A truth that a file can hold."""

    def document(self) -> dict[str, Any]:
        """The content of the truth file."""


def simulate_recording(recipe: Recipe) -> tuple[Recording, Truth]:
    """The recording that `recipe` describes, and its truth. The same recipe gives the same numbers."""
    return scan_workpiece(Workpiece(recipe))


def scan_workpiece(workpiece: Workpiece, courses: Sequence[ScanCourse] | None = None) -> tuple[Recording, Truth]:
    """The recording of a workpiece as it is now, cut or not, and its truth.

    A part that was milled is scanned by the same scanner on the same robot, with the same hand-eye error; all other
    random numbers are new ones, after each milling. courses: planned passes in place of the recipe's.
    """
    recipe, cut = workpiece.recipe, workpiece.cut
    motions = plan_motion(recipe, cut, courses)
    blocks = [[block for _, block in scan_pass(recipe, motion, k, cut)] for k, motion in enumerate(motions)]
    flat = [block for scan in blocks for block in scan]
    grids = Frames(
        np.concatenate([b.x_mm for b in flat]),
        np.concatenate([b.z_mm for b in flat]),
        np.concatenate([b.intensity for b in flat if b.intensity is not None]) if recipe.scanner.intensity else None,
    )
    truth = build_truth(recipe, [np.concatenate([b.seen_u for b in scan]) for scan in blocks], cut)
    return recorded(motions, grids, recorded_hand_eye(recipe), recipe.part_id), truth


def simulate_file(recipe_path: str | Path, out_path: str | Path, progress: Progress | None = None) -> AnyTruth:
    """Write the recording of the recipe at `recipe_path` to `out_path`, its truth to `<out_path>.truth.json`.

    Both files appear whole or not at all. `progress` is told frames done and frames in all.
    InputError: the recipe is unusable. OutputError: `out_path` does not end in .h5, the files cannot be written.
    """
    if Path(out_path).suffix != ".h5":
        raise OutputError(str(out_path), "expected the name of a recording to write, ending in .h5")
    recipe = read_any_recipe(recipe_path)
    if Path(recipe_path).resolve() in (Path(out_path).resolve(), truth_path(out_path).resolve()):
        raise OutputError(str(out_path), "expected a name that does not overwrite the recipe")
    return write_simulation(recipe, out_path, progress)


def write_simulation(
    recipe: Recipe | SphereRecipe | PrismRecipe, out_path: str | Path, progress: Progress | None = None
) -> AnyTruth:
    """As `simulate_file`, from a recipe at hand."""
    if isinstance(recipe, Recipe):
        return _written(lambda path: _write_recording(recipe, path, progress), out_path)
    if isinstance(recipe, SphereRecipe):
        return write_made(*simulate_sphere(recipe), out_path)
    return write_made(*simulate_prism(recipe), out_path)


def write_made(recording: Recording, truth: T, out_path: str | Path) -> T:
    """A recording that is simulated already, and its truth, as `simulate_file` writes them."""

    def write(path: Path) -> T:
        fill(path, recording, [Frames(recording.x_mm, recording.z_mm, recording.intensity)], PACKING)
        return truth

    return _written(write, out_path)


def _written(write: Callable[[Path], T], out_path: str | Path) -> T:
    """What `write` makes of a file for the recording: both files, whole or not at all."""
    recording, truth_file = Path(out_path), truth_path(out_path)
    partial = [partial_path(path) for path in (recording, truth_file)]
    for path in (recording, truth_file):
        if path.is_dir():
            raise OutputError(str(path), "expected a file to write, this is a folder")
    try:
        truth = write(partial[0])
        document = {**truth.document(), DIGEST: digest_of(partial[0])}
        text = json.dumps(document, allow_nan=False, separators=(",", ":")) + "\n"
        partial[1].write_text(text, encoding="utf-8")
        truth_file.unlink(missing_ok=True)  # a kill between the two leaves no truth rather than another recording's
        partial[0].replace(recording)
        partial[1].replace(truth_file)
    except OSError as error:
        raise OutputError(str(out_path), f"cannot be written: {error.strerror or error}") from None
    finally:
        for path in partial:
            with suppress(OSError):
                path.unlink(missing_ok=True)
    return truth


def truth_path(recording_path: str | Path) -> Path:
    """Where the truth of a recording stands: `FILE.truth.json` beside `FILE.h5`."""
    path = Path(recording_path)
    return path.with_name(path.name.removesuffix(".h5") + ".truth.json")


def _write_recording(recipe: Recipe, path: Path, progress: Progress | None) -> Truth:
    """The HDF5 file, block by block, so that metres of edge need little memory."""
    motions, scanner = plan_motion(recipe), recipe.scanner
    shape = (sum(len(m.time_s) for m in motions), scanner.columns)
    seen: list[list[Float]] = [[] for _ in motions]

    def frames() -> Iterator[Frames]:
        done = 0
        for index, motion in enumerate(motions):
            for _, block in scan_pass(recipe, motion, index):
                yield Frames(block.x_mm, block.z_mm, block.intensity)
                seen[index].append(block.seen_u)
                done += len(block.x_mm)
                if progress is not None:
                    progress(done, shape[0])

    unseen = np.broadcast_to(np.float32(np.nan), shape)
    dark = np.broadcast_to(np.uint16(0), shape) if scanner.intensity else None
    empty = recorded(motions, Frames(unseen, unseen, dark), recorded_hand_eye(recipe), recipe.part_id)
    fill(path, empty, frames(), PACKING)
    return build_truth(recipe, [np.concatenate(scan) for scan in seen])
