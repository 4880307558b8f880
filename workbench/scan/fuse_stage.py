"""`scan.fuse`: every profile placed in the robot base by the pose at its own time (the paper's section 4.1)."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from workbench.artefacts import Cloud, HandEye, Recording
from workbench.checks import Limits, judged, refuse_failed
from workbench.errors import InputError
from workbench.geometry.poses import interpolate_poses, rotation_from_quaternion, vector_from_rotation
from workbench.scan.checks import read_hand_eye, recorded_hand_eye
from workbench.stage import InputFile, stage
from workbench.units import Bool, Float, Float32

SPARSE_MM = 2.0  # of way between recorded poses, from which on their errors do not average over 4 mm (geometry.curves)
TWO_SIGMA = 0.97725  # probability below two standard deviations


@stage("scan.fuse")
def fuse(
    recording: Recording,
    *,
    hand_eye: InputFile | None = None,
    scan_plan: InputFile | None = None,
    limits: Limits = {},  # noqa: B006  (never changed)
) -> Cloud:
    """Place every profile in the robot base: the paper's equation (9), with one pose a frame (docs/conventions.md).

    The cloud keeps the scanner's grid, without copied frames, copied passes and columns that measured nothing. A
    recording that contradicts itself is refused (docs/checks.md).

    Args:
        recording: profiles and flange poses on one clock.
        hand_eye: a `handeye.json` to use instead of the recording's own calibration.
        scan_plan: the `scan-plan.json` that was to be followed; departures are among the checks.
        limits: limits of checks by name (docs/checks.md).

    Raises:
        InputError: no calibration, an improper one, or one of another sensor or robot; a recording on the profiler's
            own clock, or one that fails a check. PipelineError: `limits` names no check.

    Example:
        >>> from workbench.scan import fuse, read
        >>> cloud = fuse(read(recording="data/synthetic/milled_edge.h5"))
        >>> cloud.points_mm.round(1)[0].tolist()
        [1445.2, -308.7, 734.5]
    """
    if recording.clock == "own":
        raise InputError(f"{recording.source}: /profiles", "expected times on the robot's clock, found clock 'own'")
    calibration = recorded_hand_eye(recording) if hand_eye is None else read_hand_eye(hand_eye, recording.part)
    part = dataclasses.replace(
        recording.part,
        hand_eye=hand_eye.name if hand_eye else "the recording's own",
        hand_eye_calibrated_at=calibration.calibrated_at,
        hand_eye_u_mm=calibration.volume_u_mm,
    )
    checks, once = judged(recording, calibration.flange_from_profiler, limits)
    refuse_failed(checks, recording.source)
    recording = pass_after_pass(once)
    cloud = Cloud(
        x_mm=_true(recording.x_mm, calibration, 0),
        z_mm=_true(recording.z_mm, calibration, 1),
        keep=_returns(recording),
        base_from_profiler=flange_poses(recording) @ calibration.flange_from_profiler,
        time_s=recording.time_s,
        pass_index=recording.pass_index,
        hand_eye_covariance=calibration.covariance,
        flange_from_profiler=calibration.flange_from_profiler,
        recorded_flange_from_profiler=recording.flange_from_profiler,
        source=recording.source,
        part=part,
        checks=checks,
        sparse_poses_u=sparse_poses_u(recording),
        only_end_poses=bool((np.unique(recording.robot_pass, return_counts=True)[1] <= 2).any()),
        intensity=recording.intensity,
    )
    if scan_plan is None:
        return cloud
    from workbench.result_files.scan_plan import plan_id  # pydantic: loaded when there is a plan
    from workbench.scan.followed import followed

    departures, some = followed(cloud, scan_plan)
    if some:
        part = dataclasses.replace(part, scan_plan=part.scan_plan or plan_id(scan_plan.read_bytes()))
    return dataclasses.replace(cloud, part=part, checks=(*checks, departures))


def sparse_poses_u(recording: Recording) -> tuple[float, float]:
    """Standard uncertainty of what lies between recorded poses that stand far apart: of a place, mm, of a turn, rad.

    Where they stand near to each other their errors average along the edge, and 0 is returned (eq. (15a)).
    """
    place, turn = 0.0, 0.0
    for number in np.unique(recording.robot_pass):
        here = recording.robot_pass == number
        position, quaternion = recording.robot_position_mm[here], recording.robot_quaternion_wxyz[here]
        way = np.gradient(position, axis=0) if len(position) > 2 else np.zeros((1, 3))
        step = np.linalg.norm(way, axis=1, keepdims=True)
        if np.median(step) <= SPARSE_MM:
            continue
        way /= np.maximum(step, SPARSE_MM)
        turns = rotation_from_quaternion(quaternion)
        steps = vector_from_rotation(turns[1:] @ np.swapaxes(turns[:-1], 1, 2))
        rotation = np.concatenate([np.zeros((1, 3)), np.cumsum(steps, axis=0)])  # of a ring more than half a turn
        place, turn = max(place, _between(position, way, 2)), max(turn, _between(rotation, 0.0 * way, 3))
    return place, turn


def _between(value: Float, way: Float, axes: int) -> float:
    """Standard uncertainty, each of `axes`, of a value between its neighbours (k, 3); along `way` (k, 3) none counts.

    White errors sigma, or a course with waves shorter than the poses tell, have fourth differences of sqrt(70) sigma;
    a course that bends smoothly leaves the chord by an eighth of its second difference, sqrt(8 / 15) of it rms.
    """

    from scipy.special import stdtrit  # a sixth of the processor time of a start, for poses that stand far apart alone

    def across(order: int) -> float:
        off = np.diff(value, order, axis=0)
        along = way[order // 2 : len(way) - order // 2]
        off = off - (off * along).sum(axis=1, keepdims=True) * along  # along the way only the speed changes
        return float(np.sqrt((off**2).sum(axis=1).mean() / axes))

    second = across(2)
    scatter = across(4) / math.sqrt(70.0) if len(value) > 4 else second / math.sqrt(6.0)
    freedom = axes * (len(value) - (4 if len(value) > 4 else 2))
    few = float(stdtrit(freedom, TWO_SIGMA)) / 2.0  # so that 2 u cover as much, however few they are
    return few * math.hypot(scatter, second / 8.0 * math.sqrt(8.0 / 15.0))


def _true(measured_mm: Float32, calibration: HandEye, axis: int) -> Float32:
    """Coordinates by the scale that a calibration found: themselves, unless it found another than the sensor's own."""
    scale, middle = calibration.sensor_scale[axis], calibration.sensor_middle_mm[axis]
    return measured_mm if scale == 1.0 else (middle + (measured_mm - middle) / scale).astype(np.float32)


def pass_after_pass(recording: Recording) -> Recording:
    """The recording with the frames of each pass together, in the order of first appearance; itself if they are."""
    _, first, inverse = np.unique(recording.pass_index, return_index=True, return_inverse=True)
    rank = first[inverse]
    if (np.diff(rank) >= 0).all():
        return recording
    order = np.argsort(rank, kind="stable")
    return dataclasses.replace(
        recording,
        time_s=recording.time_s[order],
        x_mm=recording.x_mm[order],
        z_mm=recording.z_mm[order],
        pass_index=recording.pass_index[order],
        intensity=None if recording.intensity is None else recording.intensity[order],
    )


def flange_poses(recording: Recording) -> Float:
    """base_from_flange (N, 4, 4) at each frame's time, interpolated within its pass; a single pose holds.

    Raises:
        InputError: a frame's time lies outside its pass's poses, which no reader lets through.
    """
    base_from_flange = np.empty((len(recording.time_s), 4, 4))
    for number in np.unique(recording.pass_index):
        frames = recording.pass_index == number
        poses = recording.robot_pass == number
        time, known = recording.time_s[frames], recording.robot_time_s[poses]
        if len(known) > 1 and not (known[0] <= time.min() and time.max() <= known[-1]):
            expected = f"expected its frames within its poses' times {known[0]:.6g} to {known[-1]:.6g} s, "
            raise InputError(
                f"{recording.source}: pass {number}", expected + f"found {time.min():.6g} to {time.max():.6g} s"
            )
        base_from_flange[frames] = interpolate_poses(
            time, known, recording.robot_position_mm[poses], recording.robot_quaternion_wxyz[poses]
        )
    return base_from_flange


def _returns(recording: Recording) -> Bool:
    from workbench.geometry import grids  # compiled code: loaded when there is something to fuse

    return grids.returns(recording.x_mm, recording.z_mm)
