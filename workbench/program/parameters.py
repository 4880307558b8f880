"""Parameters that the stages of all dialects share: the tool on the flange and the zone."""

from __future__ import annotations

import math
from typing import Annotated

import numpy as np
from pydantic import AfterValidator, Field

from workbench.artefacts import Moves
from workbench.dialect import MillingTool
from workbench.geometry.poses import quaternion_from_rotation

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]


def unit_quaternion(q: Quaternion) -> Quaternion:
    """`q`, normalised; ValueError if its norm is not within 1e-3 of 1 (docs/conventions.md)."""
    norm = math.hypot(*q)
    if abs(norm - 1.0) > 1e-3:
        raise ValueError(f"expected a quaternion w x y z of unit length, this one has {norm:.6g}")
    return (q[0] / norm, q[1] / norm, q[2] / norm, q[3] / norm)


ToolPosition = Annotated[
    Vector, Field(description="in the flange: the point on the cutter's axis beside the middle of the bevel face")
]
ToolQuaternion = Annotated[
    Quaternion,
    Field(description="orientation of the path's frame in the flange, w x y z, each a number: z from shank to tip"),
    AfterValidator(unit_quaternion),
]
ToolMass = Annotated[float, Field(gt=0, le=1000, description="of spindle and cutter")]
ToolCentreOfGravity = Annotated[Vector, Field(description="centre of gravity of spindle and cutter in the flange")]
Zone = Annotated[
    float,
    Field(
        ge=0,
        le=50,
        description="how far before a target the next move may blend in, but at sharp corners; 0: never",
    ),
]

TOOL_POSITION_MM: Vector = (0.0, 0.0, 400.0)
TOOL_CENTRE_OF_GRAVITY_MM: Vector = (0.0, 0.0, 150.0)
UPRIGHT: Quaternion = (1.0, 0.0, 0.0, 0.0)


def tool(position_mm: Vector, quaternion_wxyz: Quaternion, mass_kg: float, centre_of_gravity_mm: Vector,
         moves: Moves | None = None) -> MillingTool:  # fmt: skip
    """The tool that a stage's parameters describe; its frame is that of the postures where the moves rest on some."""
    if moves is not None and moves.flange_from_point is not None:
        pose, radius = moves.flange_from_point, moves.toolpath.cutter.diameter_mm / 2
        return MillingTool(pose[:3, 3] - radius * pose[:3, 0], quaternion_from_rotation(pose[:3, :3]), mass_kg,
                           np.array(centre_of_gravity_mm))  # fmt: skip
    return MillingTool(np.array(position_mm), np.array(quaternion_wxyz), mass_kg, np.array(centre_of_gravity_mm))
