"""A laser sheet, a camera beside it, a robot that errs: recordings from the sensor's physics, with exact truth.

The part is a section that changes along an arc, straight ones with a radius of a kilometre. Where the sheet cuts the
curves that the section's vertices run on is solved for; between them the cut is straight to 0.1 um. Pixel columns are
lines of the sheet through the point A in which the planes of camera and pixels meet it. What a column sees is averaged
over its footprint, weighted by brightness (Lambert and a lobe about the mirrored sheet), of what the laser lights and
the camera sees: both ways must be free. Speckle is correlated over columns; what is darker than a threshold is lost.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from scipy.ndimage import gaussian_filter1d
from scipy.spatial.transform import Rotation

from workbench.artefacts import Recording
from workbench.units import Bool, Float

FAR_MM = 40.0  # how far the plate reaches from its edge
STRAIGHT_MM = 1e6  # radius of a straight edge
STATION_MM = 0.25
FILLET = np.linspace(0.0, 1.0, 11)  # a rounding's vertices
SPLIT = np.linspace(0.0, 1.0, 5)[1:-1]  # of a long face
SUB = 4  # rays over a column's footprint
APART_MM = 0.15  # of two lines that a camera tells apart: it takes the brighter one
RIVAL = 1e-9  # by which a point may lie behind what is nearest and still be that


@dataclass(frozen=True)
class Course:
    """A size along the edge: mean, change from end to end, a wave."""

    mean: float
    change: float = 0.0
    wave: float = 0.0
    wavelength_mm: float = 100.0
    phase: float = 0.0

    def at(self, s: Float, length_mm: float) -> Float:
        wave = self.wave * np.sin(2.0 * np.pi * s / self.wavelength_mm + self.phase)
        return self.mean + self.change * (s / length_mm - 0.5) + wave


@dataclass(frozen=True)
class Workpiece:
    """kind: milled, raw (the end face leans by `lean`, rad) or groove (two plates, root faces `gap` apart)."""

    kind: str
    length_mm: float
    radius_mm: float  # of the edge in the plate's plane; below 0: concave
    thickness_mm: float
    root_mm: Course = Course(1.5)
    bevel: Course = Course(0.7)  # rad
    lean: Course = Course(0.0)
    gap_mm: Course = Course(2.0)
    lower_radius_mm: float = 0.0
    upper_radius_mm: float = 0.0
    burr_mm: float = 0.0  # greatest height; ragged, on about half of the edge
    burr_width_mm: float = 0.2
    table_mm: float | None = None  # below the plate
    seed: int = 0

    def stations(self) -> Float:
        return np.arange(-5.0, self.length_mm + 5.0, STATION_MM)

    def chains(self, s: Float) -> list[Float]:
        """Polylines (n, k, 2) of the section at stations s (n,): u away from the plate, v up."""
        root, bevel = self.root_mm.at(s, self.length_mm), self.bevel.at(s, self.length_mm)
        lean, top = self.lean.at(s, self.length_mm), self.thickness_mm
        zero = np.zeros_like(s)
        burr = self._burr(s)
        width = np.minimum(self.burr_width_mm, 2.0 * burr)
        low = [(zero, zero, self.lower_radius_mm), (zero, -burr, 0.0), (-width, zero, 0.0), (zero - FAR_MM, zero, 0.0)]
        if self.burr_mm == 0.0:
            low = [low[0], low[3]]
        corner = (-np.tan(bevel) * (top - root), zero + top, 0.02)
        if self.kind == "raw":
            high = [(zero - FAR_MM, zero + top, 0.0), (top * np.tan(lean), zero + top, self.upper_radius_mm)]
        else:
            high = [(zero - FAR_MM, zero + top, 0.0), corner, (zero, root, self.upper_radius_mm)]
        chain = filleted([*high, *low])
        chains = [chain]
        if self.kind == "groove":
            half = np.stack([self.gap_mm.at(s, self.length_mm) / 2.0, zero], axis=-1)[:, None]
            chains = [chain - half, chain[:, ::-1] * [-1.0, 1.0] + half]
        if self.table_mm is not None:
            table = np.array([[-FAR_MM, -self.table_mm], [FAR_MM, -self.table_mm]])
            chains.append(np.broadcast_to(table, (len(s), 2, 2)))
        return chains

    def _burr(self, s: Float) -> Float:
        if self.burr_mm == 0.0:
            return np.zeros_like(s)
        rng = np.random.default_rng([41, self.seed])
        along = self.stations()
        height = gaussian_filter1d(rng.normal(size=along.size), 1.5 / STATION_MM)
        return np.interp(s, along, np.clip(self.burr_mm * height / (2.0 * height.std()), 0.0, self.burr_mm))

    def place(self, s: Float, u: Float, v: Float) -> Float:
        """Points (..., 3) of section coordinates: x away from the plate at s = 0, y up, z along."""
        turn, r = s / self.radius_mm, self.radius_mm + u
        sag = u * np.cos(turn) - 2.0 * self.radius_mm * np.sin(turn / 2.0) ** 2
        return np.stack([sag, np.broadcast_to(v, np.shape(sag)), r * np.sin(turn)], axis=-1)

    def axes(self, s: Float) -> Float:
        """Unit vectors (n, 3, 3) as columns: away, up, along."""
        c, w, zero = np.cos(s / self.radius_mm), np.sin(s / self.radius_mm), np.zeros_like(s)
        away, up, along = np.stack([c, zero, w]), np.stack([zero, zero + 1.0, zero]), np.stack([-w, zero, c])
        return np.stack([away.T, up.T, along.T], axis=2)


def filleted(corners: list[tuple[Float, Float, float]]) -> Float:
    """A chain (n, k, 2) through corners (u (n,), v (n,), radius), its faces split, its corners rounded."""
    points = [np.stack([u, v], axis=-1) for u, v, _ in corners]
    out = [points[0]]
    for k in range(1, len(points) - 1):
        here, radius = points[k], corners[k][2]
        if radius == 0.0:
            out.append(here)
            continue
        back, on = (unit(points[j] - here) for j in (k - 1, k + 1))
        half = 0.5 * np.arccos(np.clip((back * on).sum(axis=-1), -1.0, 1.0))
        middle = here + (radius / np.sin(half))[:, None] * unit(back + on)
        first, last = (here + (radius / np.tan(half))[:, None] * one - middle for one in (back, on))
        sweep = np.pi - 2.0 * half
        for share in FILLET:
            a, b = np.sin((1.0 - share) * sweep) / np.sin(sweep), np.sin(share * sweep) / np.sin(sweep)
            out.append(middle + a[:, None] * first + b[:, None] * last)
    out.append(points[-1])
    split = [out[0]]
    for one, two in pairwise(out):
        if np.abs(two - one).max() > 1.0:
            split += [one + share * (two - one) for share in SPLIT]
        split.append(two)
    return np.stack(split, axis=1)


def unit(vectors: Float) -> Float:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@dataclass(frozen=True)
class Sensor:
    """A profiler: sheet from the origin along z, x across, camera at (side, base, 0) mm seeing the stand-off."""

    columns: int = 640
    width_mm: float = 25.0  # at the stand-off
    stand_off_mm: float = 120.0
    triangulation: float = 0.5  # rad, either sign: the side of the camera along the motion
    side_mm: float = 0.0
    footprint: float = 1.0  # columns
    noise_mm: float = 0.006
    speckle_columns: float = 1.5  # correlation of the noise
    lobe: float = 0.35  # rad, width of the mirrored lobe
    shine: float = 0.5  # its share
    threshold: float = 0.12  # of the median brightness
    lost: float = 0.003
    stray: float = 0.001
    linearity_mm: float = 0.0  # rms
    linearity_length_mm: float = 20.0
    bright: bool = True  # whether brightness is recorded
    falls: bool = False  # x falls with the column
    digit_mm: float = 1e-4


@dataclass(frozen=True)
class Way:
    """How the sensor is led: frames `step_mm` apart, `elevation` over the outward normal of the root face, rad."""

    step_mm: float = 0.6
    elevation: float = 0.8
    oblique: tuple[float, float, float] = (0.0, 0.0, 0.0)  # rad about the sensor's axes
    sway: float = 0.0  # rad
    aim_mm: tuple[float, float] = (0.0, 0.0)  # of the section, (u, v), at the stand-off
    drift_mm: float = 0.0  # of the aim across the view, from end to end
    backwards: bool = False
    robot_mm: float = 0.0  # standard deviation of a position, each axis
    robot_length_mm: float = 10.0
    robot_deg: float = 0.0


class Simulated(NamedTuple):
    """The recording, and the truth at stations along the virtual lower edge, of a groove along its upper middle."""

    recording: Recording
    truth: dict[str, Any]


def simulate(part: Workpiece, sensor: Sensor, ways: list[Way], seed: int) -> Simulated:
    """Scan the part, a pass a way."""
    rng = np.random.default_rng([43, seed])
    base_from_part, flange_from_profiler = pose(rng, 1000.0), pose(rng, 150.0)
    passes, time, seen = [], 0.0, []
    off = linearity(rng, sensor)
    for number, way in enumerate(ways):
        s = np.arange(1.0, part.length_mm - 1.0, way.step_mm)
        s = s[::-1] if way.backwards else s
        part_from_sensor = led(part, sensor, way, s, rng)
        x, z, light = profiles(part, sensor, part_from_sensor, s, rng)
        z = np.round((z + off(x, z)) / sensor.digit_mm) * sensor.digit_mm
        told = base_from_part @ part_from_sensor @ np.linalg.inv(flange_from_profiler)
        told[:, :3, 3] += way.robot_mm * smooth(rng, s, way.robot_length_mm)
        wrong = np.radians(way.robot_deg) * smooth(rng, s, way.robot_length_mm)
        told[:, :3, :3] = Rotation.from_rotvec(wrong).as_matrix() @ told[:, :3, :3]
        stamps = time + np.arange(s.size) * 0.02
        time = stamps[-1] + 5.0
        passes.append((stamps, x, z, light, told, np.full(s.size, number)))
        seen.append(
            s[np.isfinite(z).sum(axis=1) > 20 if part.kind == "groove" else shown(part, part_from_sensor, s, x, z)]
        )
    stamps, x, z, light, told, numbers = (np.concatenate(column) for column in zip(*passes, strict=True))
    order = -1 if sensor.falls else 1
    recording = Recording(
        source=f"triangulated {seed}",
        time_s=1.0 + stamps,
        x_mm=x[:, ::order].astype(np.float32),
        z_mm=z[:, ::order].astype(np.float32),
        pass_index=numbers.astype(np.int64),
        robot_time_s=1.0 + stamps,
        robot_position_mm=told[:, :3, 3],
        robot_quaternion_wxyz=Rotation.from_matrix(told[:, :3, :3]).as_quat()[:, [3, 0, 1, 2]],
        robot_pass=numbers.astype(np.int64),
        flange_from_profiler=flange_from_profiler,
        intensity=np.clip(light[:, ::order], 0, 65535).astype(np.uint16) if sensor.bright else None,
    )
    return Simulated(recording, true(part, base_from_part, np.sort(np.concatenate(seen))))


def shown(part: Workpiece, part_from_sensor: Float, s: Float, x: Float, z: Float) -> Bool:
    """Frames (n,) with returns from the middle of the root face or raw end face: it may be dark, or in shadow."""
    high = part.root_mm.at(s, part.length_mm) if part.kind == "milled" else np.full(s.size, part.thickness_mm)
    middle = part.place(s, np.zeros_like(s), 0.5 * high) - part_from_sensor[:, :3, 3]
    spot = np.einsum("nji,nj->ni", part_from_sensor[:, :3, :3], middle)
    near = np.hypot(x - spot[:, :1], z - spot[:, 2:]) < 0.3 * high[:, None]
    return np.asarray(near.sum(axis=1) > 2)


def true(part: Workpiece, base_from_part: Float, seen: Float) -> dict[str, Any]:
    """Stations; normal, across and tangent are those of the root face or the leaning end face.

    Of a groove midway between the upper edges, else on the lower edge.
    """
    s = part.stations()[::2]
    axes = base_from_part[:3, :3] @ part.axes(s)
    lean = part.lean.at(s, part.length_mm)[:, None] if part.kind == "raw" else np.zeros((len(s), 1))
    away, up = axes[:, :, 0], axes[:, :, 1]
    level = part.thickness_mm if part.kind == "groove" else 0.0
    place = part.place(s, np.zeros_like(s), level) @ base_from_part[:3, :3].T + base_from_part[:3, 3]
    found: dict[str, Any] = {
        "position_mm": place,
        "seen": (s >= seen.min(initial=np.inf)) & (s <= seen.max(initial=-np.inf)),
    }
    if part.kind == "raw":
        normal = np.cos(lean) * away - np.sin(lean) * up
        across = np.cos(lean) * up + np.sin(lean) * away
        return found | {"normal": normal, "across": across, "tangent": np.cross(across, normal)}
    root = part.root_mm.at(s, part.length_mm)
    if part.kind == "groove":
        return found | {"gap_mm": part.gap_mm.at(s, part.length_mm), "depth_mm": part.thickness_mm - root}
    return found | {"root_mm": root, "bevel_deg": np.degrees(part.bevel.at(s, part.length_mm)), "across": up}


def led(part: Workpiece, sensor: Sensor, way: Way, s: Float, rng: np.random.Generator) -> Float:
    """part_from_sensor (n, 4, 4): z of the sensor to the part."""
    sine, cosine = np.sin(way.elevation), np.cos(way.elevation)
    sense = 1.0 if rng.random() < 0.5 else -1.0
    y = np.array([0.0, 0.0, sense])
    z = np.array([-cosine, -sine, 0.0])
    square = np.stack([np.cross(y, z), y, z], axis=1)
    phase = rng.uniform(0.0, 6.0, 3) + s[:, None] / rng.uniform(8.0, 30.0, 3)
    turned = Rotation.from_euler("xyz", way.oblique).as_matrix()
    turned = turned @ Rotation.from_rotvec(way.sway * np.sin(phase)).as_matrix()
    axes = part.axes(s)
    out = np.tile(np.eye(4), (s.size, 1, 1))
    out[:, :3, :3] = axes @ square @ turned
    across = way.drift_mm * (s / part.length_mm - 0.5)
    aim = part.place(s, way.aim_mm[0] - sine * across, way.aim_mm[1] + cosine * across)
    out[:, :3, 3] = aim - sensor.stand_off_mm * out[:, :3, 2]
    return out


def profiles(
    part: Workpiece, sensor: Sensor, part_from_sensor: Float, s: Float, rng: np.random.Generator
) -> tuple[Float, Float, Float]:
    """x, z and brightness (n, columns) of frames, NaN where nothing came back."""
    chains = cut(part, part_from_sensor, s)
    edge = np.einsum("nji,nj->ni", part_from_sensor[:, :3, :3], part.axes(s)[:, :, 2])
    base = sensor.stand_off_mm * np.tan(sensor.triangulation)
    camera = np.array([sensor.side_mm, base, 0.0])
    # planes of pixel columns meet the sheet in lines through A
    apex = np.array([sensor.side_mm, -abs(base) * np.tan(abs(sensor.triangulation))])
    beside = camera[[0, 2]] - base / edge[:, 1:2] * edge[:, [0, 2]]  # the camera, seen along the edge
    lines = [segments(chain, apex) for chain in chains]
    column = (np.arange(sensor.columns) + 0.5 - sensor.columns / 2.0) * sensor.width_mm / sensor.columns
    sub = ((np.arange(SUB) + 0.5) / SUB - 0.5) * sensor.footprint * sensor.width_mm / sensor.columns
    lateral = (column[:, None] + sub - apex[0]).ravel() / (sensor.stand_off_mm - apex[1])
    which, depth = nearest(lines, np.broadcast_to(lateral, (s.size, lateral.size)))
    z = 1.0 / depth + apex[1]
    x = apex[0] + lateral * (z - apex[1])
    light = np.take_along_axis(brightness(chains, edge, camera, sensor), np.maximum(which, 0), axis=1)
    light[which < 0] = 0.0
    for eye in (np.zeros((s.size, 2)), beside):
        light *= free(chains, eye, x, z)
    light, z = light.reshape(s.size, -1, SUB), z.reshape(s.size, -1, SUB)
    return seen_by_pixels(sensor, light, z, apex, column, rng)


def seen_by_pixels(
    sensor: Sensor, light: Float, z: Float, apex: Float, column: Float, rng: np.random.Generator
) -> tuple[Float, Float, Float]:
    """What pixels make of brightness and range (n, columns, SUB) over their footprints."""
    z = np.where(light > 0.0, z, 0.0)
    brightest = np.take_along_axis(z, light.argmax(axis=2)[..., None], axis=2)
    light = np.where(np.abs(z - brightest) < APART_MM, light, 0.0)
    total = light.sum(axis=2)
    usual = np.median(total[total > 0.0])
    seen = total > sensor.threshold * usual
    total = np.where(seen, total, np.nan)
    value = (light * z).sum(axis=2) / total
    speckle = gaussian_filter1d(rng.normal(size=value.shape), sensor.speckle_columns, axis=1)
    speckle /= speckle.std()
    shot = rng.normal(size=value.shape) * np.sqrt(np.minimum(usual / total, 25.0))
    value = value + sensor.noise_mm * (0.8 * speckle + 0.6 * shot)
    stray = rng.random(value.shape) < sensor.stray
    value = np.where(stray, value + rng.normal(0.0, 2.0, value.shape), value)
    value[rng.random(value.shape) < sensor.lost] = np.nan
    x = apex[0] + (column - apex[0]) / (sensor.stand_off_mm - apex[1]) * (value - apex[1])
    return x, value, np.nan_to_num(20_000.0 * total / usual)


def cut(part: Workpiece, part_from_sensor: Float, s: Float) -> list[Float]:
    """Chains (n, k, 2), (x, z), in which the sheet of each frame cuts the part."""
    stations = part.stations()
    y, origin = part_from_sensor[:, :3, 1], part_from_sensor[:, :3, 3]
    found = []
    for chain in part.chains(stations):
        out = np.empty((s.size, chain.shape[1], 2))
        for k in range(chain.shape[1]):
            at = s.copy()
            for _ in range(4):
                u, v = (np.interp(at, stations, chain[:, k, j]) for j in (0, 1))
                point = part.place(at, u, v)
                run = (part.axes(at)[:, :, 2] * y).sum(axis=1) * (1.0 + u / part.radius_mm)
                at = at - ((point - origin) * y).sum(axis=1) / run
            u, v = (np.interp(at, stations, chain[:, k, j]) for j in (0, 1))
            local = np.einsum("nji,nj->ni", part_from_sensor[:, :3, :3], part.place(at, u, v) - origin)
            out[:, k] = local[:, [0, 2]]
        found.append(out)
    return found


class Segments(NamedTuple):
    """Pieces of a chain seen from a point: in (x / z, 1 / z) about it straight lines are straight."""

    lateral: Float  # (n, k)
    depth: Float  # (n, k), 1 / z


def segments(chain: Float, eye: Float) -> Segments:
    depth = 1.0 / np.maximum(chain[..., 1] - eye[..., 1], 1.0)
    return Segments((chain[..., 0] - eye[..., 0]) * depth, depth)


def nearest(lines: list[Segments], lateral: Float) -> tuple[Any, Float]:
    """Which piece (n, m), counted over all chains, is nearest at lateral places (n, m); -1: none; and its 1 / z."""
    best, which = np.full(lateral.shape, 1e-9), np.full(lateral.shape, -1)
    number = 0
    for line in lines:
        for k in range(line.lateral.shape[1] - 1):
            a, b = line.lateral[:, k, None], line.lateral[:, k + 1, None]
            low, high = np.minimum(a, b), np.maximum(a, b)
            on = (lateral >= low) & (lateral < high)
            rise = (line.depth[:, k + 1] - line.depth[:, k])[:, None] / np.where(b == a, 1.0, b - a)
            depth = line.depth[:, k, None] + (lateral - a) * rise
            on &= depth > best
            best = np.where(on, depth, best)
            which = np.where(on, number, which)
            number += 1
    return which, best


def free(chains: list[Float], eye: Float, x: Float, z: Float) -> Any:
    """Whether the ways from points (n, m) to an eye (n, 2) are free."""
    depth = 1.0 / np.maximum(z - eye[:, 1:], 1.0)
    _, best = nearest([segments(chain, eye[:, None]) for chain in chains], (x - eye[:, :1]) * depth)
    return best * (1.0 - 1e-6) <= depth + RIVAL


def brightness(chains: list[Float], edge: Float, camera: Float, sensor: Sensor) -> Float:
    """Of every piece (n, pieces) of all chains: light that comes back from it a column."""
    found = []
    for chain in chains:
        middle = (chain[:, 1:] + chain[:, :-1]) / 2.0
        point = np.stack([middle[..., 0], 0.0 * middle[..., 0], middle[..., 1]], axis=-1)
        along = np.diff(chain, axis=1)
        along = np.stack([along[..., 0], 0.0 * along[..., 0], along[..., 1]], axis=-1)
        normal = np.cross(np.broadcast_to(edge[:, None], along.shape), along)
        normal = normal / np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-12)
        laser, seen = unit(-point), unit(camera - point)
        lit, view = (normal * laser).sum(axis=-1), (normal * seen).sum(axis=-1)
        same = lit * view > 0.0
        between = np.abs((normal * unit(laser + seen)).sum(axis=-1))
        lobe = np.exp(-((np.arccos(np.clip(between, 0.0, 1.0)) / sensor.lobe) ** 2))
        share = (1.0 - sensor.shine) + 3.0 * sensor.shine * lobe
        found.append(np.where(same, np.abs(lit) * share, 0.0))
        found[-1] = np.where(np.linalg.norm(along, axis=-1) > 0.0, found[-1], 0.0)
    return np.concatenate(found, axis=1)


def linearity(rng: np.random.Generator, sensor: Sensor) -> Callable[[Float, Float], Float]:
    """What a sensor's ranges are off by over its window: slow, the same in every frame."""
    count = 8
    turn, phase = rng.uniform(0.0, np.pi, count), rng.uniform(0.0, 2.0 * np.pi, count)
    k = 2.0 * np.pi / (sensor.linearity_length_mm * rng.uniform(0.7, 3.0, count))
    waves = np.stack([k * np.cos(turn), k * np.sin(turn), phase], axis=1)
    scale = sensor.linearity_mm * np.sqrt(2.0 / count)
    return lambda x, z: scale * sum(np.cos(a * x + b * z + p) for a, b, p in waves) if scale else 0.0 * z


def smooth(rng: np.random.Generator, s: Float, length_mm: float) -> Float:
    """Gaussian process (n, 3) of unit variance along a way, correlation exp(-d^2 / (2 length^2))."""
    step = min(length_mm / 6.0, 0.5)
    reach = float(np.ptp(s)) + step
    edge = int(np.ceil(5.0 * length_mm / step))
    white = rng.normal(size=(int(np.ceil(reach / step)) + 2 + 2 * edge, 3))
    sigma = length_mm / step / np.sqrt(2.0)
    drawn = gaussian_filter1d(white, sigma, axis=0)[edge:-edge] * np.sqrt(2.0 * np.sqrt(np.pi) * sigma)
    at = np.arange(len(drawn)) * step
    return np.stack([np.interp(s - s.min(), at, column) for column in drawn.T], axis=1)


def pose(rng: np.random.Generator, distance_mm: float) -> Float:
    out = np.eye(4)
    out[:3, :3] = Rotation.random(random_state=rng).as_matrix()
    out[:3, 3] = distance_mm * unit(rng.normal(size=3))
    return out
