"""`inspect.sections`: root size and bevel angle in sections of a milled edge, and the verdict on them."""

from __future__ import annotations

from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Edge, EdgeProfile, Inspection, Requirements, Section, Verdict
from workbench.errors import InputError
from workbench.geometry.gaps import covered
from workbench.inspect.angles import BevelAngles, bevel_angles
from workbench.inspect.budget import budget
from workbench.inspect.roots import RootSizes, root_sizes
from workbench.inspect.verdict import judge, worst
from workbench.stage import stage
from workbench.units import DEG, Bool, Float

Tolerance = tuple[Annotated[float, Field(le=0)], Annotated[float, Field(ge=0)]]

MOST_BEVEL = 85.0 * DEG  # a root size or an angle beyond these limits is no measure of a bevel


@stage("inspect.sections")
def sections(
    edge: Edge,
    *,
    root_nominal_mm: Annotated[float, Field(gt=0, le=50, description="required root size")] = 1.5,
    root_tolerance_mm: Annotated[Tolerance, Field(description="allowed deviations from it, lower and upper")] = (
        -0.5,
        0.5,
    ),
    bevel_nominal_deg: Annotated[float, Field(gt=0, lt=90, description="required bevel angle")] = 40.0,
    bevel_tolerance_deg: Annotated[Tolerance, Field(description="allowed deviations from it")] = (-1.0, 1.0),
    sections: Annotated[int, Field(ge=1, le=999, description="count of sections along the edge")] = 9,
    half_width_mm: Annotated[
        float, Field(ge=1, le=100, description="length of edge on each side of a section whose frames count for it")
    ] = 10.0,
    guard_factor: Annotated[float, Field(ge=0, le=5, description="guard band over u; 1.645: 95 % one-sided")] = 1.645,
) -> Inspection:
    """Measure root size and bevel angle in equidistant sections (the paper's section 6.3, Figs. 20 and 21) and judge.

    Section i lies at (i - 1/2)/n of the measured stretch of the lower edge. Sizes and angles hold in the section plane,
    normal to the edge's tangent. The root face's tilt is one for the whole edge; each value carries all of its
    uncertainty. Verdicts by ISO 14253-1: pass inside the limits by at least guard_factor * u, fail outside by at least
    that, else undecided; a section where the edge is hidden stays, undecided.

    Args:
        edge: the measured edge.
        root_nominal_mm: required root size.
        root_tolerance_mm: allowed deviations from it, lower <= 0 <= upper.
        bevel_nominal_deg: required bevel angle.
        bevel_tolerance_deg: allowed deviations from it, lower <= 0 <= upper.
        sections: how many sections.
        half_width_mm: edge on each side of a section whose frames count for it.
        guard_factor: guard band in standard uncertainties.
    """
    required = Requirements(root_nominal_mm, root_tolerance_mm, bevel_nominal_deg, bevel_tolerance_deg)
    at = (np.arange(sections) + 0.5) / sections * float(edge.arc_length_mm[-1])
    places = np.concatenate([at, edge.arc_length_mm])
    angles, roots, seen = measure_at(edge, places, half_width_mm)
    seen, absurd = seen & is_bevel(angles, roots), seen & ~is_bevel(angles, roots)
    inspected = tuple(
        _section(edge, i, float(at[i]), angles, roots, bool(seen[i]), half_width_mm, required, guard_factor)
        for i in range(sections)
    )
    verdict = worst(s.verdict for s in inspected)
    profile = _profile(edge, angles, roots, seen, slice(sections, None))
    at_sections = seen & (np.arange(seen.size) < sections)
    uncertainty = budget(angles.where(at_sections), roots.where(at_sections), edge.part)
    warnings = (*edge.warnings, *_no_bevel(places[absurd]),
                *_warnings(profile, angles, required, guard_factor, verdict))  # fmt: skip
    return Inspection(inspected, profile, required, guard_factor, verdict, _reason(inspected), "whole edge", edge.part,
                      uncertainty, warnings, edge.checks)  # fmt: skip


def _warnings(profile: EdgeProfile, angles: BevelAngles, required: Requirements, guard_factor: float,
              verdict: Verdict) -> list[str]:  # fmt: skip
    """What the sections alone do not say: failures between them, and a root face that does not keep its direction."""
    warnings = []
    if angles.tilt_variation > 0:
        warnings.append(f"the root face's direction varies along the edge by {angles.tilt_variation / DEG:.2f} deg: "
                        "every bevel angle carries that in its uncertainty")  # fmt: skip
    failing = []
    for s, root, root_u, bevel, bevel_u in zip(profile.arc_length_mm, profile.root_mm, profile.root_u_mm,
                                               profile.bevel_deg, profile.bevel_u_deg, strict=True):  # fmt: skip
        if np.isfinite(root) and judge(root, root_u, bevel, bevel_u, required, guard_factor)[0] == "fail":
            failing.append(s)
    if failing and verdict != "fail":
        warnings.append(f"out of tolerance between sections, at {len(failing)} places of the profile from arc length "
                        f"{failing[0]:.1f} to {failing[-1]:.1f} mm; the verdict rests on the sections")  # fmt: skip
    return warnings


def measure_at(edge: Edge, at_mm: Float, half_width_mm: float) -> tuple[BevelAngles, RootSizes, Bool]:
    """Angles and root sizes at arc lengths (m,), and whether the edge was seen there."""
    if edge.kind != "milled":
        raise InputError("edge", "expected a milled edge to inspect, found a raw one")
    angles = bevel_angles(edge, at_mm, half_width_mm)
    roots = root_sizes(edge, at_mm, angles)
    seen = covered(edge.frame_arc_length_mm, edge.pass_index, at_mm)
    return angles, roots, seen & np.isfinite(angles.bevel) & np.isfinite(roots.root_mm)


def is_bevel(angles: BevelAngles, roots: RootSizes) -> Bool:
    """Whether the values (m,) are such as a bevel can have: else other faces were taken for it."""
    return np.asarray((roots.root_mm > 0.0) & (angles.bevel > 0.0) & (angles.bevel < MOST_BEVEL))


def _no_bevel(at_mm: Float) -> list[str]:
    """Places (m,) where what was followed is no bevel: told, and not measured."""
    if not at_mm.size:
        return []
    return [f"what was followed between arc length {at_mm.min():.1f} and {at_mm.max():.1f} mm gives a root size or "
            "an angle that no bevel has: not measured there"]  # fmt: skip


def _profile(edge: Edge, angles: BevelAngles, roots: RootSizes, seen: Bool, stations: slice) -> EdgeProfile:
    """Root size and bevel angle at every station of the edge; NaN where it was not seen."""

    def where(value: Float) -> Float:
        return np.where(seen, value, np.nan)[stations]

    return EdgeProfile(edge.arc_length_mm, edge.position_mm, where(roots.root_mm), where(roots.u_mm),
                       where(angles.bevel / DEG), where(angles.u / DEG))  # fmt: skip


def _section(edge: Edge, i: int, at: float, angles: BevelAngles, roots: RootSizes, seen: bool, half_width_mm: float,
             required: Requirements, guard_factor: float) -> Section:  # fmt: skip
    values = (roots.root_mm[i], roots.u_mm[i], angles.bevel[i] / DEG, angles.u[i] / DEG)
    root, root_u, bevel, bevel_u = (float(v) for v in values) if seen else (None,) * 4
    verdict, reason = judge(root, root_u, bevel, bevel_u, required, guard_factor)
    near = np.abs(edge.frame_arc_length_mm - at) <= half_width_mm
    return Section(
        index=i + 1, arc_length_mm=at, origin_mm=_along(edge, edge.position_mm, at),
        tangent=_unit(edge, edge.tangent, at), normal=_unit(edge, edge.normal, at), across=_unit(edge, edge.across, at),
        root_mm=root, root_u_mm=root_u, bevel_deg=bevel, bevel_u_deg=bevel_u, verdict=verdict, reason=reason,
        frames=np.flatnonzero(near & seen),
    )  # fmt: skip


def _along(edge: Edge, values: Float, at: float) -> Float:
    """Rows of `values` (n, 3) interpolated at arc length `at`, over hidden stretches too."""
    good = np.isfinite(values[:, 0])
    return np.array([np.interp(at, edge.arc_length_mm[good], values[good, k]) for k in range(3)])


def _unit(edge: Edge, values: Float, at: float) -> Float:
    v = _along(edge, values, at)
    return v / np.linalg.norm(v)


def _reason(inspected: tuple[Section, ...]) -> str:
    """The part's verdict in words."""
    count = len(inspected)
    failed = [s for s in inspected if s.verdict == "fail"]
    open_ = [s for s in inspected if s.verdict == "undecided"]
    if failed:
        return f"{len(failed)} of {count} sections fail: section {failed[0].index}: {failed[0].reason}"
    if open_:
        return f"{len(open_)} of {count} sections undecided: section {open_[0].index}: {open_[0].reason}"
    return f"all {count} sections within tolerance"
