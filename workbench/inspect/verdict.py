"""Conformity of measured values (ISO 14253-1), and their uncertainty budget (GUM 5.1)."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from workbench.artefacts import (
    KINDS,
    MilledEdge,
    Quantity,
    Requirements,
    Uncertainty,
    UncertaintySource,
    Verdict,
    conformity,
)
from workbench.artefacts.evidence import UNSEEN
from workbench.units import DEG, Float

RANK: dict[Verdict, int] = {"pass": 0, "undecided": 1, "fail": 2}
NOT_INCLUDED = (
    *UNSEEN,
    "Thermal expansion: values hold at the temperature of the measurement and are not corrected to 20 °C (ISO 1).",
)
NO_HAND_EYE = "The uncertainty of the hand-eye calibration: the calibration in use states none."


def worst(verdicts: Iterable[Verdict]) -> Verdict:
    """'fail' before 'undecided' before 'pass'; 'undecided' of none."""
    return max(verdicts, key=lambda v: RANK[v], default="undecided")


def judge(
    root_mm: float | None,
    root_u_mm: float | None,
    bevel_deg: float | None,
    bevel_u_deg: float | None,
    required: Requirements,
    guard_factor: float,
) -> tuple[Verdict, str]:
    """Verdict of one section, and the reason in words."""
    if root_mm is None or root_u_mm is None or bevel_deg is None or bevel_u_deg is None:
        return "undecided", "the edge is hidden here"
    root = conformity(root_mm, root_u_mm, required.root_nominal_mm, required.root_tolerance_mm, guard_factor)
    bevel = conformity(bevel_deg, bevel_u_deg, required.bevel_nominal_deg, required.bevel_tolerance_deg, guard_factor)
    words = {"pass": "within tolerance", "undecided": "too near a limit to decide", "fail": "out of tolerance"}
    return worst([root, bevel]), f"root face {words[root]}, bevel angle {words[bevel]}"


def budget(edge: MilledEdge, at_mm: Float) -> Uncertainty:
    """The sources at the section of the largest uncertainty, of each characteristic by itself.

    at_mm (m,): arc lengths of the measured sections.
    """
    root, bevel = _largest(edge, edge.root, at_mm), _largest(edge, edge.bevel, at_mm)
    sources = tuple(
        UncertaintySource(name, root.get(name, 0.0), bevel.get(name, 0.0) / DEG, KINDS[name])
        for name in KINDS
        if root.get(name, 0.0) > 0.0 or bevel.get(name, 0.0) > 0.0
    )
    left_out = NOT_INCLUDED if edge.part.hand_eye_u_mm is not None else (*NOT_INCLUDED, NO_HAND_EYE)
    return Uncertainty(sources=sources, not_included=(*left_out, *edge.not_included))


def u_at(edge: MilledEdge, quantity: Quantity, at_mm: Float) -> Float:
    """Combined standard uncertainty (m,) at arc lengths: of the sources there."""
    return np.sqrt(sum(np.interp(at_mm, edge.arc_length_mm, u) ** 2 for u in quantity.u_by_source.values()))


def _largest(edge: MilledEdge, quantity: Quantity, at_mm: Float) -> dict[str, float]:
    if not at_mm.size:
        return {}
    worst = at_mm[int(np.argmax(u_at(edge, quantity, at_mm)))]
    return {name: float(np.interp(worst, edge.arc_length_mm, u)) for name, u in quantity.u_by_source.items()}
