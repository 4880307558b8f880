"""Agreement with a reference and with stated uncertainties: bias, E_n numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from workbench.compare.gauge import Gauge
from workbench.compare.values import Study
from workbench.units import Float, Shaped

COVERAGE = 2.0  # standard uncertainties in an expanded one, about 95 %


@dataclass(frozen=True, slots=True, eq=False)
class Agreement:
    """P parts, O operators, R trials, S sections; NaN where there is no reference or no stated uncertainty."""

    bias: Shaped[Float, "P S"]  # mean of all measurements less the reference
    bias_u: Shaped[Float, "P S"]
    e_n: Shaped[Float, "P O R S"]  # |E_n| <= 1: the difference is within what both sides state
    observed_over_stated: float  # repeatability over the RMS of the stated uncertainties

    @property
    def has_reference(self) -> bool:
        """Whether any section has a reference."""
        return bool(np.isfinite(self.bias).any())

    @property
    def significant(self) -> int:
        """How many of the biases are larger than their expanded uncertainty."""
        return int((np.abs(self.bias) > COVERAGE * self.bias_u).sum())


def agreement(study: Study, name: str, gauge: Gauge) -> Agreement:
    """Bias and E_n of one characteristic.

    The mean of O operators and R trials has the variance AV^2 / O + EV^2 / (O R), to which the reference adds its own.
    E_n = (x - X) / sqrt(U_x^2 + U_X^2) with expanded uncertainties (ISO 13528:2022, 9.7; ISO/IEC 17043:2023, annex B).
    """
    values, reference, reference_u = study.measured[name], study.reference[name], study.reference_u[name]
    _, o, r, _ = values.shape
    ev, av = (gauge.of(one).sd or 0.0 for one in ("EV", "AV"))
    mean_u = math.sqrt(av**2 / o + ev**2 / (o * r))
    stated = study.stated_u[name]
    both = COVERAGE * np.sqrt(stated**2 + reference_u[:, None, None] ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        e_n = (values - reference[:, None, None]) / both
    rms = math.sqrt(float(np.nanmean(stated**2))) if np.isfinite(stated).any() else math.nan
    return Agreement(
        values.mean(axis=(1, 2)) - reference,
        np.hypot(mean_u, reference_u),
        np.where(np.isfinite(e_n), e_n, np.nan),
        ev / rms if rms > 0 else math.nan,
    )
