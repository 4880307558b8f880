"""The milling cell at work: a worn cutter moved along a path, as robot and tool let it, through the stock."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Layer, Toolpath, Travel
from workbench.geometry.poses import (
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    slerp,
)
from workbench.synthetic.milling import Hit, Motion, Stock
from workbench.units import DEG, Bool, Float, Shaped

_WAVES = 64
_PIECE_MM, _PIECE = 1.0, 1.0 * DEG  # poses are at most so far apart


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
        position = position_mm @ self.base_from_path[:3, :3].T + self.base_from_path[:3, 3]
        turned = rotation_from_vector(self.rotation) @ rotation
        bent = self.deflection_mm + self.deflections_mm.get(layer, np.zeros((len(position), 3)))
        travelled = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(position, axis=0), axis=1))])
        new = _noise(travelled[:, None], self.noise_mm, self.noise_length_mm, [*self.seed, 0x7A, draw])
        again = _noise(position, self.repeating_mm, self.noise_length_mm, [self.seed[0], 0x7B])
        return pose_from(turned, position + self.offset_mm + new + again + np.einsum("kij,kj->ki", turned, bent))


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
    way = np.linalg.norm(np.diff(position, axis=0), axis=1)
    pieces = np.maximum(1, np.ceil(np.maximum(way / _PIECE_MM, turn / _PIECE) - 1e-6).astype(int))
    after = np.repeat(np.arange(1, len(position)), pieces)
    start = after - 1
    f = (np.arange(len(after)) - np.repeat(np.cumsum(pieces) - pieces, pieces) + 1) / pieces[start]
    moved = (1 - f[:, None]) * position[start] + f[:, None] * position[after]
    turned = rotation_from_quaternion(slerp(quaternion[start], quaternion[after], f))
    poses = np.concatenate([base_from_tool[:1], pose_from(turned, moved)])
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
    way = np.linalg.norm(np.diff(layer.position_mm, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(way * (layer.cutting[:-1] & layer.cutting[1:]))])


def _deepest(hits: list[Hit]) -> tuple[Hit, ...]:
    """Of everything that was hit, the deepest place."""
    found = {hit.what: hit for hit in sorted(hits, key=lambda hit: hit.depth_mm)}
    return tuple(found.values())


def _runs(cutting: Bool) -> list[tuple[int, int, bool]]:
    """Runs of pieces that cut, or do not: first point, last point, cutting."""
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(cutting)) + 1, [len(cutting)]]).tolist()
    return [(a, b, bool(cutting[a])) for a, b in itertools.pairwise(bounds)]
