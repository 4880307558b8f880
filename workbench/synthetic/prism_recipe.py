"""Straight weld grooves of the first simulator (`"format": "groove-recipe"`): the recipe, and random ones.

The part's frame: the groove runs along +x, its middle at y = 0, the left plate at +y; the left plate's lower surface
lies in z = 0. Lengths in mm, angles in degrees.
"""

from __future__ import annotations

import math
import zlib
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, model_validator

from workbench.errors import InputError, nearest
from workbench.synthetic.draws import Document, draw_course, draw_disturbances, draw_part, draw_robot, draw_scanner
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
from workbench.units import DEG

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
_STEEP = ("U", "J")  # flanks of 10 to 20 deg above a radius; others 28 to 45


def random_prism_recipe(kind: str, seed: int) -> PrismRecipe:
    """A groove of type `kind` drawn at random; the same seed gives the same recipe."""
    if kind not in TYPES:
        raise InputError(f"groove '{kind}'", "a type of groove" + nearest(kind, TYPES))
    rng = np.random.default_rng([seed, zlib.crc32(f"prism {kind}".encode())])
    thickness = rng.uniform(8, 15)
    low, high = (10, 20) if kind in _STEEP else (28, 45)
    bevels = rng.uniform(low, high, 2)
    robot, scanner, length = draw_robot(rng), draw_scanner(rng), rng.uniform(80, 140)
    half_width = (thickness - 1) * math.tan(max(bevels) * DEG) + (6 if kind in _STEEP else 2)
    scanner["pitch_mm"] = max(0.04, (2 * half_width + 16) / scanner["columns"])
    scanner["near_mm"], scanner["far_mm"] = scanner["standoff_mm"] - 40, scanner["standoff_mm"] + 60
    lean = rng.uniform(-8, 8) if kind in "VYXU" else rng.uniform(3, 9 if kind == "J" else 20)
    groove: Document = {
        "type": kind,
        "length_mm": length,
        "thickness_mm": draw_course(rng, thickness, 0.05, 0.05),
        "gap_mm": draw_course(rng, rng.uniform(1, 3.5), 0.5, 0.2),
        "root_face_mm": draw_course(rng, rng.uniform(0.5, 0.2 * thickness), 0.1, 0.05),
        "bevel_left_deg": draw_course(rng, bevels[0], 0.5, 0.2),
        "bevel_right_deg": draw_course(rng, bevels[1], 0.5, 0.2),
        "radius_mm": rng.uniform(2, 5),
        "under_mm": rng.uniform(0.25, 0.4) * thickness,
        "misalignment_mm": draw_course(rng, rng.uniform(-0.8, 0.8), 0.3, 0.1),
        "background_mm": None if rng.random() < 0.4 else rng.uniform(2, 20),
        "mounds": [
            {
                "at_mm": rng.uniform(10, length - 10),
                "z_mm": rng.uniform(0, 2),
                "half_mm": [rng.uniform(3, 8), rng.uniform(1.5, 3), rng.uniform(1, 3)],
            }
            for _ in range(rng.integers(0, 3))
        ],
        "base_from_part": draw_part(rng)["base_from_part"],
    }
    ends = [2.0, length - 2.0]
    if rng.random() < 0.5:
        ends.reverse()
    scan = {
        "from_mm": ends[0],
        "to_mm": ends[1],
        "elevation_deg": 90 + lean,
        "oblique_deg": rng.uniform(-5, 5),
        "lead_deg": rng.uniform(-6, 6),
        "aim_mm": [rng.uniform(-1, 1), 0.7 * thickness],
        "skew_mm": [-1.0, 1.0],
        "upside_down": bool(rng.random() < 0.5),
    }
    document: Document = {"format": "groove-recipe", "title": kind, "seed": seed, "groove": groove, "passes": [scan]}
    document |= {"scanner": scanner, "robot": robot | {"frame_pitch_mm": 0.4}, "disturbances": draw_disturbances(rng)}
    return PrismRecipe.model_validate(document)
