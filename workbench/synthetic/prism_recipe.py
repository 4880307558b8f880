"""The recipe of straight weld grooves of the first simulator (`"format": "groove-recipe"`).

The part's frame: the groove runs along +x, its middle at y = 0, the left plate at +y; the left plate's lower surface
lies in z = 0. Lengths in mm, angles in degrees.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from workbench.synthetic.recipe import (
    Along,
    Course,
    Disturbances,
    NonNegative,
    Number,
    Part,
    Pass,
    Placement,
    Positive,
    Recipe,
    Robot,
    Scanner,
    Strict,
)

SQUARE = {"I": ("left", "right"), "HV": ("right",), "HY": ("right",), "K": ("right",), "J": ("right",)}


class Mound(Strict):
    """A tack weld: an ellipsoid about the middle of the gap."""

    at_mm: Number
    z_mm: Number = 1.0
    half_mm: tuple[Positive, Positive, Positive] = (6.0, 2.5, 2.0)  # along the groove, across, up


class PrismGroove(Strict):
    """Two plates with a gap; one-sided types have their bevel on the left plate."""

    type: Literal["I", "V", "Y", "HV", "HY", "X", "K", "U", "J"] = "V"
    length_mm: Annotated[float, Field(ge=5, le=20000)] = 120.0
    thickness_mm: Along = Course(start=10.0, end=10.0)
    gap_mm: Along = Course(start=2.0, end=2.0)
    root_face_mm: Along = Course(start=2.0, end=2.0)
    bevel_left_deg: Along = Course(start=30.0, end=30.0)
    bevel_right_deg: Along = Course(start=30.0, end=30.0)
    radius_mm: Annotated[float, Field(ge=0.5, le=30)] = 6.0
    under_mm: Annotated[float, Field(gt=0, le=100)] = 4.0
    under_deg: Annotated[float, Field(ge=5, le=70)] = 30.0
    misalignment_mm: Along = Course(start=0.0, end=0.0)
    plate_width_mm: Positive = 60.0
    background_mm: NonNegative | None = None
    mounds: tuple[Mound, ...] = ()
    base_from_part: Placement = Placement(position_mm=(1500.0, 0.0, 800.0))

    @model_validator(mode="after")
    def _sound(self) -> PrismGroove:
        below = self.under_mm if self.type in ("X", "K") else 0.0
        if self.gap_mm.lowest < 0 or self.root_face_mm.lowest < 0:
            raise ValueError("gap_mm and root_face_mm must not fall below 0 along the edge")
        if self.type != "I" and self.root_face_mm.highest + below > 0.9 * self.thickness_mm.lowest:
            raise ValueError("root_face_mm must stay below 0.9 thickness_mm, less under_mm of an X or K")
        if min(self.bevel_left_deg.lowest, self.bevel_right_deg.lowest) < 3:
            raise ValueError("bevel_left_deg and bevel_right_deg must stay above 3")
        if max(self.bevel_left_deg.highest, self.bevel_right_deg.highest) > 70:
            raise ValueError("bevel_left_deg and bevel_right_deg must stay below 70")
        return self


class PrismRecipe(Strict):
    """A synthetic recording of a straight groove in full. The same recipe gives the same numbers."""

    format: Literal["groove-recipe"] = "groove-recipe"
    version: Literal[1] = 1
    title: str = ""
    part_id: str | None = None
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    groove: PrismGroove = PrismGroove()
    scanner: Scanner = Scanner()
    robot: Robot = Robot()
    disturbances: Disturbances = Disturbances()
    passes: Annotated[tuple[Pass, ...], Field(min_length=1, max_length=100)]

    def on_plate(self) -> Recipe:
        """The same scan past a raw plate's edge that lies where the groove's middle does: it moves alike."""
        groove = self.groove
        part = Part(kind="raw", length_mm=groove.length_mm, base_from_part=groove.base_from_part)
        return Recipe(
            title=self.title,
            part_id=self.part_id,
            seed=self.seed,
            part=part,
            scanner=self.scanner,
            robot=self.robot,
            disturbances=self.disturbances,
            passes=self.passes,
        )


TYPES = ("I", "V", "Y", "HV", "HY", "X", "K", "U", "J")
