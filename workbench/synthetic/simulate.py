"""A recipe in, a profile recording and its exact truth out: in memory, or as files written block by block."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from workbench.artefacts import Part, Recording
from workbench.errors import OutputError
from workbench.storage import beside, require_space
from workbench.synthetic.prism_scan import simulate_prism
from workbench.synthetic.recipe import PrismRecipe, Recipe, SphereRecipe
from workbench.synthetic.recipe_file import read_any_recipe
from workbench.synthetic.scan import PassMotion, plan_motion, recorded_hand_eye, scan_pass
from workbench.synthetic.sphere import SphereTruth, write_sphere
from workbench.synthetic.swept import (
    GrooveRecipe,
    GrooveTruth,
    SweptRecipe,
    SweptTruth,
    simulate_groove,
    simulate_swept,
)
from workbench.synthetic.workpiece import Truth, Workpiece, build_truth
from workbench.units import Float, Int

Progress = Callable[[int, int], None]
AnyTruth = Truth | SphereTruth | SweptTruth | GrooveTruth
InMemory = SweptRecipe | GrooveRecipe | PrismRecipe
_PACKED: dict[str, Any] = {"compression": "gzip", "compression_opts": 4, "shuffle": True}


def simulate_recording(recipe: Recipe) -> tuple[Recording, Truth]:
    """The recording that `recipe` describes, and its truth. The same recipe gives the same numbers."""
    return scan_workpiece(Workpiece(recipe))


def scan_workpiece(workpiece: Workpiece) -> tuple[Recording, Truth]:
    """The recording of a workpiece as it is now, cut or not, and its truth.

    A part that was milled is scanned by the same scanner on the same robot, with the same hand-eye error; all other
    random numbers are new ones, after each milling.
    """
    recipe, cut = workpiece.recipe, workpiece.cut
    motions = plan_motion(recipe, cut)
    blocks = [[block for _, block in scan_pass(recipe, motion, k, cut)] for k, motion in enumerate(motions)]
    flat = [block for scan in blocks for block in scan]
    recording = Recording(
        source="synthetic",
        time_s=np.concatenate([m.time_s for m in motions]),
        x_mm=np.concatenate([b.x_mm for b in flat]),
        z_mm=np.concatenate([b.z_mm for b in flat]),
        pass_index=_pass_index(len(m.time_s) for m in motions),
        robot_time_s=np.concatenate([m.pose_time_s for m in motions]),
        robot_position_mm=np.concatenate([m.position_mm for m in motions]),
        robot_quaternion_wxyz=np.concatenate([m.quaternion_wxyz for m in motions]),
        robot_pass=_pass_index(len(m.pose_time_s) for m in motions),
        flange_from_profiler=recorded_hand_eye(recipe),
        intensity=np.concatenate([b.intensity for b in flat if b.intensity is not None])
        if recipe.scanner.intensity
        else None,
        part=Part(part_id=recipe.part_id, sensor="synthetic", robot="synthetic", simulated=True),
    )
    return recording, build_truth(recipe, [np.concatenate([b.seen_u for b in scan]) for scan in blocks], cut)


def simulate_file(recipe_path: str | Path, out_path: str | Path, progress: Progress | None = None) -> AnyTruth:
    """Write the recording of the recipe at `recipe_path` to `out_path`, its truth to `<out_path>.truth.json`.

    Both files appear whole or not at all. `progress` is told frames done and frames in all.
    InputError: the recipe is unusable. OutputError: the files cannot be written.
    """
    recipe = read_any_recipe(recipe_path)
    if Path(recipe_path).resolve() in (Path(out_path).resolve(), truth_path(out_path).resolve()):
        raise OutputError(str(out_path), "a name that does not overwrite the recipe")
    return write_simulation(recipe, out_path, progress)


def write_simulation(
    recipe: Recipe | SphereRecipe | InMemory, out_path: str | Path, progress: Progress | None = None
) -> AnyTruth:
    """As `simulate_file`, from a recipe at hand."""
    recording, truth_file = Path(out_path), truth_path(out_path)
    partial = [beside(path) for path in (recording, truth_file)]
    for path in (recording, truth_file):
        if path.is_dir():
            raise OutputError(str(path), "a file to write, but this is a folder")
    try:
        truth: AnyTruth
        if isinstance(recipe, SphereRecipe):
            truth = write_sphere(recipe, partial[0])
        elif isinstance(recipe, InMemory):
            truth = _write_in_memory(recipe, partial[0], progress)
        else:
            truth = _write_recording(recipe, partial[0], progress)
        text = json.dumps(truth.document(), allow_nan=False, separators=(",", ":")) + "\n"
        partial[1].write_text(text, encoding="utf-8")
        partial[1].replace(truth_file)
        partial[0].replace(recording)
    except (OSError, RuntimeError) as error:  # HDF5 reports a full disk as either
        cause = getattr(error, "strerror", None) or error
        raise OutputError(str(out_path), f"a place to write the recording to ({cause})") from error
    finally:
        for path in partial:
            path.unlink(missing_ok=True)
    return truth


def truth_path(recording_path: str | Path) -> Path:
    """Where the truth of a recording stands: `FILE.truth.json` beside `FILE.h5`."""
    path = Path(recording_path)
    return path.with_name(path.name.removesuffix(".h5") + ".truth.json")


def _pass_index(counts: Any) -> Int:
    return np.concatenate([np.full(count, index, dtype=np.int64) for index, count in enumerate(counts)])


def _write_in_memory(recipe: InMemory, path: Path, progress: Progress | None) -> SweptTruth | GrooveTruth:
    """The HDF5 file of a swept part or a groove, which is simulated in memory."""
    import h5py

    truth: SweptTruth | GrooveTruth
    if isinstance(recipe, PrismRecipe):
        recording, truth = simulate_prism(recipe)
    elif isinstance(recipe, GrooveRecipe):
        recording, truth = simulate_groove(recipe, progress)
    else:
        recording, truth = simulate_swept(recipe, progress)
    grids = {"x": recording.x_mm, "z": recording.z_mm, "intensity": recording.intensity}
    require_space(path, sum(grid.nbytes for grid in grids.values() if grid is not None))
    with h5py.File(path, "w") as file:
        _write_header(file, recipe.part_id)
        chunk = (min(64, len(recording.x_mm)), recording.x_mm.shape[1])
        for name, grid in grids.items():
            if grid is not None:
                file.create_dataset(f"profiles/{name}", data=grid, chunks=chunk, **_PACKED)
        file["profiles/time"], file["robot/time"] = recording.time_s, recording.robot_time_s
        file["robot/position"] = recording.robot_position_mm
        file["robot/quaternion_wxyz"] = recording.robot_quaternion_wxyz
        file["hand_eye/flange_from_profiler"] = recording.flange_from_profiler
        if len(recipe.passes) > 1:
            file["profiles/pass"] = recording.pass_index.astype(np.int32)
            file["robot/pass"] = recording.robot_pass.astype(np.int32)
    return truth


def _write_header(file: Any, part_id: str | None) -> None:
    file.attrs.update({"format": "profile-recording", "version": 1, "length_unit": "mm", "time_unit": "s"})
    file.attrs.update({"sensor": "synthetic", "robot": "synthetic", "simulated": 1})
    if part_id is not None:
        file.attrs["part_id"] = part_id


def _write_recording(recipe: Recipe, path: Path, progress: Progress | None) -> Truth:
    """The HDF5 file, block by block, so that metres of edge need little memory."""
    import h5py

    motions, scanner = plan_motion(recipe), recipe.scanner
    total, done = sum(len(m.time_s) for m in motions), 0
    seen: list[list[Float]] = []
    require_space(path, total * scanner.columns * (10 if scanner.intensity else 8))
    with h5py.File(path, "w") as file:
        _write_header(file, recipe.part_id)
        _write_poses(file, motions, recipe)
        shape = {"shape": (total, scanner.columns), "chunks": (min(64, total), scanner.columns)}
        packed = {**shape, **_PACKED}
        x = file.create_dataset("profiles/x", dtype="f4", **packed)
        z = file.create_dataset("profiles/z", dtype="f4", **packed)
        grey = file.create_dataset("profiles/intensity", dtype="u2", **packed) if scanner.intensity else None
        for index, motion in enumerate(motions):
            seen.append([])
            for _, block in scan_pass(recipe, motion, index):
                rows = slice(done, done + len(block.x_mm))
                x[rows], z[rows] = block.x_mm, block.z_mm
                if grey is not None:
                    grey[rows] = block.intensity
                seen[index].append(block.seen_u)
                done = rows.stop
                if progress is not None:
                    progress(done, total)
    return build_truth(recipe, [np.concatenate(scan) for scan in seen])


def _write_poses(file: Any, motions: list[PassMotion], recipe: Recipe) -> None:
    file["profiles/time"] = np.concatenate([m.time_s for m in motions])
    file["robot/time"] = np.concatenate([m.pose_time_s for m in motions])
    file["robot/position"] = np.concatenate([m.position_mm for m in motions])
    file["robot/quaternion_wxyz"] = np.concatenate([m.quaternion_wxyz for m in motions])
    file["hand_eye/flange_from_profiler"] = recorded_hand_eye(recipe)
    if len(motions) > 1:
        file["profiles/pass"] = _pass_index(len(m.time_s) for m in motions).astype(np.int32)
        file["robot/pass"] = _pass_index(len(m.pose_time_s) for m in motions).astype(np.int32)
