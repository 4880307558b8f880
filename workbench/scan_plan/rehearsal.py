"""A planned scan rehearsed: the engine itself on a simulated scan of the nominal joint, before anything moves.

The joint is straight, sharp and of the edge's length; its root face is as rough as declared. Each pass is led along it
as planned and sees it where the plan says so. What the engine then says of it is what it will say of the part: its own
windows, priors and ways to put passes together. What a broken edge hides it does not show: that term stays as
`information.combined` has it.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from workbench import cloud, edge, scan, twin
from workbench.artefacts import ROUNDING, MilledEdge, PlannedScan, Quantity, Recording
from workbench.errors import WorkbenchError
from workbench.scan_plan.information import Joint, Knowledge, Profiler
from workbench.scan_plan.way import EdgeLine
from workbench.synthetic import Recipe
from workbench.synthetic.recipe import Course, Noise, Part, Pass, Placement, Robot, Scanner
from workbench.synthetic.workpiece import Workpiece
from workbench.units import DEG, Bool, Float, Shaped

DRAWS, ROUGH_DRAWS = 3, 2  # of noise; of a rough face's waves: how they lie decides what is taken for the face's own
MOST_SEEN_DEG = 80.0  # of incidence: candidates meet the lower surface below 70 deg, or not at all
PLACE_MM = (1500.0, 0.0, 800.0)  # where the nominal edge begins
RATE_HZ = 200.0  # of frames and of poses
SECTIONS = 9  # of an inspection: the first and the last lie half a section from the ends, where u is larger


def straight(length_mm: float) -> EdgeLine:
    """The edge of the nominal joint before the robot: t is x, n is -y, m is z."""
    ends = np.add(PLACE_MM, [[0.0, 0.0, 0.0], [length_mm, 0.0, 0.0]])
    return EdgeLine.through(ends, np.array([0.0, 0.0, 1.0]), "nominal")


def rehearsed(
    joint: Joint,
    profiler: Profiler,
    known: Knowledge,
    way: PlannedScan,
    sees: Shaped[Bool, "p s"],
    stations: Shaped[Float, " s"],
) -> tuple[Quantity, Quantity] | str:
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
    found, why = [], ""
    for seed in range(ROUGH_DRAWS if known.roughness_mm else DRAWS):
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
    if len(found) < ROUGH_DRAWS:
        return why
    root, bevel = (
        _mean([_along(one, getattr(one, name), stations) for one in found], sees, known.roughness_mm > 0.0)
        for name in ("root", "bevel")
    )
    return root, bevel


def decay_columns(noise_columns: float) -> float:
    """Over which an exponential correlation falls to 1/e whose sum over all columns is `noise_columns`."""
    return 1.0 / math.log((noise_columns + 1.0) / (noise_columns - 1.0)) if noise_columns > 1.0 else 0.0


def _mean(draws: list[Quantity], sees: Shaped[Bool, "p s"], rough: bool) -> Quantity:
    """The first of them, with the root mean squares of all their uncertainties.

    Where one draw of a rough face is odd says nothing of where the part's is: the medians along all stations that the
    same passes see.
    """
    squares = [{name: np.square(u) for name, u in one.u_by_source.items()} for one in draws]
    terms = {name: np.sqrt(np.mean([one[name] for one in squares], axis=0)) for name in squares[0]}
    if rough:
        patterns = np.unique(sees, axis=1, return_inverse=True)[1].ravel()
        for which in (patterns == k for k in np.unique(patterns)):
            for u in terms.values():
                known = which & np.isfinite(u)
                u[known] = np.median(u[known])
    return Quantity.of(draws[0].name, draws[0].value, terms)


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
