"""`edge.segment_cloud`: the faces of the edge and its lower edge, from a cloud without a grid."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import ROOT_FACE, Cloud, Edge, PointSet
from workbench.edge.faces import find_faces
from workbench.edge.measure import measure_edge
from workbench.edge.segment import segment
from workbench.edge.segment_cloud_direction import edge_direction
from workbench.edge.segment_cloud_slices import (
    COARSE_SLICES,
    MOST_FRAMES,
    REACH_MM,
    best_view,
    organised,
    sliced,
    spacing,
    straight_course,
)
from workbench.geometry.curves import Curve
from workbench.geometry.scan_grid import scan_grid
from workbench.geometry.scan_lines import scan_lines
from workbench.stage import stage
from workbench.units import DEG, Float


@stage("edge.segment_cloud")
def segment_cloud(
    points: PointSet,
    *,
    root_nominal_mm: Annotated[
        float, Field(gt=0, le=50, description="expected root size, tells the faces apart")
    ] = 1.5,
    bevel_nominal_deg: Annotated[float, Field(ge=20, le=70, description="expected bevel angle, likewise")] = 40.0,
    robot_noise_mm: Annotated[
        float, Field(ge=0, le=5, description="standard deviation of a recorded flange position, each axis")
    ] = 0.07,
) -> tuple[Cloud, Edge]:
    """Find root face, bevel face and the lower edge of a milled edge in a cloud without a grid."""
    lines = scan_lines(points.points_mm)
    if lines is not None:
        grid = scan_grid(points.points_mm, lines)
        cloud = organised(points, grid.x_mm, grid.z_mm, grid.base_from_profiler, lines.pass_index)
        return cloud, segment(cloud, root_nominal_mm=root_nominal_mm, bevel_nominal_deg=bevel_nominal_deg,
                   robot_noise_mm=robot_noise_mm)
    along = edge_direction(points.points_mm, points.source)
    step = spacing(points.points_mm)
    course = straight_course(points.points_mm, along)
    view = best_view(points, course, along, step, root_nominal_mm, bevel_nominal_deg * DEG)
    s = (points.points_mm - course.position(np.zeros(1))) @ along
    coarse = sliced(points, points.points_mm, s, course, view, step, COARSE_SLICES)
    tracked = find_faces(coarse, root_nominal_mm, bevel_nominal_deg)
    curve = measure_edge(coarse, tracked).curve
    near, guess = _near(points.points_mm, curve)
    frame, column = np.nonzero(tracked.labels == ROOT_FACE)
    pose = coarse.base_from_profiler[frame, :3]
    root = (
        pose[:, :, 3]
        + coarse.x_mm[frame, column, None] * pose[:, :, 0]
        + coarse.z_mm[frame, column, None] * pose[:, :, 2]
    )
    step = spacing(near, root)
    print(step)
    cloud = sliced(points, near, guess, curve, view, step, MOST_FRAMES)
    edge = segment(cloud, root_nominal_mm=root_nominal_mm, bevel_nominal_deg=bevel_nominal_deg,
                   robot_noise_mm=robot_noise_mm)  # fmt: skip
    return cloud, edge


def _near(points_mm: Float, curve: Curve) -> tuple[Float, Float]:
    at = np.linspace(curve.stations_mm[0], curve.stations_mm[-1], 400)
    position = curve.position(at)
    from scipy.spatial import cKDTree

    off, nearest = cKDTree(position).query(points_mm, distance_upper_bound=REACH_MM)
    here = np.isfinite(off)
    return points_mm[here], at[nearest[here]]
