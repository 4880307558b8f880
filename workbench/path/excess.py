"""How much material stands above the required bevel, or lacks, along an inspected edge."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.artefacts import Inspection
from workbench.path.section import Bevel
from workbench.units import DEG, Bool, Float

LEAST_MM = 0.02  # no less than this is milled, or missed


@dataclass(frozen=True, slots=True, eq=False)
class Excess:
    """What the face as measured has above the required one, along its normal, at n stations; NaN where not measured."""

    root_end_mm: Float  # (n,) at the root face
    upper_end_mm: Float  # (n,) at the upper surface
    fails: Bool  # (n,) out of tolerance by the guard band
    lacks: Bool  # (n,) of those: too small a root, or an angle that leaves part of the face below the required one

    @property
    def height_mm(self) -> Float:
        """(n,) of the most that stands above."""
        return np.asarray(np.fmax(self.root_end_mm, self.upper_end_mm))

    @property
    def lack_mm(self) -> Float:
        """(n,) of the most that lacks."""
        return np.asarray(np.fmax(-np.fmin(self.root_end_mm, self.upper_end_mm), 0.0))


def excess_of(inspection: Inspection, bevel: Bevel, thickness_mm: Float) -> Excess:
    """Excess along the inspection's profile; `thickness_mm` (n,) of the stock there.

    The measured face goes up from root face r at its own angle b: over the required face (R, B) it has
    (r - R) sin B at the root face and (T - R) sin B - (T - r) tan b cos B at the upper surface, T the thickness.
    """
    profile, required = inspection.profile, inspection.requirements
    root, angle = profile.root_mm, profile.bevel_deg * DEG
    sine, cosine = np.sin(bevel.angle), np.cos(bevel.angle)
    low = (root - bevel.root_mm) * sine
    high = (thickness_mm - bevel.root_mm) * sine - (thickness_mm - root) * np.tan(angle) * cosine
    guard = inspection.guard_factor
    low_u = profile.root_u_mm * sine
    high_u = np.hypot(
        profile.root_u_mm * np.tan(angle) * cosine,
        (thickness_mm - root) * profile.bevel_u_deg * DEG * cosine / np.cos(angle) ** 2,
    )
    small, large = _outside(root - required.root_nominal_mm, required.root_tolerance_mm, guard * profile.root_u_mm)
    steep, flat = _outside(
        profile.bevel_deg - required.bevel_nominal_deg, required.bevel_tolerance_deg, guard * profile.bevel_u_deg
    )
    below = (low < -np.maximum(guard * low_u, LEAST_MM)) | (high < -np.maximum(guard * high_u, LEAST_MM))
    return Excess(low, high, small | large | steep | flat, small | ((steep | flat) & below))


def _outside(deviation: Float, tolerance: tuple[float, float], guard: Float) -> tuple[Bool, Bool]:
    """Whether deviations (n,) lie below, or above, the tolerance by at least the guard band."""
    return np.asarray(deviation <= tolerance[0] - guard), np.asarray(deviation >= tolerance[1] + guard)
