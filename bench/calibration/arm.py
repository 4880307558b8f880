"""A robot whose joint offsets and lengths are off, seen by a tracker and with a sphere: what is found, and how well.

The chain here is multiplied out by matrix exponentials of its own, and the bound is by differences of its predictions:
both share nothing with `calibrate.robot` and `calibrate.tracker`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from bench.bounds import cramer_rao
from bench.calibration.faces import TRUE
from bench.calibration.sphere_truth import circles_of
from bench.harness import ROOT
from workbench.api import DEG, Chain, Float, estimator, inverse_kinematics, pose_from, read_cell
from workbench.plugins.calibration.arm_errors import ArmErrors, arm_errors
from workbench.plugins.calibration.model import Estimate, Noise
from workbench.plugins.calibration.observations import from_arrays
from workbench.plugins.calibration.robot_stage import together
from workbench.plugins.calibration.tracker_stage import Readings, Tracking

CELL = ROOT / "data" / "robot" / "cell.json"
CENTER, RADIUS_MM = np.array([1890.33, 241.48, 1079.72]), 5.0
NOMINAL = Rotation.from_euler("ZYX", [20.0, 65.0, 10.0], degrees=True)
TARGETS_MM = np.array([[200.0, 50.0, 100.0], [-100.0, 150.0, 120.0], [0.0, -180.0, 300.0]])
TRACKER_MM, POSE_MM, POSE = 0.02, 0.05, 0.005 * DEG  # noise of a reading and of the robot
MOST_OFF_PLANE_MM = 4.3  # of a sphere of 5 mm
STEP = 1e-4  # of the differences, in prior standard deviations


@dataclass(frozen=True)
class Arm:
    """The shipped robot, its possible errors, and the true ones."""

    chain: Chain
    errors: ArmErrors
    x: Float  # (P,)


def draw(rng: np.random.Generator, tilt: float = 0.0) -> Arm:
    """A robot built as its priors say, its axes' tilts among them where their u, rad, is above 0."""
    chain = read_cell(CELL).chain
    errors = arm_errors(chain, tilt=tilt)
    return Arm(chain, errors, rng.normal(size=len(errors)) * errors.prior)


def flange(arm: Arm, x: Float, joints: Float) -> Float:
    """`base_from_flange` (n, 4, 4) of the robot with the errors x."""
    pose = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
    for k in range(6):
        for p in np.flatnonzero(arm.errors.before == k):
            pose = pose @ _exp(arm.errors.twist[p] * x[p])
        axis, point = arm.chain.axes[k], arm.chain.points_mm[k]
        turn = Rotation.from_rotvec(joints[:, k : k + 1] * axis).as_matrix()
        pose = pose @ pose_from(turn, point - turn @ point)
    return np.asarray(pose @ arm.chain.base_from_flange_at_zero)


def _exp(twist: Float) -> Float:
    matrix = np.zeros((4, 4))
    matrix[:3, :3], matrix[:3, 3] = np.cross(np.eye(3), twist[3:]), twist[:3]
    return np.asarray(expm(matrix))


def _moved(rng: np.random.Generator, poses: Float) -> Float:
    """Poses as the robot repeats them."""
    turn = Rotation.from_rotvec(rng.normal(size=(len(poses), 3)) * POSE).as_matrix()
    return pose_from(poses[:, :3, :3] @ turn, poses[:, :3, 3] + rng.normal(size=(len(poses), 3)) * POSE_MM)


def tracked(rng: np.random.Generator, arm: Arm) -> tuple[Float, Float, Float]:
    """Joints (n, 6) rad, and places (n, 3, 3) of the three targets in the tracker's frame, and that frame (4, 4)."""
    reach = np.array([90, 40, 40, 120, 100, 150]) * DEG
    joints = rng.uniform(-1, 1, (32, 6)) * reach + np.array([0, 10, 0, 0, 0, 0]) * DEG
    frame = pose_from(Rotation.random(random_state=int(rng.integers(2**31))).as_matrix(), rng.normal(size=3) * 2000)
    places = _places(frame, TARGETS_MM, _moved(rng, flange(arm, arm.x, joints)))
    return joints, places + rng.normal(size=places.shape) * TRACKER_MM, frame


def _places(frame: Float, targets: Float, poses: Float) -> Float:
    in_base = np.einsum("nij,kj->nki", poses[:, :3, :3], targets) + poses[:, None, :3, 3]
    return np.asarray(in_base @ frame[:3, :3].T + frame[:3, 3])


def sphere(rng: np.random.Generator, arm: Arm) -> tuple[Float, Float, Float, Float]:
    """Joints (n, 6), recorded poses (n, 4, 4), sphere centres (n, 3) in the profiler frame, and in the base (3,)."""
    postures, many = 36, 144
    turns = (Rotation.from_rotvec(rng.uniform(-1, 1, (many, 3)) * 35 * DEG) * NOMINAL).as_matrix()
    aside = rng.uniform(1.5, 3.5, many) * rng.choice([-1.0, 1.0], many)
    centre = np.column_stack([rng.uniform(-10, 10, many), aside, rng.uniform(-15, 15, many)])
    wanted = pose_from(turns, CENTER - np.einsum("kij,kj->ki", turns, centre @ TRUE[:3, :3].T + TRUE[:3, 3]))
    joints = inverse_kinematics(arm.chain, wanted)[:, 0]
    reached = np.isfinite(joints).all(axis=1)
    joints, recorded, centre = joints[reached], wanted[reached], centre[reached]
    true = flange(arm, arm.x, joints)
    at = np.einsum("nij,nj->ni", (true @ TRUE)[:, :3, :3], centre) + (true @ TRUE)[:, :3, 3]
    ball = np.median(at, axis=0)  # set where the robot finds it
    shown = _seen_at(_moved(rng, true), TRUE, ball)
    good = np.flatnonzero(np.abs(shown[:, 1]) < MOST_OFF_PLANE_MM)[:postures]
    return joints[good], recorded[good], shown[good], ball


def _seen_at(poses: Float, hand_eye: Float, ball: Float) -> Float:
    profiler = poses @ hand_eye
    return np.asarray(np.einsum("nji,nj->ni", profiler[:, :3, :3], ball - profiler[:, :3, 3]))


def one_tracked(seed: int, tilt: float = 0.0) -> tuple[Float, Float, Float]:
    """Errors (P,) of the arm's parameters, their stated covariance and the bound."""
    rng = np.random.default_rng([seed, 0x7AC])
    arm = draw(rng, tilt)
    joints, places, frame = tracked(rng, arm)
    each = np.repeat(joints, 3, axis=0)
    target = np.tile(np.arange(3), len(joints))
    lines = tuple(range(len(each)))
    seen = Readings(flange(arm, 0 * arm.x, each), each, target, places.reshape(-1, 3), ("a", "b", "c"), lines)
    tracking = Tracking(seen, arm.chain, arm.errors, (TRACKER_MM, POSE_MM, POSE))
    found = estimator.fit(tracking, tracking.begun())

    def predict(step: Float) -> Float:
        moved = pose_from(Rotation.from_rotvec(step[3:6]).as_matrix() @ frame[:3, :3], frame[:3, 3] + step[:3])
        return _places(moved, TARGETS_MM + step[6:15].reshape(3, 3), flange(arm, arm.x + step[15:], joints))

    poses, blocks = flange(arm, arm.x, joints), []
    for pose in poses:
        lever = np.concatenate([pose[:3, :3] @ np.cross(np.eye(3), -point) for point in TARGETS_MM]) * POSE
        shift = np.tile(np.eye(3), (3, 1)) * POSE_MM
        turn = np.kron(np.eye(3), frame[:3, :3])
        shared = turn @ np.concatenate([shift, lever], axis=1)
        blocks.append(TRACKER_MM**2 * np.eye(9) + shared @ shared.T)
    scale = np.concatenate([np.full(3, 1.0), np.full(3, 1e-3), np.full(9, 1.0), arm.errors.prior])
    prior = np.concatenate([np.zeros(15), arm.errors.prior**-2])
    return (
        found.at.errors - arm.x,
        found.covariance[15:, 15:],
        cramer_rao(predict, STEP * scale, blocks, prior)[15:, 15:],
    )


def one_sphere(seed: int, tilt: float = 0.0) -> tuple[Float, Float, Float]:
    """The same for a sphere; before the arm's parameters the hand-eye pose (6): translation, rotation."""
    rng = np.random.default_rng([seed, 0x5F])
    arm = draw(rng, tilt)
    joints, recorded, centre, ball = sphere(rng, arm)
    circle, spread = circles_of(rng, centre, RADIUS_MM)
    noise = Noise(POSE_MM, POSE / DEG, RADIUS_MM, 0.05)
    off = np.concatenate([rng.normal(size=3), rng.normal(size=3) * 0.3 * DEG])
    start = Estimate(Rotation.from_rotvec(off[3:]).as_matrix() @ TRUE[:3, :3], TRUE[:3, 3] + off[:3], ball, RADIUS_MM)
    found = together(start, from_arrays(circle, spread, recorded), joints, noise, arm.chain, arm.errors)

    def shown(step: Float) -> Float:
        hand_eye = pose_from(Rotation.from_rotvec(step[3:6]).as_matrix() @ TRUE[:3, :3], TRUE[:3, 3] + step[:3])
        at = _seen_at(flange(arm, arm.x + step[10:], joints), hand_eye, ball + step[6:9])
        return np.column_stack([at[:, 0], at[:, 2], (RADIUS_MM + step[9]) ** 2 - at[:, 1] ** 2])

    poses, blocks = flange(arm, arm.x, joints), []
    for pose, own, at in zip(poses, spread, centre, strict=True):
        to_circle = np.array([[1, 0, 0], [0, 0, 1], [0, -2 * at[1], 0]])
        there = pose[:3, :3].T @ (ball - pose[:3, 3])
        by_pose = np.concatenate(
            [-(pose @ TRUE)[:3, :3].T * POSE_MM, TRUE[:3, :3].T @ -np.cross(np.eye(3), there) * POSE], axis=1
        )
        blocks.append(own + to_circle @ by_pose @ by_pose.T @ to_circle.T)
    scale = np.concatenate([np.full(3, 1.0), np.full(3, 1e-3), np.full(4, 1.0), arm.errors.prior])
    prior = np.concatenate([np.zeros(9), [0.05**-2], arm.errors.prior**-2])
    turned = Rotation.from_matrix(TRUE[:3, :3] @ found.at.estimate.rotation.T).as_rotvec()
    error = np.concatenate([found.at.estimate.translation_mm - TRUE[:3, 3], -turned, found.at.errors - arm.x])
    keep = np.r_[0:6, 10 : 10 + len(arm.x)]
    lowest = cramer_rao(shown, STEP * scale, blocks, prior)
    return error, found.covariance[np.ix_(keep, keep)], lowest[np.ix_(keep, keep)]
