"""Parameters that several stages of this family take, each said once."""

from __future__ import annotations

import math
from typing import Annotated, TypeAlias

from pydantic import AfterValidator, Field

from workbench.checks.limits import Bound

Vector: TypeAlias = tuple[float, float, float]


def _with_length(direction: Vector) -> Vector:
    if not 1e-9 < math.hypot(*direction) < math.inf:
        raise ValueError("expected a direction, of any length but 0")
    return direction


Direction: TypeAlias = Annotated[Vector, AfterValidator(_with_length)]

STATION_MM = 1.0  # between places along an edge at which it is told
USUAL_NOISE_MM = 0.07  # of an arm of this size, each axis: the paper, Table 1; where nothing is declared

RobotNoise: TypeAlias = Annotated[
    float,
    Field(ge=0, le=5, description="standard deviation of a recorded flange position, each axis."),
]
RobotNoiseOrUsual: TypeAlias = Annotated[
    float | None,
    Field(
        ge=0,
        le=5,
        description="standard deviation of a recorded flange position, each axis: it turns the edge's direction; "
        "null: 0.07, that of an arm of this size.",
    ),
]
RobotNoiseLength: TypeAlias = Annotated[
    float | None,
    Field(
        ge=0.1,
        le=1000,
        description="correlation length of these errors along the way: exp(-d^2 / 2 length^2) at a distance d; "
        "null: estimated from the frames.",
    ),
]
EndU: TypeAlias = Annotated[
    float,
    Field(
        ge=0,
        le=5,
        description="declared u of the lower edge, across it, for what no frame shows (a burr in the face's plane, "
        "returns lost along the whole edge).",
    ),
]
RootNominal: TypeAlias = Annotated[
    float, Field(gt=0, le=50, description="expected root face; only distinguishes the faces.")
]
BevelNominal: TypeAlias = Annotated[
    float,
    Field(
        ge=15, le=70, description="expected bevel angle (of less, both faces pass for one); only distinguishes them."
    ),
]
Limits: TypeAlias = Annotated[
    dict[str, Bound],
    Field(description="limits of the checks of this stage by name (docs/checks.md)."),
]


def usual_noise_mm(declared: float | None) -> float:
    """What is declared of the robot's noise; null: that of an arm of this size."""
    return USUAL_NOISE_MM if declared is None else declared
