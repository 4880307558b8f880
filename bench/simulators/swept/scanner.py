"""The scanner: how the robot carries it, and what laser and camera see of the part, column by column.

The part is triangles that rays meet: Open3D finds the triangle, its plane is met again in double precision.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy
from scipy.spatial.transform import Rotation

from bench.simulators.swept.recipe import AnyRecipe, Block, EdgeBurr, SweptPart, SweptScanner, Way
from bench.simulators.swept.sweep import ROOT, Chain, Curve, Frames, chain_of, outline_of
from workbench.geometry.poses import inverse, pose_from
from workbench.synthetic.workpiece import pose
from workbench.units import DEG, AnyArray, Bool, Float, Float32, Int, Shaped

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
        return Hits(reach, cosine, face, at[:, 0], at[:, 1], at[:, 2])

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
    return curve.stations(max(2, math.ceil(curve.length / step) + 1))


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
        place = np.stack(np.broadcast_arrays(s, across_mm)) / self.step_mm
        return np.asarray(scipy.ndimage.map_coordinates(self.field, place, order=1, mode="grid-wrap"))


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
    chain = chain_of(outline_of(part, frames.s, curve.length))
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
    edges = outline_of(part, s, curve.length).corner
    knots = rng.uniform(1 - burr.ragged, 1, max(2, math.ceil((burr.to_mm - burr.from_mm) / 0.7)))
    height = burr.height_mm * np.interp(s, np.linspace(burr.from_mm, burr.to_mm, len(knots)), knots)
    height *= np.clip(np.minimum(s - s[0], s[-1] - s) / 0.5, 0, 1) * np.linspace(burr.begins, 1.0, len(s))
    corner = edges[:, 1] if burr.edge == "lower" else edges[:, 2]
    down = -1.0 if burr.edge == "lower" else 1.0
    wide, zero = np.full(len(s), burr.width_mm), np.zeros(len(s))
    if burr.direction == "in_plane":  # prolongs the root face; behind it the ridge falls back to the plate
        lean = np.radians(burr.lean_deg)
        ring = [(zero, -down * 0.02 + zero), (zero, zero), (height * np.sin(lean), down * height * np.cos(lean))]
        ring += [(-wide, zero)]
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
    import open3d

    start, stop = block.from_mm, block.to_mm
    middle = curve.frames(np.array([(start + stop) / 2]))
    outline = outline_of(part, np.array([(start + stop) / 2]).clip(0, curve.length), curve.length)
    top = float(outline.corner[0, -2, 1])
    low = np.array([-block.reach_in_mm, -1.0, (start - stop) / 2])
    high = np.array([block.reach_out_mm, top + block.height_mm, (stop - start) / 2])
    box = open3d.geometry.TriangleMesh.create_box()
    at = low + np.asarray(box.vertices) * (high - low)
    vertices = middle.position + at[:, :1] * middle.n + at[:, 1:2] * middle.m + at[:, 2:] * middle.t
    triangles = np.asarray(box.triangles)[:, ::-1]  # n, m, t are left-handed
    return vertices, triangles, np.full(len(triangles), OTHER, dtype=np.uint8), np.zeros((len(vertices), 3))


PAUSE_S = 2.0  # between passes


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One pass: N frames, K recorded poses."""

    time_s: Shaped[Float, " N"]  # as recorded
    part_from_profiler: Shaped[Float, "N 4 4"]  # true
    pose_time_s: Shaped[Float, " K"]
    position_mm: Shaped[Float, "K 3"]  # flange in the base, as recorded
    quaternion_wxyz: Shaped[Float, "K 4"]


def moves(recipe: AnyRecipe, curve: Curve) -> list[Motion]:
    """The motion of every pass, one after the other in time."""
    start, motions = 1.0, []
    for index, way in enumerate(recipe.passes):
        motions.append(_move(recipe, curve, way, start, np.random.default_rng([recipe.seed, 11, index])))
        start = float(max(motions[-1].time_s[-1], motions[-1].pose_time_s[-1])) + PAUSE_S
    return motions


def _move(recipe: AnyRecipe, curve: Curve, way: Way, start_s: float, rng: np.random.Generator) -> Motion:
    robot = recipe.robot
    turns = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(way.way_mm)))])  # way gone at each turning point
    count = math.floor(turns[-1] / robot.frame_pitch_mm + 1e-9) + 1
    speed = robot.frame_rate_hz * robot.frame_pitch_mm
    time = start_s + np.arange(count) / robot.frame_rate_hz
    pose_time = _pose_times(way, time, robot.pose_rate_hz, abs(robot.time_offset_s))

    def poses(at_s: Float) -> Float:
        gone = (at_s - start_s) * speed
        return _poses(recipe, curve, way, np.interp(gone, turns, way.way_mm), gone)

    to_base = pose(recipe.part.base_from_part)
    true = poses(time)
    from_base = inverse(to_base)[:3, :3]
    true[:, :3, 3] += _unrecorded(recipe, (time - start_s) * speed, turns[-1], rng) @ from_base.T
    flange = to_base @ poses(pose_time) @ inverse(pose(robot.flange_from_profiler))
    position = flange[:, :3, 3] + rng.standard_normal((len(flange), 3)) * robot.pose_noise_mm
    noise = Rotation.from_rotvec(rng.standard_normal((len(flange), 3)) * robot.pose_noise_deg * DEG)
    quaternion = (noise * Rotation.from_matrix(flange[:, :3, :3])).as_quat(scalar_first=True)
    return Motion(time + robot.time_offset_s, true, pose_time, position, np.asarray(quaternion))


def _pose_times(way: Way, time: Float, rate_hz: float, margin_s: float) -> Float:
    if way.motion == "stop_and_go":
        return np.asarray(time.copy())
    if way.motion == "two_poses":
        return np.array([time[0], max(time[-1], time[0] + 1.0 / rate_hz)])
    return np.arange(time[0] - margin_s - 0.7 / rate_hz, time[-1] + margin_s + 1.5 / rate_hz, 1.0 / rate_hz)


def _unrecorded(recipe: AnyRecipe, gone: Float, whole: float, rng: np.random.Generator) -> Float:
    """What the robot does but does not say (n, 3), in the base: drift, a smooth error, vibration."""
    robot = recipe.robot
    way = rng.standard_normal(3)
    drift = robot.drift_mm * (gone / whole - 0.5)[:, None] * way / np.linalg.norm(way)
    wave = 2 * math.pi * gone[:, None] / robot.smooth_error_wavelength_mm + rng.uniform(0, 2 * math.pi, 3)
    return np.asarray(
        drift + robot.smooth_error_mm * np.sin(wave) + robot.vibration_mm * rng.standard_normal((len(gone), 3))
    )


def _poses(recipe: AnyRecipe, curve: Curve, way: Way, s: Float, gone: Float) -> Float:
    """part_from_profiler (n, 4, 4): the scanner's stance in the edge's frame (n, t, m), swaying."""
    low, high = min(way.way_mm), max(way.way_mm)
    if way.follow == "line":
        ends = curve.frames(np.array([low, high]))
        chord = ends.position[1] - ends.position[0]
        chord /= np.linalg.norm(chord)
        up = ends.m.mean(axis=0)
        up -= (up @ chord) * chord
        up /= np.linalg.norm(up)
        axes = np.broadcast_to(np.stack([np.cross(chord, up), chord, up], axis=1), (len(s), 3, 3))
        share = ((s - low) / (high - low))[:, None]
        place = ends.position[0] + share * (ends.position[1] - ends.position[0])
    else:
        frames = curve.frames(s)
        n, m = (frames.n, frames.m) if way.follow == "section" else (frames.n0, frames.m0)
        axes, place = np.stack([n, frames.t, m], axis=2), frames.position
    stance, aim = _stance(recipe, way)
    sway = np.array(way.sway_deg) * DEG * np.sin(2 * math.pi * gone / way.sway_wavelength_mm)[:, None]
    share = (s - low) / (high - low)
    offset = way.skew_mm[0] + (way.skew_mm[1] - way.skew_mm[0]) * share
    turned = stance @ Rotation.from_rotvec(sway).as_matrix()
    target = np.array([way.aim_mm[0], 0.0, way.aim_mm[1]]) + offset[:, None] * stance[:, 0]
    rotation = axes @ turned
    # it sways about the place that it looks at
    return pose_from(rotation, place + np.einsum("kij,kj->ki", axes, target) - rotation @ aim)


def _stance(recipe: AnyRecipe, way: Way) -> tuple[Float, Float]:
    """Rotation (3, 3) of the profiler in the edge's axes (n, t, m), and the point it aims at, in the profiler."""
    scanner, tip = recipe.scanner, way.elevation_deg * DEG
    look = np.array([-math.cos(tip), 0.0, -math.sin(tip)])
    side = np.array([-math.sin(tip), 0.0, math.cos(tip)])
    lean = Rotation.from_rotvec(side * way.lead_deg * DEG) * Rotation.from_rotvec(look * way.oblique_deg * DEG)
    z = look if scanner.z_away else -look
    x = -side if way.upside_down else side
    axes = lean.as_matrix() @ np.stack([x, np.cross(z, x), z], axis=1)
    sign = 1.0 if scanner.z_away else -1.0
    return axes, np.array([0.0, 0.0, sign * (scanner.standoff_mm - scanner.zero_range_mm)])


SUBRAYS = 9  # odd: half of a footprint is filled just where its middle is
JUMP_MM = 0.15  # neighbours further apart may be two sides of an edge: their footprint is looked at ray by ray
LEAST_COSINE = 0.2  # a texture's height is divided by the cosine of the incidence, but not below


@dataclass(frozen=True, slots=True, eq=False)
class Profiles:
    """What frames see before noise: (n, M), or all returns in a row."""

    range_mm: Shaped[Float, "*n"]  # from the laser; NaN: nothing
    cosine: Shaped[Float, "*n"]
    fill: Shaped[Float, "*n"]  # share of the footprint that the return comes from
    face: Shaped[AnyArray, "*n"]  # uint8
    s: Shaped[Float, "*n"]
    share: Shaped[Float, "*n"]  # across the face


Spoil = Callable[[Hits, np.random.Generator], Float]  # what is added to the ranges (k,)


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """The part before the scanner."""

    mesh: Mesh
    scanner: SweptScanner
    texture: Mapping[int, Relief]  # by face
    spoil: Spoil
    rng: np.random.Generator


def see(view: View, pose: Float) -> Profiles:
    """The profiles of n frames with poses part_from_profiler (n, 4, 4)."""
    frames, columns = len(pose), view.scanner.columns
    index = np.repeat(np.arange(frames), columns)
    centre = _look(view, pose, index, np.tile(np.arange(columns, dtype=float), frames))
    grid = {name: getattr(centre, name).reshape(frames, columns) for name in Profiles.__slots__}
    if view.scanner.footprint > 0:
        _pixels_at_edges(view, grid, pose)
    return Profiles(**grid)


def _look(view: View, pose: Float, index: AnyArray, column: Float) -> Profiles:
    """Rays by frame `index` (k,) and fractional `column` (k,)."""
    scanner, mesh = view.scanner, view.mesh
    start, way = _lines(scanner, column)
    rotation, translation = pose[:, :3, :3], pose[:, :3, 3]
    start, way = _turned(rotation, start, index) + translation[index], _turned(rotation, way, index)
    hits = mesh.cast(start, way)
    found = np.isfinite(hits.reach) & (hits.reach <= scanner.far_mm - scanner.near_mm)
    found &= hits.cosine > np.cos(np.radians(scanner.max_incidence_deg))
    point = start + np.where(found, hits.reach, 0.0)[:, None] * way
    laser, camera = translation + rotation @ _eyes(scanner), translation + rotation @ _camera(scanner)
    lit = mesh.open_way(point[found], laser[index[found]])
    lit[lit] = mesh.open_way(point[found][lit], camera[index[found][lit]])
    found[found] = lit
    reach = np.where(found, hits.reach + scanner.near_mm, np.nan)
    reach -= _relief(hits, view.texture) / np.maximum(hits.cosine, LEAST_COSINE)
    reach += view.spoil(hits, view.rng)
    face = np.where(found, hits.face, OTHER).astype(np.uint8)
    return Profiles(reach, hits.cosine, found.astype(float), face, hits.s, hits.share)


def column_places(scanner: SweptScanner, column: Float, range_mm: Float) -> Float:
    """x (mm) of what lies at a range on the line of a (fractional) column."""
    at_standoff = (column - (scanner.columns - 1) / 2) * scanner.pitch_mm * (1.0 if scanner.x_rises else -1.0)
    if scanner.apex_mm is None:
        return np.asarray(at_standoff + 0.0 * range_mm)
    return np.asarray(at_standoff * (range_mm + scanner.apex_mm) / (scanner.standoff_mm + scanner.apex_mm))


def _lines(scanner: SweptScanner, column: Float) -> tuple[Float, Float]:
    """Starts (k, 3) at the near range and ways (k, 3) per mm of range, profiler frame."""
    sign = 1.0 if scanner.z_away else -1.0
    near, far = (column_places(scanner, column, np.asarray(r)) for r in (scanner.near_mm, scanner.near_mm + 1.0))
    zero = np.zeros_like(column)
    start = np.stack([near, zero, sign * (scanner.near_mm - scanner.zero_range_mm) + zero], axis=1)
    return start, np.stack([far - near, zero, sign + zero], axis=1)


def _eyes(scanner: SweptScanner) -> Float:
    """The laser (3,), profiler frame."""
    return np.array([0.0, 0.0, -(1.0 if scanner.z_away else -1.0) * scanner.zero_range_mm])


def _camera(scanner: SweptScanner) -> Float:
    offset = np.array([0.0, scanner.baseline_mm, 0.0])
    return np.asarray(_eyes(scanner) + offset)


def _turned(rotation: Float, vector: Float, index: AnyArray) -> Float:
    return np.asarray(np.matmul(rotation[index], vector[:, :, None])[..., 0])


def _relief(hits: Hits, texture: Mapping[int, Relief]) -> Float:
    height = np.zeros(len(hits.s))
    for face, relief in texture.items():
        on = hits.face == face
        height[on] = relief.at(hits.s[on], hits.across_mm[on])
    return height


def _pixels_at_edges(view: View, grid: dict[str, AnyArray], pose: Float) -> None:
    """Columns that may see an edge, in place: several rays over the footprint, their fill, mean, or mixture."""
    scanner = view.scanner
    frame, column = np.nonzero(_at_edges(grid["range_mm"]))
    if not len(frame):
        return
    offsets = ((np.arange(SUBRAYS) + 0.5) / SUBRAYS - 0.5) * scanner.footprint
    rays = _look(view, pose, np.repeat(frame, SUBRAYS), (column[:, None] + offsets).ravel())
    ranges = rays.range_mm.reshape(-1, SUBRAYS)
    order = np.argsort(ranges, axis=1)  # NaN last
    ranges = np.take_along_axis(ranges, order, axis=1)
    seen = np.isfinite(ranges).sum(axis=1)
    gaps = np.where(np.isfinite(np.diff(ranges, axis=1)), np.diff(ranges, axis=1), 0.0)
    cut = gaps.argmax(axis=1) + 1  # the nearer side has so many rays
    two = gaps.max(axis=1) > JUMP_MM
    near = np.where(two, cut, seen)
    keep_far = two & (seen - near > near)
    mixed = two & (view.rng.random(len(seen)) < scanner.mixed_share)
    first = np.where(keep_far & ~mixed, near, 0)
    last = np.where(two & ~mixed & ~keep_far, near, seen)
    place = np.arange(SUBRAYS)
    chosen = (place >= first[:, None]) & (place < last[:, None])
    count = chosen.sum(axis=1)
    fill = count / SUBRAYS
    good = (fill >= scanner.least_fill) & (count > 0)

    def mean(values: AnyArray) -> Float:
        ordered = np.take_along_axis(values.reshape(-1, SUBRAYS), order, axis=1)
        return np.asarray(np.where(chosen, ordered, 0.0).sum(axis=1) / np.maximum(count, 1))

    first_chosen = np.take_along_axis(order, np.minimum(first, SUBRAYS - 1)[:, None], axis=1)[:, 0]
    face = rays.face.reshape(-1, SUBRAYS)[np.arange(len(seen)), first_chosen]
    grid["range_mm"][frame, column] = np.where(good, mean(np.nan_to_num(rays.range_mm)), np.nan)
    grid["cosine"][frame, column] = mean(rays.cosine)
    grid["fill"][frame, column] = np.where(good, fill, 0.0)
    grid["face"][frame, column] = np.where(good & ~mixed, face, OTHER)
    grid["s"][frame, column], grid["share"][frame, column] = mean(rays.s), mean(rays.share)


def _at_edges(ranges: Float) -> Bool:
    """Columns beside a jump or beside the end of returns."""
    step = np.diff(ranges, axis=1)
    there = np.isfinite(ranges)
    jump = (there[:, 1:] != there[:, :-1]) | (np.abs(np.nan_to_num(step)) > JUMP_MM)
    at = np.zeros(ranges.shape, dtype=bool)
    at[:, 1:] |= jump
    at[:, :-1] |= jump
    return at
