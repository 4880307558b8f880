"""`stiffness.compensate`: a path that allows for the robot's giving way."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.api import PathDeflection, Toolpath, rotation_from_quaternion, stage


@stage("stiffness.compensate")
def compensate(
    toolpath: Toolpath,
    predicted: PathDeflection,
    *,
    share: Annotated[float, Field(ge=0, le=2)] = 1.0,
) -> Toolpath:
    """Move every point of a path against its predicted deflection.

    Positions only; the force on the moved path is taken as the same. Lead-ins and leads-out stay.

    Args:
        toolpath: the path, as planned.
        predicted: how far the robot gives way at its points, in their frames.
        share: factor of the prediction that is allowed for.

    Raises:
        InputError: the prediction is of another path.

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
        >>> moved = stiffness.compensate(plan, predicted)
        >>> [len(layer.position_mm) for layer in (plan.layers[-1], moved.layers[-1])]
        [171, 171]
    """
    layers = []
    for layer in toolpath.layers:
        turn = rotation_from_quaternion(layer.quaternion_wxyz)
        back = np.einsum("nij,nj->ni", turn, share * predicted.at(layer))
        layers.append(replace(layer, position_mm=layer.position_mm - back))
    return replace(toolpath, claim=None, layers=tuple(layers))
