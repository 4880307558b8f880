"""A recipe in, a recording and its exact truth out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from workbench.artefacts import Part, Recording
from workbench.errors import InputError
from workbench.synthetic.swept.mesh import Relief, build_mesh, gaussian_relief, relief_of
from workbench.synthetic.swept.motion import Motion, moves, recorded_hand_eye
from workbench.synthetic.swept.recipe import SweptPart, SweptRecipe
from workbench.synthetic.swept.returns import fixed_pattern, returned
from workbench.synthetic.swept.section import BEVEL, ROOT, shape_of
from workbench.synthetic.swept.sensor import Profiles, column_places, see
from workbench.synthetic.swept.spine import Curve, curve_of
from workbench.synthetic.swept.truth import SweptTruth, truth_of
from workbench.units import AnyArray, Float, Float32

BLOCK_FRAMES = 128
Progress = Callable[[int, int], None]


def simulate_swept(recipe: SweptRecipe, progress: Progress | None = None) -> tuple[Recording, SweptTruth]:
    """The recording that `recipe` describes, and its truth. `progress` is told frames done and frames in all.

    Raises:
        InputError: the section cannot be built, such as a rounding that is wider than its face.
    """
    part, curve = recipe.part, curve_of(recipe.part)
    try:
        mesh = build_mesh(curve, np.random.default_rng([recipe.seed, 21]))
    except ValueError as error:
        raise InputError("recipe: part", str(error)) from None
    textures = _textures(part, np.random.default_rng([recipe.seed, 22]))
    pattern = fixed_pattern(recipe.scanner, np.random.default_rng([recipe.seed, 23]))
    motions = moves(recipe, curve)
    total, done = sum(len(m.time_s) for m in motions), 0
    x, z, light, seen = [], [], [], []
    for number, motion in enumerate(motions):
        here = []
        for first in range(0, len(motion.time_s), BLOCK_FRAMES):
            rng = np.random.default_rng([recipe.seed, 24, number, first])
            poses = motion.part_from_profiler[first : first + BLOCK_FRAMES]
            profiles = see(mesh, part, recipe.scanner, poses, textures, rng)
            ranges, bright = returned(profiles, recipe, pattern, rng)
            found = _coordinates(recipe, ranges)
            x.append(found[0])
            z.append(found[1])
            light.append(bright)
            here.append(_edge_seen(profiles, part))
            done += len(poses)
            if progress is not None:
                progress(done, total)
        seen.append(np.concatenate(here))
    recording = _recording(recipe, motions, np.concatenate(x), np.concatenate(z), np.concatenate(light))
    return recording, truth_of(recipe, curve, _relief(curve, recipe), seen)


def _relief(curve: Curve, recipe: SweptRecipe) -> Relief | None:
    """The roughness of the root face: the same numbers as the mesh's."""
    shape = shape_of(curve.part, np.array([0.0]), curve.length)
    return relief_of(
        curve.part, curve.length, float(shape.corner[:, 2, 1].max()), np.random.default_rng([recipe.seed, 21])
    )


def _textures(part: SweptPart, rng: np.random.Generator) -> list[Relief] | None:
    if part.texture.sd_mm == 0:
        return None
    return [gaussian_relief(part.texture.sd_mm, part.texture.correlation_mm, (1021, 509), rng) for _ in range(4)]


def _coordinates(recipe: SweptRecipe, ranges: Float) -> tuple[Float32, Float32]:
    scanner = recipe.scanner
    x = column_places(scanner, np.arange(scanner.columns, dtype=float), ranges)
    x = np.where(np.isnan(ranges), np.nan, x)
    z = (1.0 if scanner.z_away else -1.0) * (ranges - scanner.zero_range_mm)
    return x.astype(np.float32), z.astype(np.float32)


def _edge_seen(profiles: Profiles, part: SweptPart) -> Float:
    """Where along the spine those frames see the edge that return from the root face's lower part and the bevel."""
    on = np.isfinite(profiles.range_mm)
    root = on & (profiles.face == ROOT)
    enough = (root.sum(axis=1) >= 2) & ((root & (profiles.share < 0.4)).any(axis=1))
    if part.kind == "milled":
        enough &= (on & (profiles.face == BEVEL)).sum(axis=1) >= 2
    lowest = np.where(root, profiles.share, np.inf).argmin(axis=1)
    return np.asarray(profiles.s[np.arange(len(lowest)), lowest][enough])


def _recording(recipe: SweptRecipe, motions: list[Motion], x: Float32, z: Float32, light: AnyArray) -> Recording:
    def passes(counts: list[int]) -> AnyArray:
        return np.repeat(np.arange(len(counts)), counts)

    return Recording(
        source="synthetic",
        time_s=np.concatenate([m.time_s for m in motions]),
        x_mm=x,
        z_mm=z,
        pass_index=passes([len(m.time_s) for m in motions]),
        robot_time_s=np.concatenate([m.pose_time_s for m in motions]),
        robot_position_mm=np.concatenate([m.position_mm for m in motions]),
        robot_quaternion_wxyz=np.concatenate([m.quaternion_wxyz for m in motions]),
        robot_pass=passes([len(m.pose_time_s) for m in motions]),
        flange_from_profiler=recorded_hand_eye(recipe),
        intensity=light if recipe.scanner.intensity else None,
        part=Part(part_id=recipe.part_id, sensor="synthetic", robot="synthetic", simulated=True),
    )
