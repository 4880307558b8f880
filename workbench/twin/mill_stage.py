"""`twin.mill`: a path milled in simulation, with the real cutter and, on request, real errors.

The milling cell at work is a worn cutter moved along the path, as robot and tool let it, through the stock.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import Engagement, Layer, LayerEngagement, PathCorrection, PathDeflection, Toolpath, Travel
from workbench.errors import InputError
from workbench.geometry.moves import arc_lengths_mm, chords_mm, within
from workbench.geometry.poses import (
    mapped,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    slerp,
)
from workbench.stage import InputFile, Seed, stage
from workbench.storage import MOST_BYTES, csv_rows, finite_number
from workbench.synthetic.milling import Hit, Motion, Stock
from workbench.synthetic.workpiece import Workpiece
from workbench.units import DEG, Bool, Float, Shaped

Length = Annotated[float, Field(ge=-100, le=100)]
Angle = Annotated[float, Field(ge=-180, le=180)]

_WAVES = 64
_PIECE_MM, _PIECE = 1.0, 1.0 * DEG  # poses are at most so far apart


@stage("twin.mill")
def mill(
    workpiece: Workpiece,
    toolpath: Toolpath,
    bending: PathDeflection | None = None,
    correction: PathCorrection | None = None,
    *,
    tip_mm: Annotated[
        float | None,
        Field(ge=-200, le=500),
    ] = None,
    offset_mm: tuple[Length, Length, Length] = (0.0, 0.0, 0.0),
    rotation_deg: tuple[Angle, Angle, Angle] = (0.0, 0.0, 0.0),
    robot_noise_mm: Annotated[float, Field(ge=0, le=10)] = 0.0,
    robot_repeating_mm: Annotated[float, Field(ge=0, le=10)] = 0.0,
    robot_noise_length_mm: Annotated[float, Field(ge=1, le=10000)] = 50.0,
    deflection_mm: tuple[Length, Length, Length] = (0.0, 0.0, 0.0),
    deflections: InputFile | None = None,
    wear_mm: Annotated[float, Field(ge=0, le=10)] = 0.0,
    worn_mm: Annotated[float, Field(ge=0, le=10)] = 0.0,
    seed: Seed = 0,
) -> tuple[Workpiece, Engagement]:
    """Mill a workpiece along a path and report what the cutter meets.

    The cutter, a cylinder at x = -radius of each point's frame (or a ball end), moves straight from point to point
    (dexels: T. Van Hook, SIGGRAPH 1986; docs/simulation.md).

    Args:
        workpiece: the part as it is now.
        toolpath: the path.
        bending: how far the robot gives way at each of its points, as a stage upstream predicts it.
        correction: by which the path was corrected; a refused one leaves the workpiece as it is, with a warning.
        tip_mm: reach of the cutter beyond a frame's origin, along z; null: half its flutes.
        offset_mm: constant error of the tool's position in the base: hand-eye, tool or work object.
        rotation_deg: constant error of its orientation, a rotation vector in the base.
        robot_noise_mm: standard deviation of the robot's smooth error, each axis; each layer has its own.
        robot_repeating_mm: the same of an error that every run repeats.
        robot_noise_length_mm: correlation length of both along the path.
        deflection_mm: constant deflection of the tool, in its own frame.
        deflections: a CSV of deflections in the tool's frame: layer, point, dx_mm, dy_mm, dz_mm; null: none.
        wear_mm: loss of the cutter's radius over this path, growing with the length cut.
        worn_mm: what it has lost before, as at the end of an earlier path.
        seed: of the robot's error.

    Raises:
        InputError: a path without layers, an unusable file of deflections, a bending of another path.

    Example:
        >>> from workbench import path, twin
        >>> part = twin.part(recipe="data/synthetic/raw_arc.json")
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> milled, engagement = twin.mill(part, plan)
        >>> type(milled).__name__, type(engagement).__name__
        ('Workpiece', 'Engagement')
    """
    _refuse_empty(toolpath)
    if correction is not None and correction.refused is not None:
        return workpiece, Engagement((), (f"not milled: {correction.refused}",), toolpath.part)
    mechanics = Mechanics(
        base_from_path=np.eye(4) if toolpath.base_from_workobject is None else toolpath.base_from_workobject,
        offset_mm=np.array(offset_mm),
        rotation=np.array(rotation_deg) * DEG,
        noise_mm=robot_noise_mm,
        repeating_mm=robot_repeating_mm,
        noise_length_mm=robot_noise_length_mm,
        deflection_mm=np.array(deflection_mm),
        deflections_mm=_deflections(toolpath, deflections, bending),
        seed=(seed, 0 if workpiece.cut is None else workpiece.cut.times),
    )
    stock = Stock(workpiece, toolpath.plane_mm, toolpath.bevel_deg * DEG)
    tip = toolpath.cutter.flute_length_mm / 2.0 if tip_mm is None else tip_mm
    engaged, warnings = _mill(Machine(stock, toolpath, mechanics, wear_mm, worn_mm, tip), toolpath)
    return dataclasses.replace(workpiece, cut=stock.cut), Engagement(engaged, warnings, toolpath.part)


def _deflections(toolpath: Toolpath, file: Path | None, bending: PathDeflection | None) -> dict[int, Float]:
    """By layer what a file and a stage upstream say together."""
    found = {} if file is None else read_deflections(file, toolpath.layers)
    if bending is None:
        return found
    for layer in toolpath.layers:
        found[layer.index] = found.get(layer.index, 0.0) + bending.at(layer)
    return found


def _refuse_empty(toolpath: Toolpath) -> None:
    if not toolpath.layers or min(len(layer.position_mm) for layer in toolpath.layers) < 2:
        raise InputError("toolpath", "expected layers of two points or more, found none")


def _mill(machine: Machine, toolpath: Toolpath) -> tuple[tuple[LayerEngagement, ...], tuple[str, ...]]:
    """Travels and layers in their order; the engagement of each layer, and all warnings."""
    stock, radius, travels = machine.stock, toolpath.cutter.radius_mm, iter(toolpath.travels)
    engaged: list[LayerEngagement] = []
    warnings: list[str] = []
    for layer in toolpath.layers:
        at_points = stock.u_of(toolpath.in_base(layer.position_mm))
        watch = Watch(layer, at_points, stock.u, radius, toolpath.depth_of_cut_mm)
        for travel in itertools.islice(travels, 1):
            warnings += watch.travel(f"travel to layer {layer.index}", machine.travel(travel))
        before = stock.height_mm.copy()
        met = machine.mill(layer)
        removed = stock.removed_mm(before)
        warnings += watch.layer(met, removed.max(axis=1))
        engaged.append(engage(layer, at_points, stock.u, removed, stock.w_step_mm))
    for travel in travels:
        warnings += watch.travel("travel after the last layer", machine.travel(travel))
    return tuple(engaged), tuple(warnings)


# Engagement: radial and axial depth and chip area along a layer.

_FAR_MM = 1e6


def engage(layer: Layer, u_at_points: Float, u: Float, removed_mm: Float, w_step_mm: float) -> LayerEngagement:
    """Engagement at a layer's k points from the depths (U, W) that it removed, lines `w_step_mm` apart.

    Depths are signed: below 0 the cutter passed that much above the material. `u_at_points` (k,), `u` (U,).
    """
    length, area = _positive_part(removed_mm, w_step_mm)
    radial = np.maximum(removed_mm.max(axis=1), 0.0)
    along = (np.interp(u_at_points, u, value, left=0.0, right=0.0) for value in (radial, length, area))
    return LayerEngagement(layer.index, layer.arc_length_mm, *along)


def _positive_part(depth: Float, step: float) -> tuple[Float, Float]:
    """Length over which piecewise linear depths (U, W) are above 0, and the area there."""
    depth = np.maximum(depth, -_FAR_MM)  # lines beside the part miss it by an infinite depth
    a, b = depth[:, :-1], depth[:, 1:]
    high, low = np.maximum(np.maximum(a, b), 0.0), np.minimum(a, b)
    share = np.where(low >= 0.0, high > 0.0, high / (high - np.minimum(low, -1e-12)))
    area = 0.5 * share * (high + np.maximum(low, 0.0))
    return step * share.sum(axis=1), step * area.sum(axis=1)


# What a milling run has to say: where the cutter met what the path did not mean to cut.

_SPARE_MM = 0.1  # a lead or a ramp may take the depth of cut and this much more
_MET_MM = 0.02  # less is not met in the air
_AT_ONCE = 2.0  # a layer that takes more than so many depths of cut is no layer


class Watch:
    """Warnings about one layer and the travel to it, with their places as arc lengths of that layer."""

    def __init__(self, layer: Layer, u_at_points: Float, u: Float, radius_mm: float, depth_of_cut_mm: float) -> None:
        """`u_at_points` (k,) of the layer's points, `u` (U,) of the columns that depths are counted on."""
        order = np.argsort(u_at_points)
        self._u, self._at, self._arc_length_mm = u, u_at_points[order], layer.arc_length_mm[order]
        self._name, self._depth_of_cut_mm = f"layer {layer.index}", depth_of_cut_mm
        self._cuts = bool(layer.cutting.any())
        self._near_cut = within(u, self._at[layer.cutting[order]], radius_mm)

    def travel(self, name: str, met: Met) -> list[str]:
        """A travel must not meet anything."""
        found = self._met(name, met.depth_mm, _MET_MM)
        return found + self._hits(name, met)

    def layer(self, met: Met, taken_mm: Float) -> list[str]:
        """A layer's leads and ramps take no more than a layer does; all of it took `taken_mm` (U,).

        Within a cutter's radius of a point that cuts it does not count which piece of the path came first.
        """
        found = self._met(self._name, np.where(self._near_cut, 0.0, met.depth_mm), self._depth_of_cut_mm + _SPARE_MM)
        worst = int(np.argmax(taken_mm))
        deepest, planned = taken_mm[worst], self._depth_of_cut_mm
        if self._cuts and deepest < _MET_MM:
            found.append(f"{self._name}: the cutter meets nothing")
        if deepest > _AT_ONCE * planned:
            found.append(
                f"{self._name}: the cutter takes {deepest:.2f} mm at once "
                f"{self._place(self._u[worst])}; the depth of cut is {planned:g} mm"
            )
        return found + self._hits(self._name, met)

    def _met(self, name: str, depth_mm: Float, allowed_mm: float) -> list[str]:
        worst = int(np.argmax(depth_mm))
        if depth_mm[worst] <= allowed_mm:
            return []
        return [
            f"{name}: the cutter meets material where the path does not cut, {depth_mm[worst]:.2f} mm deep "
            f"{self._place(self._u[worst])}"
        ]

    def _hits(self, name: str, met: Met) -> list[str]:
        return [
            f"{name}: the cutter runs {hit.depth_mm:.2f} mm into {hit.what} {self._place(hit.u)}" for hit in met.hits
        ]

    def _place(self, u: float) -> str:
        return f"at arc length {np.interp(u, self._at, self._arc_length_mm):.1f} mm"


# Displacements of the tool point by point, out of a CSV file.

COLUMNS = ("layer", "point", "dx_mm", "dy_mm", "dz_mm")
_MOST_MM = 100.0


def read_deflections(path: Path, layers: Sequence[Layer]) -> dict[int, Float]:
    """By layer index the displacement (k, 3) of the tool in its own frame, mm; 0 at points that the file leaves out.

    A CSV with a header and the columns `layer` (its index), `point` (from 0), `dx_mm`, `dy_mm`, `dz_mm`; lines that
    begin with # are comments. InputError names the line.
    """
    found = {layer.index: np.zeros((len(layer.position_mm), 3)) for layer in layers}
    for where, row in csv_rows(path, MOST_BYTES, COLUMNS):
        layer, point, *shift = (finite_number(row.get(name, ""), f"{where}: {name}") for name in COLUMNS)
        if layer not in found or not 0 <= point < len(found[int(layer)]) or point != int(point):
            raise InputError(where, f"a point of the path; there is no point {point:g} in a layer {layer:g}")
        if max(map(abs, shift)) > _MOST_MM:
            raise InputError(where, f"displacements of at most {_MOST_MM:g} mm, not {max(shift, key=abs):g}")
        found[int(layer)][int(point)] = shift
    return found


# The milling cell at work.


@dataclass(frozen=True, slots=True, eq=False)
class Mechanics:
    """Errors of a milling cell; all zero: a perfect one. Lengths in mm, vectors (3,)."""

    base_from_path: Shaped[Float, "4 4"]
    offset_mm: Float  # of the tool, in the base
    rotation: Float  # rotation vector (rad) in the base, by which the tool is turned about its frame's origin
    noise_mm: float  # standard deviation of the robot's smooth error, each axis
    repeating_mm: float  # of another, that is the same whenever the robot comes to the same place
    noise_length_mm: float  # correlation length of both
    deflection_mm: Float  # of the tool, in its own frame
    deflections_mm: Mapping[int, Float]  # layer index -> (k, 3), on top of `deflection_mm`
    seed: tuple[int, ...]

    def poses(self, position_mm: Float, quaternion_wxyz: Float, layer: int, draw: int) -> Float:
        """base_from_tool (k, 4, 4) as it really is where the path says (k, 3), (k, 4).

        `layer`: the layer's index, 0 in a travel. Each `draw` has a robot error of its own.
        """
        rotation = self.base_from_path[:3, :3] @ rotation_from_quaternion(quaternion_wxyz)
        position = mapped(self.base_from_path, position_mm)
        rotated = rotation_from_vector(self.rotation) @ rotation
        bent = self.deflection_mm + self.deflections_mm.get(layer, np.zeros((len(position), 3)))
        travelled = arc_lengths_mm(position)
        new = _noise(travelled[:, None], self.noise_mm, self.noise_length_mm, [*self.seed, 0x7A, draw])
        again = _noise(position, self.repeating_mm, self.noise_length_mm, [self.seed[0], 0x7B])
        return pose_from(rotated, position + self.offset_mm + new + again + np.einsum("kij,kj->ki", rotated, bent))


def _noise(at: Float, sigma_mm: float, length_mm: float, seed: list[int]) -> Float:
    """A robot's error (k, 3) over `at` (k, d) mm, the way that it went (d = 1) or its place in the base (d = 3).

    A Gaussian process with a squared exponential covariance, as a sum of random waves: A. Rahimi, B. Recht, Random
    features for large-scale kernel machines, NIPS 20 (2007).
    """
    if sigma_mm == 0.0:
        return np.zeros((len(at), 3))
    rng = np.random.default_rng(seed)
    number = rng.normal(0.0, 1.0 / length_mm, (at.shape[1], 3, _WAVES))
    phase = rng.uniform(0, 2 * math.pi, (3, _WAVES))
    waves = np.cos(np.tensordot(at, number, axes=1) + phase)
    return np.asarray(sigma_mm * math.sqrt(2.0 / _WAVES) * waves.sum(axis=2))


def straight_moves(base_from_tool: Float, values: Float) -> tuple[Float, Float]:
    """Poses (n, 4, 4) a millimetre and a degree apart or closer on the straight moves between poses (k, 4, 4).

    Position is linear, orientation by slerp, and so are `values` (k,) between theirs: (n,).
    """
    position, quaternion = base_from_tool[:, :3, 3], quaternion_from_rotation(base_from_tool[:, :3, :3])
    cosine = np.abs(np.sum(quaternion[:-1] * quaternion[1:], axis=1))
    turn = 2.0 * np.arccos(np.minimum(cosine, 1.0))
    way = chords_mm(position)
    pieces = np.maximum(1, np.ceil(np.maximum(way / _PIECE_MM, turn / _PIECE) - 1e-6).astype(int))
    after = np.repeat(np.arange(1, len(position)), pieces)
    start = after - 1
    f = (np.arange(len(after)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1) / pieces[start]
    moved = (1 - f[:, None]) * position[start] + f[:, None] * position[after]
    rotation = rotation_from_quaternion(slerp(quaternion[start], quaternion[after], f))
    poses = np.concatenate([base_from_tool[:1], pose_from(rotation, moved)])
    return poses, np.concatenate([values[:1], (1 - f) * values[start] + f * values[after]])


class Met(NamedTuple):
    """What a motion met: depth (U,) of material removed at each u, and what it must not touch at all."""

    depth_mm: Float
    hits: tuple[Hit, ...]


class Machine:
    """Mills the layers and travels of one path, one after the other, out of `stock`."""

    def __init__(
        self, stock: Stock, toolpath: Toolpath, mechanics: Mechanics, wear_mm: float, worn_mm: float, tip_mm: float
    ) -> None:
        self.stock, self._mechanics, self._tip_mm = stock, mechanics, tip_mm
        self._radius_mm, self._ball_end = toolpath.cutter.radius_mm, toolpath.cutter.ball_end
        whole = sum(float(_cut_length(layer)[-1]) for layer in toolpath.layers)
        self._wear = wear_mm / whole if whole > 0.0 else 0.0  # loss of radius a mm cut
        self._worn_mm, self._cut_mm, self._motions = worn_mm, 0.0, 0

    def travel(self, travel: Travel) -> Met:
        """Travel."""
        if len(travel.position_mm) < 2:
            return Met(np.zeros(len(self.stock.u)), ())
        poses = self._poses(travel, 0)
        return self._sweep(poses, np.full(len(poses), self._worn(self._cut_mm)))

    def mill(self, layer: Layer) -> Met:
        """Mill a layer; what its pieces met that do not cut, and what clamps and table."""
        poses, radius = self._poses(layer, layer.index), self._worn(self._cut_mm + _cut_length(layer))
        idle = np.zeros(len(self.stock.u))
        hits: list[Hit] = []
        for first, last, cutting in _runs(layer.cutting[:-1] | layer.cutting[1:]):
            met = self._sweep(poses[first : last + 1], radius[first : last + 1])
            idle = idle if cutting else np.maximum(idle, met.depth_mm)
            hits += met.hits
        self._cut_mm += float(_cut_length(layer)[-1])
        return Met(idle, _deepest(hits))

    def _poses(self, points: Layer | Travel, layer: int) -> Float:
        self._motions += 1
        return self._mechanics.poses(points.position_mm, points.quaternion_wxyz, layer, self._motions)

    def _worn(self, cut_mm: Float | float) -> Float:
        return np.asarray(np.maximum(self._radius_mm - self._worn_mm - self._wear * cut_mm, 0.0))

    def _sweep(self, poses: Float, radius: Float) -> Met:
        fine, radius_mm = straight_moves(poses, radius)
        motion = Motion(fine, radius_mm, self._radius_mm, self._tip_mm, self._ball_end)
        before = self.stock.height_mm.copy()
        self.stock.remove(motion)
        return Met(self.stock.depth_mm(before), _deepest(self.stock.hits(motion)))


def _cut_length(layer: Layer) -> Float:
    """Length (k,) that was cut from the layer's beginning to each of its points, mm."""
    way = chords_mm(layer.position_mm)
    return np.concatenate([[0.0], np.cumsum(way * (layer.cutting[:-1] & layer.cutting[1:]))])


def _deepest(hits: list[Hit]) -> tuple[Hit, ...]:
    """Of everything that was hit, the deepest place."""
    found = {hit.what: hit for hit in sorted(hits, key=lambda hit: hit.depth_mm)}
    return tuple(found.values())


def _runs(cutting: Bool) -> list[tuple[int, int, bool]]:
    """Runs of pieces that cut, or do not: first point, last point, cutting."""
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(cutting)) + 1, [len(cutting)]]).tolist()
    return [(a, b, bool(cutting[a])) for a, b in itertools.pairwise(bounds)]
