"""`edge.segment`: the faces of the edge and its lower edge, from an organised cloud."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Annotated, NamedTuple

import numpy as np
from pydantic import Field

from workbench.artefacts import BEVEL_FACE, LOWER_SURFACE, ROOT_FACE, UPPER_SURFACE, Check, Cloud, MilledEdge
from workbench.checks.corners import ledge_takes_mm
from workbench.checks.end_face import edge_break_check
from workbench.checks.faces import FURTHER, ViewContext, require_bevel, require_columns
from workbench.checks.judge import refuse_failed
from workbench.checks.levels import BEHIND
from workbench.checks.limits import judged_by
from workbench.checks.residuals import FaceAlong, late_of
from workbench.checks.sensor import column_pitch_mm
from workbench.checks.window import end_step_check
from workbench.edge.broken_end import NOT_SHARP, BrokenEnd, broken_end, together_along, weights
from workbench.edge.certified import certified, certified_linearity
from workbench.edge.column_errors import ColumnErrors, Linearity, declared_linearity, notes_of, without_column_errors
from workbench.edge.drawn_end import burr_note
from workbench.edge.end_templates import EdgeCondition
from workbench.edge.faces import TrackedFaces, find_faces
from workbench.edge.frame_order import left_out
from workbench.edge.groove_frames import two_plates_share
from workbench.edge.identify import CONTEXT
from workbench.edge.last_returns import is_free_end, root_rim
from workbench.edge.lower_fillet import LIT_COLUMNS, lower_fillet
from workbench.edge.measure import LEAST_WEIGHT, UNDETERMINED, Measured, face_turns, measure_edge, rocking_u
from workbench.edge.on_table import under_u_mm
from workbench.edge.parameters import (
    STATION_MM,
    USUAL_NOISE_MM,
    BevelNominal,
    Direction,
    EndU,
    Limits,
    RobotNoiseLength,
    RobotNoiseOrUsual,
    RootNominal,
    usual_noise_mm,
)
from workbench.edge.residual_image import OFFSETS_MM, FaceForm, FaceImage, face_image, forms
from workbench.edge.sizes import EndTerms, corrected_angles, sizes, straightened
from workbench.edge.steps import burr_stations, step_note, waves_u
from workbench.edge.unseen import (
    BY_BACKING,
    BY_NOMINAL,
    BY_TABLE,
    COMPOUND,
    by_thickness,
    by_window,
    root_end_check,
    unseen_of,
)
from workbench.errors import InputError
from workbench.geometry.along import between, by_pass
from workbench.geometry.curves import covered, turn_by_robot
from workbench.geometry.silhouette import reached_mm
from workbench.stage import InputFile, stage
from workbench.units import DEG, Float

SEEN_TWIST_DEG = 0.3  # a twist of the section that is no error of its estimate
ROUNDED = (
    "the lower edge is rounded or chamfered, by about {:.2f} mm, or blurred so by the sensor: sizes are those to the "
    "virtual sharp edge, {:.2f} mm beyond the last return on the root face"
)
FILLETED = (
    "the lower edge is rounded or chamfered, by about {:.2f} mm: sizes are those to where root face and lower surface "
    "would meet"
)
LIES_ON = (
    "the plate lies on what joins the root face's lower end: sizes are those to where both cross, and by how much the "
    "root face seems to end above it is in their uncertainty"
)
LEDGE = "a part of the {} stands aside by {:.2f} mm, a step or second returns: sizes are those of its line without it"


@stage("edge.segment")
def segment(
    cloud: Cloud,
    *,
    root_nominal_mm: RootNominal = 1.5,
    bevel_nominal_deg: BevelNominal = 40.0,
    robot_noise_mm: RobotNoiseOrUsual = USUAL_NOISE_MM,
    robot_noise_length_mm: RobotNoiseLength = None,
    end_u_mm: EndU = 0.0,
    upper_side: Direction | None = None,
    edge_condition: EdgeCondition = "unknown",
    thickness_mm: Annotated[float, Field(ge=0.5, le=500)] | None = None,
    sensor: InputFile | None = None,
    sensor_dcc: InputFile | None = None,
    thermometer_dcc: InputFile | None = None,
    temperature_c: Annotated[float, Field(ge=-50, le=200)] | None = None,
    limits: Annotated[Limits, judged_by("edge.segment")] = {},  # noqa: B006  (never changed)
) -> MilledEdge:
    """Find root face, bevel face and the lower edge of a milled edge (the paper's section 4.2, Fig. 8).

    Lengths and angles hold in the section plane, normal to the lower edge (docs/method.md).

    Args:
        cloud: the organised cloud of one edge, in one or more passes.
        upper_side: direction in the base from the plate's lower to its upper surface; null: from what is seen. Needed
            where root face and bevel face are about as wide and neither surface is in view.
        edge_condition: prior for the lower edge, where it is out of view: `sharp` (radius to 0.02 mm), `deburred` or
            `unknown`.
        thickness_mm: of the plate, measured beside the edge to 0.02 mm. With the upper surface in view it shows whether
            the root face continues below its last returns.
        sensor: a `sensor.json`, whose linearity enters u; null: half a micrometre.
        sensor_dcc: the sensor's calibration certificate (DCC), whose linearity and scale enter u.
        thermometer_dcc: the thermometer's certificate, by which the part's temperature enters u of the root face.
        temperature_c: of the part (steel) during the scan; counts with the thermometer's certificate.

    Raises:
        InputError: no root face next to a bevel face in view, or no bevel: not straight, not convex, or only here and
            there along the scan.

    Example:
        >>> from workbench import cloud, edge, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> len(milled.arc_length_mm), round(float(milled.arc_length_mm[-1]), 1)
        (78, 77.0)
    """
    columns = require_columns(cloud, root_nominal_mm, limits)
    find = partial(
        find_faces, root_nominal_mm=root_nominal_mm, bevel_nominal_deg=bevel_nominal_deg, upper_side=upper_side
    )
    linearity = certified_linearity(declared_linearity(sensor), sensor_dcc)
    tracked = find(cloud)
    better, errors = without_column_errors(cloud, tracked.labels, tracked.faces, linearity)
    if better is not cloud:
        cloud, tracked = better, find(better)
    context = view_context(cloud, tracked, root_nominal_mm, bevel_nominal_deg)
    rounding = _broken_end(cloud, tracked, 0.0, edge_condition)
    context = context._replace(rim_mm=max(context.rim_mm, rounding.size_mm, rounding.rim_mm))
    checks = (columns, *require_bevel(cloud, tracked.labels, context, limits))
    notes = (NOT_SHARP,) if rounding.contradicts else ()
    condition: EdgeCondition = "unknown" if rounding.contradicts else edge_condition
    if rounding.rim_mm > 0.0:
        tracked = find(cloud, rim_mm=rounding.rim_mm)
        rounding = _broken_end(cloud, tracked, rounding.rim_mm, condition)
    free = is_free_end(tracked)
    checks = (*checks, edge_break_check(rounding.size_mm, limits), end_step_check(tracked.end_column[free], limits))
    refuse_failed(checks, f"{cloud.source}: no bevel", "edge.segment.limits")
    try:
        measured = measure_edge(cloud, tracked, rounding)
        declared = Declared(linearity, errors, usual_noise_mm(robot_noise_mm), robot_noise_length_mm, end_u_mm)
        edge = milled_edge(cloud, tracked, measured, rounding, declared, checks)
    except np.linalg.LinAlgError:
        raise InputError(cloud.source, UNDETERMINED) from None
    doubts = [] if (context.upper_seen or context.lower_seen) and context.readings_apart > CONTEXT else [BY_NOMINAL]
    doubts += [BY_TABLE] if context.lies_on else []
    ends = root_end_check(cloud, tracked)
    doubts += by_window(ends)
    doubts += [COMPOUND] if _value(checks, FURTHER) else []
    doubts += [BY_BACKING] if _value(checks, BEHIND) else []
    doubts += unseen_of(cloud, tracked, edge, is_sharp=condition == "sharp")
    unseen = by_thickness(cloud, tracked, edge, doubts, thickness_mm)
    edge = replace(edge, unseen=unseen, checks=(*edge.checks, ends), warnings=(*notes, *edge.warnings))
    return certified(edge, sensor_dcc, thermometer_dcc, temperature_c)


def _broken_end(cloud: Cloud, tracked: TrackedFaces, rim_mm: float, condition: EdgeCondition) -> BrokenEnd:
    """The lower end of the root face, of whose line `rim_mm` was left out."""
    corner = lower_fillet(cloud, tracked)
    return broken_end(cloud, root_rim(tracked, rim_mm), is_free_end(tracked), condition, corner)


def view_context(cloud: Cloud, tracked: TrackedFaces, root_nominal_mm: float, bevel_nominal_deg: float) -> ViewContext:
    """What the view shows beside both faces, to tell whether they are root face and bevel face."""
    passes = by_pass(cloud.pass_index, tracked.seen)
    upper, lower = (
        any((tracked.faces[one].count[on] > 2).mean() > 0.5 for on in passes) for one in (UPPER_SURFACE, LOWER_SURFACE)
    )
    root, bevel = (np.arctan(tracked.faces[one].slope) for one in (ROOT_FACE, BEVEL_FACE))
    lies_on = bool(tracked.lies_on[tracked.seen].mean() > 0.5)
    return ViewContext(
        two_plates_share(cloud),
        1.0 - float(tracked.end_is_cut[tracked.seen].mean()),
        _reach_mm(tracked) / root_nominal_mm,
        root_nominal_mm,
        upper,
        lower,
        float(np.nanmedian(np.abs(root - bevel))) / DEG,
        bevel_nominal_deg,
        tracked.readings_apart,
        lies_on,
        0.5 if lies_on else 0.0,  # what lies below shows all of its rounding
    )


def _reach_mm(tracked: TrackedFaces) -> float:
    """Width of the root face from its corner with the bevel to its end: the points of its line keep off both."""
    root, bevel = tracked.faces[ROOT_FACE], tracked.faces[BEVEL_FACE]
    return float(np.nanmedian(np.abs(tracked.root_end[:, 0] - root.crossing(bevel)) * root.lean))


def _value(checks: Sequence[Check], name: str) -> float:
    """What one of the checks found; 0: nothing."""
    return next((check.value or 0.0 for check in checks if check.name == name), 0.0)


def u_of_both_pieces(checks: Sequence[Check]) -> float:
    """Standard uncertainty, rad, of the direction of a face in which checks found a corner: it has either piece's."""
    return _value(checks, "face_bend_deg") * DEG / math.sqrt(3.0)


class Declared(NamedTuple):
    """What a user says of what no frame shows."""

    sensor: Linearity
    errors: Mapping[int, ColumnErrors]
    robot_noise_mm: float
    robot_noise_length_mm: float | None
    end_u_mm: float


def milled_edge(
    cloud: Cloud,
    tracked: TrackedFaces,
    measured: Measured,
    rounding: BrokenEnd,
    declared: Declared,
    checks: Sequence[Check],
) -> MilledEdge:
    """The edge at its stations, from the state that was measured; checks: of its faces, which it holds as well.

    A ledge that explains what stands out close to their corner is in the uncertainty, as a whole: a burr on the corner
    would take nothing off. So is what a corner within a face leaves open: its direction is that of either piece.
    """
    s_low = measured.s_low
    length = float(np.nanmax(s_low))
    at = np.linspace(0.0, length, max(3, round(length / STATION_MM) + 1))
    seen = covered(s_low, cloud.pass_index, at)
    position = measured.curve.position(at + measured.shift)
    position[~seen] = np.nan
    root_form, bevel_form, lower_form = _forms(cloud, tracked, measured, at, checks, declared)
    measured = straightened(measured, at, root_form, bevel_form)
    tangent, normal, across = section_axes(measured, at)
    by_robot = turn_by_robot(measured.curve, length, declared.robot_noise_mm, declared.robot_noise_length_mm)
    shared = math.hypot(by_robot, laser_plane_u(cloud), cloud.sparse_poses_u[1])
    shared_u = np.hypot(shared, _late_u(cloud, measured, at))
    tangent_u = np.hypot(measured.curve.tangent_u(at + measured.shift), shared_u)
    end = _end_terms(cloud, tracked, measured, measured.broken, at, lower_form, declared.end_u_mm)
    ledge_mm = ledge_takes_mm(_value(checks, "close_stands_out_mm"), corrected_angles(measured, at + measured.shift)[1])
    end = end._replace(hidden_u_mm=np.hypot(end.hidden_u_mm, ledge_mm))
    rocking = rocking_u(measured.faces, cloud.pass_index)
    root, bevel = sizes(measured, at, tangent_u, root_form, bevel_form, end, rocking)
    notes: tuple[str, ...] = ()
    if rounding.size_mm > 0.0:
        sentence = FILLETED if tracked.end_is_corner[tracked.seen].all() else ROUNDED
        notes = (sentence.format(rounding.size_mm, measured.broken.beyond_mm.max()),)
    if tracked.lies_on.any():
        notes += (LIES_ON,)
    notes += burr_note("the root face's lower end", rounding.drawn, s_low)
    drawn_out = rounding.drawn is not None and rounding.drawn.is_proven
    faces = ("root face", root_form), ("bevel face", bevel_form)
    notes += tuple(LEDGE.format(name, one.part_offset_mm) for name, one in faces if one.part_offset_mm > OFFSETS_MM[0])
    course = measured.end.course
    step = np.interp(at + measured.shift, course.at_mm, measured.said.sure_step_mm(course))
    notes += (*step_note("the root face's end", step, at), *notes_of(declared.errors))
    notes += left_out(cloud.pass_index, tracked.seen)
    return MilledEdge(
        part=cloud.part,
        source=cloud.source,
        faces=tracked.faces,
        labels=tracked.labels,
        pass_index=cloud.pass_index,
        frame_arc_length_mm=s_low,
        arc_length_mm=at,
        position_mm=position,
        tangent=tangent,
        tangent_u=tangent_u,
        normal=normal,
        across=across,
        seen=seen,
        burr_stations=burr_stations(s_low, at, tracked.end_is_burred | drawn_out),
        checks=(*cloud.checks, *checks),
        root=root,
        bevel=bevel,
        warnings=notes,
    )


def _forms(
    cloud: Cloud, tracked: TrackedFaces, measured: Measured, at: Float, checks: Sequence[Check], declared: Declared
) -> tuple[FaceForm, FaceForm, FaceForm]:
    """What lasts in the residuals of both faces and of the lower surface.

    Where a face holds a corner, its direction is either piece's.
    """
    faces = measured.faces
    root_turn, bevel_turn = face_turns(faces, faces.root.s)
    bows = {ROOT_FACE: faces.root.bow_in_range(root_turn), BEVEL_FACE: faces.bevel.bow_in_range(bevel_turn)}

    def image(of: int, s: Float) -> FaceImage | None:
        errors = declared.errors.get(of)
        return face_image(cloud, tracked.labels, tracked.faces[of], of, tracked.side, s, bows.get(of), errors)

    own = np.where(faces.own, measured.s_low, np.nan)
    images = [
        image(ROOT_FACE, own) or image(ROOT_FACE, measured.s_low),
        *(image(of, measured.s_low) for of in (BEVEL_FACE, LOWER_SURFACE, UPPER_SURFACE)),  # the last: of the sensor
    ]
    pieces_u = u_of_both_pieces(checks)
    root, bevel, lower, _ = forms(images, at, declared.sensor)
    root, bevel = (replace(one, turn_u=np.hypot(one.turn_u, pieces_u)) for one in (root, bevel))
    return root, bevel, lower


def _end_terms(
    cloud: Cloud,
    tracked: TrackedFaces,
    measured: Measured,
    broken: BrokenEnd,
    at: Float,
    lower_form: FaceForm,
    declared_u_mm: float,
) -> EndTerms:
    """What the course leaves open of the root face's end at arc lengths `at` (m,) of the lower edge."""
    s, end = at + measured.shift, measured.end
    shown = np.where(np.isfinite(measured.ends.low), measured.upper_s, np.nan)
    face = tracked.faces[ROOT_FACE]
    by_break, by_columns, at_corner = together_along(
        shown, broken.doubt_mm, s, broken.together_u_mm, broken.hidden_u_mm, tracked.end_is_corner
    )
    lower = at_corner * np.hypot(lower_form.upper_u_mm, LIT_COLUMNS * column_pitch_mm(cloud.x_mm))
    hidden = np.hypot(by_columns, under_u_mm(cloud, tracked, measured.s_low, at))
    frames = measured.ends
    own = np.interp(np.nan_to_num(measured.upper_s), end.s, measured.said.own) > 0.5
    left = frames.low + 0.5 * frames.step - end.course.value(np.nan_to_num(measured.upper_s))
    left[~own | (weights(shown, broken.doubt_mm) < LEAST_WEIGHT)] = np.nan
    waves = waves_u(measured.upper_s, left, cloud.pass_index, 0.5 * float(np.nanmedian(frames.step)))
    low = np.where(own, frames.low, np.nan)
    reached = reached_mm(measured.upper_s, low, frames.step, frames.sigma, end.course, s)
    unsettled = between(measured.upper_s, measured.unsettled_mm, s)
    level_u = np.sqrt(np.interp(s, end.course.at_mm, measured.said.u_mm) ** 2 + waves**2 + reached**2 + unsettled**2)
    steep = float(np.abs(np.nanmedian(face.slope)))
    return EndTerms(level_u, by_break, hidden, lower, declared_u_mm, steep)


def _late_u(cloud: Cloud, measured: Measured, at: Float) -> Float:
    """Standard uncertainty (m,) of the laser plane's direction across the edge by poses that come late, rad."""
    lines, here = measured.faces.bevel, np.isfinite(measured.faces.bevel.s)
    s, angle = np.nan_to_num(lines.s), np.where(here, np.unwrap(np.nan_to_num(lines.angle)), np.nan)
    t, a, b = measured.curve.frame(s)
    square = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
    normal = square[:, :1] * a + square[:, 1:] * b
    place = measured.curve.position(s) + (lines.place * square).sum(axis=1)[:, None] * normal
    face = FaceAlong(lines.s, angle, t, normal, place)
    late = late_of(face, cloud.base_from_profiler, cloud.time_s, cloud.pass_index)
    return between(lines.s, late.off_s * late.oblique_rate, at + measured.shift)


def laser_plane_u(cloud: Cloud) -> float:
    """Standard uncertainty (rad) of the laser plane's direction against the robot's motion: that of the hand-eye pose.

    The profiles are turned with it, the way that the edge takes through the base is not. A measured orientation shows
    by its scatter that it is one. Where all are alike but for their last digits, and the section turns, the plate may
    be twisted, or the orientation was only commanded: the laser plane may have turned across the edge by as much.
    """
    covariance = cloud.hand_eye_covariance
    u = 0.0 if covariance is None else math.sqrt(float(np.trace(covariance[3:, 3:])) / 3.0)
    values = {check.name: check.value or 0.0 for check in cloud.checks}
    held = values.get("flange_turn_deg") == 0.0 and values.get("twist_deg", 0.0) > SEEN_TWIST_DEG
    return math.hypot(u, values["twist_deg"] * DEG) if held else u


def section_axes(measured: Measured, at: Float) -> tuple[Float, Float, Float]:
    """t, n and m (k, 3) at arc lengths `at` (k,)."""
    t, a, b = measured.curve.frame(at + measured.shift)
    tilt = corrected_angles(measured, at + measured.shift)[0][:, None]
    m = np.cos(tilt) * a + np.sin(tilt) * b
    return t, np.cross(t, m), m
