"""A sphere recipe in, a calibration recording and its exact truth out: in memory, or as files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from workbench.artefacts import Part, Recording
from workbench.storage import require_space
from workbench.synthetic.returns import disturb
from workbench.synthetic.scan import column_offsets, sensor_of
from workbench.synthetic.sphere_motion import design_hand_eye, sphere_motion
from workbench.synthetic.sphere_rays import cast, scene
from workbench.synthetic.sphere_recipe import SphereRecipe
from workbench.synthetic.surface import pose
from workbench.units import Float, Int

_BLOCK_FRAMES = 64


@dataclass(frozen=True, slots=True, eq=False)
class SphereTruth:
    """What a synthetic calibration recording was made from. N frames."""

    recipe: SphereRecipe
    flange_from_profiler: Float  # (4, 4) true
    design: Float  # (4, 4) as the recording states it
    base_from_flange: Float  # (N, 4, 4) true, of every frame
    centre_mm: Float  # (N, 3) of the sphere in the profiler frame
    pass_index: Int  # (N,)

    @property
    def gross_passes(self) -> tuple[int, ...]:
        """Passes whose recorded poses are grossly off."""
        return tuple(i for i, one in enumerate(self.recipe.passes) if any(one.gross_mm))

    def document(self) -> dict[str, Any]:
        """The content of a truth file: strict JSON."""
        sphere, robot = self.recipe.sphere, self.recipe.robot
        return {
            "format": "sphere-truth",
            "version": 1,
            "seed": self.recipe.seed,
            "flange_from_profiler": self.flange_from_profiler.tolist(),
            "design_flange_from_profiler": self.design.tolist(),
            "sphere_center_mm": list(sphere.center_mm),
            "sphere_diameter_mm": sphere.diameter_mm,
            "time_offset_s": robot.clock_offset_s if robot.clock == "own" else None,
            "gross_passes": list(self.gross_passes),
            "pass": self.pass_index.tolist(),
            "sphere_in_profiler_mm": self.centre_mm.round(9).tolist(),
            "recipe": self.recipe.model_dump(mode="json"),
        }


def simulate_sphere(recipe: SphereRecipe) -> tuple[Recording, SphereTruth]:
    """The calibration recording that `recipe` describes, and its truth. The same recipe gives the same numbers."""
    motions = sphere_motion(recipe)
    poses = np.concatenate([m.base_from_flange for m in motions])
    x, z = _profiles(recipe, poses)
    truth = _truth(recipe, poses, _pass_index([len(m.time_s) for m in motions]))
    sphere = recipe.sphere
    recording = Recording(
        source="synthetic",
        time_s=np.concatenate([m.time_s for m in motions]),
        x_mm=x,
        z_mm=z,
        pass_index=truth.pass_index,
        robot_time_s=np.concatenate([m.pose_time_s for m in motions]),
        robot_position_mm=np.concatenate([m.position_mm for m in motions]),
        robot_quaternion_wxyz=np.concatenate([m.quaternion_wxyz for m in motions]),
        robot_pass=_pass_index([len(m.pose_time_s) for m in motions]),
        flange_from_profiler=truth.design,
        sphere_diameter_mm=sphere.stated_diameter_mm or sphere.diameter_mm,
        clock=recipe.robot.clock,
        part=Part(sensor="synthetic", robot="synthetic", simulated=True),
    )
    return recording, truth


def true_poses(recipe: SphereRecipe) -> tuple[Float, Float, Float]:
    """flange_from_profiler (4, 4), flange poses (N, 4, 4), sphere centres in the profiler frame (N, 3): true."""
    poses = np.concatenate([m.base_from_flange for m in sphere_motion(recipe)])
    return pose(recipe.robot.flange_from_profiler), poses, scene(recipe, poses).centre


def _truth(recipe: SphereRecipe, poses: Float, pass_index: Int) -> SphereTruth:
    true = pose(recipe.robot.flange_from_profiler)
    return SphereTruth(recipe, true, design_hand_eye(recipe), poses, scene(recipe, poses).centre, pass_index)


def _profiles(recipe: SphereRecipe, poses: Float) -> tuple[Any, Any]:
    """x and z (N, M) as returned."""
    sensor, offsets = sensor_of(recipe.scanner), column_offsets(recipe.scanner)
    xs, zs = [], []
    for number, first in enumerate(range(0, len(poses), _BLOCK_FRAMES)):
        exact, cosines = cast(scene(recipe, poses[first : first + _BLOCK_FRAMES]), sensor, offsets)
        ranges = disturb(recipe, exact, cosines, np.random.default_rng([recipe.seed, 3, number]))
        x = sensor.emitter_x + (ranges * offsets if sensor.angular else np.broadcast_to(offsets, ranges.shape))
        xs.append(x.astype(np.float32))
        zs.append((sensor.emitter_z + sensor.sign * ranges).astype(np.float32))
    return np.concatenate(xs), np.concatenate(zs)


def _pass_index(counts: list[int]) -> Int:
    return np.repeat(np.arange(len(counts)), counts)


def write_sphere(recipe: SphereRecipe, path: Path) -> SphereTruth:
    """The recording as HDF5 (INTERFACES section 1)."""
    import h5py

    recording, truth = simulate_sphere(recipe)
    require_space(path, recording.x_mm.nbytes * 2)
    packed = {"compression": "gzip", "compression_opts": 4, "shuffle": True}
    with h5py.File(path, "w") as file:
        file.attrs.update({"format": "profile-recording", "version": 1, "length_unit": "mm", "time_unit": "s"})
        file.attrs.update({"sensor": "synthetic", "robot": "synthetic", "simulated": 1})
        file["profiles/time"], file["profiles/pass"] = recording.time_s, recording.pass_index.astype(np.int32)
        file.create_dataset("profiles/x", data=recording.x_mm, **packed)
        file.create_dataset("profiles/z", data=recording.z_mm, **packed)
        file["profiles"].attrs["clock"] = recording.clock
        file["robot/time"], file["robot/pass"] = recording.robot_time_s, recording.robot_pass.astype(np.int32)
        file["robot/position"] = recording.robot_position_mm
        file["robot/quaternion_wxyz"] = recording.robot_quaternion_wxyz
        file["hand_eye/flange_from_profiler"] = recording.flange_from_profiler
        file.create_group("sphere").attrs["diameter_mm"] = recording.sphere_diameter_mm
    return truth
