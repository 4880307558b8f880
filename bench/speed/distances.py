"""The distance from the cutter's axis to the stock that is still there, as one would compute it without this project.

The axis is sampled every mm; the nearest point of the cloud to each sample comes from Open3D or from a k-d tree, and
the least over the samples is d_min. What is left of the cloud changes from layer to layer, so its tree is built anew.
A sampled axis errs by up to 0.025 mm at 5 mm, the radius of the cutter; finer samples would take longer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial import cKDTree

from bench.speed.raw_edges import section_frames
from workbench.artefacts import Cloud, Layer, Toolpath
from workbench.geometry import grids
from workbench.geometry.poses import rotation_from_quaternion
from workbench.units import DEG, Float

SAMPLE_MM = 1.0


def open3d_distances(samples: Float, points: Float) -> Float:
    """d_min (k,) of samples (k, j, 3) to points (p, 3)."""
    import open3d as o3d

    cloud, query = (
        o3d.geometry.PointCloud(o3d.utility.Vector3dVector(values)) for values in (points, samples.reshape(-1, 3))
    )
    return np.asarray(query.compute_point_cloud_distance(cloud)).reshape(samples.shape[:2]).min(axis=1)


def tree_distances(samples: Float, points: Float) -> Float:
    """The same with scipy's k-d tree."""
    return np.asarray(cKDTree(points).query(samples.reshape(-1, 3))[0].reshape(samples.shape[:2]).min(axis=1))


def layer_problems(toolpath: Toolpath, cloud: Cloud) -> Iterator[tuple[Float, Float]]:
    """For each layer: samples (k, j, 3) of the axis, and points (p, 3) of what still stands.

    Those are the points of the cloud that no earlier layer removed, and the face that the layer before left.
    """
    centre = cloud.base_from_profiler[len(cloud.base_from_profiler) // 2, :3, 3]
    points = grids.fuse(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, centre).astype(float)
    height = _heights(points + centre, cloud, toolpath)
    left, face = np.inf, np.zeros((0, 3))
    for layer in toolpath.layers:
        standing = np.concatenate([points[cloud.keep & (height <= left)], face])
        yield axis_samples(layer, toolpath) - centre, standing
        left, face = layer.height_mm, face_samples(layer) - centre


def face_samples(layer: Layer) -> Float:
    """Points (p, 3) of the bevel face that a layer leaves: lines across it at its cutting points."""
    along = np.linspace(-0.5, 0.5, math.ceil(float(layer.width_mm.max()) / SAMPLE_MM) + 1)
    axis = rotation_from_quaternion(layer.quaternion_wxyz[layer.cutting])[:, None, :, 2]
    reach = (layer.width_mm[layer.cutting, None] * along)[:, :, None]
    return np.asarray((layer.position_mm[layer.cutting][:, None] + reach * axis).reshape(-1, 3))


def axis_samples(layer: Layer, toolpath: Toolpath) -> Float:
    """Points (k, j, 3) of the cutter's axis, as long as its flutes, a radius off the frame's origin."""
    axes = rotation_from_quaternion(layer.quaternion_wxyz)
    half = 0.5 * toolpath.cutter.flute_length_mm
    along = np.linspace(-half, half, math.ceil(2 * half / SAMPLE_MM) + 1)
    centre = layer.position_mm - 0.5 * toolpath.cutter.diameter_mm * axes[:, :, 0]
    return np.asarray(centre[:, None] + along[:, None] * axes[:, None, :, 2])


def _heights(points: Float, cloud: Cloud, toolpath: Toolpath) -> Float:
    """Height (N, M) over the finished bevel, each frame in its own section plane."""
    position, _, normal, across = section_frames(len(points))
    up = normal * math.cos(toolpath.bevel_deg * DEG) + across * math.sin(toolpath.bevel_deg * DEG)
    corner = position + toolpath.root_mm * across
    return np.asarray(np.einsum("ijk,ik->ij", points - corner[:, None], up))
