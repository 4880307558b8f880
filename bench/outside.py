"""A third simulator, for judging only: `python -m bench.score --simulators outside`.

A polygon drawn along a straight line, hit by rays in the plane across it: nothing is shared with the two simulators
that the package is developed on. Its own faults: heavy tails, a sensor error that walks over the columns, returns lost
where rays graze, flyers, mixed pixels, a rounded lower edge, a table behind, parallel or fanned rays, z counted either
way, values rounded, poses at every frame or every fourth.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from workbench.artefacts import Recording
from workbench.kernels import kernel
from workbench.units import Float

ARC = np.linspace(0.0, np.pi / 2.0, 9)  # a rounding's vertices
FAR_MM = 60.0  # how far the plate reaches


@dataclass(frozen=True, slots=True)
class Section:
    """The edge across its length; u: away from the plate, v: up, w: along, mm; the root face stands at u = 0."""

    root_mm: float  # at w = 0; of a raw edge its end face
    drift: float  # of the root face, mm a mm of w
    bevel: float  # rad from the root face; of a raw edge the rest of the quarter: its upper surface
    thickness_mm: float
    radius_mm: float  # of the lower edge
    table_mm: float | None  # under the plate

    @property
    def is_even(self) -> bool:
        """Whether the section is the same all along."""
        return self.drift == 0.0

    @property
    def is_prism(self) -> bool:
        """Whether `segments` are the same at every w."""
        return self.is_even

    def root_at(self, w: Float) -> Float:
        """Root face (n,) mm at w (n,) mm."""
        return self.root_mm + self.drift * w

    def segments(self, w: Float) -> Float:
        """Straight pieces (n, k, 4), u and v of both ends, of the section at w (n,)."""
        root, r = self.root_at(w), self.radius_mm
        corner = -np.tan(self.bevel) * (self.thickness_mm - root)
        below = [(0.0 - r + r * np.cos(t), 0.0 + r - r * np.sin(t)) for t in ARC] if r > 0.0 else [(0.0, 0.0)]
        below.append((0.0 - FAR_MM, 0.0))
        line = np.zeros((len(w), 3 + len(below), 2))
        line[:, 0, 0], line[:, 1, 0] = corner - FAR_MM, corner
        line[:, :2, 1], line[:, 2, 1] = self.thickness_mm, root
        line[:, 3:] = below
        pieces = np.concatenate([line[:, :-1], line[:, 1:]], axis=-1)
        if self.table_mm is None:
            return pieces
        table = np.array([2 * FAR_MM, -self.table_mm, -FAR_MM, -self.table_mm])
        return np.concatenate([pieces, np.broadcast_to(table, (len(w), 1, 4))], axis=1)


class Usual:
    """How a cell is usually set up; every method draws one thing."""

    flawed = 1.0  # the walk of the sensor's error, over the usual one

    def section(self, rng: np.random.Generator, is_raw: bool) -> Section:
        radius = rng.choice([0.0, 0.0, rng.uniform(0.02, 0.15)])
        table = None if rng.random() < 0.5 else rng.uniform(4, 30)
        if is_raw:
            thick = rng.uniform(4, 12)
            return Section(thick - 1e-3, 0.0, np.pi / 4.0, thick, radius, table)
        root = rng.uniform(0.8, 3.0)
        drift = rng.choice([0.0, rng.uniform(-2e-3, 2e-3)])
        return Section(root, drift, np.radians(rng.uniform(25, 55)), root + rng.uniform(3, 8), radius, table)

    def incline_deg(self, rng: np.random.Generator, is_raw: bool) -> float:
        """Of the rays over the horizontal."""
        return float(rng.uniform(15, 55) if is_raw else rng.uniform(25, 65))

    def window(self, rng: np.random.Generator, thick_mm: float, is_raw: bool) -> tuple[int, float]:
        """Columns, and how wide they are together at the stand-off, mm."""
        return int(rng.choice([640, 1024, 1280])), rng.uniform(max(18, 2.5 * thick_mm if is_raw else 0), 38)

    def frames(self, rng: np.random.Generator) -> tuple[int, float]:
        """How many, and how far apart, mm."""
        step = rng.choice([0.1, 0.2, 0.3])
        return int(min(rng.uniform(60, 150) / step, 900)), float(step)

    def sway_deg(self, rng: np.random.Generator) -> float:
        """By which the scanner sways."""
        return float(rng.choice([0.0, 0.0, rng.uniform(0.3, 3.0)]))

    def sway_mm(self, rng: np.random.Generator) -> Float:
        """Of its way, in which the phases (3,) of that go on by 1 rad."""
        return rng.uniform(5, 30, 3)


def between(rng: np.random.Generator, low: float, high: float) -> float:
    """Evenly in the logarithm."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


class Part(NamedTuple):
    """A recording and what is true of it."""

    recording: Recording
    section: Section
    base_from_section: Float  # (4, 4)
    about: dict[str, object]


def simulate(seed: int, is_raw: bool, of: Section | None = None, cell: Usual | None = None) -> Part:
    """Part `seed`: a milled edge, or a raw one whose end face is as high as the plate; or a section `of` one's own."""
    cell = cell or Usual()
    rng, section = drawn_section(seed, is_raw, cell)
    section = section if of is None else of
    thick = section.thickness_mm
    incline = np.radians(cell.incline_deg(rng, is_raw))
    columns, width = cell.window(rng, thick, is_raw)
    stand, fan = float(rng.uniform(80, 250)), bool(rng.random() < 0.5)
    frames, step = cell.frames(rng)
    along = np.linspace(0.0, (frames - 1) * step, frames)
    rotation = _orientations(rng, incline, along, cell)
    aim = (
        np.array([0.0, thick / 2.0, 0.0]) if is_raw else np.array([-np.tan(section.bevel), section.root_mm + 1.0, 0.0])
    )
    sense = np.sign(rotation[0, 2, 1])
    sway = rng.choice([0.0, rng.uniform(0.05, 1.5)]) * np.sin(along / rng.uniform(5, 30) + rng.uniform(0, 6))
    place = aim - stand * rotation[:, :, 2] + (rng.uniform(-3, 3) + sway)[:, None] * rotation[:, :, 0]
    place[:, 2] += sense * along
    x, z, about = _profiles(
        rng, section, rotation, place, (np.arange(columns) / (columns - 1) - 0.5) * width, stand, fan, cell.flawed
    )
    flip, origin = rng.choice([1, -1]), rng.choice([0.0, stand])  # z counts away from the sensor or towards it
    digit = float(rng.choice([1e-6, 1e-4, 1e-3]))
    mirror = np.eye(4)
    mirror[[0, 2], [0, 2]], mirror[2, 3] = flip, origin
    pose = np.tile(np.eye(4), (frames, 1, 1))
    pose[:, :3, :3], pose[:, :3, 3] = rotation, place
    base_from_section, flange_from_profiler = _pose(rng, 900.0), _pose(rng, rng.uniform(90, 220))
    flange = base_from_section @ pose @ mirror @ np.linalg.inv(flange_from_profiler)
    poses = max(3, rng.choice([frames, frames // 4]))  # two say that the robot moved straight, which this one does not
    told = np.unique(np.linspace(0, frames - 1, poses).astype(int))
    jitter = float(rng.choice([0.0, 0.01, 0.03]))  # of recorded positions
    time = 1000.0 + along / rng.uniform(8, 40)
    recording = Recording(
        source=f"outside {seed}",
        time_s=time,
        x_mm=(np.round(x * flip / 1e-5) * 1e-5).astype(np.float32),
        z_mm=(np.round((z - origin) * flip / digit) * digit).astype(np.float32),
        pass_index=np.zeros(frames, np.int64),
        robot_time_s=time[told],
        robot_position_mm=flange[told, :3, 3] + rng.normal(0, jitter, (told.size, 3)),
        robot_quaternion_wxyz=Rotation.from_matrix(flange[told, :3, :3]).as_quat()[:, [3, 0, 1, 2]],
        robot_pass=np.zeros(told.size, np.int64),
        flange_from_profiler=flange_from_profiler,
    )
    return Part(
        recording,
        section,
        base_from_section,
        about | {"incline": np.degrees(incline), "jitter": jitter, "digit": digit},
    )


def drawn_section(seed: int, is_raw: bool, cell: Usual) -> tuple[np.random.Generator, Section]:
    """The section of part `seed`, and the generator that draws the rest of it."""
    rng = np.random.default_rng([778, seed, is_raw])
    return rng, cell.section(rng, is_raw)


def _orientations(rng: np.random.Generator, incline: float, along: Float, cell: Usual) -> Float:
    """section_from_emitter (n, 3, 3): z along the rays, y nearly along the edge; oblique, and swaying or not."""
    z = -np.array([np.cos(incline), np.sin(incline), 0.0])
    y = np.array([0.0, 0.0, rng.choice([1.0, -1.0])])
    square = np.stack([np.cross(y, z), y, z], axis=1)
    oblique = Rotation.from_euler("xyz", rng.normal(0, [3, 3, 5]) * rng.choice([0.3, 1.0, 1.5]), degrees=True)
    sway = np.radians(cell.sway_deg(rng)) * np.sin(along[:, None] / cell.sway_mm(rng) + rng.uniform(0, 6, 3))
    return square @ oblique.as_matrix() @ Rotation.from_rotvec(sway).as_matrix()


def _profiles(
    rng: np.random.Generator,
    section: Section,
    rotation: Float,
    place: Float,
    u: Float,
    stand: float,
    fan: bool,
    flawed: float,
) -> tuple[Float, Float, dict[str, object]]:
    """Lateral places and ranges (n, m) of rays through lateral places u (m,) mm at the stand-off, with their faults."""
    frames, columns = len(place), u.size
    sigma, heavy = rng.choice([0.002, 0.005, 0.01, 0.02]), bool(rng.random() < 0.4)
    walk = rng.choice([0.0, 0.0, rng.uniform(1e-4, 5e-4)])
    pattern = flawed * walk * np.cumsum(rng.normal(0, 1, columns))
    lost, flyers = rng.choice([0.0, 0.02, 0.1]), rng.choice([0.0, 0.005, 0.02])
    graze = np.radians(rng.uniform(72, 84))
    zero, one = np.zeros(columns), np.ones(columns)
    rays = np.swapaxes(rotation @ np.stack([u / stand if fan else zero, zero, one]), 1, 2)
    origin = place[:, None] + np.where(fan, 0.0, u)[:, None] * rotation[:, None, :, 0]
    parts = np.array_split(np.arange(frames), 1 if section.is_prism else frames)  # a frame at a time has few pieces
    hit = [_hit(section, origin[some].reshape(-1, 3), rays[some].reshape(-1, 3), 2.2 * stand) for some in parts]
    z, cosine = (np.concatenate(found).reshape(frames, columns) for found in zip(*hit, strict=True))
    spread, incidence = sigma / np.sqrt(np.maximum(cosine, 0.15)), np.arccos(np.clip(cosine, 0.0, 1.0))
    for i, way in enumerate(z):
        noise = rng.standard_t(4, columns) / np.sqrt(2.0) if heavy else rng.normal(0, 1, columns)
        seen = way + pattern + spread[i] * noise
        for j in np.flatnonzero(np.abs(np.diff(way)) > 1.0):
            if rng.random() < 0.4:
                share = rng.random()
                seen[j] = share * way[j] + (1.0 - share) * way[j + 1]
        stray = rng.random(columns) < flyers
        seen = seen + np.where(stray, rng.choice([-1, 1], columns) * rng.uniform(0.2, 4.0, columns), 0.0)
        seen[(incidence[i] > graze + rng.normal(0, 0.02, columns)) | (rng.random(columns) < lost)] = np.nan
        z[i] = seen
    x = u / stand * z if fan else np.where(np.isfinite(z), u, np.nan)
    about = {"sigma": sigma, "heavy": heavy, "walk": walk, "lost": lost, "flyers": flyers, "graze": np.degrees(graze)}
    return x, z, about


def _hit(section: Section, origin: Float, rays: Float, reach_mm: float) -> tuple[Float, Float]:
    """Way along rays (n, 3) from origins (n, 3) to the part, NaN beyond reach, and cos(incidence) there."""
    w = origin[:, 2]
    for _ in range(1 if section.is_even else 3):  # the section is the one where the ray hits
        way, cosine = _nearest(np.array(section.segments(w[:1] if section.is_prism else w)), origin, rays)
        w = origin[:, 2] + np.where(way < reach_mm, way, 0.0) * rays[:, 2]
    return np.where(way < reach_mm, way, np.nan), cosine


@kernel
def _nearest(pieces: Float, origin: Float, rays: Float) -> tuple[Float, Float]:
    """Way along each ray (n, 3) to the nearest of the straight pieces (n or 1, k, 4), else infinite; cos(incidence)."""
    way, cosine = np.full(len(rays), np.inf), np.zeros(len(rays))
    for i in range(len(rays)):
        x, y, z = rays[i]
        for j in range(pieces.shape[1]):
            u, v, to_u, to_v = pieces[i if len(pieces) > 1 else 0, j]
            beside = x * (to_v - v) - y * (to_u - u)
            beside = 1e-12 if abs(beside) < 1e-12 else beside
            far = ((u - origin[i, 0]) * (to_v - v) - (v - origin[i, 1]) * (to_u - u)) / beside
            share = ((u - origin[i, 0]) * y - (v - origin[i, 1]) * x) / beside
            if 0.0 <= share <= 1.0 and 1.0 < far < way[i]:
                way[i] = far
                cosine[i] = abs(beside) / np.sqrt(((to_u - u) ** 2 + (to_v - v) ** 2) * (x * x + y * y + z * z))
    return way, cosine


def _pose(rng: np.random.Generator, distance_mm: float) -> Float:
    pose = np.eye(4)
    pose[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    away = rng.normal(size=3)
    pose[:3, 3] = distance_mm * away / np.linalg.norm(away)
    return pose
