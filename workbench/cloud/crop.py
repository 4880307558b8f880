"""`cloud.crop`: what lies in a box."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import PointSet, frozen
from workbench.errors import InputError
from workbench.geometry.poses import is_rigid
from workbench.stage import stage

Corner = Annotated[list[float], Field(min_length=3, max_length=3)]


@stage("cloud.crop")
def crop(
    points: PointSet,
    *,
    low_mm: Corner,
    high_mm: Corner,
    base_from_box: list[list[float]] | None = None,
) -> PointSet:
    """Keep the points inside a box (Open3D's `OrientedBoundingBox`), their order as it was.

    Args:
        points: a cloud without a grid.
        low_mm: least x, y, z of the box, in its own frame.
        high_mm: greatest x, y, z.
        base_from_box: 4x4 (direction cosines, mm) of the box's frame; null: the base.

    Raises:
        InputError: an empty box, no rigid motion, or no point in it.

    Example:
        >>> import numpy as np
        >>> from workbench.api import PointSet
        >>> from workbench.cloud import crop
        >>> line = PointSet(np.arange(10.0)[:, None] * [1.0, 0.0, 0.0])
        >>> crop(line, low_mm=[2.5, -1, -1], high_mm=[5.5, 1, 1]).points_mm[:, 0].tolist()
        [3.0, 4.0, 5.0]
    """
    import open3d as o3d

    low, high = np.array(low_mm), np.array(high_mm)
    if not (low < high).all():
        raise InputError("cloud.crop.low_mm", f"expected less than high_mm, found {low.tolist()} and {high.tolist()}")
    pose = np.eye(4) if base_from_box is None else np.array(base_from_box, float)
    if not is_rigid(pose):
        raise InputError("cloud.crop.base_from_box", "expected a rigid motion, 4x4")
    box = o3d.geometry.OrientedBoundingBox(pose[:3, :3] @ ((low + high) / 2) + pose[:3, 3], pose[:3, :3], high - low)
    inside = np.sort(box.get_point_indices_within_bounding_box(o3d.utility.Vector3dVector(np.array(points.points_mm))))
    if not len(inside):
        a, b = points.points_mm.min(axis=0).round(3).tolist(), points.points_mm.max(axis=0).round(3).tolist()
        raise InputError(points.source or "cloud.crop", f"no point lies in the box; the cloud spans {a} to {b}")
    places = {name: one[inside] for name in ("row", "column") if (one := getattr(points, name)) is not None}
    return replace(points, points_mm=frozen(points.points_mm[inside]), **places)
