"""Where a sphere stands in the base, by a hand-eye pose that is known: what a marker or a reference is, if scanned."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from workbench.api import Float, HandEye, HandEyeFile, InputError, InputFile, Recording, Shaped, estimator
from workbench.plugins.calibration.model import Estimate, Noise, Sphere, linearise, to_base
from workbench.plugins.calibration.observations import Observations, by_pass
from workbench.plugins.calibration.values import SphereProfiles
from workbench.plugins.calibration.verdicts import rescaled, sensor_of

LEAST_POSTURES = 3  # of a sphere: one circle does not tell its side of the laser plane, and a third one checks two
UNUSED = "expected scanned spheres, which hand_eye is for, found typed places: give {}, or leave hand_eye out"
UNSAID = "nobody says how well the hand-eye pose is known"
BELIEVED = "the hand-eye pose is believed: give a handeye.json with its covariance, for what it is off is in the result"


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Centres of p spheres in the base."""

    center_mm: Shaped[Float, "p 3"]
    covariance: Shaped[Float, "p 3 3"]  # of profiles and robot, mm^2
    shared: Shaped[Float, "p 3 q"]  # what errors of the hand-eye pose move them by, a standard deviation of each


class Scanner:
    """A profiler whose hand-eye pose is known, and the spheres that it has seen."""

    def __init__(
        self, profiles: SphereProfiles, recording: Recording, path: InputFile | None, pose: tuple[float, float]
    ) -> None:
        """By a handeye.json, or the recording's own pose; `pose`: noise of the flange, mm and deg.

        Raises:
            InputError: there is no hand-eye pose, or it is no rigid motion, or of another sensor or robot; the robot
                moved.
        """
        if path is not None:
            self.eye = HandEyeFile.hand_eye(path, recording.part)
        elif recording.flange_from_profiler is not None:
            self.eye = HandEye(recording.flange_from_profiler, source=recording.source)
        else:
            raise InputError(f"{recording.source}: /hand_eye", "missing, and no handeye.json is given (hand_eye)")
        self.radius_mm = profiles.sphere_diameter_mm / 2.0
        self.noise = Noise(*pose, self.radius_mm)
        self.seen = by_pass(rescaled(profiles, recording, sensor_of(self.eye)), recording)
        if self.seen.here.scans:
            raise InputError(f"{recording.source}: /robot", "expected postures held still (one pose a pass)")
        self.passes = np.array([recording.pass_index[frames[0]] for frames in self.seen.frames])

    @property
    def warnings(self) -> tuple[str, ...]:
        """Of a pose of which nobody says how well it is known."""
        return (BELIEVED,) if self.eye.covariance is None else ()

    def places(self, groups: Sequence[Float], where: Sequence[str]) -> Places:
        """Maximum likelihood of the sphere that each group of passes shows; of its radius with the prior too.

        Larger residuals make a larger covariance.

        Raises:
            InputError: too few postures see it.
        """
        pose, spread = self.eye.flange_from_profiler, self.eye.covariance
        own = np.zeros((6, 0)) if spread is None else np.linalg.cholesky(spread)
        known = Estimate(pose[:3, :3], pose[:3, 3], np.zeros(3), self.radius_mm)
        as_certain = known, np.eye(6) / np.finfo(float).eps  # the pose stays
        found = []
        for passes, line in zip(groups, where, strict=True):
            seen = self.seen.subset(np.isin(self.passes, passes))
            if len(seen) < LEAST_POSTURES:
                said = f"expected {LEAST_POSTURES} postures or more that see the sphere, found {len(seen)}"
                raise InputError(line, said)
            begun = start_center(known, seen, self.noise)
            found.append(estimator.fit(Sphere(seen, self.noise, as_certain), begun))
        carried = [-one.carried(one.rows.jacobian[..., :6])[6:9] for one in found]
        centers, covariances = [one.at.center_mm for one in found], [one.covariance[6:9, 6:9] for one in found]
        return Places(np.array(centers), np.array(covariances), np.array(carried) @ own)


def start_center(estimate: Estimate, seen: Observations, noise: Noise) -> Estimate:
    """Where a sphere stood, roughly: of all frames and both signs of y the centre that fits all best."""
    h = np.sqrt(np.maximum(noise.radius_mm**2 - seen.circle[:, 2], 0.0))
    centres = [np.stack([seen.circle[:, 0], sign * h, seen.circle[:, 1]], axis=1) for sign in (1.0, -1.0)]
    points = np.concatenate([to_base(centre, estimate, seen) for centre in centres])
    tried = [replace(estimate, center_mm=point, radius_mm=noise.radius_mm) for point in points]
    off = [np.linalg.norm(linearise(one, seen, noise).residual[:, :2], axis=1) for one in tried]
    return tried[int(np.median(off, axis=1).argmin())]
