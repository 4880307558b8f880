"""The part as triangles that rays meet: Open3D finds the triangle, its plane is met again in double precision."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy

from workbench.synthetic.swept.section import Chain
from workbench.synthetic.swept.spine import Curve, Frames
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

    def cast(self, start: Float, way: Float, threads: int = 1) -> Hits:
        """The first hits of rays from `start` (k, 3) along `way` (k, 3), part frame."""
        local = start - self.origin
        rays = _rays(local, way)
        found = self.scene.cast_rays(rays, nthreads=threads)
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

    def open_way(self, start: Float, end: Float, threads: int = 1) -> Bool:
        """Whether nothing stands between `start` (k, 3) on the part and `end` (k, 3)."""
        way = end - start
        length = np.linalg.norm(way, axis=1, keepdims=True)
        rays = _rays(start - self.origin, way / length)
        return ~np.asarray(
            self.scene.test_occlusions(rays, tnear=0.02, tfar=float(length.max()), nthreads=threads).numpy()
        )


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
