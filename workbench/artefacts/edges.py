"""The edge that was found in a scan: its faces frame by frame, its stations and axes, its sizes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from workbench.artefacts.evidence import UNKNOWN_PART, Check, Part
from workbench.artefacts.showing import AlongTheEdge
from workbench.geometry.faces import FaceLines
from workbench.units import AnyArray, Bool, Float, Int, Shaped

# Face labels of a grid point, in `Edge.labels` (uint8).
UNLABELLED, ROOT_FACE, BEVEL_FACE, UPPER_SURFACE, LOWER_SURFACE = range(5)
FACE_NAMES = ("unlabelled", "root face", "bevel face", "upper surface", "lower surface")


# Sources of uncertainty of root face and bevel angle, and how each is evaluated (GUM 4.2, 4.3).
END = "end of the root face and range noise"
DIRECTIONS = "directions of the faces"
TANGENT = "direction of the edge: robot position noise and hand-eye pose"
FORM = "form of the faces: what straight lines leave"
ROUNDING = "rounding of the lower edge"
PASSES = "agreement of scanning passes"
DECLARED = "declared for what no frame shows"
KINDS: dict[str, Literal["A", "B"]] = {
    END: "A",
    DIRECTIONS: "A",
    TANGENT: "B",
    FORM: "A",
    ROUNDING: "B",
    PASSES: "B",
    DECLARED: "B",
}


@dataclass(frozen=True, slots=True, eq=False)
class Quantity:
    """A quantity along the edge with its standard uncertainty by source; NaN where it was not measured."""

    value: Shaped[Float, " n"]
    u_by_source: Mapping[str, Float]  # (n,) each, in the unit of the value; squares add

    @property
    def u(self) -> Float:
        """Combined standard uncertainty (n,)."""
        return np.sqrt(sum(u**2 for u in self.u_by_source.values()))


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Edge(AlongTheEdge):
    """The workpiece's edge as measured: faces a frame, the lower edge as a curve in the base.

    t = m x n (docs/conventions.md). Curve arrays have one row a *station*, about 1 mm apart, from arc length 0 at the
    first measured point of the lower edge to its last.
    """

    faces: Mapping[int, FaceLines]  # by label: ROOT_FACE (the end face of a raw edge), BEVEL_FACE, ...
    labels: Shaped[AnyArray, "N M"]  # uint8, face of each grid point
    pass_index: Shaped[Int, " N"]
    # where each frame crosses the lower edge; NaN: edge not seen in that frame
    frame_arc_length_mm: Shaped[Float, " N"]
    arc_length_mm: Shaped[Float, " n"]
    position_mm: Shaped[Float, "n 3"]  # lower edge in the base; NaN where hidden
    tangent: Shaped[Float, "n 3"]  # unit, rising arc length; interpolated where hidden
    tangent_u: Shaped[Float, " n"]  # standard uncertainty of the tangent's direction, rad
    normal: Shaped[Float, "n 3"]  # unit outward normal of the end face (root face), in the section plane
    across: Shaped[Float, "n 3"]  # unit, m: from the lower to the upper side
    seen: Shaped[Bool, " n"]  # measured here; False under clamps and in other gaps
    burr_stations: Shaped[Int, " b"]  # stations where material stands out beyond the faces
    part: Part = UNKNOWN_PART
    source: str = ""  # the file it was measured in
    warnings: tuple[str, ...] = ()
    not_included: tuple[str, ...] = ()  # what no recording of this kind can show, in sentences
    checks: tuple[Check, ...] = ()  # of the cloud that it was found in, and of the faces


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class MilledEdge(Edge):
    """A milled edge: root face and bevel face, with the width of one and the angle of the other at each station."""

    root: Quantity  # (n,) root face, mm
    bevel: Quantity  # (n,) bevel angle, rad


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class RawEdge(Edge):
    """A raw edge: an end face between the two surfaces of the plate."""

    upper_position_mm: Shaped[Float, "n 3"]  # its upper edge; NaN where hidden
    upper_inward: Shaped[Float, "n 3"]  # unit, along the upper surface, into the plate
    position_u_mm: Shaped[Float, "n 2"]  # standard uncertainty of `position_mm` along `normal` and `across`
    normal_u: Shaped[Float, " n"]  # standard uncertainty of the direction of `normal` about the tangent, rad
    hand_eye_u_mm: Shaped[Float, "n 2"] | None = (
        None  # as `position_u_mm`: what the hand-eye pose adds, one for the whole scan
    )
    hand_eye_turn: Shaped[Float, " n"] | None = None  # of `normal_u`: what the hand-eye pose has in it, rad
