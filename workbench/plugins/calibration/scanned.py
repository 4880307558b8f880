"""Where a sphere stands in the base, by a hand-eye pose that is known: what a marker or a reference is, if scanned."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from workbench.api import Float, HandEye, HandEyeFile, InputError, InputFile, Recording, Shaped, estimator
from workbench.plugins.calibration.model import Ball, Estimate, Noise, Sphere, linearise, to_base
from workbench.plugins.calibration.observations import Observations, by_pass
from workbench.plugins.calibration.values import SphereProfiles
from workbench.plugins.calibration.verdicts import rescaled, sensor_of

LEAST_POSTURES = 3  # of a sphere: one circle does not tell its side of the laser plane, and a third one checks two
UNSAID = "nobody says how well the hand-eye pose is known"
BELIEVED = "the hand-eye pose is believed: give a handeye.json with its covariance, for what it is off is in the result"


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """A sphere's centre in the base."""

    center_mm: Shaped[Float, " 3"]
    covariance: Shaped[Float, "3 3"]  # of profiles and robot
    by_hand_eye: Shaped[Float, "3 6"]  # its change with the hand-eye pose, as HandEye.covariance counts


def known_hand_eye(path: InputFile | None, recording: Recording) -> HandEye:
    """The pose from a handeye.json, or the recording's own, of which nobody says how well it is known.

    Raises:
        InputError: there is none, or it is no rigid motion.
    """
    if path is None:
        if recording.flange_from_profiler is None:
            raise InputError(f"{recording.source}: /hand_eye", "missing, and no handeye.json is given (hand_eye)")
        return HandEye(recording.flange_from_profiler, source=recording.source)
    return HandEyeFile.hand_eye(path)


def seen_by(hand_eye: HandEye, profiles: SphereProfiles, recording: Recording) -> Observations:
    """The circles of a recording's postures, the errors of the profiler's scales taken out."""
    seen = by_pass(rescaled(profiles, recording, sensor_of(hand_eye)), recording).place()
    if seen.scans:
        raise InputError(f"{recording.source}: /robot", "expected postures held still (one pose a pass)")
    return seen


def sphere_place(hand_eye: HandEye, seen: Observations, noise: Noise, where: str) -> Place:
    """Maximum likelihood of the centre, and of the radius with its prior; larger residuals make a larger covariance.

    Raises:
        InputError: too few postures see it.
    """
    if len(seen) < LEAST_POSTURES:
        raise InputError(where, f"expected {LEAST_POSTURES} postures or more that see the sphere, found {len(seen)}")
    pose = hand_eye.flange_from_profiler
    at = start_center(Estimate(pose[:3, :3], pose[:3, 3], np.zeros(3), noise.radius_mm), seen, noise)
    found = estimator.fit(Ball(seen, noise), at)
    by_pose = Sphere(seen, noise).rows(found.at).jacobian[..., :6]
    return Place(found.at.center_mm, found.covariance[:3, :3], -found.carried(by_pose)[:3])


def start_center(estimate: Estimate, seen: Observations, noise: Noise) -> Estimate:
    """Where a sphere stood, roughly: of all frames and both signs of y the centre that fits all best."""
    h = np.sqrt(np.maximum(noise.radius_mm**2 - seen.circle[:, 2], 0.0))
    best: tuple[float, Estimate] | None = None
    for sign in (1.0, -1.0):
        centre = np.stack([seen.circle[:, 0], sign * h, seen.circle[:, 1]], axis=1)
        for point in to_base(centre, estimate, seen):
            one = dataclasses.replace(estimate, center_mm=point, radius_mm=noise.radius_mm)
            off = np.median(np.linalg.norm(linearise(one, seen, noise).residual[:, :2], axis=1))
            if best is None or off < best[0]:
                best = float(off), one
    assert best is not None
    return best[1]
