"""`edge.segment_raw`: the end face of a raw plate, its lower and its upper edge, from an organised cloud."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud, Edge
from workbench.edge.hand_eye_u import place_u_mm, turn_u
from workbench.edge.raw_burrs import raw_burr_stations
from workbench.edge.raw_direction import face_directions
from workbench.edge.raw_faces import RawFaces, find_end_face
from workbench.edge.raw_measure import RawMeasured, measure_raw_edge
from workbench.geometry.courses import fit_course
from workbench.geometry.gaps import covered
from workbench.stage import stage
from workbench.units import Float

STATION_MM = 1.0


@stage("edge.segment_raw")
def segment_raw(
    cloud: Cloud,
    *,
    upper_side: Annotated[
        tuple[float, float, float],
        Field(
            description="direction in the base from the plate's lower to its upper surface, good to 25 deg; "
            "the ratio of its components counts, its length does not"
        ),
    ],
    z_away: Annotated[
        bool | None, Field(description="does z count away from the sensor; null: from what lies beside the end face")
    ] = None,
    robot_noise_mm: Annotated[
        float, Field(ge=0, le=5, description="standard deviation of a recorded flange position, each axis")
    ] = 0.07,
) -> Edge:
    """Find the end face of a raw edge, its lower and its upper edge (the paper's section 4.2, Fig. 8 a to e).

    In every frame the end face is the straight run along `upper_side`, rough or not; where a surface of the plate is
    seen beside it, the edge is the crossing of both, else the place where the face's returns end. All frames together
    give smooth edges, in the section planes of the lower one, and the end face's direction.

    Args:
        cloud: the organised cloud of one edge, in one or more passes.
        upper_side: from the lower to the upper side, in the base: on a raw edge nothing tells the sides apart.
        z_away: whether z counts away from the sensor; only needed where nothing but the end face is in view.
        robot_noise_mm: standard deviation of a recorded flange position, each axis. Where a pass has only the poses of
            its two ends, nothing in the scan shows it, yet it turns the edge's tangent.

    Raises:
        InputError: `upper_side` is zero or runs along the edge; no raw edge, or only a part of it, is in view.
    """
    along, sense = face_directions(cloud, upper_side, z_away)
    found = find_end_face(cloud, along, sense)
    measured = measure_raw_edge(cloud, found)
    return _edge(cloud, found, measured, robot_noise_mm)


def _edge(cloud: Cloud, found: RawFaces, measured: RawMeasured, robot_noise_mm: float) -> Edge:
    start, stop = float(np.nanmin(measured.s)), float(np.nanmax(measured.s))
    length = stop - start
    at = np.linspace(start, stop, max(3, round(length / STATION_MM) + 1))
    seen = covered(measured.s, cloud.pass_index, at)
    t, m = section_axes(measured, at)
    n = np.cross(t, m)
    origin = measured.curve.position(at)
    (low, low_u), (high, _) = measured.lower.at(at), measured.upper.at(at)
    high[~covered(measured.s_upper, cloud.pass_index, at)] = np.nan
    low[~seen] = np.nan
    here = np.isfinite(measured.s)
    frame_tangent = np.full((here.size, 3), np.nan)
    frame_tangent[here] = measured.curve.tangent(measured.s[here])
    inward = -n if math.isnan(measured.lean) else math.cos(measured.lean) * m + math.sin(measured.lean) * n
    position, seen_frames = origin + low[:, None] * m, np.flatnonzero(here)
    shared, turn = None, 0.0
    if cloud.hand_eye_covariance is not None and cloud.flange_from_profiler is not None:
        frame = seen_frames[np.argmin(np.abs((measured.s[seen_frames])[None, :] - at[:, None]), axis=1)]
        shared = np.stack([place_u_mm(cloud, frame, origin, axis) for axis in (n, m)], axis=1)
        turn = float(np.median(turn_u(cloud, frame, t)))
    return Edge(
        kind="raw", part=cloud.part, faces=found.faces, labels=found.labels, pass_index=cloud.pass_index,
        frame_arc_length_mm=measured.s - start, frame_tangent=frame_tangent, frames=None,
        tangent_u=math.hypot(measured.tangent_u, math.sqrt(2.0) * robot_noise_mm / length), arc_length_mm=at - start,
        position_mm=position, tangent=t, normal=n, across=m, seen=seen,
        burr_stations=raw_burr_stations(found, measured, at),
        upper_position_mm=origin + high[:, None] * m, upper_inward=inward,
        position_u_mm=np.stack([_stand_out_u(measured, at), low_u], axis=1),
        normal_u=math.hypot(measured.tilt_u, turn), hand_eye_u_mm=shared,
        checks=cloud.checks,
    )  # fmt: skip


def section_axes(measured: RawMeasured, at: Float) -> tuple[Float, Float]:
    """t and m (k, 3) at arc lengths `at` (k,) of the curve."""
    t, a, b = measured.curve.frame(at)
    return t, math.cos(measured.tilt) * a + math.sin(measured.tilt) * b


def _stand_out_u(measured: RawMeasured, at: Float) -> Float:
    """Standard uncertainty (k,) of the lower edge along n at `at`, mm: of the face's middle, and its direction's."""
    on = np.isfinite(measured.stand_out) & np.isfinite(measured.s_face)
    s, out = measured.s_face[on], measured.stand_out[on]
    course = fit_course(s, out[:, None])
    residual = out - course.spline(s)[:, 0]
    return np.hypot(course.u(s, at, residual), measured.lever_mm * measured.tilt_u)
