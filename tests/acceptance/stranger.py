"""A recording as somebody else would make it: written from docs alone, and sharing no code with the project.

A plate with a milled edge, or a raw one. The lower edge is a planar curve of given heading; the section normal to it is
a polygon of lower surface, root face, bevel face and upper surface, so that root face and bevel angle at any arc length
are known without measuring. The scanner sends parallel rays in its laser plane; the first surface hit answers.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

UP = np.array([0.0, 0.0, 1.0])  # m, in the part's frame: the upper side is up
FACE_SAMPLES = 16  # points of each face that the laser plane is intersected with; straight between them
GRAZING_DEG = 82.0  # incidence beyond which nothing comes back


@dataclass(frozen=True)
class Part:
    """A plate; lengths in mm, s is the arc length of the lower edge, rising along t = m x n."""

    length_mm: float = 120.0
    raw: bool = False  # no bevel yet: the end face reaches from the lower surface to the upper one
    thickness_mm: float = 8.0
    root_mm: tuple[float, float] = (1.5, 1.5)  # at both ends, linear between
    bevel_deg: tuple[float, float] = (40.0, 40.0)
    tilt_deg: float = 0.0  # of the root face, away from the normal of the plate's surfaces
    curvature_per_mm: float = 0.0  # > 0: convex (an outer rim), < 0: concave
    wave_rad: float = 0.0  # amplitude of the heading
    wavelength_mm: float = 150.0

    def _share(self, s: np.ndarray) -> np.ndarray:
        return np.clip(s / self.length_mm, 0, 1)

    def root(self, s: np.ndarray) -> np.ndarray:
        """Root face in mm at s."""
        return self.root_mm[0] + self._share(s) * (self.root_mm[1] - self.root_mm[0])

    def bevel(self, s: np.ndarray) -> np.ndarray:
        """Bevel angle in degrees at s."""
        return self.bevel_deg[0] + self._share(s) * (self.bevel_deg[1] - self.bevel_deg[0])

    def heading(self, s: np.ndarray) -> np.ndarray:
        """Direction of t in the plate's plane."""
        return self.curvature_per_mm * s + self.wave_rad * np.sin(2 * np.pi * s / self.wavelength_mm)

    def tangent(self, s: np.ndarray) -> np.ndarray:
        """t at s."""
        angle = self.heading(s)
        return np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], axis=-1)

    def normal(self, s: np.ndarray) -> np.ndarray:
        """n = t x m at s, out of the plate."""
        return np.cross(self.tangent(s), UP)

    def lower_edge(self, s: np.ndarray) -> np.ndarray:
        """Position of the lower edge at s."""
        grid, points = _course(self)
        return np.stack([np.interp(s, grid, points[:, k]) for k in range(2)] + [np.zeros_like(s)], axis=-1)

    def vertices(self, s: np.ndarray) -> np.ndarray:
        """Polygon of the section at s: (..., 5, 2) as (along n, along m), from the lower surface to the upper one."""
        tilt, both = np.radians(self.tilt_deg), np.radians(self.tilt_deg + self.bevel(s))
        width = self.thickness_mm / np.cos(tilt) + 0 * s if self.raw else self.root(s)
        top_n, top_m = -width * np.sin(tilt), width * np.cos(tilt)
        back = top_n - (self.thickness_mm - top_m) * np.tan(both)
        flat = np.zeros_like(s)
        n = np.stack([flat - 30, flat, top_n, back, back - 25], axis=-1)
        m = np.stack([flat, flat, top_m, flat + self.thickness_mm, flat + self.thickness_mm], axis=-1)
        return np.stack([n, m], axis=-1)

    def surface(self, s: np.ndarray, face: int, q: np.ndarray) -> np.ndarray:
        """Point at share q of a face's width in the section at s."""
        corners = self.vertices(s)
        inside = corners[..., face, :] + q[..., None] * (corners[..., face + 1, :] - corners[..., face, :])
        return self.lower_edge(s) + inside[..., :1] * self.normal(s) + inside[..., 1:] * UP

    def nearest(self, points: np.ndarray) -> np.ndarray:
        """Arc length of the lower edge's point nearest to each of `points` (part frame)."""
        s = np.arange(-10.0, self.length_mm + 10.0, 0.5)
        best = s[np.argmin(np.linalg.norm(points[:, None] - self.lower_edge(s)[None], axis=2), axis=1)]
        for _ in range(6):
            best = best + np.sum((points - self.lower_edge(best)) * self.tangent(best), axis=1)
        return best


@lru_cache(maxsize=8)
def _course(part: Part) -> tuple[np.ndarray, np.ndarray]:
    """The lower edge as a chain of 0.02 mm, by the midpoint rule."""
    grid = np.arange(-60.0, part.length_mm + 60.0, 0.02)
    step = part.tangent(grid + 0.01) * 0.02
    return grid, np.cumsum(np.vstack([np.zeros(3), step[:-1]]), axis=0)


@dataclass(frozen=True)
class Scan:
    """One pass of the scanner over the part."""

    elevation_deg: float = 40.0  # of the sensor over the end face's normal: 0 frontal, < 0 from below
    yaw_deg: float = 0.0  # of the laser plane about the rays
    pitch_deg: float = 0.0  # of the rays, along the edge
    start_mm: float = -4.0  # arc length at which the pass starts; beyond the end of the part is fine
    stop_mm: float = 124.0  # below `start_mm`: scanned against t
    pitch_mm: float = 0.5  # of the frames
    column_mm: float = 0.06
    columns: int = 600
    x_sense: int = 1  # of the x axis against e = t x rays
    z_sense: int = 1  # 1: counts away from the sensor
    falling: bool = False  # x falls with the column
    x_zero_mm: float = 0.0
    z_zero_mm: float = 0.0
    skew_mm: float = 1.0  # drift across the rays, start to end
    turn_deg: float = 0.0  # of the orientation, start to end
    follow: bool = False  # poses follow a curved edge; else one straight motion
    poses: str = "ends"  # ends | dense | frames
    pose_noise_mm: float = 0.0
    vibration_mm: float = 0.0
    noise_mm: float = 0.012
    dropouts: float = 0.0
    outliers: float = 0.0
    mixed: float = 0.0
    table_mm: float | None = None  # depth of a table below the lower surface
    clamp_mm: tuple[float, float] | None = None  # stretch of the edge behind a box
    box_mm: tuple[float, float, float, float] = (-20.0, 5.0, -4.0, 18.0)  # its extent along n and m: about all the edge
    pass_index: int = 0


@dataclass(frozen=True)
class Setting:
    """Where the part lies and how the profiler sits on the flange."""

    base_from_part: np.ndarray = field(default_factory=lambda: np.eye(4))
    flange_from_profiler: np.ndarray = field(default_factory=lambda: np.eye(4))


def pose(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    """(..., 4, 4) from parts."""
    out = np.zeros((*np.shape(rotation)[:-2], 4, 4))
    out[..., :3, :3], out[..., :3, 3], out[..., 3, 3] = rotation, translation, 1
    return out


def any_setting(rng: np.random.Generator) -> Setting:
    """Part and hand-eye anywhere, turned anyhow."""
    part = pose(Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix(), rng.uniform(-2000, 2000, 3))
    eye = pose(Rotation.random(random_state=int(rng.integers(1 << 30))).as_matrix(), rng.uniform(-200, 200, 3))
    return Setting(part, eye)


def record(part: Part, scans: list[Scan], setting: Setting, seed: int = 0) -> dict[str, np.ndarray]:
    """Arrays of a recording, by their path in the file."""
    rng = np.random.default_rng(seed)
    passes, clock = [], 100.0
    for scan in scans:
        passes.append(_record_pass(part, scan, setting, rng, clock))
        clock = passes[-1]["/robot/time"][-1] + 7.0
    out = {key: np.concatenate([one[key] for one in passes]) for key in passes[0]}
    return out | {"/hand_eye/flange_from_profiler": setting.flange_from_profiler}


def _record_pass(part: Part, scan: Scan, setting: Setting, rng: np.random.Generator, clock: float) -> dict:
    count = max(int(abs(scan.stop_mm - scan.start_mm) / scan.pitch_mm) + 1, 1)
    frame_time = clock + 0.02 * np.arange(count)
    margin = 0.001
    ends = np.array([frame_time[0] - margin, frame_time[-1] + margin])
    robot_time = {"ends": ends, "dense": np.linspace(*ends, max(2, count // 2)), "frames": frame_time}[scan.poses]
    profiler_from_flange = np.linalg.inv(setting.flange_from_profiler)
    part_from_flange = _motion(part, scan, ends, profiler_from_flange)
    true = part_from_flange(frame_time) @ setting.flange_from_profiler
    true[:, :3, 3] += rng.normal(0, 1, (count, 3)) * scan.vibration_mm
    x, z = _rays(part, scan, true)
    _disturb(scan, z, rng)
    told = setting.base_from_part @ part_from_flange(robot_time)
    position = told[:, :3, 3] + rng.normal(0, 1, (len(told), 3)) * scan.pose_noise_mm
    return {
        "/profiles/time": frame_time,
        "/profiles/x": x.astype("f4"),
        "/profiles/z": z.astype("f4"),
        "/profiles/pass": np.full(count, scan.pass_index, "i4"),
        "/robot/time": robot_time,
        "/robot/position": position,
        "/robot/quaternion_wxyz": Rotation.from_matrix(told[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]],
        "/robot/pass": np.full(len(robot_time), scan.pass_index, "i4"),
    }


def _motion(part: Part, scan: Scan, ends: np.ndarray, profiler_from_flange: np.ndarray):
    """The flange's pose in the part's frame as a function of time."""

    def at(time: np.ndarray) -> np.ndarray:
        share = (np.asarray(time) - ends[0]) / (ends[1] - ends[0])
        return _profiler(part, scan, share) @ profiler_from_flange

    if scan.follow:
        return at
    first, last = at(ends)
    turn = Slerp(ends, Rotation.from_matrix(np.stack([first, last])[:, :3, :3]))

    def straight(time: np.ndarray) -> np.ndarray:
        share = ((np.asarray(time) - ends[0]) / (ends[1] - ends[0]))[:, None]
        return pose(turn(time).as_matrix(), (1 - share) * first[:3, 3] + share * last[:3, 3])

    return straight


def _profiler(part: Part, scan: Scan, share: np.ndarray) -> np.ndarray:
    """Pose of the profiler in the part's frame at a share of the pass."""
    s = scan.start_mm + share * (scan.stop_mm - scan.start_mm)
    middle = np.full_like(s, (scan.start_mm + scan.stop_mm) / 2)
    looks_at = s if scan.follow else middle
    t, n = part.tangent(looks_at), part.normal(looks_at)
    rise = np.radians(scan.elevation_deg)
    rays = -(np.cos(rise) * n + np.sin(rise) * UP)
    across = np.cross(t, rays)
    yaw = Rotation.from_rotvec(np.radians(scan.yaw_deg + scan.turn_deg * (share[:, None] - 0.5)) * rays)
    tip = Rotation.from_rotvec(np.radians(scan.pitch_deg) * across)
    rays, across = (yaw * tip).apply(rays), (yaw * tip).apply(across)
    corners = part.vertices(s)
    centre = (corners[..., 1, :] + corners[..., 3, :]) / 2
    target = part.lower_edge(s) + centre[..., :1] * part.normal(s) + centre[..., 1:] * UP
    x, z = scan.x_sense * across, scan.z_sense * rays
    origin = target - 100 * rays + scan.skew_mm * (share[:, None] - 0.5) * across
    return pose(np.stack([x, np.cross(z, x), z], axis=-1), origin - scan.x_zero_mm * x - scan.z_zero_mm * z)


def _rays(part: Part, scan: Scan, part_from_profiler: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """x and z of each frame and column, NaN where nothing is hit."""
    column = scan.x_zero_mm + (np.arange(scan.columns) - (scan.columns - 1) / 2) * scan.column_mm
    x = np.tile(column[::-1] if scan.falling else column, (len(part_from_profiler), 1))
    depth = np.full(x.shape, np.inf)  # along the rays: the least wins
    for face in range(4):
        _hit_face(part, scan, face, part_from_profiler, x, depth)
    if scan.table_mm is not None:
        _hit_table(scan, part_from_profiler, x, depth)
    if scan.clamp_mm is not None:
        _hit_clamp(part, scan, part_from_profiler, x, depth)
    return x, np.where(np.isfinite(depth), scan.z_sense * depth, np.nan)


def _hit_face(part: Part, scan: Scan, face: int, poses: np.ndarray, x: np.ndarray, depth: np.ndarray) -> None:
    """Cut a face with each laser plane into a chain of points, and let the rays meet the chain."""
    origin, y = poses[:, None, :3, 3], poses[:, None, :3, 1]
    q = np.broadcast_to(np.linspace(0, 1, FACE_SAMPLES + 1), (len(poses), FACE_SAMPLES + 1))
    middle = part.nearest(poses[:, :3, 3] + (100 + scan.z_sense * scan.z_zero_mm) * scan.z_sense * poses[:, :3, 2])
    s = np.repeat(middle[:, None], q.shape[1], axis=1)
    for _ in range(12):
        off = np.sum((part.surface(s, face, q) - origin) * y, axis=2)
        s = np.clip(s - off / np.sum(part.tangent(s) * y, axis=2), -50, part.length_mm + 50)
    points = part.surface(s, face, q) - origin
    good = (s >= 0) & (s <= part.length_mm) & (np.abs(np.sum(points * y, axis=2)) < 1e-6)
    px = np.sum(points * poses[:, None, :3, 0], axis=2)
    pz = scan.z_sense * np.sum(points * poses[:, None, :3, 2], axis=2)
    for k in range(FACE_SAMPLES):
        run, rise = px[:, k + 1] - px[:, k], pz[:, k + 1] - pz[:, k]
        seen = good[:, k] & good[:, k + 1] & (np.abs(run) > np.cos(np.radians(GRAZING_DEG)) * np.hypot(run, rise))
        share = (x - px[:, k, None]) / np.where(run == 0, 1, run)[:, None]
        hit = np.where((share >= 0) & (share <= 1), pz[:, k, None] + share * rise[:, None], np.inf)
        np.minimum(depth, np.where(seen[:, None], hit, np.inf), out=depth)


def _frames_rays(scan: Scan, poses: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Origin (at z = 0) and direction of each ray, in the part's frame."""
    start = poses[:, None, :3, 3] + x[..., None] * poses[:, None, :3, 0]
    return start, scan.z_sense * poses[:, None, :3, 2]


def _hit_table(scan: Scan, poses: np.ndarray, x: np.ndarray, depth: np.ndarray) -> None:
    start, along = _frames_rays(scan, poses, x)
    if np.all(along[..., 2] < -0.1):
        np.minimum(depth, (-scan.table_mm - start[..., 2]) / along[..., 2], out=depth)


def _hit_clamp(part: Part, scan: Scan, poses: np.ndarray, x: np.ndarray, depth: np.ndarray) -> None:
    """A box around, or in front of, a stretch of the edge."""
    middle, half = np.mean(scan.clamp_mm), np.ptp(scan.clamp_mm) / 2
    axes = np.stack([part.tangent(middle), part.normal(middle), UP])
    low = np.array([-half, scan.box_mm[0], scan.box_mm[2]])
    high = np.array([half, scan.box_mm[1], scan.box_mm[3]])
    start, along = _frames_rays(scan, poses, x)
    local, way = (start - part.lower_edge(np.array(middle))) @ axes.T, along @ axes.T
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.stack([(low - local) / way, (high - local) / way])
    enter, leave = sides.min(axis=0).max(axis=-1), sides.max(axis=0).min(axis=-1)
    np.minimum(depth, np.where(enter <= leave, enter, np.inf), out=depth)


def _disturb(scan: Scan, z: np.ndarray, rng: np.random.Generator) -> None:
    """Noise, mixed pixels, outliers and dropouts, in place."""
    with np.errstate(invalid="ignore"):
        jump = np.flatnonzero((np.abs(np.diff(z, axis=1)) > 0.5) & (rng.random(z[:, 1:].shape) < scan.mixed))
    row, before = np.divmod(jump, z.shape[1] - 1)
    share = rng.random(len(jump))
    between = share * z[row, before] + (1 - share) * z[row, before + 1]
    z[row, before + rng.integers(0, 2, len(jump))] = between  # the spot straddles the step from either side
    z += rng.normal(0, scan.noise_mm, z.shape)
    wild = (rng.random(z.shape) < scan.outliers) & np.isfinite(z)
    z[wild] += rng.uniform(-6, 6, wild.sum())
    z[rng.random(z.shape) < scan.dropouts] = np.nan


def with_all(scans: list[Scan], **changes: object) -> list[Scan]:
    """The passes with some of their fields replaced."""
    return [replace(scan, **changes) for scan in scans]
