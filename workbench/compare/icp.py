"""Point-to-plane registration: Open3D's ICP from coarse to fine, then weighted Gauss-Newton steps.

Chen and Medioni, "Object modelling by registration of multiple range images", Image and Vision Computing 10, 1992;
directions that the shapes leave open as in Gelfand and others, "Geometrically stable sampling for the ICP algorithm",
3DIM 2003.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from workbench.compare.surfels import Surfels, Target
from workbench.geometry.poses import inverse, pose_from, rotation_from_vector, vector_from_rotation
from workbench.units import Bool, Float, Int, Shaped

OPEN = 2e-3  # mean square of the motion along the normals, per mm of motion: below, a direction is open
SCALES = (4.0, 2.0, 1.0)  # of the reach
STEPS = 30
TUKEY = 4.685  # cut-off of the biweight in standard deviations
SAME_SIDE = 0.8  # least cosine between normals that belong together
LEAST_SIGMA_MM = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Equations:
    """Point-to-plane equations at one pose: n rows that count. Unknowns: shift (mm), turn times `lever_mm` (mm)."""

    use: Shaped[Bool, " c"]  # which places of the scan they belong to
    off_mm: Shaped[Float, "n 3"]  # those places, less the pivot
    frame: Shaped[Int, " n"] | None  # theirs; None: not known
    rows: Shaped[Float, "n 6"]
    residual_mm: Shaped[Float, " n"]
    weight: Shaped[Float, " n"]  # of the robust kernel
    pivot_mm: Shaped[Float, " 3"]
    lever_mm: float

    @property
    def information(self) -> Float:
        """Mean normal matrix (6, 6): squared motion along the normals for each mm of motion."""
        return np.asarray((self.rows * self.weight[:, None]).T @ self.rows / max(float(self.weight.sum()), 1e-9))

    def directions(self) -> tuple[Float, Float]:
        """Eigenvalues (6,), rising, and eigenvectors (6, 6) as columns."""
        size, vectors = np.linalg.eigh(self.information)
        return size, vectors


def coarse(source: Surfels, target: Surfels, initial: Float, reach_mm: float) -> Float:
    """Open3D's point-to-plane ICP with Tukey's kernel, at reaches of 4, 2 and 1 times `reach_mm`."""
    import open3d

    o3d: Any = open3d  # its stubs know less than it does
    origin = target.centre_mm.mean(axis=0)
    away = pose_from(np.eye(3), -origin)
    clouds = [_cloud(o3d, one, shift) for one, shift in ((source, np.zeros(3)), (target, -origin))]
    pose = away @ initial
    for scale in SCALES:
        kernel = o3d.pipelines.registration.TukeyLoss(k=scale * reach_mm)
        found = o3d.pipelines.registration.registration_icp(
            *clouds,
            scale * reach_mm,
            pose,
            o3d.pipelines.registration.TransformationEstimationPointToPlane(kernel),
            o3d.pipelines.registration.ICPConvergenceCriteria(1e-9, 1e-9, 60),
        )
        pose = np.array(found.transformation)
    return _rounded(np.asarray(inverse(away) @ pose))


def refine(
    source: Surfels, target: Target, pose: Float, initial: Float, reach_mm: float, hold: bool
) -> tuple[Float, Equations]:
    """The pose of least weighted squares and the equations there; with `hold`, open directions stay as in `initial`."""
    equations = equations_at(source, target, pose, reach_mm)
    if hold:
        pose = _without_open_motion(equations, pose, initial)
    for _ in range(STEPS):
        equations = equations_at(source, target, pose, reach_mm)
        size, vectors = equations.directions()
        gradient = (equations.rows * equations.weight[:, None]).T @ equations.residual_mm
        known = size > OPEN if hold else size > 1e-12
        step = -vectors[:, known] @ ((vectors.T @ gradient)[known] / (size[known] * equations.weight.sum()))
        pose = moved(equations, step) @ pose
        if np.abs(step).max() < 1e-8:
            break
    return pose, equations


def equations_at(source: Surfels, target: Target, pose: Float, reach_mm: float) -> Equations:
    """Equations of the flat places of a scan that find a place with the same normal within reach."""
    points, normals = source.centre_mm @ pose[:3, :3].T + pose[:3, 3], source.normal @ pose[:3, :3].T
    foot, normal = target(points)
    height = ((points - foot) * normal).sum(axis=1)
    with np.errstate(invalid="ignore"):
        use = source.flat & (np.abs(height) < reach_mm) & ((normals * normal).sum(axis=1) > SAME_SIDE)
    points, normal, height = points[use], normal[use], height[use]
    pivot = points.mean(axis=0) if len(points) else np.zeros(3)
    off = points - pivot
    lever = float(np.sqrt((off**2).sum() / max(len(off), 1))) or 1.0
    middle = np.median(height) if len(height) else 0.0
    sigma = max(1.4826 * float(np.median(np.abs(height - middle))) if len(height) else 0.0, LEAST_SIGMA_MM)
    spread = max(sigma, abs(float(middle)))  # far from the end all residuals are of one sign
    weight = np.maximum(1.0 - (height / (TUKEY * spread)) ** 2, 0.0) ** 2
    frame = None if source.frame is None else source.frame[use]
    return Equations(use, off, frame, np.hstack([normal, np.cross(off, normal) / lever]), height, weight, pivot, lever)


def moved(equations: Equations, step: Float) -> Float:
    """The small motion (4, 4) that unknowns (6,) stand for: a turn about the pivot, then a shift."""
    turn = rotation_from_vector(step[3:] / equations.lever_mm)
    return pose_from(turn, equations.pivot_mm - turn @ equations.pivot_mm + step[:3])


def _without_open_motion(equations: Equations, pose: Float, initial: Float) -> Float:
    """`pose`, less what it moves away from `initial` in open directions."""
    size, vectors = equations.directions()
    motion = pose @ inverse(initial)
    turn = vector_from_rotation(motion[:3, :3])
    shift = motion[:3, :3] @ equations.pivot_mm + motion[:3, 3] - equations.pivot_mm
    step = np.r_[shift, turn * equations.lever_mm]
    known = vectors[:, size > OPEN]
    return moved(equations, known @ (known.T @ step)) @ initial


def _rounded(pose: Float) -> Float:
    """The pose to a micrometre and a microradian: Open3D sums in threads, whose last digits differ from run to run."""
    return pose_from(rotation_from_vector(vector_from_rotation(pose[:3, :3]).round(6)), pose[:3, 3].round(3))


def _cloud(o3d: Any, surfels: Surfels, shift: Float) -> Any:
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(surfels.centre_mm[surfels.flat] + shift))
    cloud.normals = o3d.utility.Vector3dVector(surfels.normal[surfels.flat])
    return cloud
