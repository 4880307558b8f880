"""Coefficients of the mechanistic milling force: published ones with their sources, and files of one's own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from workbench.api import CoefficientsFile, Float, Shaped

NAMES = ("ktc_n_mm2", "krc_n_mm2", "kac_n_mm2", "kte_n_mm", "kre_n_mm", "kae_n_mm")

REVIEW = (
    "Duan et al., Milling force model for aviation aluminum alloy, Chin. J. Mech. Eng. 34 (2021) 18, "
    "doi 10.1186/s10033-021-00536-9, Table 5, row"
)


@dataclass(frozen=True, slots=True)
class CuttingCoefficients:
    """Forces on a cutting edge, per area of chip (c) and per length of edge (e): tangential, radial, axial."""

    ktc_n_mm2: float
    krc_n_mm2: float
    kac_n_mm2: float
    kte_n_mm: float
    kre_n_mm: float
    kae_n_mm: float
    source: str = "given"
    covariance: Shaped[Float, "6 6"] | None = None  # of them, in the order of NAMES; None: nobody states it

    @property
    def values(self) -> Float:
        """All six (6,), in the order of NAMES."""
        return np.array([getattr(self, name) for name in NAMES])

    @property
    def table(self) -> Float:
        """(3, 2): tangential, radial, axial; of the chip, of the edge."""
        return self.values.reshape(2, 3).T

    @property
    def relative_u(self) -> float:
        """Standard uncertainty of the logarithm of K_tc, which all forces of the chip go with.

        Of published coefficients: the scatter of PUBLISHED's rows, since the cutter's geometry is in them.
        """
        if self.covariance is not None:
            return (np.sqrt(self.covariance[0, 0]) / self.ktc_n_mm2) if self.ktc_n_mm2 else np.inf
        return float(np.log([one.ktc_n_mm2 for one in PUBLISHED.values()]).std(ddof=1))


def read_coefficients(path: Path) -> CuttingCoefficients:
    """Those of a `coefficients.json`; raises InputError with the place and what was expected."""
    found = CoefficientsFile.read(path)
    source = f"{path} ({found.material}, {found.tool})"
    values = {name: getattr(found, name) for name in NAMES}
    return CuttingCoefficients(**values, source=source, covariance=np.array(found.covariance))


# Rows of one alloy show how far apart published coefficients are: the cutter's geometry is in them.
# The review prints the edge coefficients' unit as N mm; per length of edge it is N/mm. Rows without axial values: 0.
PUBLISHED = {
    "al6061_t6": CuttingCoefficients(243.77, 113.5, 0.0, 7.53, 7.83, 0.0, f"{REVIEW} [160] (carbide, dry)"),
    "al6082_t6": CuttingCoefficients(631.0, 99.0, 273.0, 13.0, 10.0, 2.8, f"{REVIEW} [189] (carbide, dry)"),
    "al7075_t6": CuttingCoefficients(767.01, 168.8, 222.0, 27.7, 26.6, 0.7, f"{REVIEW} [190] (carbide, dry)"),
    "al7075_t6_ref160": CuttingCoefficients(600.46, 180.96, 0.0, 17.9, 20.42, 0.0, f"{REVIEW} [160] (carbide, dry)"),
    "al7075_ref47": CuttingCoefficients(1319.41, 788.83, 48.75, 19.65, 26.77, 2.05, f"{REVIEW} [47] (carbide, dry)"),
    "al7075_hss": CuttingCoefficients(
        951.365, 262.597, 323.33, 11.115, 11.314, 1.105, f"{REVIEW} [156] (high-speed steel, dry)"
    ),
}
