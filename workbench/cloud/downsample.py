"""`cloud.downsample`: a point a voxel."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

from pydantic import Field

from workbench.artefacts import PointSet, frozen
from workbench.errors import InputError
from workbench.stage import stage

MOST_VOXELS = 2**31  # along a side: Open3D counts them in int32


@stage("cloud.downsample")
def downsample(
    points: PointSet,
    *,
    voxel_mm: Annotated[float, Field(gt=0, le=1000)],
) -> PointSet:
    """Thin a cloud to the mean point of each voxel (Open3D's `voxel_down_sample`).

    Means hide noise and round edges, and scan lines are lost: for a look, a registration or a comparison, not before
    an edge is measured.

    Args:
        points: a cloud without a grid.
        voxel_mm: side of the cubes of which one point is left; the first begins half a side before the least x, y, z.

    Raises:
        InputError: nothing is left, or the cloud is too large for such voxels.

    Example:
        >>> import numpy as np
        >>> from workbench.api import PointSet
        >>> from workbench.cloud import downsample
        >>> grid = np.stack(np.meshgrid(*3 * [np.arange(0.25, 4, 0.5)]), axis=-1).reshape(-1, 3)
        >>> len(grid), len(downsample(PointSet(grid), voxel_mm=1.0).points_mm)
        (512, 125)
    """
    size = float((points.points_mm.max(axis=0) - points.points_mm.min(axis=0)).max())
    if size / voxel_mm >= MOST_VOXELS:
        raise InputError(
            points.source or "cloud.downsample", f"a cloud of {size:.4g} mm has too many voxels of {voxel_mm:g} mm"
        )
    cloud = points.to_open3d().to_legacy()  # the legacy one averages in float64
    thinned = PointSet.from_open3d(cloud.voxel_down_sample(voxel_mm)).points_mm
    order = thinned[:, 2].argsort(kind="stable")
    for k in (1, 0):  # Open3D's order is that of a hash
        order = order[thinned[order, k].argsort(kind="stable")]
    return replace(points, points_mm=frozen(thinned[order]), row=None, column=None)
