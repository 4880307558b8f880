"""How measured values are written: value ± expanded uncertainty, digits after the uncertainty (GUM 7.2.2, 7.2.6)."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from workbench.units import Float

COVERAGE = 2.0  # U = k u with k = 2, about 95 %


def decimals(uncertainties: Iterable[float | None]) -> int:
    """Decimal places, one to four, for the smallest expanded uncertainty: two digits of it if it starts with 1 or 2,
    else one, so that rounding never changes it by more than a fifth.
    """
    known = [COVERAGE * u for u in uncertainties if u is not None and u > 0.0 and math.isfinite(u)]
    if not known:
        return 3
    exponent = math.floor(math.log10(min(known)))
    digits = 2 if min(known) < 2.95 * 10.0**exponent else 1
    return min(4, max(1, digits - 1 - exponent))


def measured(value: float | None, u: float | None, places: int) -> str:
    """'1.503 ± 0.012'; a dash where nothing was measured."""
    if value is None or not math.isfinite(value):
        return "–"
    if u is None or not math.isfinite(u):
        return f"{value:.{places}f}"
    return f"{value:.{places}f} ± {COVERAGE * u:.{places}f}"


def span(values: Float, places: int, unit: str) -> str:
    """'1.421 to 1.583 mm' over what was measured."""
    known = values[np.isfinite(values)]
    return f"{known.min():.{places}f} to {known.max():.{places}f}{unit}" if len(known) else "–"


def alike(*values: float) -> tuple[str, ...]:
    """Set values, such as limits, with as many decimals as the one that needs most: '1.0', '1.5', '2.0'."""
    places = max(len(f"{value:.9g}".partition(".")[2]) for value in values)
    return tuple(f"{value:.{places}f}" for value in values)
