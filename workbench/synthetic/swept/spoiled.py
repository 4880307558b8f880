"""Ranges that are wrong for what the part is: second returns of a face, and one flank seen in the other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from workbench.synthetic.swept.groove import RIGHT
from workbench.synthetic.swept.mesh import Hits, Mesh, gaussian_relief
from workbench.synthetic.swept.recipe import Ghost, Reflection
from workbench.synthetic.swept.section import BEVEL, ROOT
from workbench.synthetic.swept.sensor import Spoil
from workbench.units import Float

MOST_BETWEEN_MM = 40.0  # flanks further apart show nothing of each other


def ghosts_of(ghosts: Sequence[Ghost]) -> Spoil:
    """What ghosts add to the ranges."""

    def added(hits: Hits, point: Float, way: Float, rng: np.random.Generator) -> Float:
        off = np.zeros(len(hits.s))
        for ghost in ghosts:
            on = (hits.face == (ROOT if ghost.face == "root" else BEVEL)) & (hits.s >= ghost.from_mm)
            on &= (hits.s <= ghost.to_mm) & (hits.share >= ghost.across[0]) & (hits.share <= ghost.across[1])
            if ghost.probability < 1:
                on &= rng.random(len(on)) < ghost.probability
            off[on] += ghost.offset_mm
        return off

    return added


def reflections_of(reflection: Reflection, mesh: Mesh, rng: np.random.Generator) -> Spoil:
    """What reflections add: where a patch of a flank mirrors the laser onto the other plate, a share of that way."""
    patches = gaussian_relief(1.0, reflection.patch_mm, (512, 256), rng)
    least = float(np.quantile(patches.field, 1 - reflection.share))
    sides = {"left": (0,), "right": (RIGHT,), "both": (0, RIGHT)}[reflection.flank]

    def added(hits: Hits, point: Float, way: Float, rng: np.random.Generator) -> Float:
        off = np.zeros(len(hits.s))
        if reflection.share == 0:
            return off
        for side in sides:
            on = np.flatnonzero(np.isin(hits.face, (ROOT + side, BEVEL + side)))
            on = on[patches.at(hits.s[on] + 37.0 * side, hits.across_mm[on]) > least]
            normal, into = hits.normal[on], way[on] / np.linalg.norm(way[on], axis=1, keepdims=True)
            out = into - 2 * np.einsum("ij,ij->i", into, normal)[:, None] * normal
            back = mesh.cast(point[on] + 0.02 * normal, out)
            seen = (back.reach < MOST_BETWEEN_MM) & (back.face // RIGHT == (RIGHT - side) // RIGHT)
            off[on[seen]] = reflection.depth_share * back.reach[seen]
        return off

    return added
