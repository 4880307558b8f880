"""Conformity of measured values: ISO 14253-1 with a guard band on both sides of each limit."""

from __future__ import annotations

from collections.abc import Iterable

from workbench.artefacts import Requirements, Verdict, conformity

RANK: dict[Verdict, int] = {"pass": 0, "undecided": 1, "fail": 2}


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
