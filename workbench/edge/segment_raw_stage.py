"""`edge.segment_raw`: the end face of a raw plate, its lower and its upper edge, from an organised cloud."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import (
    DECLARED,
    DIRECTIONS,
    FORM,
    HIDDEN,
    LOWER_SURFACE,
    ROOT_FACE,
    ROUNDING,
    STEPS,
    TANGENT,
    Check,
    Cloud,
    Quantity,
    RawEdge,
)
from workbench.artefacts.quantities import root_sum_square
from workbench.checks import refuse_failed
from workbench.checks.end_face import edge_break_check, require_end_face
from workbench.checks.faces import plates_check
from workbench.checks.limits import judged_by
from workbench.checks.residuals import FaceAlong, Late, every_second, late_check, late_of
from workbench.checks.window import end_step_check
from workbench.edge.broken_end import NOT_SHARP, together_along
from workbench.edge.column_errors import ColumnErrors, Linearity, declared_linearity, notes_of, without_column_errors
from workbench.edge.drawn_end import burr_note
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.groove_frames import two_plates_share
from workbench.edge.measure import UNDETERMINED
from workbench.edge.on_table import raw_under_u_mm
from workbench.edge.parameters import STATION_MM, Direction, EndU, Limits, RobotNoise, RobotNoiseLength
from workbench.edge.raw_direction import face_directions
from workbench.edge.raw_faces import RawFaces, find_end_face
from workbench.edge.raw_measure import (
    SAMPLE_FRAMES,
    EndAlong,
    OutAlong,
    RawMeasured,
    Robot,
    axes,
    measure_raw_edge,
    unevenness,
)
from workbench.edge.residual_image import face_image, forms
from workbench.edge.steps import LEAST_BURRED, burr_stations, step_note
from workbench.edge.unseen import fixed_end_check
from workbench.errors import InputError
from workbench.geometry.along import between, in_order
from workbench.geometry.blocks import evenly
from workbench.geometry.curves import covered
from workbench.geometry.poses import in_planes, unit
from workbench.stage import InputFile, stage
from workbench.units import DEG, Float, Int

PLACE = "course of the edge along its frames"
ROBOT = "robot: errors along its way and declared drift"
SPARSE = "poses between those that were recorded"
HAND_EYE = "hand-eye pose"
CLOCK = "clocks: poses that may come late"
ROUNDED = "the {} edge is rounded or chamfered, by about {:.2f} mm: the path rests on its virtual sharp edge"
LIES_ON = (
    "the plate lies on what joins the end face's lower end, unless that is a stop which touches it further up: nothing "
    "tells which. The path rests on where both cross; by how much the face seems to end above it is in the uncertainty"
)


@stage("edge.segment_raw")
def segment_raw(
    cloud: Cloud,
    *,
    upper_side: Direction,
    z_away: bool | None = None,
    robot_noise_mm: RobotNoise | None = None,
    robot_noise_length_mm: RobotNoiseLength = None,
    end_u_mm: EndU = 0.0,
    robot_drift_u_mm: Annotated[float, Field(ge=0, le=5)] = 0.0,
    edge_condition: EdgeCondition = "unknown",
    sensor: InputFile | None = None,
    limits: Annotated[Limits, judged_by("edge.segment_raw")] = {},  # noqa: B006  (never changed)
) -> RawEdge:
    """Find the end face of a raw edge, its lower and its upper edge (the paper's section 4.2, Fig. 8 a to e).

    Method: docs/method.md, section 6.

    Args:
        cloud: the organised cloud of one edge, in one or more passes.
        upper_side: direction in the base, to 25 deg, from the plate's lower to its upper surface; a raw edge does not
            show it.
        z_away: z counts away from the sensor; null: from the rays and the surfaces. Needed where only the end face is
            in view.
        edge_condition: as in `edge.segment`, of both edges.
        sensor: as in `edge.segment`.
        robot_noise_mm: as in `edge.segment`; null: averaged over what robots have, with its length.
        robot_drift_u_mm: declared standard uncertainty of the edge's place in the base by slow errors of the robot
            (drift, path accuracy).

    Raises:
        InputError: `upper_side` is along the edge; no raw edge, only a part of it, or a groove in view.

    Example:
        >>> from workbench import edge, path, scan
        >>> points = scan.fuse(scan.read(recording="data/synthetic/raw_edge.h5"))
        >>> raw = edge.segment_raw(points, upper_side=[0, 0, 1])
        >>> round(float(raw.arc_length_mm[-1]), 1)
        75.0
    """
    plates = plates_check(two_plates_share(cloud), limits)
    refuse_failed((plates,), f"{cloud.source}: no raw edge", "edge.segment_raw.limits")
    lies = face_directions(cloud, upper_side, z_away)
    found = find_end_face(cloud, lies.along, lies.sense)
    linearity = declared_linearity(sensor)
    better, errors = without_column_errors(cloud, found.labels, found.faces, linearity)
    if better is not cloud:
        cloud, found = better, find_end_face(better, lies.along, lies.sense)
    goes_on = max(float(end.goes_on[found.seen].mean()) for end in (found.lower, found.upper))
    checks = plates, *require_end_face(cloud, found.labels, upper_side, goes_on, limits)
    robot = Robot(robot_noise_mm, robot_noise_length_mm)
    try:
        measured = measure_raw_edge(cloud, found, edge_condition, robot)
    except np.linalg.LinAlgError:
        raise InputError(cloud.source, UNDETERMINED) from None
    broken = max(measured.lower.broken.size_mm, measured.upper.broken.size_mm)
    ends = [end.column[np.isfinite(end.column) & ~end.corner].astype(np.int64) for end in (found.lower, found.upper)]
    steps = max((end_step_check(columns, limits) for columns in ends), key=lambda one: one.value or 0.0)
    late = _late(cloud, measured)
    checks = *checks, edge_break_check(broken, limits), steps, late_check(late, limits)
    refuse_failed(checks, f"{cloud.source}: no raw edge", "edge.segment_raw.limits")
    checks += (*_lies_on(found), fixed_end_check(cloud, ends, int(found.seen.sum())))
    declared = RawDeclared(linearity, errors, robot, end_u_mm, robot_drift_u_mm)
    edge = _edge(cloud, found, measured, late, declared)
    contradicted = measured.lower.broken.contradicts or measured.upper.broken.contradicts
    notes = *((NOT_SHARP,) if contradicted else ()), *edge.warnings, *lies.warnings
    return replace(edge, checks=(*edge.checks, *checks), warnings=(*notes, *notes_of(errors)))


def _late(cloud: Cloud, measured: RawMeasured) -> Late:
    """What an offset between the clocks makes of the frames."""
    s = measured.s_face
    t, n, _ = axes(measured, np.nan_to_num(s))
    place = measured.curve.position(np.nan_to_num(s)) + measured.stands_out_mm[:, None] * n
    face = FaceAlong(s, measured.angle, t, n, place)
    return late_of(face, cloud.base_from_profiler, cloud.time_s, cloud.pass_index)


class RawDeclared(NamedTuple):
    """What a user says of what no frame shows."""

    sensor: Linearity
    errors: Mapping[int, ColumnErrors]
    robot: Robot
    end_u_mm: float
    robot_drift_u_mm: float


def _edge(
    cloud: Cloud,
    found: RawFaces,
    measured: RawMeasured,
    late: Late,
    declared: RawDeclared,
) -> RawEdge:
    lower_s, upper_s = measured.lower.s, measured.upper.s
    start, stop = float(np.nanmin(lower_s)), float(np.nanmax(lower_s))
    length = stop - start
    at = np.linspace(start, stop, max(3, round(length / STATION_MM) + 1))
    seen = covered(lower_s, cloud.pass_index, at)
    t, n, m = axes(measured, at)
    origin = measured.curve.position(at)
    origin = origin + measured.out.value(at)[:, None] * n
    low, high = measured.lower.value(at), measured.upper.value(at)
    position = origin + low[:, None] * m
    upper = origin + high[:, None] * m
    turned, turned_u = measured.out.local_turn(declared.robot, at)
    smooth = measured.out.smooth(at)
    slopes = np.gradient([smooth, low], at, axis=1)  # sections are of the curve, which is not quite the edge
    askew = np.hypot(*slopes)
    askew_mm = askew * np.hypot(smooth, low)
    t = unit(t + (slopes[0] + turned)[:, None] * n + slopes[1][:, None] * m)
    n = unit(np.cross(t, m))
    m = np.cross(n, t)
    position[~seen] = np.nan
    upper[~covered(upper_s, cloud.pass_index, at)] = np.nan
    lean = measured.lean
    inward = -n if math.isnan(lean) else math.cos(lean) * m + math.sin(lean) * n
    shared, turn = None, np.zeros(at.size)
    if cloud.hand_eye_covariance is not None and cloud.flange_from_profiler is not None:
        order = in_order(lower_s)
        frame = order[np.clip(np.searchsorted(lower_s[order], at), 0, order.size - 1)]
        shared = np.stack([place_u_mm(cloud, frame, origin, axis) for axis in (n, m)], axis=1)
        turn = turn_u(cloud, frame, t)
    images = tuple(
        face_image(cloud, found.labels, found.faces[of], of, -found.side, s, bow, declared.errors.get(of))
        for of, s, bow in ((ROOT_FACE, measured.s_face, measured.bow), (LOWER_SURFACE, lower_s, None))
    )
    form, below = (one.uncorrected for one in forms(images, at, declared.sensor))
    turning = np.hypot(measured.out.course.slope_u(at), measured.lower.course.slope_u(at))
    sparse_mm, sparse_turn = cloud.sparse_poses_u
    only_ends_mm = declared.robot.usual_mm if cloud.only_end_poses else 0.0
    by_clock = between(measured.s_face, late.off_s * late.oblique_rate, at)
    tangent_u = root_sum_square(at, (turning, turned_u, sparse_turn, by_clock, askew**2))
    axis = {
        DIRECTIONS: np.hypot(measured.tilt.u(at), 0.0 if measured.rough else measured.local_turn_u),
        FORM: form.turn_u,
        CLOCK: between(measured.s_face, late.turn_u, at),
        TANGENT: np.abs(between(measured.s_face, measured.run, at)) * tangent_u,
        HAND_EYE: turn,
        SPARSE: np.full(at.size, sparse_turn),
    }
    seen_turn_u = root_sum_square(at, (axis[of] for of in (DIRECTIONS, FORM, CLOCK, TANGENT)))
    reach_mm = float(np.linalg.norm((origin.mean(axis=0) - cloud.base_from_profiler[:, :3, 3]).mean(axis=0)))
    sparse_u_mm = root_sum_square(0.0, (sparse_mm, sparse_turn * reach_mm, only_ends_mm))
    out_u, low_u = (_by_robot(measured, one, declared, at) for one in (measured.out, measured.lower))
    apart, late_mm = _apart_mm(cloud, found, measured), _late_mm(measured, late)
    along_n = {
        ROBOT: out_u[0],
        SPARSE: np.full(at.size, sparse_u_mm),
        PLACE: np.hypot(out_u[1], 0.0 if measured.out.local is None else measured.out.local.u(at)),
        DIRECTIONS: measured.lever_mm * seen_turn_u,
        FORM: form.offset_u_mm,
        STEPS: np.hypot(math.hypot(apart[0], measured.out.course.step_u), askew_mm),
        CLOCK: between(measured.s_face, late_mm[0], at),
    }
    steep = np.nanmedian(np.abs(found.faces[ROOT_FACE].slope))
    broken = measured.lower.broken
    by_break, by_columns = together_along(measured.lower.s, broken.doubt_mm, at, broken.u_mm, broken.hidden_u_mm)
    hidden = by_columns, raw_under_u_mm(found, lower_s, at)
    along_m = {
        ROBOT: low_u[0],
        SPARSE: np.full(at.size, sparse_u_mm),
        PLACE: low_u[1],
        FORM: np.hypot(below.offset_u_mm, steep * form.offset_u_mm),  # along the rays
        ROUNDING: by_break,
        HIDDEN: root_sum_square(at, (*hidden, burred_u_mm(cloud, found))),
        DECLARED: np.full(at.size, declared.end_u_mm),
        STEPS: root_sum_square(
            at,
            (between(lower_s, measured.lower.reached_mm, at), apart[1], measured.out.course.step_u, askew_mm),
        ),
        CLOCK: between(measured.s_face, late_mm[1], at),
    }
    out = Quantity.of("along_normal_mm", np.einsum("kd,kd->k", position, n), along_n)
    down = Quantity.of("along_across_mm", np.einsum("kd,kd->k", position, m), along_m)
    direction = Quantity.of("axis_deg", measured.tilt.value(at) / DEG, {name: u / DEG for name, u in axis.items()})
    both = (("lower", measured.lower.broken.size_mm), ("upper", measured.upper.broken.size_mm))
    notes = tuple(ROUNDED.format(name, radius) for name, radius in both if radius > 0)
    for name, end in (("lower", measured.lower), ("upper", measured.upper)):
        notes += burr_note(f"the end face's {name} end", end.broken.drawn, end.s - start)
    step = np.interp(at, measured.lower.course.at_mm, measured.lower.step_mm)
    notes += (*step_note("the end face's lower end", step, at - start), *(check.finding for check in _lies_on(found)))
    return RawEdge(
        part=cloud.part,
        source=cloud.source,
        faces=found.faces,
        labels=found.labels,
        pass_index=cloud.pass_index,
        frame_arc_length_mm=lower_s - start,
        arc_length_mm=at - start,
        position_mm=position,
        tangent=t,
        tangent_u=tangent_u,
        normal=n,
        across=m,
        seen=seen,
        burr_stations=burr_stations(measured.s_face, at, found.lower.burred, found.upper.burred),
        upper_position_mm=upper,
        upper_inward=inward,
        position_u_mm=np.stack([out.u, down.u], axis=1),
        normal_u=direction.u * DEG,
        budget=(out, down, direction),
        hand_eye_u_mm=shared,
        hand_eye_turn=None if shared is None else turn,
        checks=cloud.checks,
        warnings=notes,
    )


def _by_robot(measured: RawMeasured, of: OutAlong | EndAlong, declared: RawDeclared, at: Float) -> tuple[Float, Float]:
    """Standard uncertainties (k,) mm of a place at stations (k,): by the robot's errors, and by all else."""
    shared_mm = of.course.shared_u(at)
    rest = np.sqrt(np.maximum(of.course.u(at) ** 2 - shared_mm**2, 0.0))
    uneven = unevenness(measured, at)
    robot_mm = root_sum_square(at, (shared_mm, declared.robot_drift_u_mm))
    return uneven * robot_mm, uneven * rest


def _late_mm(measured: RawMeasured, late: Late) -> tuple[Float, ...]:
    """What an offset between the clocks makes of the frames' places (N,) along n and along m, mm."""
    return tuple(late.place_u_mm(way) for way in axes(measured, np.nan_to_num(measured.s_face))[1:])


def _apart_mm(cloud: Cloud, found: RawFaces, measured: RawMeasured) -> tuple[float, ...]:
    """Half of what every second frame differs from those between, along n and along m, mm."""
    s, passes = measured.s_face, cloud.pass_index
    here = np.nan_to_num(s)
    _, _, m = axes(measured, here)
    low = in_planes(cloud.base_from_profiler, *found.lower.point.T)
    out = measured.stands_out_mm - measured.out.value(here)
    down = ((low - measured.curve.position(here)) * m).sum(axis=1) - measured.lower.value(here)
    return tuple(every_second(left, passes) for left in (out, down))


def _lies_on(found: RawFaces) -> Iterator[Check]:
    """That the lower edge is told by what the plate seems to lie on: named, not judged."""
    share = float(np.isfinite(found.lower.gap_mm[found.seen]).mean())
    if share > 0.0:
        reason = "a lower surface, or a silhouette, tells the edge by itself"
        yield Check("lies_on_share", share, None, True, reason, LIES_ON)


# What an uncertain hand-eye pose makes of a place and of a direction in the base.


def place_u_mm(cloud: Cloud, frame: Int, point_mm: Float, along: Float) -> Float:
    """Standard uncertainty (k,) mm, along unit vectors (k, 3), of points (k, 3) in the base that `frame` (k,) shows.

    With w the six errors of the pose (HandEye.covariance) a point moves by R (dt + dr x lever), R from flange to base.
    All that was scanned in one posture moves alike: it matters to a path, not to sizes.
    """
    pose = cloud.base_from_profiler[frame]
    lever = point_mm - pose[:, :3, 3]
    flange = _flange_axes(cloud, frame)
    return _propagated(
        cloud, np.concatenate([_rotated(flange, along), _rotated(flange, np.cross(lever, along))], axis=1)
    )


def turn_u(cloud: Cloud, frame: Int, axis: Float) -> Float:
    """Standard uncertainty (k,) rad of a direction's turn about unit vectors (k, 3) in the base."""
    rotated = _rotated(_flange_axes(cloud, frame), axis)
    return _propagated(cloud, np.concatenate([np.zeros_like(rotated), rotated], axis=1))


def _flange_axes(cloud: Cloud, frame: Int) -> Float:
    """Rotation (k, 3, 3) from the flange to the base."""
    assert cloud.flange_from_profiler is not None
    return np.asarray(cloud.base_from_profiler[frame, :3, :3] @ cloud.flange_from_profiler[:3, :3].T)


def _rotated(base_from_flange: Float, vectors: Float) -> Float:
    return np.asarray(np.einsum("kji,kj->ki", base_from_flange, vectors))


def _propagated(cloud: Cloud, rows: Float) -> Float:
    assert cloud.hand_eye_covariance is not None
    return np.asarray(np.sqrt(np.einsum("ki,ij,kj->k", rows, cloud.hand_eye_covariance, rows)))


def burred_u_mm(cloud: Cloud, found: RawFaces) -> float:
    """Standard uncertainty of the lower edge along the face, mm, where returns stand out of it in most of the frames.

    A burr here and there is told by the frames beside it. One all along, or coolant that hangs there, hides whether the
    edge is where the face's line is left or where the last of them stands.
    """
    ends = found.lower
    on = np.flatnonzero(found.seen & np.isfinite(ends.point[:, 0]) & ~ends.corner)
    if not on.size or ends.burred[on].mean() < LEAST_BURRED:
        return 0.0
    on = on[evenly(on.size, SAMPLE_FRAMES)]
    far = []
    for i in on:
        x, z = (of[i, (found.labels[i] == ROOT_FACE) & cloud.keep[i]].astype(float) for of in (cloud.x_mm, cloud.z_mm))
        far.append(float(np.hypot(x - ends.point[i, 0], z - ends.point[i, 1]).min()))
    return float(np.median(far)) / math.sqrt(3.0)
