"""Where base points lie along the true edge."""

from __future__ import annotations

import numpy as np

from workbench.synthetic import Truth
from workbench.units import Bool, Float

BOUNDARY_MM = 1.0  # this near to the end of a hidden stretch either answer is right


def clear_of_boundaries(truth: Truth, position_mm: Float) -> tuple[Bool, Bool]:
    """Which base points (m, 3) lie where all of the edge is seen, and where all of it is hidden, 1 mm to both sides."""
    at = truth.arc_length_mm_at(position_mm)
    seen_before = np.concatenate([[0], np.cumsum(truth.seen)])
    first = np.searchsorted(truth.arc_length_mm, at - BOUNDARY_MM)
    last = np.searchsorted(truth.arc_length_mm, at + BOUNDARY_MM, side="right")
    seen = seen_before[last] - seen_before[first]
    return seen == last - first, seen == 0
