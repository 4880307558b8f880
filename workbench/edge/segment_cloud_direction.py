"""The direction in which an edge runs through a cloud without a grid: all its faces contain it."""

from __future__ import annotations

import numpy as np

from workbench.errors import InputError
from workbench.units import Float

SAMPLE = 40_000  # points whose normals tell it
NEIGHBOURS = 24
HEAVY = 60  # directions of normals that are paired
ALIGNED = 0.12  # |n . t| of a face that contains t; on an arc t turns
LEAST_TURN = 0.3  # sine between the normals of two faces


def edge_direction(points_mm: Float, source: str) -> Float:
    """Unit vector (3,) along the edge: normal to as many of the cloud's surface normals as possible.

    Normals by Open3D's nearest neighbours, on a sample; every pair of frequent normals proposes its cross product, and
    all normals vote (RANSAC's principle, without chance).

    Raises InputError where the cloud shows no two faces at an angle.
    """
    normals = sample_normals(points_mm)
    heavy, count = _frequent(normals)
    pairs = [np.cross(p, q) for i, p in enumerate(heavy) for q in heavy[:i]]
    proposed = np.array([d / np.linalg.norm(d) for d in pairs if np.linalg.norm(d) > LEAST_TURN])
    if not len(proposed):
        raise InputError(source, "no edge in view: expected two faces at an angle, all surface normals are alike")
    votes = (np.abs(proposed @ heavy.T) < ALIGNED) @ count
    best = proposed[np.argmax(votes)]
    for _ in range(3):
        faces = normals[np.abs(normals @ best) < ALIGNED]
        best = np.linalg.eigh(faces.T @ faces)[1][:, 0]
    return np.asarray(best)


def sample_normals(points_mm: Float) -> Float:
    """Unit normals (k, 3), sign unknown, at up to SAMPLE points spread evenly over the cloud (n, 3)."""
    import open3d as o3d

    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points_mm - points_mm.mean(axis=0)))
    extent = np.ptp(points_mm, axis=0)
    voxel = float(np.sort(extent)[1:].prod() / SAMPLE) ** 0.5  # about so many cells on a sheet of that size
    if voxel > 0:
        cloud = cloud.voxel_down_sample(voxel)
    cloud.estimate_normals(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    return np.asarray(cloud.normals)


def _frequent(normals: Float) -> tuple[Float, Float]:
    """The most frequent normals (h, 3), up to sign and to a tenth, and how many there are of each (h,)."""
    upward = (
        normals * np.where(normals[np.arange(len(normals)), np.abs(normals).argmax(axis=1)] < 0, -1.0, 1.0)[:, None]
    )
    _, group, count = np.unique(np.round(upward * 10).astype(np.int64), axis=0, return_inverse=True, return_counts=True)
    heaviest = np.argsort(-count)[:HEAVY]
    means = np.stack([np.bincount(group.ravel(), upward[:, k]) for k in range(3)], axis=1)[heaviest]
    return means / np.linalg.norm(means, axis=1, keepdims=True), count[heaviest].astype(np.float64)
