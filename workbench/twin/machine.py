"""The milling cell at work: it moves the worn cutter along a path, as the mechanics let it, through the stock."""

from __future__ import annotations

import itertools
from typing import NamedTuple

import numpy as np

from workbench.artefacts import Layer, Toolpath, Travel
from workbench.synthetic.milling import Hit, Motion, Stock
from workbench.twin.mechanics import Mechanics, straight_moves
from workbench.units import Bool, Float


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
