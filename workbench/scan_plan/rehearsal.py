"""A planned scan rehearsed: the engine itself on a simulated scan of the nominal joint, before anything moves.

The joint is straight, its root face as rough as declared. Each pass is led along it as planned and sees it where the
plan says so. What the engine then says of it is what it will say of the part: its own windows, priors and ways to put
passes together. Predicted is the median over stations, root mean square over the radii that stand for what is held
possible of the lower edge (`information.edges_of`), but for the last; promised is that with the last one and a wave of
the root face, and `information.RESERVE`.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from workbench import cloud, edge, scan, twin
from workbench.artefacts import DIRECTIONS, END, MilledEdge, PlannedScan, Quantity, Recording
from workbench.errors import WorkbenchError
from workbench.scan_plan.information import Joint, Knowledge, Profiler, decay_columns
from workbench.scan_plan.way import EdgeLine
from workbench.synthetic import Recipe
from workbench.synthetic.recipe import Course, Noise, Part, Pass, Placement, Robot, Scanner
from workbench.synthetic.workpiece import Workpiece
from workbench.units import DEG, Bool, Float, Shaped

WAVE_MM = 0.05  # as a robot leaves a root face, that is promised for: the engine averages less along such an edge
LONGEST_MM = 100.0  # of a nominal edge: a longer one is rehearsed on so much, its shadows drawn together
FOOTPRINT = np.linspace(-0.4, 0.4, 5)  # rays of a pixel, in columns from its middle
MOST_SEEN_DEG = 80.0  # of incidence: candidates meet the lower surface below 70 deg, or not at all
LEAST_RISE = 1e-6  # of a ray towards the lower surface: less is rounding, of a view square to the root face
PLACE_MM = (1500.0, 0.0, 800.0)  # where the nominal edge begins
RATE_HZ = 200.0  # of frames and of poses
UNKNOWN = ("root_mm", END), ("bevel_deg", DIRECTIONS)  # quantities by one source, where nothing is told of them
SECTIONS = 9  # of an inspection: the first and the last lie half a section from the ends, where u is larger


def straight(length_mm: float) -> EdgeLine:
    """The edge of the nominal joint before the robot: t is x, n is -y, m is z."""
    ends = np.add(PLACE_MM, [[0.0, 0.0, 0.0], [length_mm, 0.0, 0.0]])
    return EdgeLine.through(ends, np.array([0.0, 0.0, 1.0]), "nominal")


class Supposed(NamedTuple):
    """What is supposed of the part that is rehearsed."""

    radius_mm: float  # of the lower edge
    wave_mm: float  # amplitude of the root face along the edge
    draw: int  # of the noise


class Rehearsed(NamedTuple):
    """What the engine tells of a rehearsed scan, at s stations; NaN: no pass sees it."""

    root: Quantity
    bevel: Quantity
    refused: str | None = None  # why the engine refuses such recordings


def rehearsed(
    joint: Joint,
    profiler: Profiler,
    known: Knowledge,
    way: PlannedScan,
    sees: Shaped[Bool, "p s"],
    stations: Shaped[Float, " s"],
    supposed: Supposed,
) -> Rehearsed:
    """Root face and bevel angle at the stations as the engine tells them.

    way: the passes along `straight`; sees: which of them sees which station.
    """
    length = float(stations[-1])
    recipe = Recipe(
        seed=supposed.draw,
        part=Part(
            length_mm=length,
            thickness_mm=Course(start=joint.thickness_mm, end=joint.thickness_mm),
            root_mm=Course(
                start=joint.root_mm, end=joint.root_mm, amplitude=supposed.wave_mm, wavelength_mm=LONGEST_MM
            ),
            bevel_deg=Course(start=joint.bevel / DEG, end=joint.bevel / DEG),
            roughness_mm=known.roughness_mm,
            base_from_part=Placement(position_mm=PLACE_MM),
        ),
        scanner=Scanner(
            max_incidence_deg=MOST_SEEN_DEG,
            noise=Noise(correlation_columns=decay_columns(profiler.noise_columns)),
        ),
        robot=Robot(frame_rate_hz=RATE_HZ, pose_rate_hz=RATE_HZ, pose_noise_mm=known.robot_noise_mm),
        passes=(Pass(from_mm=0.0, to_mm=length),),
    )
    turn = np.diag([0.0, 0.0, 0.0, *3 * [known.hand_eye_turn**2]])
    recording = _as_seen(twin.scan(Workpiece(recipe), way), way, sees, stations, supposed.radius_mm)
    try:
        points = cloud.denoise(scan.fuse(recording))
        made = edge.segment(
            dataclasses.replace(points, hand_eye_covariance=turn),
            root_nominal_mm=joint.root_mm,
            bevel_nominal_deg=joint.bevel / DEG,
            robot_noise_mm=known.robot_noise_mm,
            sensor=profiler.file,
        )
    except WorkbenchError as refused:
        unknown = np.full(stations.size, np.nan)
        root, bevel = (Quantity.of(name, unknown, {of: unknown}) for name, of in UNKNOWN)
        return Rehearsed(root, bevel, f"with a radius of {supposed.radius_mm:.2g} mm: {refused}")
    patterns = [(sees == one[:, None]).all(axis=0) for one in np.unique(sees[:, sees.any(axis=0)], axis=1).T]
    root, bevel = (_typical(_along(made, one, stations), patterns) for one in (made.root, made.bevel))
    return Rehearsed(root, bevel)


def _typical(found: Quantity, patterns: list[Bool]) -> Quantity:
    """As at the station of median u where the same passes see it: where one draw is odd says nothing of the part."""
    like = np.full(found.u.size, -1)
    for which in patterns:
        seen = np.flatnonzero(which & np.isfinite(found.u))
        if seen.size:
            like[seen] = seen[np.argsort(found.u[seen])[seen.size // 2]]
    terms = {name: np.where(like < 0, np.nan, u[like]) for name, u in found.u_by_source.items()}
    return Quantity.of(found.name, found.value, terms)


def pooled(one: Quantity, other: Quantity) -> Quantity:
    """Of two draws: root mean squares, term by term."""
    terms = {
        name: np.hypot(u, other.u_by_source.get(name, 0.0)) / math.sqrt(2.0) for name, u in one.u_by_source.items()
    }
    return Quantity.of(one.name, one.value, terms)


def _as_seen(recording: Recording, way: PlannedScan, sees: Bool, stations: Float, radius_mm: float) -> Recording:
    """The recording of an edge with a radius; frames are dark where something stands in the way."""
    z = recording.z_mm.astype(float)
    for number, course in enumerate(way.courses):
        rows = np.flatnonzero(recording.pass_index == number)
        first, *_, last = course.base_from_profiler[:, :3, 3]
        along = (last - first) / np.linalg.norm(last - first)
        place = first + course.frame_pitch_mm * np.arange(rows.size)[:, None] * along - PLACE_MM
        turn = course.base_from_profiler[0, :3, :3]
        # The laser meets the edge ahead of a profiler that leans.
        at = np.clip(place[:, 0] + way.standoff_mm * turn[0, 2], stations[0], stations[-1])
        z[rows[np.interp(at, stations, sees[number].astype(float)) < 1.0 - 1e-9]] = np.nan
        if radius_mm > 0.0:
            of_columns = place[:, None] + recording.x_mm[rows, :, None] * turn[:, 0]
            z[rows] += _farther_mm(of_columns, way.pitch_mm * turn[:, 0], turn[:, 2], radius_mm)
    return dataclasses.replace(recording, x_mm=np.where(np.isnan(z), np.nan, recording.x_mm), z_mm=z.astype(np.float32))


def _farther_mm(
    origin: Shaped[Float, "f c 3"], pixel: Shaped[Float, " 3"], ray: Shaped[Float, " 3"], radius_mm: float
) -> Shaped[Float, "f c"]:
    """How much farther pixels see an edge with a radius than their middle ray a sharp one.

    NaN: most of a pixel's rays go past it, or meet it at too flat an angle.
    """
    sharp, n, m = _met(origin, ray)
    reach = radius_mm + float(np.linalg.norm(pixel))
    near = (n > -reach) & (m < reach)
    first, n, m = _met(origin[near][:, None] + FOOTPRINT[:, None] * pixel, ray)
    by_n, by_m, n, m = -ray[1], ray[2], n + radius_mm, m - radius_mm  # from the rounding's middle
    at_edge = (n > 0.0) & (m < 0.0) & (m > -radius_mm - 1e-9)
    square, half = by_n**2 + by_m**2, n * by_n + m * by_m
    left = half**2 - square * (n**2 + m**2 - radius_mm**2)
    far = (-half - np.sqrt(np.where(left > 0.0, left, np.nan))) / square
    cosine = -((n + far * by_n) * by_n + (m + far * by_m) * by_m) / radius_mm
    first += np.where(at_edge, np.where(cosine > math.cos(MOST_SEEN_DEG * DEG), far, np.nan), 0.0)
    count = np.isfinite(first).sum(axis=1)
    out = np.zeros(near.shape)
    out[near] = np.nansum(first, axis=1) / np.where(2 * count > FOOTPRINT.size, count, np.nan) - sharp[near]
    return out


def _met(origin: Shaped[Float, "... 3"], ray: Shaped[Float, " 3"]) -> tuple[Float, Float, Float]:
    """Range to the root face, or to the lower surface where that is met first; and along n and m from the edge."""
    by_n = origin[..., 1] / -ray[1]
    first = by_n if ray[2] <= LEAST_RISE else np.fmax(by_n, -origin[..., 2] / ray[2])
    return first, -first * ray[1] - origin[..., 1], first * ray[2] + origin[..., 2]


def _along(found: MilledEdge, quantity: Quantity, stations: Float) -> Quantity:
    """The quantity at the stations, NaN where it is not seen."""
    on = found.seen & np.isfinite(quantity.u)
    place = found.position_mm[on, 0] - PLACE_MM[0]
    half = 0.5 * float(stations[-1]) / SECTIONS
    at = np.clip(stations, half, stations[-1] - half)
    near = np.abs(at[:, None] - place).min(axis=1) < np.diff(stations).max()
    terms = {
        name: np.where(near, np.interp(at, place, np.broadcast_to(u, on.shape)[on]), np.nan)
        for name, u in quantity.u_by_source.items()
    }
    return Quantity.of(quantity.name, np.interp(at, place, quantity.value[on]), terms)
