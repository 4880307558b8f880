"""The edge that was found in a scan: its faces frame by frame, its stations and axes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from workbench.artefacts.checks import Check
from workbench.artefacts.parts import UNKNOWN_PART, Part
from workbench.artefacts.showing import AlongTheEdge
from workbench.geometry.faces import FaceLines
from workbench.units import AnyArray, Bool, Float, Int

# Face labels of a grid point, in `Edge.labels` (uint8).
UNLABELLED, ROOT_FACE, BEVEL_FACE, UPPER_SURFACE, LOWER_SURFACE = range(5)
FACE_NAMES = ("unlabelled", "root face", "bevel face", "upper surface", "lower surface")


@dataclass(frozen=True, slots=True, eq=False)
class EdgeFrames:
    """What each of the N frames says about a milled edge, in the section plane; NaN where it does not see the edge.

    Angles are directions of the faces, from the lower to the upper side, in the plane normal to the edge's tangent,
    counted from `reference` towards t x `reference`.
    """

    arc_length_mm: Float  # (N,) where the frame crosses the upper edge of the root face
    lower_arc_length_mm: Float  # (N,) where it crosses the lower edge
    reference: Float  # (N, 3) unit vector normal to t that does not twist along the edge
    tilt: Float  # (N,) direction of the root face, as estimated for the whole pass, rad
    root_angle: Float  # (N,) direction of the root face in this frame alone, rad
    root_angle_variance: Float  # (N,) rad^2, from independent range noise
    bevel_arc_length_mm: Float  # (N,) where the frame measures the bevel
    bevel_angle: Float  # (N,) direction of the bevel face, corrected for drift and curvature, rad
    bevel_angle_variance: Float  # (N,) rad^2, from independent range noise
    bevel_lever_mm: Float  # (N,) distance of the bevel's measured points from the upper edge of the root face
    root_low_mm: Float  # (N,) root size up to the last return on the root face; the edge lies at most a step beyond
    root_step_mm: Float  # (N,) that step between columns; 0 where the lower edge is a corner of two faces
    root_sigma_mm: Float  # (N,) standard deviation of root_low_mm from range noise
    root_weight: Float  # (N,) what the frame counts for the root size: less than 1 where neighbours say the same
    missing: Float  # (N,) probability that a column at the end of the root face has no return on it
    tangent_leverage: (
        Float  # (N,) error of the bevel angle per error of the edge's tangent; 0: the laser plane is square
    )


@dataclass(frozen=True, slots=True, eq=False)
class Edge(AlongTheEdge):
    """The workpiece's edge as measured: faces a frame, the lower edge as a curve in the base.

    t = m x n (docs/conventions.md). Curve arrays have one row a *station*, about 1 mm apart, from arc length 0 at the
    first measured point of the lower edge to its last.
    """

    kind: Literal["milled", "raw"]
    faces: Mapping[int, FaceLines]  # by label: ROOT_FACE (the end face of a raw edge), BEVEL_FACE, ...
    labels: AnyArray  # (N, M) uint8, face of each grid point
    pass_index: Int  # (N,)
    frame_arc_length_mm: Float  # (N,) where each frame crosses the lower edge; NaN: edge not seen in that frame
    frame_tangent: Float  # (N, 3) t at each frame, NaN where not seen
    frames: EdgeFrames | None  # None: a raw edge
    tangent_u: float  # standard uncertainty of the tangent's direction, rad
    arc_length_mm: Float  # (n,)
    position_mm: Float  # (n, 3) lower edge in the base; NaN where hidden
    tangent: Float  # (n, 3) unit, rising arc length; interpolated where hidden
    normal: Float  # (n, 3) unit outward normal of the end face (root face), in the section plane
    across: Float  # (n, 3) unit, m: from the lower to the upper side
    seen: Bool  # (n,) measured here; False under clamps and in other gaps
    burr_stations: Int  # (b,) stations where material stands out beyond the faces
    upper_position_mm: Float | None = None  # (n, 3) raw edge: its upper edge; NaN where hidden
    upper_inward: Float | None = None  # (n, 3) raw edge: unit, along the upper surface, into the plate
    position_u_mm: Float | None = None  # (n, 2) standard uncertainty of `position_mm` along `normal` and `across`
    normal_u: float = 0.0  # standard uncertainty of the direction of `normal` about the tangent, rad
    hand_eye_u_mm: Float | None = None  # (n, 2) as `position_u_mm`: what the hand-eye pose adds, one for the whole scan
    root_u_mm: float = 0.0  # standard uncertainty of all root sizes by what no frame shows
    root_direction_u: float = 0.0  # the same of the root face's direction, rad
    part: Part = UNKNOWN_PART
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()  # of the cloud that it was found in, and of the faces
