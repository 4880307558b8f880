"""`calibrate.hand_eye_faces`: the profiler's pose on the flange from an edge, a plane or a tracker's points."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.api import (
    Chapter,
    Document,
    HandEye,
    InputError,
    Limits,
    Recording,
    pieces,
    refuse_unsound,
    stage,
)
from workbench.plugins.calibration.circles_stage import HARMLESS
from workbench.plugins.calibration.determinacy import Demand, check_postures, directions
from workbench.plugins.calibration.fixed_faces import part_of
from workbench.plugins.calibration.model import Noise, view_of_points
from workbench.plugins.calibration.profile_lines import Target, marks_of
from workbench.plugins.calibration.search import located, undetermined
from workbench.plugins.calibration.suspicions import pose_warnings
from workbench.plugins.calibration.tables import fit_words, noisy, sentence
from workbench.plugins.calibration.values import Rejected
from workbench.plugins.calibration.verdicts import (
    Sensor,
    directions_html,
    hand_eye_file,
    hand_eye_of,
    pose_facts,
    serves,
)
from workbench.plugins.ranges import BevelDeg, BevelToleranceDeg, LengthMm, NoiseDeg, NoiseMm, SensorScaleU, ToleranceMm

NO_SUCH = "is the part fixed and flat, and are the poses the flange's, in order?"
ASK = "turn the flange about two axes, and give the design's pose"


@stage("calibrate.hand_eye_faces")
def hand_eye_faces(
    recording: Recording,
    *,
    target: Target = "edge",
    profile_noise_mm: Annotated[float, Field(gt=0, le=1)] = 0.015,
    corner_mm: LengthMm = 1.0,
    pose_noise_mm: NoiseMm = 0.07,
    pose_noise_deg: NoiseDeg = 0.01,
    sensor_scale_u: SensorScaleU = 0.003,
    clock_search_s: Annotated[float, Field(gt=0, le=2)] = 0.1,
    max_u_mm: ToleranceMm = 0.75,
    root_tolerance_mm: ToleranceMm = 0.5,
    bevel_tolerance_deg: BevelToleranceDeg = 1.0,
    bevel_deg: BevelDeg = 40.0,
    limits: Limits = {},  # noqa: B006  (never changed)
) -> tuple[HandEye, Document, Chapter]:
    """Find the profiler's pose on the flange from flat faces of a fixed part.

    Points of the profiles lie on planes, or straight lines, of the base: pose, faces, scales of the profiler and, where
    the profiles have their own clock, its offset are one fit, from many starts (docs/calibration.md).

    Args:
        recording: profiles of the part from postures that turn about two axes and more; /hand_eye, if there, is the
            design's pose: a start, and what tells two answers apart.
        target: 'edge': two flat faces that meet; 'plane': one face; 'points': each column is a point that a seam
            tracker found, on a straight line of its own.
        profile_noise_mm: as in `calibrate.circles`.
        corner_mm: of 'edge': points nearer to the corner, which may be rounded, are left out.
        pose_noise_mm: as in `calibrate.hand_eye`.
        pose_noise_deg: as in `calibrate.hand_eye`.
        sensor_scale_u: standard uncertainty of the profiler's x and z, as a share.
        clock_search_s: greatest offset of the clocks, where the profiles have their own.
        max_u_mm: as in `calibrate.hand_eye`.
        root_tolerance_mm: of a bevel planned by the pose; the verdict says whether it serves.
        bevel_tolerance_deg: likewise.
        bevel_deg: angle of that bevel.
        limits: limits of checks by name (docs/checks.md).

    Raises:
        InputError: too few postures, an undetermined direction (named), two answers that fit equally, none that fits.

    Example:
        >>> from workbench import scan
        >>> from workbench.plugins import calibration
        >>> bar = scan.read(recording="data/calibration/edge.h5")
        >>> pose, document, chapter = calibration.hand_eye_faces(bar)
        >>> pose.flange_from_profiler.shape
        (4, 4)
    """
    if target != "points":
        refuse_unsound(recording, HARMLESS | limits, "calibrate.hand_eye_faces.limits", calibrating=True)
    marks = marks_of(recording, target, profile_noise_mm, corner_mm)
    noise = Noise(pose_noise_mm, pose_noise_deg)
    search_s = clock_search_s if recording.clock == "own" else 0.0
    where, place = f"{recording.source}: /robot", f"{recording.source}: /profiles"
    cause = f": frame {marks.rejected[0].frame}: {marks.rejected[0].cause}" if marks.rejected else ""
    if not len(marks.frame):
        raise InputError(place, f"no frame shows the {target.removesuffix('s')}{cause}")
    part, frames = part_of(recording, marks, target, noise, sensor_scale_u, search_s)
    check_postures(part.flange.at(0.0), place, part.what, cause)
    x_mm, z_mm = marks.point_mm.reshape(-1, 2).T
    view = view_of_points(x_mm, z_mm, np.array([[*part.middle_mm, 0.0]]))
    demand = Demand(view, max_u_mm, where)
    best, alone = located(part, recording.flange_from_profiler, demand, NO_SUCH, ASK)
    covariance = best.covariance
    demand.refuse(undetermined(part, best.at, covariance, demand))
    words = ("the hand-eye pose", "add postures that turn about another axis")
    verdict = serves(
        covariance[:6, :6],
        best.at.pose.rotation,
        view,
        bevel_deg,
        (root_tolerance_mm, bevel_tolerance_deg),
        words,
    )
    warned = pose_warnings(best.at.pose, recording.flange_from_profiler)
    warned += noisy(best, "the lines", "a part that moved or is not flat, a systematic robot error, or a wrong noise")
    left_out = np.flatnonzero(~best.used).tolist()
    if left_out:
        named = ", ".join(str(frames[k]) for k in left_out[:12])
        warned += (f"{len(left_out)} of {len(frames)} profiles left out: all others contradict them (frames {named})",)
    if not alone:
        warned += ("a second answer fits nearly as well: turn the flange about another axis",)
    of_pose, first = covariance[:6, :6], covariance.shape[0] - 2 - part.with_offset
    eye = hand_eye_of(best.at.pose, of_pose, view, recording, Sensor(np.zeros(2), part.middle_mm))
    clock = (best.at.pose.offset_s, np.sqrt(covariance[-1, -1])) if part.with_offset else None
    residual = np.sqrt(np.mean(best.rows.residual[best.used] ** 2))
    more = {
        "sensor_scale_u": np.sqrt(np.diagonal(covariance)[first : first + 2]),
        **dict(zip(("time_offset_s", "time_offset_u_s"), clock or (), strict=False)),
        "residual_rms_mm": residual,
        "method": part.target,
        "frames_used": np.delete(frames, left_out),
        "warnings": warned,
    }
    gross = [Rejected(int(frames[k]), "all other profiles contradict it") for k in left_out]
    document = hand_eye_file(eye, recording.part, verdict, [*part.marks.rejected, *gross], more)
    facts = [*pose_facts(eye, clock), ("Distance from the faces, RMS", f"{residual:.3f} mm")]
    html = "\n".join(
        (
            pieces.facts_html(facts),
            pieces.paragraph(f"{sentence(verdict[1])} {fit_words(best)}"),
            directions_html(directions(of_pose, best.at.pose, view)),
        )
    )
    summary = f"Predicted error over the field of view {eye.volume_u_mm:.3f} mm (standard uncertainty); {verdict[1]}."
    chapter = Chapter("Hand-eye calibration", html, summary=summary, part=recording.part, warnings=warned)
    return eye, document, chapter
