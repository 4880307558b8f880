"""The part as triangles that rays meet: Open3D finds the triangle, its plane is met again in double precision."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from workbench.synthetic.swept.recipe import Block, EdgeBurr, SweptPart
from workbench.synthetic.swept.sweep import ROOT, Chain, Curve, Frames, chain_of, outline_of, shape_of
from workbench.units import AnyArray, Bool, Float, Float32, Int, Shaped

STEP_STRAIGHT_MM, STEP_BENT_MM = 0.5, 0.3  # between stations
OTHER = 255  # face of clamps and burrs


@dataclass(frozen=True, slots=True, eq=False)
class Hits:
    """Where rays enter the part: k rays."""

    reach: Shaped[Float, " k"]  # length along the ray in units of its direction; inf: nothing
    cosine: Shaped[Float, " k"]  # of the incidence; not positive: the back of a face
    face: Shaped[AnyArray, " k"]  # uint8
    s: Shaped[Float, " k"]  # along the spine
    across_mm: Shaped[Float, " k"]  # across the face, from its lower end
    share: Shaped[Float, " k"]  # the same as a share of the face
    normal: Shaped[Float, "k 3"]  # of the triangle


@dataclass(frozen=True, slots=True, eq=False)
class Mesh:
    """Triangles with what stands at their corners."""

    origin: Shaped[Float, " 3"]  # of the local coordinates, in which single precision is enough to find a triangle
    corner: Shaped[Float, "n 3"]  # a corner of each triangle, local
    normal: Shaped[Float, "n 3"]  # unit, outward
    face: Shaped[AnyArray, " n"]  # uint8
    place: Shaped[Float, "n 3 3"]  # at each corner: s, across_mm, share
    scene: Any

    def cast(self, start: Float, way: Float) -> Hits:
        """The first hits of rays from `start` (k, 3) along `way` (k, 3), part frame."""
        local = start - self.origin
        rays = _rays(local, way)
        found = self.scene.cast_rays(rays, nthreads=1)
        index = found["primitive_ids"].numpy().astype(np.int64)
        hit = np.isfinite(found["t_hit"].numpy())
        index[~hit] = 0
        uv = found["primitive_uvs"].numpy().astype(float)
        normal = self.normal[index]
        slope = np.einsum("ij,ij->i", way, normal)
        with np.errstate(divide="ignore", invalid="ignore"):
            reach = np.einsum("ij,ij->i", self.corner[index] - local, normal) / slope
            cosine = -slope / np.linalg.norm(way, axis=1)
        hit &= np.isfinite(reach)
        place = self.place[index]
        at = place[:, 0] + uv[:, :1] * (place[:, 1] - place[:, 0]) + uv[:, 1:] * (place[:, 2] - place[:, 0])
        face = np.where(hit, self.face[index], OTHER).astype(np.uint8)
        reach, cosine = np.where(hit, reach, np.inf), np.where(hit, cosine, 0.0)
        return Hits(reach, cosine, face, at[:, 0], at[:, 1], at[:, 2], normal)

    def open_way(self, start: Float, end: Float) -> Bool:
        """Whether nothing stands between `start` (k, 3) on the part and `end` (k, 3)."""
        way = end - start
        length = np.linalg.norm(way, axis=1, keepdims=True)
        rays = _rays(start - self.origin, way / length)
        return ~np.asarray(self.scene.test_occlusions(rays, tnear=0.02, tfar=float(length.max()), nthreads=1).numpy())


def _rays(start: Float, way: Float) -> Any:
    import open3d

    o3d: Any = open3d  # its stubs know less than it does
    return o3d.core.Tensor(np.concatenate([start, way], axis=1).astype(np.float32))


def stations(curve: Curve, step_mm: float = STEP_STRAIGHT_MM) -> Frames:
    """The stations of a mesh, at most `step_mm` apart, closer on a bent or twisted part."""
    twist = curve.part.twist_deg
    bent = curve.part.spine.shape != "straight" or twist.lowest != twist.highest
    step = min(step_mm, STEP_BENT_MM) if bent else step_mm
    s = np.linspace(0.0, curve.length, max(2, math.ceil(curve.length / step) + 1))
    frames = curve.frames(np.append(s[:-1], s[-1] - (1e-9 if curve.closed else 0.0)))
    return replace(frames, s=s)


def swept(frames: Frames, points: Float) -> Float:
    """Part coordinates (k, j, 3) of section points (k, j, 2)."""
    return np.asarray(
        frames.position[:, None] + points[..., :1] * frames.n[:, None] + points[..., 1:] * frames.m[:, None]
    )


@dataclass(frozen=True, slots=True, eq=False)
class Relief:
    """A Gaussian random field over a face, zero mean, on a periodic grid."""

    field: Shaped[Float, "p q"]
    step_mm: float

    def at(self, s: Float, across_mm: Float) -> Float:
        """Heights at places of the face, bilinear."""
        x, y = s / self.step_mm, across_mm / self.step_mm
        i, j = np.floor(x).astype(np.int64), np.floor(y).astype(np.int64)
        f, g = x - i, y - j
        p, q = self.field.shape
        i, j, k, m = i % p, j % q, (i + 1) % p, (j + 1) % q
        low = self.field[i, j] * (1 - f) + self.field[k, j] * f
        high = self.field[i, m] * (1 - f) + self.field[k, m] * f
        return np.asarray(low * (1 - g) + high * g)


def gaussian_relief(sd_mm: float, correlation_mm: float, size: tuple[int, int], rng: np.random.Generator) -> Relief:
    """A field whose autocorrelation falls to 1/e over `correlation_mm`, on a grid of a third of it."""
    smooth = scipy.ndimage.gaussian_filter(
        rng.standard_normal(size), 3.0 / 2.0, mode="wrap"
    )  # exp(-(d/2w)^2): 1/e at d = 2w
    return Relief(sd_mm * smooth / smooth.std(), correlation_mm / 3.0)


Piece = tuple[Float, Int, AnyArray, Float]  # vertices, triangles, faces, places of the vertices


def chain_sheet(frames: Frames, chain: Chain, points: Float | None = None) -> Piece:
    """The surface that a chain sweeps; `points` where they are not the chain's own."""
    points = chain.points if points is None else points
    width = np.linalg.norm(np.diff(points, axis=1), axis=2)
    along_chain = np.concatenate([np.zeros((len(width), 1)), np.cumsum(width, axis=1)], axis=1)
    place = np.stack([np.broadcast_to(frames.s[:, None], along_chain.shape), along_chain, chain.across], axis=2)
    return sheet(swept(frames, points), place, chain.face.astype(np.uint8))


def sheet(vertices: Float, place: Float, face: AnyArray) -> Piece:
    """Triangles of a grid of vertices (k, j, 3), `face` (j - 1,) of its strips."""
    rows, columns = vertices.shape[:2]
    i, j = np.meshgrid(np.arange(rows - 1), np.arange(columns - 1), indexing="ij")
    a, b = (i * columns + j).ravel(), (i * columns + j + 1).ravel()
    c, d = a + columns, b + columns
    triangles = np.concatenate([np.stack([a, c, b], axis=1), np.stack([d, b, c], axis=1)])
    return vertices.reshape(-1, 3), triangles, np.tile(np.tile(face, rows - 1), 2), place.reshape(-1, 3)


def mesh_of(pieces: list[Piece]) -> Mesh:
    """One mesh of many pieces."""
    import open3d

    o3d: Any = open3d  # its stubs know less than it does
    offsets = np.cumsum([0, *(len(p[0]) for p in pieces)])
    vertices = np.concatenate([p[0] for p in pieces])
    triangles = np.concatenate([p[1] + o for p, o in zip(pieces, offsets, strict=False)])
    face, place = np.concatenate([p[2] for p in pieces]), np.concatenate([p[3] for p in pieces])
    corners = vertices[triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    size = np.linalg.norm(normal, axis=1)
    solid = size > 1e-12
    triangles, normal, face = triangles[solid], normal[solid] / size[solid, None], face[solid]
    origin = vertices.mean(axis=0)
    local: Float32 = (vertices - origin).astype(np.float32)
    scene = o3d.t.geometry.RaycastingScene(nthreads=1)
    scene.add_triangles(o3d.core.Tensor(local), o3d.core.Tensor(triangles.astype(np.uint32)))
    return Mesh(origin, vertices[triangles[:, 0]] - origin, normal, face, place[triangles], scene)


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
