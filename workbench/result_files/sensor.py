"""`sensor.json`: what a data sheet or a calibration says of a laser line profiler; null where it is not known."""

from __future__ import annotations

import difflib
from typing import Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from workbench.result_files.contract import ResultFile, Row

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Limits = tuple[Positive, Positive]
MISSPELT = 0.76  # of a word's letters: linearity_um for linearity_mm, noise for noise_mm


class Box(Row):
    """A box of the sensor's body, in the profiler's frame."""

    centre_mm: tuple[float, float, float]
    size_mm: tuple[Positive, Positive, Positive]


class SensorFile(ResultFile):
    """`sensor.json`: what a user declares of the profiler. Of no part."""

    NAME: ClassVar[str] = "sensor.json"
    name: str | None = Field(default=None, description="recorded only: nothing is computed from it")
    columns: Annotated[int, Field(ge=2, le=100_000)] | None = None
    measuring_range_mm: Limits | None = Field(default=None, description="nearest and farthest range")
    width_mm: Limits | None = Field(default=None, description="of the laser line at these ranges")
    camera_side: Literal["x", "-x", "y", "-y"] | None = Field(default=None, description="of the laser, where it looks")
    triangulation_deg: Annotated[float, Field(ge=2, lt=90)] | None = None
    noise_mm: Positive | None = Field(default=None, description="standard deviation of one range")
    noise_columns: Positive | None = Field(default=None, description="over which neighbours share their noise")
    linearity_mm: Annotated[float, Field(ge=0, le=1)] | None = Field(
        default=None, description="rms of the range error over the columns that is the same in every profile"
    )
    linearity_length_mm: Positive | None = Field(
        default=None, description="lateral length over which it changes: a quarter of a wave's"
    )
    line_thickness_mm: Positive | None = Field(default=None, description="recorded only, likewise")
    filters: tuple[str, ...] | None = Field(default=None, description="recorded only, likewise")
    body: tuple[Box, ...] | None = None

    @model_validator(mode="after")
    def _spelt(self) -> Self:
        """A word misspelt would count as one that is not known; further words are kept."""
        absent = self.__class__.model_fields.keys() - self.model_fields_set
        for word in self.model_extra or ():
            if near := difflib.get_close_matches(word, absent, n=1, cutoff=MISSPELT):
                raise ValueError(f"unknown key '{word}'; did you mean '{near[0]}'?")
        if self.model_extra and len(self.model_extra) == len(self.model_fields_set):
            raise ValueError(f"says nothing of a sensor, such as its 'columns', but '{next(iter(self.model_extra))}'")
        return self
