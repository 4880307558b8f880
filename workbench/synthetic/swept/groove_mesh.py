"""A groove as triangles: both plates, tack welds, spatter and what lies behind the gap."""

from __future__ import annotations

import numpy as np

from workbench.synthetic.swept.groove import groove_chains, groove_sizes
from workbench.synthetic.swept.mesh import OTHER, Mesh, Piece, chain_sheet, mesh_of, sheet, stations, swept
from workbench.synthetic.swept.recipe import GroovePart
from workbench.synthetic.swept.spine import Curve
from workbench.units import Float

BACKGROUND = 32  # a face: what is seen through the gap


def groove_mesh(part: GroovePart, curve: Curve, rng: np.random.Generator) -> Mesh:
    """The mesh of a groove."""
    frames = stations(curve)
    pieces = [chain_sheet(frames, chain) for chain in groove_chains(part, frames.s, curve.length)]
    pieces += _tacks(part, curve) + _spatter(part, curve, rng)
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


def _spatter(part: GroovePart, curve: Curve, rng: np.random.Generator) -> list[Piece]:
    """Drops, their middles on the surface."""
    count = rng.poisson(part.spatter.per_100_mm * curve.length / 100)
    s, across = rng.uniform(0, curve.length, count), rng.uniform(-1, 1, count) * part.spatter.reach_mm
    radius = rng.uniform(*part.spatter.radius_mm, count)
    pieces = []
    for i in range(count):
        at = np.array([s[i]])
        corners = groove_sizes(part, at, curve.length).corners
        side = "left" if across[i] < 0 else "right"
        root, upper = corners[f"{side}_root"][0], corners[f"{side}_upper"][0]
        outer, inner = sorted([abs(root[0]), abs(upper[0])])[::-1]
        if abs(across[i]) < inner:  # it fell through the gap
            continue
        share = np.clip((abs(across[i]) - inner) / max(outer - inner, 1e-9), 0, 1)
        height = root[1] + share * (upper[1] - root[1])
        place = np.array([across[i], height])
        pieces.append(_ellipsoid(curve, s[i], place, (radius[i],) * 3, steps=9))
    return pieces


def _ellipsoid(curve: Curve, s: float, place: Float, half: tuple[float, float, float], steps: int = 25) -> Piece:
    """An ellipsoid about the place (a, b) of the section at s, half axes along a, b and the edge."""
    frames = curve.frames(np.array([s]))
    turn, tilt = np.linspace(0, 2 * np.pi, 2 * steps - 1), np.linspace(-np.pi / 2, np.pi / 2, steps)
    u, v = np.meshgrid(turn, tilt, indexing="ij")
    a = place[0] + half[0] * np.cos(u) * np.cos(v)
    b = place[1] + half[1] * np.sin(u) * np.cos(v)
    t = half[2] * np.sin(v)
    vertices = frames.position[0] + a[..., None] * frames.n[0] + b[..., None] * frames.m[0] + t[..., None] * frames.t[0]
    return sheet(vertices[:, ::-1], np.zeros((*a.shape, 3)), np.full(steps - 1, OTHER, dtype=np.uint8))
