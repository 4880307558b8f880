"""Ranges of the parameters that several stages take, each in the unit that ends the parameter's name."""

from typing import Annotated

from pydantic import Field

ToleranceMm = Annotated[float, Field(gt=0, le=10)]
NoiseMm = Annotated[float, Field(gt=0, le=5)]
NoiseDeg = Annotated[float, Field(ge=0, le=1)]
Deviation = Annotated[float, Field(ge=0, le=5)]  # a standard deviation; 0: none
LengthMm = Annotated[float, Field(ge=0, le=20)]
BevelDeg = Annotated[float, Field(ge=10, le=75)]
BevelToleranceDeg = Annotated[float, Field(gt=0, le=30)]
SensorScaleU = Annotated[float, Field(gt=0, le=0.05)]
RelativeU = Annotated[float, Field(gt=0, le=1)]
ScaleU = Annotated[float, Field(ge=0, le=0.2)]
AsBuiltU = Annotated[float, Field(ge=0, le=10)]
Positive = Annotated[float, Field(gt=0, le=1e5)]
SizeMm = Annotated[float, Field(gt=0, le=500)]
HelixDeg = Annotated[float, Field(ge=0, le=60)]
Targets = Annotated[int, Field(ge=0, le=50)]
Stations = Annotated[int, Field(ge=2, le=2000)]
LeastMargin = Annotated[float, Field(ge=0, le=100)]
