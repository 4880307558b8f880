"""The true answer of a simulated calibration: errors over the field of view, and the Cramer-Rao bound.

Written apart from the calibration itself, and nothing is shared with it.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from bench.bounds import cramer_rao, differences
from workbench.geometry.poses import pose_from, rotation_from_quaternion
from workbench.synthetic import SphereRecipe, SphereTruth
from workbench.synthetic.sphere import sphere_motion, true_poses
from workbench.units import Float

FIELD_MM = (16.0, 20.0)  # half width and half height of the field of view
STEEP = 0.95  # |x - x_c| / r beyond which no return is used
STEP = 1e-5  # of differences, mm and rad


@dataclass(frozen=True)
class Cell:
    """k postures: what is true. `turned` are true flange poses."""

    hand_eye: Float  # (4, 4)
    turned: Float  # (k, 4, 4)
    centre: Float  # (k, 3) of the sphere in the profiler frame
    radius_mm: float
    noise_mm: float  # of a point along z
    pitch_mm: float
    pose_mm: float
    pose_deg: float

    def only(self, which: Any) -> Cell:
        """Some of the postures."""
        return dataclasses.replace(self, turned=self.turned[which], centre=self.centre[which])

    def field(self) -> Float:
        """Gauss points (4, 3) of the field of view about the sphere centres: their mean square is that of the field."""
        x, _, z = self.centre.mean(axis=0)
        return np.array(
            [
                [x + a * FIELD_MM[0] / np.sqrt(3), 0.0, z + b * FIELD_MM[1] / np.sqrt(3)]
                for a in (-1, 1)
                for b in (-1, 1)
            ]
        )

    def vol_mm(self, pose: Float) -> float:
        """RMS error of a point over the field of view with the hand-eye pose (4, 4)."""
        off = self.field() @ (pose - self.hand_eye)[:3, :3].T + (pose - self.hand_eye)[:3, 3]
        return float(np.sqrt(np.mean(np.sum(off**2, axis=1))))

    def vol_u_mm(self, covariance: Float) -> float:
        """The same as predicted by a covariance (6, 6) of translation and rotation vector in the flange frame."""
        total = 0.0
        for point in self.field() @ self.hand_eye[:3, :3].T:
            by = np.concatenate([np.eye(3), np.cross(np.eye(3), -point)], axis=1)
            total += float(np.trace(by @ covariance @ by.T)) / 4
        return float(np.sqrt(total))

    def off(self, pose: Float) -> Float:
        """Truth less answer (6,): translation mm, rotation vector rad with R_true = exp(w) R."""
        turn = Rotation.from_matrix(self.hand_eye[:3, :3] @ pose[:3, :3].T).as_rotvec()
        return np.concatenate([self.hand_eye[:3, 3] - pose[:3, 3], turn])


def cell_of(recipe: SphereRecipe, truth: SphereTruth | None = None) -> Cell:
    """What is true of a recipe's postures held still."""
    if truth is None:
        hand_eye, turned, centre = true_poses(recipe)
    else:
        hand_eye, turned, centre = truth.flange_from_profiler, truth.base_from_flange, truth.centre_mm
    robot = recipe.robot
    return Cell(
        hand_eye,
        turned,
        centre,
        recipe.sphere.diameter_mm / 2,
        recipe.scanner.noise.sd_mm,
        recipe.scanner.pitch_mm,
        robot.pose_noise_mm,
        robot.pose_noise_deg,
    )


def recorded_poses(recipe: SphereRecipe) -> Float:
    """Flange poses (k, 4, 4) as recorded, of postures held still."""
    return np.array(
        [pose_from(rotation_from_quaternion(m.quaternion_wxyz[0]), m.position_mm[0]) for m in sphere_motion(recipe)]
    )


def circles(cell: Cell, rng: np.random.Generator) -> tuple[Float, Float]:
    """As `circles_of`, of a cell."""
    return circles_of(rng, cell.centre, cell.radius_mm, cell.noise_mm, cell.pitch_mm)


def circles_of(
    rng: np.random.Generator, centre: Float, radius_mm: float, noise_mm: float = 0.015, pitch_mm: float = 0.05
) -> tuple[Float, Float]:
    """Circles (k, 3) = x_c, z_c, w with the noise that the points' noise along z makes, and its covariance (k, 3, 3).

    Of a sphere whose centre lies at (k, 3) in the profiler frame.
    """
    w, found = radius_mm**2 - centre[:, 1] ** 2, []
    for one in w:
        r = np.sqrt(one)
        dx = np.arange(-STEEP * r, STEEP * r, pitch_mm)
        q = np.sqrt(one - dx**2)
        J = np.column_stack([-dx / q, np.ones_like(dx), -1 / (2 * q)])
        found.append(np.linalg.inv(J.T @ J) * noise_mm**2)
    covariance = np.array(found)
    noise = np.einsum("kij,kj->ki", np.linalg.cholesky(covariance), rng.normal(size=(len(w), 3)))
    return np.stack([centre[:, 0], centre[:, 2], w], axis=1) + noise, covariance


def bound(cell: Cell, covariance: Float, radius_u_mm: float) -> Float:
    """Cramer-Rao bound (6, 6) of the hand-eye pose: centre unknown, radius known to `radius_u_mm`."""
    center = (cell.turned @ cell.hand_eye @ np.append(cell.centre[0], 1.0)[:, None])[0, :3, 0]

    def seen(unknown: Float) -> Float:
        return np.array([_predict(cell, pose, center, unknown, np.zeros(6)) for pose in cell.turned])

    errors, blocks = np.repeat([cell.pose_mm, np.radians(cell.pose_deg)], 3), []
    for pose, spread in zip(cell.turned, covariance, strict=True):
        by_pose = partial(_predict, cell, pose, center, np.zeros(10))
        off = differences(by_pose, np.full(6, STEP)) * errors
        blocks.append(spread + off @ off.T)
    prior = np.append(np.zeros(9), radius_u_mm**-2)
    return cramer_rao(seen, np.full(10, STEP), blocks, prior)[:6, :6]


def _predict(cell: Cell, pose: Float, center: Float, unknown: Float, error: Float) -> Float:
    """x_c, z_c, w of one posture, `unknown` (10,) and the pose's `error` (6,) about the truth."""
    R = Rotation.from_rotvec(unknown[3:6]).as_matrix() @ cell.hand_eye[:3, :3]
    A = pose[:3, :3] @ Rotation.from_rotvec(error[3:]).as_matrix()
    flange = A.T @ (center + unknown[6:9] - pose[:3, 3] - error[:3])
    c = R.T @ (flange - cell.hand_eye[:3, 3] - unknown[:3])
    return np.array([c[0], c[2], (cell.radius_mm + unknown[9]) ** 2 - c[1] ** 2])
