"""The edge of a plate as triangles: the swept section, burrs and clamps."""

from __future__ import annotations

import math

import numpy as np

from workbench.synthetic.swept.mesh import (
    OTHER,
    STEP_STRAIGHT_MM,
    Mesh,
    Piece,
    Relief,
    chain_sheet,
    gaussian_relief,
    mesh_of,
    sheet,
    stations,
    swept,
)
from workbench.synthetic.swept.recipe import Block, EdgeBurr, SweptPart
from workbench.synthetic.swept.section import ROOT, chain_of, outline_of, shape_of
from workbench.synthetic.swept.spine import Curve

STEP_ROUGH_MM = 0.25  # between the stations of a rough face


def plate_mesh(part: SweptPart, curve: Curve, rng: np.random.Generator) -> Mesh:
    """The mesh of a plate's edge: the swept section, its burrs and clamps."""
    frames = stations(curve, STEP_ROUGH_MM if part.roughness.sd_mm > 0 else STEP_STRAIGHT_MM)
    shape = shape_of(part, frames.s, curve.length)
    chain = chain_of(outline_of(part, shape))
    points = chain.points.copy()
    relief = relief_of(part, curve.length, rng)
    on_root = np.zeros(points.shape[1], dtype=bool)
    on_root[:-1] |= chain.face == ROOT
    on_root[1:] |= chain.face == ROOT
    if relief is not None:
        points[:, on_root, 0] += relief.at(frames.s[:, None], points[:, on_root, 1])
    pieces = [chain_sheet(frames, chain, points)]
    pieces += [_burr(part, curve, burr, rng) for burr in part.burrs]
    pieces += [_clamp(part, curve, block) for block in part.clamps]
    return mesh_of(pieces)


def relief_of(part: SweptPart, length: float, rng: np.random.Generator) -> Relief | None:
    """The roughness of the end face, at least twice as large as the face so that it does not repeat."""
    rough, height = part.roughness, part.thickness_mm.highest
    if rough.sd_mm == 0:
        return None
    step = rough.correlation_mm / 3.0
    return gaussian_relief(
        rough.sd_mm, rough.correlation_mm, (math.ceil(1.1 * length / step) + 8, math.ceil(2 * height / step) + 8), rng
    )


def _burr(part: SweptPart, curve: Curve, burr: EdgeBurr, rng: np.random.Generator) -> Piece:
    """A ridge of triangular section with a ragged crest that runs out at its ends."""
    s = np.arange(burr.from_mm, burr.to_mm + 1e-9, 0.25).clip(0, curve.length)
    shape = shape_of(part, s, curve.length)
    knots = rng.uniform(1 - burr.ragged, 1, max(2, math.ceil((burr.to_mm - burr.from_mm) / 0.7)))
    height = burr.height_mm * np.interp(s, np.linspace(burr.from_mm, burr.to_mm, len(knots)), knots)
    height *= np.clip(np.minimum(s - s[0], s[-1] - s) / 0.5, 0, 1)
    corner = shape.corner[:, 1] if burr.edge == "lower" else shape.corner[:, 2]
    down = -1.0 if burr.edge == "lower" else 1.0
    wide, zero = np.full(len(s), burr.width_mm), np.zeros(len(s))
    if burr.direction == "in_plane":  # prolongs the root face; behind it the ridge falls back to the plate
        ring = [(zero, -down * 0.02 + zero), (zero, down * height), (-wide, zero)]
    else:
        ring = [(zero, -down * wide), (height, zero), (zero, zero)]
    points = np.stack([corner + np.stack(p, axis=1) for p in ring], axis=1)
    if down > 0:
        points = points[:, ::-1]
    vertices = swept(curve.frames(s), points)
    place = np.zeros((*vertices.shape[:2], 3)) + 0.0
    place[..., 0] = s[:, None]
    face = ROOT if burr.direction == "in_plane" else OTHER
    return sheet(vertices[:, ::-1], place, np.full(len(ring) - 1, face, dtype=np.uint8))


def _clamp(part: SweptPart, curve: Curve, block: Block) -> Piece:
    """A box round the edge, from below the plate to above it."""
    start, stop = block.from_mm, block.to_mm
    middle = curve.frames(np.array([(start + stop) / 2]))
    shape = shape_of(part, np.array([(start + stop) / 2]).clip(0, curve.length), curve.length)
    top = float(shape.corner[0, -2, 1])
    a = np.array([-block.reach_in_mm, block.reach_out_mm])
    b = np.array([-1.0, top + block.height_mm])
    t = np.array([start - stop, stop - start]) / 2
    grid = np.stack(np.meshgrid(a, b, t, indexing="ij"), axis=-1).reshape(-1, 3)
    vertices = middle.position + grid[:, :1] * middle.n + grid[:, 1:2] * middle.m + grid[:, 2:] * middle.t
    quads = np.array([[0, 1, 3, 2], [4, 6, 7, 5], [0, 4, 5, 1], [2, 3, 7, 6], [0, 2, 6, 4], [1, 5, 7, 3]])
    triangles = np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])
    corners = vertices[triangles]
    outwards = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    flip = np.einsum("ij,ij->i", outwards, corners.mean(axis=1) - vertices.mean(axis=0)) < 0
    triangles[flip] = triangles[flip][:, ::-1]
    return vertices, triangles, np.full(len(triangles), OTHER, dtype=np.uint8), np.zeros((len(vertices), 3))
