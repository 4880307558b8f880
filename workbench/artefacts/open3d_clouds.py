"""Clouds as Open3D's tensor point clouds, and back."""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.units import AnyArray, Float


def tensor_cloud(points_mm: Float, **attributes: AnyArray) -> Any:
    """`open3d.t.geometry.PointCloud` with float64 positions and int32 (n, 1) attributes by name."""
    import open3d as o3d

    cloud = o3d.t.geometry.PointCloud()
    cloud.point["positions"] = o3d.core.Tensor.from_numpy(np.array(points_mm, np.float64))
    for name, values in attributes.items():
        cloud.point[name] = o3d.core.Tensor.from_numpy(np.ascontiguousarray(values, np.int32)[:, None].copy())
    return cloud


def positions(cloud: Any) -> Float:
    """Points (n, 3) of either of Open3D's point clouds, those that are not finite left out."""
    points = cloud.point.positions.cpu().numpy() if hasattr(cloud, "point") else cloud.points
    array = np.array(points, np.float64).reshape(-1, 3)
    return array[np.isfinite(array).all(axis=1)]
