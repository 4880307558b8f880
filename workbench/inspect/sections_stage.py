"""`inspect.sections`: root face and bevel angle in sections of a milled edge, and the verdict on them."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts import (
    EdgeProfile,
    Inspection,
    MilledEdge,
    Requirements,
    Uncertainty,
    Verdict,
    conformity,
)
from workbench.artefacts.edges import BEVEL_TERMS, Deviations
from workbench.inspect.section import section_at
from workbench.inspect.verdict import material, of_the_part
from workbench.stage import stage
from workbench.units import Bool, Float

Condition = Literal[
    "told_by_nominal",
    "lies_on",
    "stands_behind",
    "window_end",
    "thickness",
    "compound",
    "lost_columns",
    "shadow",
    "hand_eye",
    "scale",
    "clock_offset",
    "layer",
    "other_software",
]
MOST_BEVEL_DEG = 85.0  # a root face or an angle beyond these limits is no measure of a bevel


@stage("inspect.sections")
def sections(
    edge: MilledEdge,
    *,
    root_nominal_mm: Annotated[float, Field(gt=0, le=50)] = 1.5,
    root_tolerance_mm: Deviations = (
        -0.5,
        0.5,
    ),
    bevel_nominal_deg: Annotated[float, Field(gt=0, lt=90)] = 40.0,
    bevel_tolerance_deg: Deviations = (-1.0, 1.0),
    sections: Annotated[int, Field(ge=1, le=999)] = 9,
    guard_factor: Annotated[float, Field(ge=0, le=5)] = 1.645,
    accept_conditions: tuple[Condition, ...] = (),
) -> Inspection:
    """Measure root face and bevel angle in equidistant sections (the paper's section 6.3, Figs. 20 and 21) and judge.

    Section i lies at (i - 1/2)/n of the measured stretch, in the plane normal to the lower edge. Verdicts by ISO
    14253-1 (docs/conventions.md); a hidden section is undecided.

    Args:
        edge: the measured edge.
        root_nominal_mm: required root face.
        root_tolerance_mm: allowed deviations from it, lower <= 0 <= upper.
        bevel_nominal_deg: required bevel angle.
        bevel_tolerance_deg: allowed deviations from it, likewise.
        sections: count of sections along the edge.
        guard_factor: guard band over u; 1.645: 95 % one-sided.
        accept_conditions: names of `conditions` of inspection.json that do not hold back a pass.

    Example:
        >>> from workbench import cloud, edge, inspect, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> found.verdict
        'pass'
        >>> [round(section.values["root_mm"], 1) for section in found.sections[:3]]
        [1.5, 1.5, 1.5]
    """
    asked = Requirements(root_nominal_mm, root_tolerance_mm, bevel_nominal_deg, bevel_tolerance_deg)
    required = {
        "root_mm": (root_nominal_mm, root_tolerance_mm),
        "bevel_deg": (bevel_nominal_deg, bevel_tolerance_deg),
    }
    at = (np.arange(sections) + 0.5) / sections * float(edge.arc_length_mm[-1])
    seen = edge.seen & np.isfinite(edge.root.value) & np.isfinite(edge.bevel.value)
    absurd = seen & ~is_bevel(edge)
    root, bevel = sizes = [one.where(seen & ~absurd) for one in (edge.root, edge.bevel)]
    profile = EdgeProfile(
        edge.arc_length_mm,
        edge.position_mm,
        root.value,
        root.u,
        bevel.value,
        bevel.u,
        root.u_by_source,
        bevel.u_by_source,
    )
    inspected = tuple(
        section_at(i, float(s), edge, edge.position_mm, sizes, required, BEVEL_TERMS, guard_factor)
        for i, s in enumerate(at, 1)
    )
    unseen = material(edge.unseen, inspected)
    verdict, reason, left, notes = of_the_part(inspected, unseen, required, guard_factor, accept_conditions)
    warnings = (
        *edge.warnings,
        *_no_bevel(edge.arc_length_mm[absurd]),
        *_warnings(edge, seen & ~absurd, required, guard_factor, verdict),
        *notes,
    )
    return Inspection(
        inspected,
        profile,
        asked,
        guard_factor,
        verdict,
        reason,
        "per section",
        edge.part,
        Uncertainty(not_included=unseen),
        warnings,
        edge.checks,
        edge.source,
        left,
    )


Asked = Mapping[str, tuple[float, tuple[float, float]]]


def _warnings(edge: MilledEdge, seen: Bool, required: Asked, guard_factor: float, verdict: Verdict) -> list[str]:
    """What the sections alone do not say: failures between them."""
    failing = []
    for name, one in (("root_mm", edge.root), ("bevel_deg", edge.bevel)):
        failing += [
            s
            for s, value, u in zip(edge.arc_length_mm[seen], one.value[seen], one.u[seen], strict=True)
            if conformity(value, u, *required[name], guard_factor) == "fail"
        ]
    failing = sorted(set(failing))
    if not failing or verdict == "fail":
        return []
    return [
        f"out of tolerance between sections, at {len(failing)} places of the profile from arc length "
        f"{failing[0]:.1f} to {failing[-1]:.1f} mm; the verdict rests on the sections"
    ]


def is_bevel(edge: MilledEdge) -> Bool:
    """Whether the values at the stations (n,) are such as a bevel can have: else other faces were taken for it."""
    bevel = edge.bevel.value
    return np.asarray((edge.root.value > 0.0) & (bevel > 0.0) & (bevel < MOST_BEVEL_DEG))


def _no_bevel(at_mm: Float) -> list[str]:
    """Places (m,) where what was followed is no bevel: told, and not measured."""
    if not at_mm.size:
        return []
    return [
        f"what was followed between arc length {at_mm.min():.1f} and {at_mm.max():.1f} mm gives a root face or "
        "an angle that no bevel has: not measured there"
    ]
