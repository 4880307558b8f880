"""Joint preparations: grooves between two plates, and the prepared edge of one. Terms of ISO 9692-1 and ISO 17659."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

from workbench.artefacts.edges import Quantity, Uncertainty, Verdict
from workbench.artefacts.evidence import UNKNOWN_PART, Check, Part
from workbench.artefacts.showing import rows_table
from workbench.units import AnyArray, Bool, Float, Shaped

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
