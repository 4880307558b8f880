"""The profiler: each column looks along a line of the laser plane; laser and camera must both see what lies there."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from workbench.synthetic.swept.mesh import OTHER, Hits, Mesh, Relief
from workbench.synthetic.swept.recipe import SweptScanner
from workbench.units import AnyArray, Bool, Float, Shaped

SUBRAYS = 9  # odd: half of a footprint is filled just where its middle is
JUMP_MM = 0.15  # neighbours further apart may be two sides of an edge: their footprint is looked at ray by ray
LEAST_COSINE = 0.2  # a texture's height is divided by the cosine of the incidence, but not below


@dataclass(frozen=True, slots=True, eq=False)
class Profiles:
    """What frames see before noise: (n, M), or all returns in a row."""

    range_mm: Shaped[Float, "*n"]  # from the laser; NaN: nothing
    cosine: Shaped[Float, "*n"]
    fill: Shaped[Float, "*n"]  # share of the footprint that the return comes from
    face: Shaped[AnyArray, "*n"]  # uint8
    s: Shaped[Float, "*n"]
    share: Shaped[Float, "*n"]  # across the face


Spoil = Callable[[Hits, Float, Float, np.random.Generator], Float]  # hits, points (k, 3), ways (k, 3) -> what is added


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The part before the scanner."""

    mesh: Mesh
    scanner: SweptScanner
    texture: Mapping[int, Relief]  # by face
    spoil: Spoil  # what ghosts and reflections add to the ranges
    rng: np.random.Generator


def see(view: View, pose: Float) -> Profiles:
    """The profiles of n frames with poses part_from_profiler (n, 4, 4)."""
    frames, columns = len(pose), view.scanner.columns
    index = np.repeat(np.arange(frames), columns)
    centre = _look(view, pose, index, np.tile(np.arange(columns, dtype=float), frames))
    grid = {name: getattr(centre, name).reshape(frames, columns) for name in Profiles.__slots__}
    if view.scanner.footprint > 0:
        _pixels_at_edges(view, grid, pose)
    return Profiles(**grid)


def _look(view: View, pose: Float, index: AnyArray, column: Float) -> Profiles:
    """Rays by frame `index` (k,) and fractional `column` (k,)."""
    scanner, mesh = view.scanner, view.mesh
    start, way = _lines(scanner, column)
    rotation, translation = pose[:, :3, :3], pose[:, :3, 3]
    start, way = _turned(rotation, start, index) + translation[index], _turned(rotation, way, index)
    hits = mesh.cast(start, way)
    found = np.isfinite(hits.reach) & (hits.reach <= scanner.far_mm - scanner.near_mm)
    found &= hits.cosine > np.cos(np.radians(scanner.max_incidence_deg))
    point = start + np.where(found, hits.reach, 0.0)[:, None] * way
    laser, camera = translation + rotation @ _eyes(scanner), translation + rotation @ _camera(scanner)
    lit = mesh.open_way(point[found], laser[index[found]])
    lit[lit] = mesh.open_way(point[found][lit], camera[index[found][lit]])
    found[found] = lit
    reach = np.where(found, hits.reach + scanner.near_mm, np.nan)
    reach -= _relief(hits, view.texture) / np.maximum(hits.cosine, LEAST_COSINE)
    reach += view.spoil(hits, point, way, view.rng)
    face = np.where(found, hits.face, OTHER).astype(np.uint8)
    return Profiles(reach, hits.cosine, found.astype(float), face, hits.s, hits.share)


def column_places(scanner: SweptScanner, column: Float, range_mm: Float) -> Float:
    """x (mm) of what lies at a range on the line of a (fractional) column."""
    at_standoff = (column - (scanner.columns - 1) / 2) * scanner.pitch_mm * (1.0 if scanner.x_rises else -1.0)
    if scanner.apex_mm is None:
        return np.asarray(at_standoff + 0.0 * range_mm)
    return np.asarray(at_standoff * (range_mm + scanner.apex_mm) / (scanner.standoff_mm + scanner.apex_mm))


def _lines(scanner: SweptScanner, column: Float) -> tuple[Float, Float]:
    """Starts (k, 3) at the near range and ways (k, 3) per mm of range, profiler frame."""
    sign = 1.0 if scanner.z_away else -1.0
    near, far = (column_places(scanner, column, np.asarray(r)) for r in (scanner.near_mm, scanner.near_mm + 1.0))
    zero = np.zeros_like(column)
    start = np.stack([near, zero, sign * (scanner.near_mm - scanner.zero_range_mm) + zero], axis=1)
    return start, np.stack([far - near, zero, sign + zero], axis=1)


def _eyes(scanner: SweptScanner) -> Float:
    """The laser (3,), profiler frame."""
    return np.array([0.0, 0.0, -(1.0 if scanner.z_away else -1.0) * scanner.zero_range_mm])


def _camera(scanner: SweptScanner) -> Float:
    offset = np.array([0.0, scanner.baseline_mm, 0.0])
    return np.asarray(_eyes(scanner) + offset)


def _turned(rotation: Float, vector: Float, index: AnyArray) -> Float:
    return np.asarray(np.matmul(rotation[index], vector[:, :, None])[..., 0])


def _relief(hits: Hits, texture: Mapping[int, Relief]) -> Float:
    height = np.zeros(len(hits.s))
    for face, relief in texture.items():
        on = hits.face == face
        height[on] = relief.at(hits.s[on], hits.across_mm[on])
    return height


def _pixels_at_edges(view: View, grid: dict[str, AnyArray], pose: Float) -> None:
    """Columns that may see an edge, in place: several rays over the footprint, their fill, mean, or mixture."""
    scanner = view.scanner
    frame, column = np.nonzero(_at_edges(grid["range_mm"]))
    if not len(frame):
        return
    offsets = ((np.arange(SUBRAYS) + 0.5) / SUBRAYS - 0.5) * scanner.footprint
    rays = _look(view, pose, np.repeat(frame, SUBRAYS), (column[:, None] + offsets).ravel())
    ranges = rays.range_mm.reshape(-1, SUBRAYS)
    order = np.argsort(ranges, axis=1)  # NaN last
    ranges = np.take_along_axis(ranges, order, axis=1)
    seen = np.isfinite(ranges).sum(axis=1)
    gaps = np.where(np.isfinite(np.diff(ranges, axis=1)), np.diff(ranges, axis=1), 0.0)
    cut = gaps.argmax(axis=1) + 1  # the nearer side has so many rays
    two = gaps.max(axis=1) > JUMP_MM
    near = np.where(two, cut, seen)
    keep_far = two & (seen - near > near)
    mixed = two & (view.rng.random(len(seen)) < scanner.mixed_share)
    first = np.where(keep_far & ~mixed, near, 0)
    last = np.where(two & ~mixed & ~keep_far, near, seen)
    place = np.arange(SUBRAYS)
    chosen = (place >= first[:, None]) & (place < last[:, None])
    count = chosen.sum(axis=1)
    fill = count / SUBRAYS
    good = (fill >= scanner.least_fill) & (count > 0)

    def mean(values: AnyArray) -> Float:
        ordered = np.take_along_axis(values.reshape(-1, SUBRAYS), order, axis=1)
        return np.asarray(np.where(chosen, ordered, 0.0).sum(axis=1) / np.maximum(count, 1))

    first_chosen = np.take_along_axis(order, np.minimum(first, SUBRAYS - 1)[:, None], axis=1)[:, 0]
    face = rays.face.reshape(-1, SUBRAYS)[np.arange(len(seen)), first_chosen]
    grid["range_mm"][frame, column] = np.where(good, mean(np.nan_to_num(rays.range_mm)), np.nan)
    grid["cosine"][frame, column] = mean(rays.cosine)
    grid["fill"][frame, column] = np.where(good, fill, 0.0)
    grid["face"][frame, column] = np.where(good & ~mixed, face, OTHER)
    grid["s"][frame, column], grid["share"][frame, column] = mean(rays.s), mean(rays.share)


def _at_edges(ranges: Float) -> Bool:
    """Columns beside a jump or beside the end of returns."""
    step = np.diff(ranges, axis=1)
    there = np.isfinite(ranges)
    jump = (there[:, 1:] != there[:, :-1]) | (np.abs(np.nan_to_num(step)) > JUMP_MM)
    at = np.zeros(ranges.shape, dtype=bool)
    at[:, 1:] |= jump
    at[:, :-1] |= jump
    return at
