"""The edge, groove or preparation that was found, and what was measured on it against what was asked for.

Terms of joint preparations are those of ISO 9692-1 and ISO 17659.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal

import numpy as np

from workbench.artefacts.evidence import UNKNOWN_PART, Check, Part, Verdict
from workbench.artefacts.showing import AlongTheEdge, along_chart, rows_table
from workbench.geometry.chains import FaceLines
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


@dataclass(frozen=True, slots=True, eq=False)
class Requirements:
    """What the part must satisfy: nominal values and deviations from them, lower <= 0 <= upper."""

    root_nominal_mm: float = 1.5
    root_tolerance_mm: tuple[float, float] = (-0.5, 0.5)
    bevel_nominal_deg: float = 40.0
    bevel_tolerance_deg: tuple[float, float] = (-1.0, 1.0)


def conformity(value: float, u: float, nominal: float, tolerance: tuple[float, float], guard_factor: float) -> Verdict:
    """Whether a value with standard uncertainty u conforms to nominal + tolerance, all in one unit (ISO 14253-1).

    'pass' inside the limits by at least guard_factor * u, 'fail' outside by at least that, else 'undecided'.
    """
    low, high, guard = nominal + tolerance[0], nominal + tolerance[1], guard_factor * u
    if low + guard <= value <= high - guard:
        return "pass"
    if value <= low - guard or value >= high + guard:
        return "fail"
    return "undecided"


@dataclass(frozen=True, slots=True, eq=False)
class Section:
    """One inspected section. Values are None where the edge is hidden; `verdict` is then 'undecided'."""

    index: int  # from 1
    arc_length_mm: float
    origin_mm: Shaped[Float, " 3"]  # on the lower edge
    tangent: Shaped[Float, " 3"]  # unit, normal of the section plane
    normal: Shaped[Float, " 3"]  # unit, n
    across: Shaped[Float, " 3"]  # unit, m
    root_mm: float | None
    root_u_mm: float | None
    bevel_deg: float | None
    bevel_u_deg: float | None
    verdict: Verdict
    reason: str
    frames: Int  # indices of the frames that it rests on


@dataclass(frozen=True, slots=True, eq=False)
class EdgeProfile:
    """Root face and bevel angle along the whole edge; NaN where they cannot be measured."""

    arc_length_mm: Shaped[Float, " n"]
    position_mm: Shaped[Float, "n 3"]  # lower edge in the base
    root_mm: Shaped[Float, " n"]
    root_u_mm: Shaped[Float, " n"]
    bevel_deg: Shaped[Float, " n"]
    bevel_u_deg: Shaped[Float, " n"]
    root_u_by_source_mm: Mapping[str, Float] = field(default_factory=dict)  # (n,) each; squares add; empty: not told
    bevel_u_by_source_deg: Mapping[str, Float] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class UncertaintySource:
    """One contribution to the combined standard uncertainty (GUM 4.1.4)."""

    name: str
    root_u_mm: float  # to the root face's width, in the section with the largest uncertainty of it
    bevel_u_deg: float  # to the bevel angle, likewise
    kind: Literal["A", "B"]  # evaluated from the scatter of these measurements, or by other means (GUM 4.2, 4.3)


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """The uncertainty budget: the squares of the sources add to the square of the largest section's u."""

    coverage_factor: float = 2.0
    sources: tuple[UncertaintySource, ...] = ()
    not_included: tuple[str, ...] = ()  # sentences
    correlations: str = ""  # why the squares do not add up, where they do not


NO_BUDGET = Uncertainty()


@dataclass(frozen=True, slots=True, eq=False)
class Inspection:
    """The measured part against its requirements (ISO 14253-1 with guard band `guard_factor` * u)."""

    sections: tuple[Section, ...]
    profile: EdgeProfile
    requirements: Requirements
    guard_factor: float
    verdict: Verdict
    reason: str
    root_face_tilt: str  # how the root face's tilt was estimated: 'whole edge' or 'per section'
    part: Part = UNKNOWN_PART
    uncertainty: Uncertainty = NO_BUDGET
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()  # what was checked of recording and faces
    source: str = ""  # the file it was measured in

    def table(self) -> Any:
        """A row a section: a pandas DataFrame where pandas is installed, else a list of dicts."""
        names = ("index", "arc_length_mm", "root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg", "verdict")
        return rows_table([{name: getattr(section, name) for name in names} for section in self.sections])

    def plot(self) -> Any:
        """A matplotlib Figure of root face and bevel angle along the edge, with U = 2 u."""
        p = self.profile
        root, bevel = ("root face, mm", p.root_mm, p.root_u_mm), ("bevel angle, deg", p.bevel_deg, p.bevel_u_deg)
        return along_chart(p.arc_length_mm, root, bevel)


GrooveType = Literal["I", "V", "Y", "HV", "HY", "X", "K", "U", "J"]
PreparationType = Literal["bevel", "compound", "nose", "J"]
SIZES = (
    "gap_mm",
    "root_face_left_mm",
    "root_face_right_mm",
    "bevel_left_deg",
    "bevel_right_deg",
    "included_deg",
    "depth_mm",
    "width_mm",
    "misalignment_mm",
    "root_radius_mm",
)

TERMS = {  # of ISO 17659 and letters of ISO 9692-1, which has none for the last two; in the order of reports
    "gap_mm": ("Root gap", "b"),
    "root_face_left_mm": ("Root face, left", "c₁"),
    "root_face_right_mm": ("Root face, right", "c₂"),
    "bevel_left_deg": ("Bevel angle, left", "β₁"),
    "bevel_right_deg": ("Bevel angle, right", "β₂"),
    "included_deg": ("Included angle", "α"),
    "depth_mm": ("Depth of preparation", "h"),
    "root_radius_mm": ("Root radius", "R"),
    "width_mm": ("Groove width", "–"),
    "misalignment_mm": ("Linear misalignment", "–"),
}
PREPARATION_TERMS = {  # likewise, of one plate
    "root_face_mm": ("Root face", "c"),
    "bevel_deg": ("Bevel angle", "β"),
    "upper_bevel_deg": ("Upper bevel angle", "β₂"),
    "lower_bevel_mm": ("Height of the lower bevel", "h₁"),
    "land_mm": ("Land", "–"),
    "depth_mm": ("Depth of preparation", "h"),
    "root_radius_mm": ("Root radius", "R"),
    "width_mm": ("Preparation width", "–"),
}


def u_name(size: str) -> str:
    """Name of a size's standard uncertainty: `gap_u_mm` of `gap_mm`."""
    stem, _, unit = size.rpartition("_")
    return f"{stem}_u_{unit}"


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """A corner of the groove along it: (right, up) of the section's axes from its origin; NaN where not seen."""

    section_mm: Shaped[Float, "n 2"]
    u_mm: Shaped[Float, "n 2"]


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Joint:
    """What is measured of a joint's preparation, one row a station about 1 mm apart along it."""

    terms: ClassVar[Mapping[str, tuple[str, str]]]  # of each size: term and letter
    type: str
    alternatives: tuple[str, ...] = ()  # types that the side seen does not exclude
    declared: bool  # the type was given, and is not excluded; else it was chosen by the evidence
    arc_length_mm: Shaped[Float, " n"]
    origin_mm: Shaped[Float, "n 3"]  # in the base
    tangent: Shaped[Float, "n 3"]
    normal: Shaped[Float, "n 3"]
    across: Shaped[Float, "n 3"]
    seen: Shaped[Bool, " n"]
    sizes: Mapping[str, Quantity]  # by names of `terms`: (n,) mm, or degrees; those that were seen
    corners: Mapping[str, Corner]
    frame_arc_length_mm: Shaped[Float, " N"]  # NaN: not seen in that frame
    x_mm: Shaped[AnyArray, "N M"]  # lateral places of the columns, for telling a corner's column
    base_from_profiler: Shaped[Float, "N 4 4"]
    pass_index: Shaped[AnyArray, " N"]
    part: Part = UNKNOWN_PART
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Groove(Joint):
    """A groove between two plates.

    Axes of the section: `normal` from the left plate to the right one along their upper surfaces, `across` up, out of
    the plates; tangent = across x normal. Its origin lies between the upper edges of both plates.
    """

    terms: ClassVar = TERMS
    type: GrooveType
    alternatives: tuple[GrooveType, ...] = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Preparation(Joint):
    """The prepared edge of one plate: root face, bevels, land, fillet.

    Axes of the section: `normal` out of the root face, `across` from the lower to the upper side; tangent = across x
    normal. Its origin is the lower edge.
    """

    terms: ClassVar = PREPARATION_TERMS
    type: PreparationType
    alternatives: tuple[PreparationType, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class GrooveSection:
    """One section of a joint: values, standard uncertainties and corners, as in `groove.json`."""

    index: int
    arc_length_mm: float
    origin_mm: Shaped[Float, " 3"]
    tangent: Float
    normal: Float
    across: Float
    values: Mapping[str, float | None]  # sizes and their u
    corners: tuple[Mapping[str, Any], ...]
    verdict: Verdict
    reason: str


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class JointInspection:
    """A joint's preparation against its requirements (ISO 14253-1 with guard band `guard_factor` * u)."""

    terms: ClassVar[Mapping[str, tuple[str, str]]]
    type: str
    alternatives: tuple[str, ...]
    declared: bool
    sections: tuple[GrooveSection, ...]
    requirements: Mapping[str, Any]
    guard_factor: float
    verdict: Verdict
    reason: str
    uncertainty: Uncertainty
    size_sources: tuple[Mapping[str, Any], ...]  # name, kind and u of every size, each in its worst section
    part: Part = UNKNOWN_PART
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()

    def table(self) -> Any:
        """A row a section: a pandas DataFrame where pandas is installed, else a list of dicts."""
        return rows_table(
            [
                {"index": s.index, "arc_length_mm": s.arc_length_mm, **s.values, "verdict": s.verdict}
                for s in self.sections
            ]
        )


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class GrooveInspection(JointInspection):
    """A groove against its requirements."""

    terms: ClassVar = TERMS


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class PreparationInspection(JointInspection):
    """The prepared edge of one plate against its requirements."""

    terms: ClassVar = PREPARATION_TERMS
