"""Parameters that several stages of this family take, each said once."""

from __future__ import annotations

from typing import Annotated, TypeAlias

from pydantic import Field

RobotNoise: TypeAlias = Annotated[
    float, Field(ge=0, le=5, description="standard deviation of a recorded flange position, each axis")
]
EndU: TypeAlias = Annotated[
    float, Field(ge=0, le=5, description="declared standard uncertainty of the lower edge that no frame shows")
]
MostRadius: TypeAlias = Annotated[
    float, Field(ge=0.01, le=0.8, description="greatest radius of the lower edge, where the view shows none")
]
RootNominal: TypeAlias = Annotated[float, Field(gt=0, le=50, description="expected root face, tells the faces apart")]
BevelNominal: TypeAlias = Annotated[float, Field(ge=20, le=70, description="expected bevel angle, likewise")]
Limits: TypeAlias = Annotated[
    dict[str, float | tuple[float, float]],
    Field(description="limits of the checks of this stage by name (docs/checks.md)"),
]
