"""`inspect.gate`: the pipeline's decision on the part."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from workbench.artefacts import Gate, Inspection
from workbench.errors import InputError
from workbench.stage import stage

LEAST_SHARE = 2.0 / 3.0
DOUBT = "is this a bevel, are orientations, axes and hand-eye pose right?"
MOST_U = 10.0  # expanded uncertainties over the tolerance's width: what is told with more was not measured


@stage("inspect.gate")
def gate(
    inspection: Inspection,
    *,
    reject: tuple[Literal["fail", "undecided"], ...] = (
        "fail",
        "undecided",
    ),
    least_measured_share: Annotated[float, Field(ge=0, le=1)] = LEAST_SHARE,
) -> Gate:
    """Let a part through whose verdict is `pass`; any other rejects it, and the exit status of the run is then 1.

    Neither does a part of which too little was measured pass. A pipeline that accepts `undecided` parts, or asks for
    less of the edge than two thirds, says so in the decision's reason and in the run's warnings.

    Args:
        inspection: the judged part.
        reject: verdicts that reject the part.
        least_measured_share: share of the edge's length that must have both root face and bevel angle for a pass.

    Raises:
        InputError: no section was measured, or none to better than ten times the tolerance: there is nothing to judge.

    Example:
        >>> from workbench import cloud, edge, inspect, scan
        >>> points = cloud.denoise(scan.fuse(scan.read(recording="data/synthetic/milled_edge.h5")))
        >>> milled = edge.segment(points)
        >>> found = inspect.sections(milled)
        >>> inspect.gate(found).passed
        True
    """
    _refuse_unmeasured(inspection)
    share = measured_share(inspection)
    reason = f"{inspection.verdict}: {inspection.reason}"
    if share < least_measured_share:
        short = f"only {100 * share:.0f} % of the edge was measured, {100 * least_measured_share:.0f} % are required"
        return Gate(False, f"{reason}; {short}")
    notes = []
    if inspection.verdict not in (*reject, "pass"):
        notes.append(f"the pipeline lets a part through that is {inspection.verdict}")
    if share < LEAST_SHARE:
        notes.append(f"the pipeline asks for {100 * least_measured_share:.0f} % of the edge only")
    return Gate(inspection.verdict not in reject, "; ".join([reason, *notes]), warnings=tuple(notes))


def measured_share(inspection: Inspection) -> float:
    """Share of the stations of the edge's profile that have a root face and a bevel angle."""
    profile = inspection.profile
    return (
        float(np.mean(np.isfinite(profile.root_mm) & np.isfinite(profile.bevel_deg))) if profile.root_mm.size else 1.0
    )


def _refuse_unmeasured(inspection: Inspection) -> None:
    if not inspection.sections:
        return
    where = inspection.source or "edge"
    told = [s for s in inspection.sections if s.root_u_mm is not None and s.bevel_u_deg is not None]
    if not told:
        raise InputError(
            where,
            f"none of {len(inspection.sections)} sections could be measured: {DOUBT}",
        )
    needs = inspection.requirements
    for name, unit, u, tolerance in (
        ("root face", "mm", [s.root_u_mm for s in told], needs.root_tolerance_mm),
        ("bevel angle", "deg", [s.bevel_u_deg for s in told], needs.bevel_tolerance_deg),
    ):
        expanded, width = 2.0 * float(np.median(np.array(u, float))), tolerance[1] - tolerance[0]
        if width > 0 and expanded > MOST_U * width:
            what = f"its {name} is known to {expanded:.3g} {unit} only, the tolerance is {width:.3g} {unit} wide"
            raise InputError(where, f"{what}: {DOUBT}")
