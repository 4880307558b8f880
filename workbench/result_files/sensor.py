"""`sensor.json`: what a data sheet or a calibration says of a laser line profiler; null where it is not known."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import ConfigDict, Field

from workbench.result_files.contract import ResultFile, Row

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Limits = tuple[Positive, Positive]


class Box(Row):
    """A box of the sensor's body, in the profiler's frame."""

    model_config = ConfigDict(extra="forbid")
    centre_mm: tuple[float, float, float]
    size_mm: tuple[Positive, Positive, Positive]


class SensorFile(ResultFile):
    """`sensor.json`: what a user declares of the profiler, in these words alone. Of no part."""

    model_config = ConfigDict(extra="forbid")  # a misspelt word would count as one that is not known
    NAME: ClassVar[str] = "sensor.json"
    name: str | None = None
    columns: Annotated[int, Field(ge=2, le=100_000)] | None = None
    measuring_range_mm: Limits | None = Field(default=None, description="nearest and farthest range")
    width_mm: Limits | None = Field(default=None, description="of the laser line at these ranges")
    camera_side: Literal["x", "-x", "y", "-y"] | None = Field(default=None, description="of the laser, where it looks")
    triangulation_deg: Annotated[float, Field(gt=0, lt=90)] | None = None
    noise_mm: Positive | None = Field(default=None, description="standard deviation of one range")
    noise_columns: Positive | None = Field(default=None, description="over which neighbours share their noise")
    linearity_mm: Annotated[float, Field(ge=0, le=1)] | None = Field(
        default=None, description="rms of the range's own error over the columns, alike in every profile"
    )
    linearity_length_mm: Positive | None = Field(
        default=None, description="lateral length over which it changes: its correlation length; a quarter of a wave's"
    )
    line_thickness_mm: Positive | None = None
    filters: tuple[str, ...] | None = None
    body: tuple[Box, ...] | None = None
