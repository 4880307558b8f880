"""Weld grooves: two plates with a gap, as found in a scan and as judged. Terms of ISO 9692-1 and ISO 17659."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

from workbench.artefacts.checks import Check
from workbench.artefacts.edges import Quantity
from workbench.artefacts.inspections import Uncertainty, Verdict
from workbench.artefacts.parts import UNKNOWN_PART, Part
from workbench.artefacts.showing import rows_table
from workbench.units import AnyArray, Bool, Float

GrooveType = Literal["I", "V", "Y", "HV", "HY", "X", "K", "U", "J"]
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


def u_name(size: str) -> str:
    """Name of a size's standard uncertainty: `gap_u_mm` of `gap_mm`."""
    stem, _, unit = size.rpartition("_")
    return f"{stem}_u_{unit}"


@dataclass(frozen=True, slots=True, eq=False)
class Corner:
    """A corner of the groove along it: (right, up) of the section's axes from its origin; NaN where not seen."""

    section_mm: Float  # (n, 2)
    u_mm: Float  # (n, 2)


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class Groove:
    """A groove as measured, one row a station about 1 mm apart along it.

    Axes of the section: `normal` from the left plate to the right one along their upper surfaces, `across` up, out of
    the plates; tangent = across x normal. Its origin lies between the upper edges of both plates.
    """

    type: GrooveType
    alternatives: tuple[GrooveType, ...]  # types that the side seen does not exclude
    declared: bool  # the type was given, and is not excluded; else it was chosen by the evidence
    arc_length_mm: Float  # (n,)
    origin_mm: Float  # (n, 3) in the base
    tangent: Float  # (n, 3)
    normal: Float  # (n, 3)
    across: Float  # (n, 3)
    seen: Bool  # (n,)
    sizes: Mapping[str, Quantity]  # by names of SIZES: (n,) mm, or degrees; those that the type has and that were seen
    corners: Mapping[str, Corner]
    frame_arc_length_mm: Float  # (N,) NaN: not seen in that frame
    x_mm: AnyArray  # (N, M) lateral places of the columns, for telling a corner's column
    base_from_profiler: Float  # (N, 4, 4)
    pass_index: AnyArray  # (N,)
    part: Part = UNKNOWN_PART
    warnings: tuple[str, ...] = ()
    checks: tuple[Check, ...] = ()


@dataclass(frozen=True, slots=True, eq=False)
class GrooveSection:
    """One section of a groove: values, standard uncertainties and corners, as in `groove.json`."""

    index: int
    arc_length_mm: float
    origin_mm: Float  # (3,)
    tangent: Float
    normal: Float
    across: Float
    values: Mapping[str, float | None]  # SIZES and their u
    corners: tuple[Mapping[str, Any], ...]
    verdict: Verdict
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class GrooveInspection:
    """A groove against its requirements (ISO 14253-1 with guard band `guard_factor` * u)."""

    type: GrooveType
    alternatives: tuple[GrooveType, ...]
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
