"""Collision of very many postures: proven apart by bounding volumes, and what these leave open decided by fcl."""

from __future__ import annotations

import functools

import numpy as np

from workbench.robot.bounds import SAFE_MM, bounding_volumes, clearance_bound_mm, near_pairs, pair_bounds_mm
from workbench.robot.cell import Cell
from workbench.robot.collision import CollisionModel, turntable_pose
from workbench.robot.kinematics import motions
from workbench.robot.pairs import Pairs
from workbench.units import Bool, Float, Int

FREE = -1


class CollisionScreen:
    """A cell's bodies, ready to be asked about many postures; the answers are `CollisionModel`'s."""

    def __init__(self, cell: Cell) -> None:
        """Build once, ask often."""
        self.model = CollisionModel(cell)
        self.cell, self._volumes = cell, bounding_volumes(cell)

    def __repr__(self) -> str:
        """What it asks."""
        return f"CollisionScreen({self.model!r})"

    def hits(self, joints: Float, turntable: Float) -> Int:
        """Index into `pairs` of a pair that is too near, or FREE (n,), at (n, 6) and (n,), rad."""
        found = np.full(len(joints), FREE)
        need = float(self.model.least_mm.max(initial=0.0)) + SAFE_MM
        open_ = np.flatnonzero(
            ~(clearance_bound_mm(self.cell, self._volumes, joints, turntable, need + SAFE_MM) > need)
        )
        if not len(open_):
            return found
        near = near_pairs(self.cell, self._volumes, joints[open_], turntable[open_], self.model.least_mm)
        moved = motions(self.cell.chain, joints[open_])
        angles, which = np.unique(turntable[open_], return_inverse=True)
        tables = [turntable_pose(self.cell, angle) for angle in angles.tolist()]
        for i, n in enumerate(open_.tolist()):
            found[n] = self.model.first_hit(moved[i], tables[which[i]], np.flatnonzero(near[i]).tolist())
        return found

    def clearances_mm(self, joints: Float, turntable: Float) -> Float:
        """The smallest distance (n,) of bodies that must not touch, 0 where they do, at (n, 6) and (n,), rad.

        fcl is asked about the pairs in the order of their bounds, until no other can be nearer. NaN: nothing can touch.
        """
        if not self.model.pairs:
            return np.full(len(joints), np.nan)
        bounds, _ = pair_bounds_mm(self.cell, self._volumes, joints, turntable)
        moved, out = motions(self.cell.chain, joints), np.full(len(joints), np.inf)
        for n, angle in enumerate(turntable.tolist()):
            turned = turntable_pose(self.cell, angle)
            for pair in np.argsort(bounds[n]).tolist():
                if bounds[n, pair] > out[n] + SAFE_MM:
                    break
                out[n] = min(out[n], *self.model.distances(moved[n], turned, [pair]))
        return out

    @functools.cached_property
    def _pairs(self) -> Pairs:
        return Pairs(self.cell)

    def swept(self, joints: Float, turntable: Float) -> Bool:
        """Which places (c, s) of ways (c, s, 6), (c,) are not proven free; see `Pairs.swept`."""
        return self._pairs.swept(joints, turntable)

    def pair(self, hit: int) -> tuple[str, str]:
        """Names of the bodies of a hit."""
        return self.model.names(*self.model.pairs[hit])

    def which(self, pair: tuple[str, str] | None) -> int:
        """A hit of two bodies by their names; FREE: there is none."""
        names = (self.model.names(*two) for two in self.model.pairs)
        return next((i for i, one in enumerate(names) if one == pair), FREE)
