"""`weld.groove`: from an inspected bevel to the weld groove, section by section and along the whole edge."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from workbench.api import DEG, Float, InputError, Inspection, Section, Verdict, frozen, stage
from workbench_welding.area import Joint, groove_area_mm2, groove_area_u_mm2


@dataclass(frozen=True, slots=True, eq=False)
class GrooveSection:
    """The groove in one inspected section; areas are None where the edge is hidden."""

    index: int
    arc_length_mm: float
    area_mm2: float | None
    area_u_mm2: float | None
    verdict: Verdict


@dataclass(frozen=True, slots=True, eq=False)
class Groove:
    """The weld groove that an inspected bevel makes with its joint."""

    joint: Joint
    sections: tuple[GrooveSection, ...]
    arc_length_mm: Float  # (n,) along the lower edge
    area_mm2: Float  # (n,) NaN where not measured
    area_u_mm2: Float  # (n,)
    nominal_mm2: float  # with root face and bevel angle as required
    limits_mm2: tuple[float, float]
    volume_mm3: float  # over the measured stretches
    volume_u_mm3: float
    measured_mm: float  # length of these stretches
    verdict: Verdict
    reason: str


def _about_zero(tolerance: tuple[float, float]) -> tuple[float, float]:
    if not tolerance[0] <= 0.0 <= tolerance[1]:
        raise ValueError("expected [lower, upper] with lower <= 0 <= upper")
    return tolerance


@stage("weld.groove")
def groove(
    inspection: Inspection,
    *,
    thickness_mm: Annotated[float, Field(gt=0, le=500, description="of both plates")],
    thickness_u_mm: Annotated[float, Field(ge=0, le=10, description="standard uncertainty of the thickness")] = 0.1,
    gap_mm: Annotated[float, Field(ge=0, le=50, description="between the root faces, as fitted up")] = 2.0,
    gap_u_mm: Annotated[float, Field(ge=0, le=10, description="standard uncertainty of the gap")] = 0.2,
    bevelled_plates: Annotated[
        Literal[1, 2], Field(description="1: against a square edge; 2: against the bevel's mirror image")
    ] = 2,
    tolerance_percent: Annotated[
        tuple[float, float],
        AfterValidator(_about_zero),
        Field(description="lower and upper deviation of the area from its nominal value, in percent of it"),
    ] = (-10.0, 10.0),
) -> Groove:
    """Compute how much weld metal the joint takes: area of the groove a section, volume along the edge, verdicts.

    The nominal area has the root face and bevel angle that the inspection requires. Verdicts follow ISO 14253-1 with
    the inspection's guard factor. The volume's uncertainty adds those along the edge, since thickness, gap and the
    tilt of the root face are common to the whole of it.

    Raises:
        InputError: a plate that is not thicker than a root face measured on it, or nothing measured.
    """
    joint = Joint(thickness_mm, thickness_u_mm, gap_mm, gap_u_mm, bevelled_plates)
    required, profile = inspection.requirements, inspection.profile
    area, u = _area(profile.root_mm, profile.root_u_mm, profile.bevel_deg, profile.bevel_u_deg, joint)
    root_mm, bevel = np.array([required.root_nominal_mm, required.bevel_nominal_deg * DEG])
    nominal = float(groove_area_mm2(root_mm, bevel, joint))
    lower, upper = (nominal * (1 + share / 100) for share in tolerance_percent)
    sections = tuple(_section(s, joint, (lower, upper), inspection.guard_factor) for s in inspection.sections)
    step_mm, middle, middle_u = _intervals(profile.arc_length_mm, area, u)
    verdict, reason = _of_the_part(sections)
    volume, volume_u, length = float(middle @ step_mm), float(middle_u @ step_mm), float(step_mm.sum())
    return Groove(
        joint,
        sections,
        frozen(profile.arc_length_mm),
        frozen(area),
        frozen(u),
        nominal,
        (lower, upper),
        volume,
        volume_u,
        length,
        verdict,
        reason,
    )


def _area(root_mm: Float, root_u_mm: Float, bevel_deg: Float, bevel_u_deg: Float, joint: Joint) -> tuple[Float, Float]:
    if not (root_mm < joint.thickness_mm).any():
        raise InputError(
            "weld.groove.thickness_mm",
            f"expected a plate thicker than its root face, "
            f"{np.nanmin(root_mm, initial=np.inf):.3g} mm or more where it was measured",
        )
    bevel, bevel_u = bevel_deg * DEG, bevel_u_deg * DEG
    return groove_area_mm2(root_mm, bevel, joint), groove_area_u_mm2(root_mm, root_u_mm, bevel, bevel_u, joint)


def _section(section: Section, joint: Joint, limits_mm2: tuple[float, float], guard_factor: float) -> GrooveSection:
    values = [section.values[name] for name in ("root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg")]
    if None in values:
        return GrooveSection(section.index, section.arc_length_mm, None, None, "undecided")
    root_mm, root_u_mm, bevel_deg, bevel_u_deg = np.array(values, dtype=float)
    area, u = (float(one) for one in _area(root_mm, root_u_mm, bevel_deg, bevel_u_deg, joint))
    return GrooveSection(section.index, section.arc_length_mm, area, u, _verdict(area, guard_factor * u, limits_mm2))


def _verdict(value: float, guard: float, limits: tuple[float, float]) -> Verdict:
    """ISO 14253-1: within the limits, or outside them, by at least the guard band; else undecided."""
    inside = min(value - limits[0], limits[1] - value)
    return "pass" if inside >= guard else "fail" if inside <= -guard else "undecided"


def _intervals(arc_length_mm: Float, *columns: Float) -> tuple[Float, ...]:
    """Lengths of the intervals whose both ends were measured, and each column's mean there (trapezoidal rule)."""
    step_mm, middles = np.diff(arc_length_mm), [(column[1:] + column[:-1]) / 2 for column in columns]
    known = np.isfinite(middles).all(axis=0)
    return (step_mm[known], *(middle[known] for middle in middles))


def _of_the_part(sections: tuple[GrooveSection, ...]) -> tuple[Verdict, str]:
    """One failing section fails the part; it passes when all pass."""
    for verdict in ("fail", "undecided"):
        found = [str(s.index) for s in sections if s.verdict == verdict]
        if found:
            return verdict, f"weld groove: section{'s' * (len(found) > 1)} {', '.join(found)} {verdict}"
    return "pass", f"weld groove: all {len(sections)} sections within tolerance"
