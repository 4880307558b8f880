"""What one simulated part gave, as it is kept on disk."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from workbench.units import Float

Numbers = list[float | None]  # one a section; None: not measured


@dataclass(slots=True)
class PartResult:
    """Measured values, their truth and their bounds; lists have one entry a section."""

    condition: str
    seed: int
    refused: str | None = None  # the pipeline's error, in one line
    crashed: str | None = None  # any other exception: a defect
    seen_share: float = 1.0  # of the part's edge, by truth
    root_mm: Numbers = field(default_factory=list)
    root_u_mm: Numbers = field(default_factory=list)
    root_unseen_u_mm: float = 0.0  # part of root_u_mm: a rounding that the view does not show
    root_true_mm: Numbers = field(default_factory=list)
    root_bound_mm: Numbers = field(default_factory=list)
    bevel_deg: Numbers = field(default_factory=list)
    bevel_u_deg: Numbers = field(default_factory=list)
    bevel_true_deg: Numbers = field(default_factory=list)
    bevel_bound_deg: Numbers = field(default_factory=list)
    hidden: list[bool] = field(default_factory=list)  # by truth, clear of the boundaries
    seen: list[bool] = field(default_factory=list)  # likewise
    stations_invented: int = 0  # of the profile along the edge, measured where the edge is hidden
    verdicts: list[str] = field(default_factory=list)
    margins: Numbers = field(default_factory=list)  # truth's distance inside its nearest limit, in u; below 0: outside
    peers: dict[str, dict[str, Numbers]] = field(default_factory=dict)  # name -> errors "root_mm", "bevel_deg"
    seconds: dict[str, float] = field(default_factory=dict)


def numbers(values: Float) -> Numbers:
    """As JSON has it: None for what is not finite."""
    return [round(float(v), 6) if np.isfinite(v) else None for v in values]
