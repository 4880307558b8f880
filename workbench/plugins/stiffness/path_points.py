"""All points of a milling path in the order of motion, as the posture optimiser sees them. mm, N, rad."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import zip_longest
from typing import Literal

import numpy as np

from workbench.api import (
    Bool,
    Cell,
    Float,
    InputError,
    Int,
    Layer,
    Shaped,
    Toolpath,
    Travel,
    chords_mm,
    interpolate_poses,
    inverse,
    pose_from,
    quaternion_from_rotation,
    turntable_pose,
)
from workbench.plugins.stiffness.values import MillingForce

AIR_STEP_MM = 5.0  # a travel is looked at so often
Load = Literal["mean", "peak"]


@dataclass(frozen=True, slots=True, eq=False)
class PathPoints:
    """n points of travels and layers in the order of motion; frames as in `Layer`, in the base."""

    base_from_point: Shaped[Float, "n 4 4"]  # with the external axes where they were when the path was planned
    feed_mm_s: Shaped[Float, " n"]  # towards the point
    force_n: Shaped[Float, "n 3"]  # on the cutter at the point, base axes; 0 in travel moves
    torque_nm: Shaped[Float, " n"]  # of the spindle, mean of a revolution
    layer: Shaped[Int, " n"]  # index of the layer; 0: travel between layers
    cutting: Shaped[Bool, " n"]
    measured: Shaped[Bool, " n"]
    point_from_tip: Shaped[Float, "4 4"]  # the cutter's tip: a radius off along x, its reach along z
    planned: Float | float  # where the external axes stood, rad
    drift: Shaped[Float, "n ..."]  # rad, where the external axes stand as the outermost, which is sought, is at 0
    spindle_rpm: float
    source: str  # of the path, for messages

    @property
    def loaded(self) -> Int:
        """Indices of the points where the cutter cuts."""
        return np.flatnonzero(np.linalg.norm(self.force_n, axis=1) > 0)

    @property
    def time_steps_s(self) -> Float:
        """Time (n,) from the point before, at the path's own feed; what stands still takes a millisecond."""
        way = chords_mm(self.part_mm)
        return np.asarray(np.maximum(np.append(0.0, way / self.feed_mm_s[1:]), 1e-3))

    def only(self, indices: Int) -> PathPoints:
        """Some of the points."""
        columns: tuple[str, ...] = ("base_from_point", "feed_mm_s", "force_n", "torque_nm", "layer", "cutting")
        columns += ("measured", "drift")
        return replace(self, **{name: getattr(self, name)[indices] for name in columns})

    def densified(self, step_mm: float) -> PathPoints:
        """With points between, where neighbours are farther apart: there the tool goes straight and turns evenly."""
        at, between = _between(self.part_mm, quaternion_from_rotation(self.base_from_point[:, :3, :3]), step_mm)
        low, high = _neighbours(at)
        return replace(
            self.only(high),
            base_from_point=between,
            drift=self.drift[low] + ((at - low) * (self.drift[high] - self.drift[low]).T).T,
        )

    @property
    def part_mm(self) -> Shaped[Float, "n 3"]:
        """Of the points, where the part was when the path was planned."""
        return self.base_from_point[:, :3, 3]

    def external(self, table: Float | float, at: Int | int) -> Float:
        """Values of the external axes at points `at` (...) where the outermost stands at `table` (...)."""
        if self.drift.ndim == 1:
            return table + self.drift[at]
        return np.asarray(np.multiply.outer(table, np.eye(self.drift.shape[1])[-1]) + self.drift[at])

    def moved(self, cell: Cell, external: Float) -> Float:
        """Motions (..., 4, 4) in the base of what stands on the external axes when they go to these values, rad."""
        return turntable_pose(cell, external) @ inverse(turntable_pose(cell, self.planned))

    def motion(self, cell: Cell, table: Float, at: Int) -> Float:
        """`moved` at points `at` (...) with the outermost axis at `table` (...), rad; both broadcast."""
        steady = bool((self.drift == self.drift[:1]).all())
        return self.moved(cell, self.external(table, np.zeros((1,) * np.ndim(at), int) if steady else at))


def path_points(
    toolpath: Toolpath, force: MillingForce, *, load: Load, reach_mm: float, planned: Float | float
) -> PathPoints:
    """Gather the points of a path; travels are filled up to one point every AIR_STEP_MM.

    Raises:
        InputError: the force is of another path, or nothing cuts.
    """
    base = np.eye(4) if toolpath.base_from_workobject is None else toolpath.base_from_workobject
    pairs = zip_longest(toolpath.travels, toolpath.layers)
    parts: list[Layer | Travel] = [part for pair in pairs for part in pair if part is not None]
    position, quaternion, feed, layer, cutting, measured = (
        np.concatenate(column) for column in zip(*map(_columns, parts), strict=True)
    )
    within = (layer[1:] == layer[:-1]) & (layer[1:] > 0)  # a layer: it has its own points
    at, poses = _between(position, quaternion, np.where(within, np.inf, AIR_STEP_MM))
    low, high = _neighbours(at)
    own, there = low == high, base @ poses
    layers = np.where(own, layer[low], 0)
    found = PathPoints(
        base_from_point=there,
        feed_mm_s=feed[high],
        force_n=(there[:, :3, :3] @ force.at_points(layers, f"{load}_n")[..., None])[..., 0],
        torque_nm=force.at_points(layers, "torque_nm"),
        layer=layers,
        cutting=own & cutting[low],
        measured=~own | measured[low],
        point_from_tip=pose_from(np.eye(3), np.array([-toolpath.cutter.diameter_mm / 2, 0, reach_mm])),
        planned=planned,
        drift=np.zeros((len(there), *np.shape(planned))),
        spindle_rpm=force.spindle_rpm,
        source=toolpath.source or "milling path",
    )
    if not len(found.loaded):
        raise InputError("milling force", "expected points where the cutter is loaded, found none")
    return found


def _columns(part: Layer | Travel) -> tuple[Float, Float, Float, Int, Bool, Bool]:
    """Positions, quaternions, feeds, layer (0: travel), and which points cut, and are measured."""
    count = len(part.feed_mm_s)
    of_layer = (np.full(count, 0), np.zeros(count, bool), np.ones(count, bool))
    if isinstance(part, Layer):
        of_layer = (np.full(count, part.index), part.cutting, part.measured)
    return part.position_mm, part.quaternion_wxyz, part.feed_mm_s, *of_layer


def _between(position_mm: Float, quaternion: Float, step_mm: Float | float) -> tuple[Float, Float]:
    """Places (m,) between n points, as indices of them, no farther apart than a step; and the poses there."""
    pieces = np.maximum(np.ceil(chords_mm(position_mm) / step_mm), 1).astype(int)
    at = np.append(np.repeat(np.arange(len(pieces)), pieces), len(pieces)).astype(float)
    at[:-1] += np.concatenate([np.arange(k) / k for k in pieces.tolist()] or [np.zeros(0)])
    return at, interpolate_poses(at, np.arange(len(position_mm), dtype=float), position_mm, quaternion)


def _neighbours(at: Float) -> tuple[Int, Int]:
    """The points before and behind places (m,); a point itself is both."""
    return np.floor(at).astype(int), np.ceil(at - 1e-9).astype(int)
