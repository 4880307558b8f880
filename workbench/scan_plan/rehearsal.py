"""A planned scan rehearsed: the engine itself on a simulated scan of the nominal joint, before anything moves.

The joint is straight, sharp and of the edge's length; its root face is as rough as declared. Each pass is led along it
as planned and sees it where the plan says so. What the engine then says of it is what it will say of the part: its own
windows, priors and ways to put passes together. Noise alone makes its u differ from scan to scan: the median is
predicted, what `LIKELY` of the draws stay within is promised. What a broken edge hides is not shown: that term stays as
`information.combined` has it.
"""

from __future__ import annotations

import dataclasses
import math
from typing import NamedTuple

import numpy as np

from workbench import cloud, edge, scan, twin
from workbench.artefacts import ROUNDING, MilledEdge, PlannedScan, Quantity, Recording
from workbench.errors import WorkbenchError
from workbench.scan_plan.information import LIKELY, Joint, Knowledge, Profiler, decay_columns
from workbench.scan_plan.way import EdgeLine
from workbench.synthetic import Recipe
from workbench.synthetic.recipe import Course, Noise, Part, Pass, Placement, Robot, Scanner
from workbench.synthetic.workpiece import Workpiece
from workbench.units import DEG, Bool, Float, Int, Shaped

DRAWS, ROUGH_DRAWS = 4, 2  # of noise; of a rough face's waves, whose rehearsals take long
MOST_SEEN_DEG = 80.0  # of incidence: candidates meet the lower surface below 70 deg, or not at all
PLACE_MM = (1500.0, 0.0, 800.0)  # where the nominal edge begins
RATE_HZ = 200.0  # of frames and of poses
SECTIONS = 9  # of an inspection: the first and the last lie half a section from the ends, where u is larger


def straight(length_mm: float) -> EdgeLine:
    """The edge of the nominal joint before the robot: t is x, n is -y, m is z."""
    ends = np.add(PLACE_MM, [[0.0, 0.0, 0.0], [length_mm, 0.0, 0.0]])
    return EdgeLine.through(ends, np.array([0.0, 0.0, 1.0]), "nominal")


class Rehearsed(NamedTuple):
    """What the engine tells of the rehearsed scans, at s stations; NaN: no pass sees it."""

    root: Quantity
    bevel: Quantity
    spread: tuple[float, float]  # of each: what `LIKELY` of the draws stay within, over what is predicted


def rehearsed(
    joint: Joint,
    profiler: Profiler,
    known: Knowledge,
    way: PlannedScan,
    sees: Shaped[Bool, "p s"],
    stations: Shaped[Float, " s"],
) -> Rehearsed | str:
    """Root face and bevel angle at the stations as the engine tells them; or why it refuses such recordings.

    way: the passes along `straight`; sees: which of them sees which station.
    """
    length = float(stations[-1])
    recipe = Recipe(
        part=Part(
            length_mm=length,
            thickness_mm=Course(start=joint.thickness_mm, end=joint.thickness_mm),
            root_mm=Course(start=joint.root_mm, end=joint.root_mm),
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
    found, why, draws = [], "", ROUGH_DRAWS if known.roughness_mm else DRAWS
    for seed in range(draws):
        recording = twin.scan(Workpiece(recipe.model_copy(update={"seed": seed})), way)
        try:
            points = cloud.denoise(scan.fuse(_masked(recording, way, sees, stations)))
            found.append(
                edge.segment(
                    dataclasses.replace(points, hand_eye_covariance=turn),
                    root_nominal_mm=joint.root_mm,
                    bevel_nominal_deg=joint.bevel / DEG,
                    robot_noise_mm=known.robot_noise_mm,
                    sensor=profiler.file,
                )
            )
        except WorkbenchError as refused:
            why = str(refused)
    if why:
        return f"{draws - len(found)} of {draws} rehearsed: {why}"
    patterns = np.where(sees.any(axis=0), np.unique(sees, axis=1, return_inverse=True)[1].ravel(), -1)
    root, bevel = (
        _typical([_along(one, getattr(one, name), stations) for one in found], patterns) for name in ("root", "bevel")
    )
    return Rehearsed(root[0], bevel[0], (root[1], bevel[1]))


def _typical(draws: list[Quantity], patterns: Shaped[Int, " s"]) -> tuple[Quantity, float]:
    """The median u over draws and stations that the same passes see; and what `LIKELY` of them stay within, over it.

    Where one draw is odd says nothing of where the part's scan is. The terms are medians too, drawn to the same sum.
    patterns: which passes see a station together, by number; -1: none.
    """
    each = {name: np.array([one.u_by_source[name] for one in draws]) for name in draws[0].u_by_source}
    u = np.array([one.u for one in draws])
    terms = {name: np.full(u.shape[1], np.nan) for name in each}
    over = np.full_like(u, np.nan)
    for which in (patterns == k for k in np.unique(patterns[patterns >= 0])):
        if np.isfinite(u[:, which]).any():
            middle = float(np.nanmedian(u[:, which]))
            medians = {name: float(np.nanmedian(one[:, which])) for name, one in each.items()}
            drawn = middle / math.sqrt(sum(one**2 for one in medians.values()))
            for name, one in medians.items():
                terms[name][which & np.isfinite(u).any(axis=0)] = drawn * one
            over[:, which] = u[:, which] / middle
    return Quantity.of(draws[0].name, draws[0].value, terms), float(np.nanquantile(over, LIKELY))


def _masked(recording: Recording, way: PlannedScan, sees: Bool, stations: Float) -> Recording:
    """The recording without the frames that show nothing, since something stands in the way."""
    seen = []
    for number, course in enumerate(way.courses):
        ends = course.base_from_profiler[[0, -1], 0]  # the laser meets the edge ahead of a profiler that leans
        first, last = ends[:, 3] + way.standoff_mm * ends[:, 2] - PLACE_MM[0]
        frames = int((recording.pass_index == number).sum())
        at = np.clip(np.linspace(first, last, frames), stations[0], stations[-1])
        seen.append(np.interp(at, stations, sees[number].astype(float)) > 1.0 - 1e-9)
    dark = ~np.concatenate(seen)[:, None]
    return dataclasses.replace(
        recording, x_mm=np.where(dark, np.nan, recording.x_mm), z_mm=np.where(dark, np.nan, recording.z_mm)
    )


def _along(found: MilledEdge, quantity: Quantity, stations: Float) -> Quantity:
    """The quantity at the stations, NaN where it is not seen; what the simulated edge hides left out."""
    on = found.seen & np.isfinite(quantity.u)
    place = found.position_mm[on, 0] - PLACE_MM[0]
    half = 0.5 * float(stations[-1]) / SECTIONS
    at = np.clip(stations, half, stations[-1] - half)
    near = np.abs(at[:, None] - place).min(axis=1) < np.diff(stations).max()
    terms = {
        name: np.where(near, np.interp(at, place, np.broadcast_to(u, on.shape)[on]), np.nan)
        for name, u in quantity.u_by_source.items()
        if name != ROUNDING
    }
    return Quantity.of(quantity.name, np.interp(at, place, quantity.value[on]), terms)
