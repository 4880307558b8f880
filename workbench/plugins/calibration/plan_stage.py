"""`calibrate.plan`: the next postures of the flange that tell most about the hand-eye pose.

The choice is D-optimal on the predicted information of that pose. Every candidate posture adds
J^T (C_fit + H S H^T)^-1 J to the information of the ten unknowns. Those are chosen whose sum has the largest
determinant once the sphere's centre and radius are eliminated (D_s-optimality), one after the other and then by
exchange (Fedorov, Theory of Optimal Experiments, 1972).
"""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field
from scipy.spatial.transform import Rotation

from workbench.api import (
    DEG,
    Document,
    Float,
    InputError,
    InputFile,
    Recording,
    Seed,
    frozen,
    pose_from,
    quaternion_from_rotation,
    rotation_from_vector,
    stage,
)
from workbench.plugins.calibration.model import POSE, Estimate, Noise, Sphere, linearise, volume_weight
from workbench.plugins.calibration.observations import Observations, by_pass, from_arrays
from workbench.plugins.calibration.tables import POSE as POSE_COLUMNS
from workbench.plugins.calibration.values import Calibration, PosturePlan, SphereProfiles
from workbench.plugins.calibration.verdicts import rescaled, sensor_of
from workbench.plugins.csv_table import csv_bytes
from workbench.plugins.design import chosen
from workbench.plugins.ranges import SizeMm

OFF_PLANE = (0.3, 0.7)  # |y| of the sphere's centre, in radii: beyond, an error may miss it
EXCHANGES = 4  # rounds over the chosen postures
AT_LIMIT = 0.6  # share of candidates that lie on a limit, where the best ones are
CANDIDATES = 800
FEW = 20  # candidates that the robot must reach


Pair = tuple[float, float]


def candidate_postures(
    nominal: Float, turn: Pair, middle_mm: Pair, half_mm: Pair, estimate: Estimate, rng: np.random.Generator
) -> tuple[Float, Float]:
    """Random postures within limits, most of them on one: flange poses (c, 4, 4), sphere centres (c, 3).

    Args:
        nominal: orientation (3, 3), base from profiler.
        turn: greatest tilt of the range axis from it, and greatest turn about the range axis, rad.
        middle_mm: of the view: x, z.
        half_mm: half its width and height.
        estimate: of the hand-eye pose, and of the sphere.
        rng: draws them.
    """
    radius, count = estimate.radius_mm, CANDIDATES
    way, tilt = rng.uniform(0, 2 * np.pi, count), turn[0] * np.sqrt(_to_limit(rng, count))
    roll = _two_sided(turn[1], rng, count)
    low, high = OFF_PLANE
    y = radius * (low + (high - low) * _to_limit(rng, count)) * _sign(rng, count)
    x, z = (m + _two_sided(h, rng, count) for m, h in zip(middle_mm, half_mm, strict=True))
    centre = np.stack([x, y, z], axis=1)
    tilted = rotation_from_vector(np.column_stack([tilt * np.cos(way), tilt * np.sin(way), np.zeros(count)]))
    rotated = tilted @ rotation_from_vector(roll[:, None] * np.eye(3)[2])
    flange = nominal @ rotated @ estimate.rotation.T
    lever = centre @ estimate.rotation.T + estimate.translation_mm
    return pose_from(flange, estimate.center_mm - (flange @ lever[..., None])[..., 0]), centre


def information_gains(
    base_from_flange: Float, centre: Float, estimate: Estimate, noise: Noise, profiles: SphereProfiles
) -> Float:
    """Information (c, 10, 10) that each posture adds: its circle is as sure as the one seen of the nearest size."""
    w = estimate.radius_mm**2 - centre[:, 1] ** 2
    alike = np.abs(w[:, None] - profiles.circle[:, 2]).argmin(axis=1)
    circle = np.stack([centre[:, 0], centre[:, 2], w], axis=1)
    linear = linearise(estimate, from_arrays(circle, profiles.covariance[alike], base_from_flange), noise)
    J = linear.jacobian
    return np.asarray(J.mT @ np.linalg.solve(linear.covariance, J))


def determinant(information: Float) -> Float:
    """Logarithm of the determinant (...) of the hand-eye pose's information, centre and radius eliminated."""
    rest = information[..., POSE:, POSE:]
    return np.asarray(np.linalg.slogdet(information)[1] - np.linalg.slogdet(rest)[1])


def chosen_postures(gain: Float, start: Float, count: int, exchanges: int) -> list[int]:
    """`count` postures that together add most to `start` (10, 10), in the order in which they were chosen."""

    def best(taken: list[int]) -> int:
        score = determinant(start + gain[taken].sum(axis=0) + gain)
        score[taken] = -np.inf
        return int(score.argmax())

    return chosen(best, lambda taken: len(taken) == count, exchanges)


def _to_limit(rng: np.random.Generator, count: int) -> Float:
    """Shares of a limit (count,): 1 for most, the rest evenly between 0 and 1."""
    return np.where(rng.random(count) < AT_LIMIT, 1.0, rng.random(count))


def _sign(rng: np.random.Generator, count: int) -> Float:
    return rng.choice([-1.0, 1.0], count)


def _two_sided(limit: float, rng: np.random.Generator, count: int) -> Float:
    return limit * _to_limit(rng, count) * _sign(rng, count)


@stage("calibrate.plan")
def plan(
    calibration: Calibration,
    profiles: SphereProfiles,
    recording: Recording,
    *,
    postures: Annotated[int, Field(ge=1, le=50)] = 3,
    cone_deg: Annotated[float, Field(gt=0, le=80)] = 25.0,
    roll_deg: Annotated[float, Field(ge=0, le=180)] = 25.0,
    half_width_mm: SizeMm = 10.0,
    half_height_mm: SizeMm = 15.0,
    cell: InputFile | None = None,
    seed: Seed = 0,
) -> tuple[PosturePlan, Document]:
    """Propose the next postures: D-optimal on the predicted information, within the limits given.

    `calibration_plan.csv`: flange poses in order, and the uncertainty after each.

    Args:
        calibration: the calibration so far.
        profiles: its circles.
        recording: its flange poses.
        postures: how many to propose.
        cone_deg: greatest tilt of the range axis from the recording's mean orientation.
        roll_deg: greatest turn of the profiler about the range axis.
        half_width_mm: half the width of the view in which the sphere's centre is shown, in x.
        half_height_mm: half its height, in z, about the mean distance in the recording.
        cell: a robot cell: postures out of reach or joint limits are left out; collision is not checked.
        seed: of the candidates.

    Raises:
        InputError: the cell's robot reaches hardly any posture within the limits.

    Example:
        >>> from workbench import scan
        >>> from workbench.plugins import calibration
        >>> ball = scan.read(recording="data/synthetic/sphere.h5")
        >>> arcs = calibration.circles(ball)
        >>> pose, found, document = calibration.hand_eye(arcs, ball)
        >>> plan, table = calibration.plan(found, arcs, ball, postures=1)
        >>> len(plan.base_from_flange), table.name
        (1, 'calibration_plan.csv')
    """
    estimate, noise = estimate_of(calibration), calibration.noise
    mean = Rotation.from_quat(recording.robot_quaternion_wxyz, scalar_first=True).mean().as_matrix()
    x = float(np.nanmin(recording.x_mm) + np.nanmax(recording.x_mm)) / 2
    middle_mm = x, float(calibration.centre_mm[calibration.used, 2].mean())
    limits = (cone_deg * DEG, roll_deg * DEG), middle_mm, (half_width_mm, half_height_mm)
    seen = seen_again(calibration, profiles, recording).subset(calibration.used)
    known = Sphere(seen, noise).rows(estimate).normal().information
    flange, centre = candidate_postures(mean @ estimate.rotation, *limits, estimate, np.random.default_rng(seed))
    if cell is not None:
        from workbench.api import inverse_kinematics, read_cell, within_limits

        chain = read_cell(cell).chain
        joints = within_limits(chain, inverse_kinematics(chain, flange))
        reached = np.isfinite(joints).all(axis=-1).any(axis=-1)
        if reached.sum() < FEW:
            raise InputError(
                str(cell),
                f"the robot reaches {reached.sum()} of {len(flange)} postures within the limits of "
                "the plan: widen cone_deg or roll_deg, or move the sphere",
            )
        flange, centre = flange[reached], centre[reached]
    gain = information_gains(flange, centre, estimate, noise, profiles)
    together = np.array(chosen_postures(gain, known, postures, EXCHANGES))
    which = together[chosen_postures(gain[together], known, postures, 0)]  # the most useful first
    weight = volume_weight(estimate.rotation, calibration.view)
    totals = known + np.concatenate([np.zeros((1, 10, 10)), np.cumsum(gain[which], axis=0)])
    volume = np.sqrt(np.einsum("ij,kji->k", weight, np.linalg.inv(totals)[:, :POSE, :POSE]))
    scale = calibration.volume_u_mm / volume[0]  # the model tells gains; where the calibration stands, it says itself
    found = PosturePlan(
        base_from_flange=frozen(flange[which]),
        centre_mm=frozen(centre[which]),
        volume_u_mm=frozen(scale * volume),
        middle_mm=middle_mm,
        half_mm=(half_width_mm, half_height_mm),
    )
    head = ["posture", *POSE_COLUMNS, "sphere_x_mm", "sphere_y_mm", "sphere_z_mm", "volume_u_after_mm"]
    quaternion, rows = quaternion_from_rotation(found.base_from_flange[:, :3, :3]), []
    for i, pose in enumerate(found.base_from_flange):
        values = [*(f"{v:.3f}" for v in pose[:3, 3]), *(f"{v:.8f}" for v in quaternion[i])]
        rows.append([i + 1, *values, *(f"{v:.2f}" for v in found.centre_mm[i]), f"{found.volume_u_mm[i + 1]:.4f}"])
    return found, Document("calibration_plan.csv", csv_bytes(head, rows))


def estimate_of(calibration: Calibration) -> Estimate:
    """The calibration as a point in the space of unknowns."""
    pose, center_mm = calibration.hand_eye.flange_from_profiler, calibration.sphere_center_mm
    offset_s = calibration.time_offset_s or 0.0
    return Estimate(pose[:3, :3], pose[:3, 3], center_mm, calibration.sphere_radius_mm, offset_s)


def seen_again(calibration: Calibration, profiles: SphereProfiles, recording: Recording) -> Observations:
    """Circles joined with the flange's poses, by the scales and the clock that the calibration has found."""
    seen = by_pass(rescaled(profiles, recording, sensor_of(calibration.hand_eye)), recording)
    return seen.place(calibration.time_offset_s or 0.0)
