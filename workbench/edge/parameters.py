"""Parameters that several stages of this family take, each said once."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import Field

RobotNoise: TypeAlias = Annotated[
    float,
    Field(
        ge=0,
        le=5,
        description="standard deviation of a recorded flange position, each axis. Where a pass has only the poses of "
        "its two ends, nothing in the scan shows it, yet it moves the edge and turns its direction.",
    ),
]
EndU: TypeAlias = Annotated[
    float,
    Field(
        ge=0,
        le=5,
        description="declared standard uncertainty of the lower edge, across it, by what no frame shows (a burr in the "
        "face's plane, returns lost along the whole edge); it is in every root face's u.",
    ),
]
MostRadius: TypeAlias = Annotated[
    float,
    Field(
        ge=0.01,
        le=0.8,
        description="greatest radius that the measured edge can have. Where the rays graze the face a rounding is not "
        "seen, and what it would hide is in the uncertainty; one that is seen may be larger.",
    ),
]
RootNominal: TypeAlias = Annotated[
    float, Field(gt=0, le=50, description="expected root face; only tells the faces apart.")
]
BevelNominal: TypeAlias = Annotated[float, Field(ge=20, le=70, description="expected bevel angle; likewise.")]
Limits: TypeAlias = Annotated[
    dict[str, float | tuple[float, float]],
    Field(
        description="limits of the checks of this stage by name (docs/checks.md). One that passes only by a wider "
        "limit than the default is named in the results."
    ),
]
