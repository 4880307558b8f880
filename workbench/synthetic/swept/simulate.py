"""A recipe in, a recording and its exact truth out."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial

import numpy as np

from workbench.artefacts import Part, Recording
from workbench.errors import InputError
from workbench.synthetic.swept.groove import RIGHT, is_square
from workbench.synthetic.swept.groove_mesh import groove_mesh
from workbench.synthetic.swept.mesh import Mesh, Relief, gaussian_relief
from workbench.synthetic.swept.motion import Motion, moves, recorded_hand_eye
from workbench.synthetic.swept.plate_mesh import plate_mesh, relief_of
from workbench.synthetic.swept.recipe import AnyRecipe, GroovePart, GrooveRecipe, SweptPart, SweptRecipe, Texture
from workbench.synthetic.swept.returns import fixed_pattern, returned
from workbench.synthetic.swept.section import BEVEL, ROOT, UNDER, UPPER
from workbench.synthetic.swept.sensor import Profiles, Spoil, View, column_places, see
from workbench.synthetic.swept.spine import Curve, curve_of
from workbench.synthetic.swept.spoiled import ghosts_of, reflections_of
from workbench.synthetic.swept.truth import GrooveTruth, SweptTruth, groove_truth, truth_of
from workbench.units import AnyArray, Float, Float32

BLOCK_FRAMES = 128
Progress = Callable[[int, int], None]


def simulate_swept(recipe: SweptRecipe, progress: Progress | None = None) -> tuple[Recording, SweptTruth]:
    """The recording that `recipe` describes, and its truth. `progress` is told frames done and frames in all.

    Raises:
        InputError: the section cannot be built, such as a rounding that is wider than its face.
    """
    part, curve = recipe.part, curve_of(recipe.part)
    with _section_refused():
        mesh = plate_mesh(part, curve, np.random.default_rng([recipe.seed, 21]))
    recording, seen = _scanned(recipe, curve, mesh, ghosts_of(part.ghosts), partial(_edge_seen, part=part), progress)
    relief = relief_of(part, curve.length, np.random.default_rng([recipe.seed, 21]))  # the same numbers as the mesh's
    return recording, truth_of(recipe, curve, relief, seen)


def simulate_groove(recipe: GrooveRecipe, progress: Progress | None = None) -> tuple[Recording, GrooveTruth]:
    """As `simulate_swept`, of a groove."""
    part, curve = recipe.part, curve_of(recipe.part)
    with _section_refused():
        mesh = groove_mesh(part, curve, np.random.default_rng([recipe.seed, 21]))
    spoil = reflections_of(part.reflections, mesh, np.random.default_rng([recipe.seed, 25]))
    recording, seen = _scanned(recipe, curve, mesh, spoil, partial(_groove_seen, part=part), progress)
    return recording, groove_truth(recipe, curve, seen)


@contextmanager
def _section_refused() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise InputError("recipe: part", str(error)) from None


def _scanned(
    recipe: AnyRecipe,
    curve: Curve,
    mesh: Mesh,
    spoil: Spoil,
    edge_seen: Callable[[Profiles], Float],
    progress: Progress | None,
) -> tuple[Recording, list[Float]]:
    """The recording, and for each pass where along the spine its frames see the edge."""
    textures = _textures(recipe.part.texture, np.random.default_rng([recipe.seed, 22]))
    pattern = fixed_pattern(recipe.scanner, np.random.default_rng([recipe.seed, 23]))
    motions = moves(recipe, curve)
    total, done = sum(len(m.time_s) for m in motions), 0
    x, z, light, seen = [], [], [], []
    for number, motion in enumerate(motions):
        here = []
        for first in range(0, len(motion.time_s), BLOCK_FRAMES):
            rng = np.random.default_rng([recipe.seed, 24, number, first])
            poses = motion.part_from_profiler[first : first + BLOCK_FRAMES]
            profiles = see(View(mesh, recipe.scanner, textures, spoil, rng), poses)
            ranges, bright = returned(profiles, recipe, pattern, rng)
            found = _coordinates(recipe, ranges)
            x.append(found[0])
            z.append(found[1])
            light.append(bright)
            here.append(edge_seen(profiles))
            done += len(poses)
            if progress is not None:
                progress(done, total)
        seen.append(np.concatenate(here))
    recording = _recording(recipe, motions, np.concatenate(x), np.concatenate(z), np.concatenate(light))
    return recording, seen


def _textures(texture: Texture, rng: np.random.Generator) -> dict[int, Relief]:
    """A field a face."""
    if texture.sd_mm == 0:
        return {}
    faces = (*range(UNDER + 1), *range(RIGHT, RIGHT + UNDER + 1))
    return {face: gaussian_relief(texture.sd_mm, texture.correlation_mm, (509, 251), rng) for face in faces}


def _coordinates(recipe: AnyRecipe, ranges: Float) -> tuple[Float32, Float32]:
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


def _groove_seen(profiles: Profiles, part: GroovePart) -> Float:
    """Where along the spine those frames see the groove that return from both upper surfaces and all bevels."""
    on = np.isfinite(profiles.range_mm)
    faces = [UPPER, UPPER + RIGHT]
    faces += [BEVEL + at for at, side in ((0, "left"), (RIGHT, "right")) if not is_square(part, side)]
    enough = np.all([(on & (profiles.face == face)).sum(axis=1) >= 2 for face in faces], axis=0)
    used = on & np.isin(profiles.face, faces)
    middle = np.where(used, profiles.s, 0.0).sum(axis=1) / np.maximum(used.sum(axis=1), 1)
    return np.asarray(middle[enough])


def _recording(recipe: AnyRecipe, motions: list[Motion], x: Float32, z: Float32, light: AnyArray) -> Recording:
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
