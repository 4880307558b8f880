"""A recipe in, a recording and its exact truth out."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial

import numpy as np
import scipy

from bench.simulators.swept.recipe import (
    AnyRecipe,
    Ghost,
    GroovePart,
    GrooveRecipe,
    SweptPart,
    SweptRecipe,
    SweptScanner,
    Texture,
)
from bench.simulators.swept.scanner import (
    OTHER,
    Hits,
    Mesh,
    Piece,
    Profiles,
    Relief,
    Spoil,
    View,
    chain_sheet,
    column_places,
    gaussian_relief,
    mesh_of,
    moves,
    plate_mesh,
    relief_of,
    see,
    sheet,
    stations,
    swept,
)
from bench.simulators.swept.sweep import (
    BEVEL,
    RIGHT,
    ROOT,
    UPPER,
    UPPER_BEVEL,
    Curve,
    curve_of,
    groove_chains,
    groove_sizes,
    is_square,
)
from bench.simulators.swept.truth import SweptTruth, groove_truth, truth_of
from workbench.artefacts import Recording
from workbench.errors import InputError
from workbench.recording_file import Frames
from workbench.synthetic import GrooveTruth
from workbench.synthetic.scan import recorded, recorded_hand_eye
from workbench.units import AnyArray, Bool, Float, Float32

BLOCK_FRAMES = 128


def simulate_swept(recipe: SweptRecipe) -> tuple[Recording, SweptTruth]:
    """The recording that `recipe` describes, and its truth.

    Raises:
        InputError: the section cannot be built, such as a rounding that is wider than its face.
    """
    part, curve = recipe.part, curve_of(recipe.part)
    with _section_refused():
        mesh = plate_mesh(part, curve, np.random.default_rng([recipe.seed, 21]))
    recording, seen = _scanned(recipe, curve, mesh, ghosts_of(part.ghosts), partial(_edge_seen, part=part))
    relief = relief_of(part, curve.length, np.random.default_rng([recipe.seed, 21]))  # the same numbers as the mesh's
    return recording, truth_of(recipe, curve, relief, seen)


def simulate_groove(recipe: GrooveRecipe) -> tuple[Recording, GrooveTruth]:
    """As `simulate_swept`, of a groove."""
    part, curve = recipe.part, curve_of(recipe.part)
    with _section_refused():
        mesh = groove_mesh(part, curve)
    recording, seen = _scanned(recipe, curve, mesh, ghosts_of(()), partial(_groove_seen, part=part))
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
) -> tuple[Recording, list[Float]]:
    """The recording, and for each pass where along the spine its frames see the edge."""
    textures = _textures(recipe.part.texture, np.random.default_rng([recipe.seed, 22]))
    pattern = fixed_pattern(recipe.scanner, np.random.default_rng([recipe.seed, 23]))
    motions = moves(recipe, curve)
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
        seen.append(np.concatenate(here))
    grids = Frames(np.concatenate(x), np.concatenate(z), np.concatenate(light) if recipe.scanner.intensity else None)
    return recorded(motions, grids, recorded_hand_eye(recipe, 12), recipe.part_id), seen


def _textures(texture: Texture, rng: np.random.Generator) -> dict[int, Relief]:
    """A field a face."""
    if texture.sd_mm == 0:
        return {}
    faces = (*range(UPPER_BEVEL + 1), *range(RIGHT, RIGHT + UPPER_BEVEL + 1))
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


def ghosts_of(ghosts: Sequence[Ghost]) -> Spoil:
    """What ghosts add to the ranges."""

    def added(hits: Hits, rng: np.random.Generator) -> Float:
        off = np.zeros(len(hits.s))
        for ghost in ghosts:
            on = (hits.face == (ROOT if ghost.face == "root" else BEVEL)) & (hits.s >= ghost.from_mm)
            on &= (hits.s <= ghost.to_mm) & (hits.share >= ghost.across[0]) & (hits.share <= ghost.across[1])
            if ghost.probability < 1:
                on &= rng.random(len(on)) < ghost.probability
            off[on] += ghost.offset_mm
        return off

    return added


# A groove as triangles: both plates, tack welds and what lies behind the gap.

BACKGROUND = 32  # a face: what is seen through the gap


def groove_mesh(part: GroovePart, curve: Curve) -> Mesh:
    """The mesh of a groove."""
    frames = stations(curve)
    pieces = [chain_sheet(frames, chain) for chain in groove_chains(part, frames.s, curve.length)]
    pieces += _tacks(part, curve)
    if part.background_mm is not None:
        a, b = 1.5 * part.reach_mm, -part.background_mm
        points = np.repeat(np.array([[[a, b], [-a, b]]]), len(frames.s), axis=0)
        place = np.zeros((len(frames.s), 2, 3))
        pieces.append(sheet(swept(frames, points), place, np.array([BACKGROUND], dtype=np.uint8)))
    return mesh_of(pieces)


def _tacks(part: GroovePart, curve: Curve) -> list[Piece]:
    """Ellipsoids about the root."""
    s = np.array([tack.at_mm for tack in part.tacks], dtype=float)
    corners = groove_sizes(part, s, curve.length).corners
    level = "lower" if part.groove == "I" else "root"  # a square plate's root face goes up to its upper surface
    height = np.minimum(corners[f"left_{level}"][:, 1], corners[f"right_{level}"][:, 1])
    root = np.stack([np.zeros(len(s)), height], axis=1)
    return [
        _ellipsoid(curve, t.at_mm, place, (t.width_mm / 2, t.height_mm, t.length_mm / 2))
        for t, place in zip(part.tacks, root, strict=True)
    ]


def _ellipsoid(curve: Curve, s: float, place: Float, half: tuple[float, float, float]) -> Piece:
    """An ellipsoid about the place (a, b) of the section at s, half axes along a, b and the edge."""
    steps = 25
    frames = curve.frames(np.array([s]))
    turn, tilt = np.linspace(0, 2 * np.pi, 2 * steps - 1), np.linspace(-np.pi / 2, np.pi / 2, steps)
    u, v = np.meshgrid(turn, tilt, indexing="ij")
    a = place[0] + half[0] * np.cos(u) * np.cos(v)
    b = place[1] + half[1] * np.sin(u) * np.cos(v)
    t = half[2] * np.sin(v)
    vertices = frames.position[0] + a[..., None] * frames.n[0] + b[..., None] * frames.m[0] + t[..., None] * frames.t[0]
    return sheet(vertices[:, ::-1], np.zeros((*a.shape, 3)), np.full(steps - 1, OTHER, dtype=np.uint8))


# From exact profiles to what the profiler hands over: noise, brightness, losses, outliers, quantisation.

FULL = 20000.0  # brightness of a full pixel that looks square at a face
DARK = 0.3  # speckle dims a pixel's signal, and raises its noise, no further


def returned(profiles: Profiles, recipe: AnyRecipe, pattern: Float, rng: np.random.Generator) -> tuple[Float, AnyArray]:
    """Ranges (n, M), NaN where there is no return, and brightness (n, M) uint16."""
    scanner, noise, losses = recipe.scanner, recipe.scanner.noise, recipe.losses
    cosine = np.clip(profiles.cosine, 1e-3, 1)
    speckle = np.ones(cosine.shape)
    if noise.speckle > 0:  # M looks: contrast 1 / sqrt(M)
        speckle = rng.gamma(noise.speckle**-2, noise.speckle**2, cosine.shape)
    grown = np.minimum(cosine**-noise.grazing_power, noise.grazing_cap)
    fill = np.maximum(profiles.fill, 1.0 / 8)
    sd = noise.sd_mm * grown / np.sqrt(np.maximum(speckle, DARK) * fill)
    unit = _correlated(rng.standard_normal(cosine.shape), noise.column_correlation)
    unit = np.sqrt(1 - noise.pattern_share) * unit + np.sqrt(noise.pattern_share) * pattern
    ranges = profiles.range_mm + sd * unit
    wrong = rng.random(ranges.shape) < losses.outlier_share
    ranges[wrong] += rng.uniform(-losses.outlier_reach_mm, losses.outlier_reach_mm, int(wrong.sum()))
    ranges[lost(profiles, recipe, rng)] = np.nan
    if scanner.quantum_mm > 0:
        ranges = np.round(ranges / scanner.quantum_mm) * scanner.quantum_mm
    light = np.clip(FULL * cosine * speckle * profiles.fill, 1, 65535)
    return ranges, np.where(np.isnan(ranges), 0, light).astype(np.uint16)


def fixed_pattern(scanner: SweptScanner, rng: np.random.Generator) -> Float:
    """The part of the noise (M,) that is the same in every frame, of unit variance."""
    return np.asarray(_correlated(rng.standard_normal((1, scanner.columns)), scanner.noise.column_correlation)[0])


def _correlated(white: Float, keep: float) -> Float:
    """First-order autoregressive along the columns, of unit variance from the first column on."""
    if keep == 0:
        return white
    fresh = np.sqrt(1 - keep**2)
    return np.asarray(scipy.signal.lfilter([fresh], [1, -keep], white, axis=1, zi=(1 - fresh) * white[:, :1])[0])


def lost(profiles: Profiles, recipe: AnyRecipe, rng: np.random.Generator) -> Bool:
    """Returns that are lost one by one, in blocks, or as the last columns of the root face."""
    losses, shape = recipe.losses, profiles.range_mm.shape
    gone = rng.random(shape) < losses.single_share
    if losses.block_share > 0:
        (wide_low, wide_high), (long_low, long_high) = losses.block_columns, losses.block_frames
        size = (wide_low + wide_high) / 2 * (long_low + long_high) / 2
        for _ in range(rng.poisson(-np.log1p(-losses.block_share) * gone.size / size)):
            rows, columns = rng.integers(long_low, long_high + 1), rng.integers(wide_low, wide_high + 1)
            i, j = rng.integers(1 - rows, shape[0]), rng.integers(1 - columns, shape[1])
            gone[max(i, 0) : i + rows, max(j, 0) : j + columns] = True
    if losses.edge_columns:
        gone |= _last_on_root(profiles, losses.edge_columns, losses.edge_from_mm, losses.edge_to_mm)
    return gone


def _last_on_root(profiles: Profiles, columns: int, start: float, stop: float) -> Bool:
    """The `columns` returns of the root face that are nearest to its lower edge, and all below it beside them."""
    on = (profiles.face == ROOT) & np.isfinite(profiles.range_mm)
    share = np.where(on, profiles.share, np.inf)
    rank = np.argsort(np.argsort(share, axis=1), axis=1)
    here = (profiles.s >= start) & (profiles.s <= stop)
    return np.asarray(on & (rank < columns) & here)
