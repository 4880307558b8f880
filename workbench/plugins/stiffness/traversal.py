"""The traversal of eq. (25): mean displacement for every cutter rotation and turntable angle, in every branch."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.api import AnyArray, Cell, Float, Int, Shaped, inverse
from workbench.plugins.stiffness.arm import BRANCHES, CAUSES, AnyArm, LoadedPath, lowest_displacements, traverse
from workbench.plugins.stiffness.path_points import PathPoints, turn_about_z


@dataclass(frozen=True, slots=True, eq=False)
class Traversal:
    """Eq. (25)'s function on its grid, without collision; t cutter rotations and a turntable angles, rad."""

    rotations: Shaped[Float, " t"]
    tables: Shaped[Float, " a"]
    mean_mm: Shaped[Float, "4 a t"]  # mean displacement in each of BRANCHES; meaningless where it is not solved
    said: Shaped[AnyArray, "4 a t"]  # index into `arm.CAUSES`: 0 where joint angles exist

    @property
    def ranked(self) -> Int:
        """Flat indices of all solved (branch, turntable, rotation), their mean displacement rising."""
        flat = np.flatnonzero(self.said == CAUSES.index(""))
        return np.asarray(flat[np.argsort(self.mean_mm.reshape(-1)[flat], kind="stable")])

    def thinned(self, every: int, rotation: float, table: float) -> Traversal:
        """Every so many-th angle both ways, those of a cell of the grid among them."""
        t, a = (int(np.abs(at - of).argmin()) % every for at, of in ((self.rotations, rotation), (self.tables, table)))
        cells = (slice(None), slice(a, None, every), slice(t, None, every))
        mean, said = np.ascontiguousarray(self.mean_mm[cells]), np.ascontiguousarray(self.said[cells])
        return Traversal(self.rotations[t::every], self.tables[a::every], mean, said)


def sample(points: PathPoints, count: int) -> Int:
    """Indices of at most `count` loaded points, evenly spread with both ends, and a quarter as many others."""
    loaded = points.loaded
    air = np.setdiff1d(np.arange(len(points.layer)), loaded)
    return np.sort(np.concatenate([spread(loaded, count), spread(air, max(count // 4, 2))]))


def spread(indices: Int, count: int) -> Int:
    """At most `count` of `indices`, evenly, the first and the last among them."""
    at = np.linspace(0, len(indices) - 1, min(count, len(indices))).round().astype(int)
    return np.asarray(indices[np.unique(at)])


def traversal(
    arm: AnyArm, cell: Cell, stiffness: Float, points: PathPoints, rotations: Float, tables: Float
) -> Traversal:
    """Mean displacement of the loaded points, and what stands in the way of joint angles at any point."""
    path = placed(cell, points, tables)
    found = [traverse(arm, stiffness, path, rotations, shoulder=s, elbow=e) for s, e in BRANCHES]
    mean, said = (np.array(part) for part in zip(*found, strict=True))
    return Traversal(rotations, tables, mean * (len(points.layer) / len(points.loaded)), said)


def lowest(arm: AnyArm, cell: Cell, stiffness: Float, points: PathPoints, rotations: Float, tables: Float) -> Float:
    """The least displacement (n, a) of each loaded point, over all rotations and branches: no law can do better."""
    path = placed(cell, points, tables)
    loaded = LoadedPath(path.flange_from_cutter, *(part[:, points.loaded] for part in path[1:]))
    return lowest_displacements(arm, stiffness, loaded, rotations).T


def placed(cell: Cell, points: PathPoints, tables: Float) -> LoadedPath:
    """The path where the turntable brings it, for each of its angles (a,)."""
    turned = points.turned(cell, tables)[:, None]
    at = turned @ points.base_from_point
    force = (turned[..., :3, :3] @ points.force_n[..., None])[..., 0]
    return LoadedPath(cell.flange_from_cutter, at @ points.point_from_tip, at[..., :3, 3], force)


def flange_poses(cell: Cell, points: PathPoints, at: Int, rotation: Float, table: Float) -> Float:
    """Poses of the flange (k, 4, 4) at points (k,), with the cutter and the turntable turned by (k,)."""
    cutter = points.turned(cell, table) @ points.base_from_point[at] @ points.point_from_tip
    return np.asarray(cutter @ turn_about_z(rotation) @ inverse(cell.flange_from_cutter))
