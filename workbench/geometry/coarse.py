"""Where one cloud lies on another, from no start at all: Open3D's features (FPFH) and RANSAC, then its ICP.

Rusu, Blodow and Beetz, "Fast point feature histograms (FPFH) for 3D registration", ICRA 2009. Coarse: good to a part of
the voxel; a fine registration follows.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from workbench.geometry.poses import inverse, pose_from, rotation_from_vector, vector_from_rotation
from workbench.units import Float, Shaped

NORMAL_VOXELS, FEATURE_VOXELS = 3.0, 6.0  # radii of the neighbourhoods, in voxels
NEAR_VOXELS = 1.5  # of points that belong together
TRIALS, CONFIDENCE = 100_000, 0.9999  # four times as many find no more on milled and raw edges, whole or in part
ALIKE_EDGES = 0.9  # of a sample's triangle in both clouds
TRIES = 6  # RANSAC may miss, and a part may look alike from several sides


class Found(NamedTuple):
    """A coarse registration."""

    target_from_source: Shaped[Float, "4 4"]
    overlap: float  # share of the source's voxels that have a point of the target near
    rms_mm: float  # of those


def coarse_registration(source_mm: Float, target_mm: Float, voxel_mm: float, seed: int = 0) -> list[Found]:
    """Poses of `source_mm` (n, 3) on `target_mm` (m, 3), both thinned to a point a voxel; the best first.

    Planes and straight edges look alike from many sides: these are candidates, none of them proven.
    """
    import open3d

    o3d: Any = open3d  # its stubs know less than it does
    middles = source_mm.mean(axis=0), target_mm.mean(axis=0)
    clouds = [_thinned(o3d, points - at, voxel_mm) for points, at in zip((source_mm, target_mm), middles, strict=True)]
    registration = o3d.pipelines.registration
    features = [
        registration.compute_fpfh_feature(cloud, o3d.geometry.KDTreeSearchParamHybrid(FEATURE_VOXELS * voxel_mm, 100))
        for cloud in clouds
    ]
    near = NEAR_VOXELS * voxel_mm
    o3d.utility.random.seed(seed)
    shifts = [pose_from(np.eye(3), at) for at in middles]
    found = []
    for _ in range(TRIES):
        start = registration.registration_ransac_based_on_feature_matching(
            *clouds,
            *features,
            True,
            near,
            registration.TransformationEstimationPointToPoint(False),
            3,
            [
                registration.CorrespondenceCheckerBasedOnEdgeLength(ALIKE_EDGES),
                registration.CorrespondenceCheckerBasedOnDistance(near),
            ],
            registration.RANSACConvergenceCriteria(TRIALS, CONFIDENCE),
        )
        fine = registration.registration_icp(
            *clouds,
            near,
            start.transformation,
            registration.TransformationEstimationPointToPlane(),
            registration.ICPConvergenceCriteria(1e-7, 1e-7, 60),
        )
        pose = shifts[1] @ np.array(fine.transformation) @ inverse(shifts[0])
        turn = rotation_from_vector(vector_from_rotation(pose[:3, :3]))  # orthonormal to the last digit
        found.append(Found(pose_from(turn, pose[:3, 3]), float(fine.fitness), float(fine.inlier_rmse)))
    return sorted(found, key=lambda one: (-one.overlap, one.rms_mm))


SCALES = (4.0, 2.0, 1.0)  # of the reach


def fine_registration(
    source_mm: Float,
    target_mm: Float,
    start: Float,
    reach_mm: float,
    normal: Float | None = None,
    *,
    robust: bool = False,
) -> Found:
    """Open3D's point-to-plane ICP of points (n, 3) and (m, 3), at 4, 2 and 1 times the reach; overlap: share of points.

    The pose is rounded to 1e-6 mm and rad: Open3D sums in threads, whose last digits differ from run to run.

    Args:
        normal: (m, 3) of the target; None: of its neighbourhoods within 3 times the reach.
        robust: with Tukey's kernel.
    """
    import open3d

    o3d: Any = open3d
    registration, origin = o3d.pipelines.registration, target_mm.mean(axis=0)
    away = pose_from(np.eye(3), -origin)
    source, target = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(one))) for one in (source_mm, target_mm - origin)
    )
    if normal is None:
        target.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(NORMAL_VOXELS * reach_mm, 30))
    else:
        target.normals = o3d.utility.Vector3dVector(normal)
    pose = away @ start
    for scale in SCALES:
        kernel = [registration.TukeyLoss(k=scale * reach_mm)] if robust else []
        found = registration.registration_icp(
            source,
            target,
            scale * reach_mm,
            pose,
            registration.TransformationEstimationPointToPlane(*kernel),
            registration.ICPConvergenceCriteria(1e-9, 1e-9, 60),
        )
        pose = np.array(found.transformation)
    pose = inverse(away) @ pose
    turn = rotation_from_vector(vector_from_rotation(pose[:3, :3]).round(6))
    return Found(pose_from(turn, pose[:3, 3].round(6)), float(found.fitness), float(found.inlier_rmse))


def _thinned(o3d: Any, points_mm: Float, voxel_mm: float) -> Any:
    """A point a voxel, with normals."""
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(np.array(points_mm)))
    cloud = cloud.voxel_down_sample(voxel_mm)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamHybrid(NORMAL_VOXELS * voxel_mm, 30))
    return cloud
