"""Parameters that several stages of this family take, each said once."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import Field

RobotNoise: TypeAlias = Annotated[
    float,
    Field(
        ge=0,
        le=5,
        description="standard deviation of a recorded flange position, each axis: it moves the edge and turns its "
        "direction, and a pass with only the poses of its two ends does not show it.",
    ),
]
EndU: TypeAlias = Annotated[
    float,
    Field(
        ge=0,
        le=5,
        description="declared u of the lower edge, across it, by what no frame shows (a burr in the face's plane, "
        "returns lost along the whole edge).",
    ),
]
MostRadius: TypeAlias = Annotated[
    float,
    Field(
        ge=0.01,
        le=0.8,
        description="greatest radius of the edge where the rays graze the face and do not show it; u holds what such a "
        "rounding would hide.",
    ),
]
RootNominal: TypeAlias = Annotated[
    float, Field(gt=0, le=50, description="expected root face; only tells the faces apart.")
]
BevelNominal: TypeAlias = Annotated[float, Field(ge=20, le=70, description="expected bevel angle; likewise.")]
Limits: TypeAlias = Annotated[
    dict[str, float | tuple[float, float]],
    Field(
        description="limits of the checks of this stage by name (docs/checks.md); the results name one that passes "
        "only by a wider limit."
    ),
]
