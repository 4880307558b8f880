"""`robot.plate`: the scanned plate, and all that was scanned with it, as a body to run into."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Cloud
from workbench.geometry.grids import fuse
from workbench.geometry.poses import inverse
from workbench.robot.cell import Cell
from workbench.robot.collision import turntable_pose
from workbench.robot.shapes import ON_BASE, ON_TURNTABLE
from workbench.robot.workpiece import scanned
from workbench.stage import stage
from workbench.units import DEG

CONTACT = ("cutter", "workpiece")  # what mills may touch what is milled


@stage("robot.plate")
def plate(
    cell: Cell | None,
    cloud: Cloud,
    *,
    voxel_mm: Annotated[float, Field(gt=0, le=100, description="edge of the cubes that hold the scan's points")] = 5.0,
    planned_at_deg: Annotated[
        float, Field(ge=-360, le=360, description="where the turntable stood when the part was scanned")
    ] = 0.0,
) -> Cell | None:
    """Make the scan a collision body of the cell: plate, clamps and fixtures as they stand, as boxes of a grid.

    The body is called `workpiece` and stands on the turntable, or on the base where there is none. Every scanned point
    lies in a box, so the body is larger than what was seen by up to a cube of the grid, which is made coarser where the
    part is large; what the scan has not seen is not there.
    The cutter (the tool's shapes with `"body": "cutter"`) may touch it, since it mills: how deep is what `path.check`
    asks; the spindle may not. It takes the place of a workpiece that the cell file names.

    Args:
        cell: the robot cell; without one there is nothing to do.
        cloud: the scan.
        voxel_mm: edge of the cubes.
        planned_at_deg: turntable angle at which the scan's points hold.

    Raises:
        InputError: points too far from the origin for the grid.
    """
    if cell is None:
        return None
    origin = cloud.base_from_profiler[len(cloud.base_from_profiler) // 2, :3, 3]
    points = fuse(cloud.x_mm, cloud.z_mm, cloud.base_from_profiler, origin)[cloud.keep] + origin
    on_table = cell.turntable is not None
    pose = inverse(turntable_pose(cell, planned_at_deg * DEG)) if on_table else np.eye(4)
    body = scanned(points, voxel_mm, ON_TURNTABLE if on_table else ON_BASE, pose, cloud.source or "cloud")
    touch = cell.may_touch if CONTACT in cell.may_touch else (*cell.may_touch, CONTACT)
    unseen = tuple(text for text in cell.unseen if not text.startswith("collision with the workpiece"))
    others = (shape for shape in cell.shapes if shape.body != "workpiece")
    return dataclasses.replace(cell, shapes=(*others, *body), may_touch=touch, unseen=unseen)
