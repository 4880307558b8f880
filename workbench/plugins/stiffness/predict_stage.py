"""`stiffness.predict`: how far the robot gives way at every point of a path."""

from __future__ import annotations

import numpy as np

from workbench.api import (
    Cell,
    Document,
    Float,
    InputError,
    PathDeflection,
    Postures,
    Toolpath,
    forward_kinematics,
    pose_from,
    stage,
    turn_about_z,
)
from workbench.plugins.csv_table import csv_bytes
from workbench.plugins.stiffness.elastic import pushed
from workbench.plugins.stiffness.path_points import Load
from workbench.plugins.stiffness.values import JointStiffness, MillingForce


@stage("stiffness.predict")
def predict(
    cell: Cell,
    stiffness: JointStiffness,
    toolpath: Toolpath,
    force: MillingForce,
    postures: Postures,
    *,
    load: Load = "mean",
) -> tuple[PathDeflection, Document]:
    """Predict the cutter's deflection at every point of a path: J K^-1 J^T f, eq. (22) corrected.

    In each point's frame (docs/conventions.md). Also as `deflections.csv`, which `twin.mill` reads.

    Args:
        cell: the robot.
        stiffness: of its joints.
        toolpath: the path, as planned.
        force: on the cutter along it.
        postures: how the robot stands along it.
        load: as in `stiffness.posture`.

    Raises:
        InputError: postures or force are of another path.

    Example:
        >>> from workbench import path, robot
        >>> from workbench.plugins import stiffness
        >>> cell = robot.cell(cell="data/robot/cell.json")
        >>> springs = stiffness.read(cell)
        >>> plan = path.read(toolpath="data/synthetic/paths/raw_arc.json")
        >>> force, file = stiffness.force(plan, None, cell)
        >>> at = {"cutter_rotation_deg": (0, 0), "turntable_deg": (0, 0), "whole_map": False}
        >>> postures, *_ = stiffness.posture(cell, springs, plan, force, **at)
        >>> predicted, file = stiffness.predict(cell, springs, plan, force, postures)
        >>> file.name
        'deflections.csv'
    """
    point = base_from_point(cell, postures, toolpath)
    push = np.einsum("nij,nj->ni", point[:, :3, :3], force.at_points(postures.layer, f"{load}_n"))
    gives = pushed(cell.chain, stiffness.nm_per_rad, postures.joints, point[:, :3, 3], push)
    in_point = np.einsum("nji,nj->ni", point[:, :3, :3], gives)
    found = {layer.index: in_point[postures.layer == layer.index] for layer in toolpath.layers}
    rows = (
        [index, i, *(f"{x:.6f}" for x in row)]
        for index, moved in found.items()
        for i, row in enumerate((moved + 0.0).tolist())
    )
    table = csv_bytes(["layer", "point", "dx_mm", "dy_mm", "dz_mm"], rows)
    return PathDeflection(found), Document("deflections.csv", table)


def base_from_point(cell: Cell, postures: Postures, toolpath: Toolpath) -> Float:
    """Frames (n, 4, 4) of the path's points where the turntable carries them: the tool's, turned back.

    Raises:
        InputError: postures of another path.
    """
    if postures.toolpath is not toolpath:
        raise InputError("postures", "expected those of this path, found another path's")
    radius_mm = toolpath.cutter.diameter_mm / 2
    tool = forward_kinematics(cell.chain, postures.joints) @ postures.flange_from_point
    out, back = (pose_from(np.eye(3), np.array([sign * radius_mm, 0.0, 0.0])) for sign in (-1, 1))
    return tool @ out @ turn_about_z(-postures.cutter_rotation) @ back
