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
    """Pass a part on if its verdict is `pass`; any other verdict gives exit status 1.

    A part of which too little was measured does not pass either. The run's warnings say where `undecided`, or less than
    two thirds of the edge, was accepted.

    Args:
        inspection: the judged part.
        reject: verdicts that reject the part.
        least_measured_share: least share of the edge with both root face and bevel angle.

    Raises:
        InputError: no section measured, or none to better than ten times the tolerance.

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
    known = [np.isfinite(one.value) for one in inspection.profile.sizes.values()]
    return float(np.mean(np.all(known, axis=0))) if known[0].size else 1.0


def _refuse_unmeasured(inspection: Inspection) -> None:
    if not inspection.sections:
        return
    where = inspection.source or "edge"
    found = [one for one in inspection.characteristics if one.required is not None]
    complete = [all(pairs) for pairs in zip(*(one.pairs for one in found), strict=True)]
    if not any(complete):
        raise InputError(
            where,
            f"none of {len(inspection.sections)} sections could be measured: {DOUBT}",
        )
    for one in found:
        u = [pair[1] for pair, here in zip(one.pairs, complete, strict=True) if pair and here]
        low, high = one.limits or (0.0, 0.0)
        expanded, width, unit = 2.0 * float(np.median(u)), high - low, one.quantity.unit
        if width > 0 and expanded > MOST_U * width:
            name = one.term.lower()
            what = f"its {name} is known to {expanded:.3g} {unit} only, the tolerance is {width:.3g} {unit} wide"
            raise InputError(where, f"{what}: {DOUBT}")
