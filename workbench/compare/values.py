"""What the stages of `compare` exchange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from workbench.units import Float

CHARACTERISTICS = {"root_mm": "root_u_mm", "bevel_deg": "bevel_u_deg"}  # and their standard uncertainties
TITLES = {"root_mm": "Root size", "bevel_deg": "Bevel angle"}
UNITS = {"root_mm": "mm", "bevel_deg": "deg"}


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Repeated measurements of parts by operators, crossed and balanced: P parts, O operators, R trials, S sections.

    Keys are the characteristics that every measurement has. NaN: hidden, or not stated.
    """

    parts: tuple[str, ...]
    operators: tuple[str, ...]
    trials: int
    section: tuple[int, ...]  # (S,) index, from 1
    arc_length_mm: Float  # (S,) mean place
    measured: Mapping[str, Float]  # (P, O, R, S)
    stated_u: Mapping[str, Float]  # (P, O, R, S) standard uncertainty that each measurement states
    reference: Mapping[str, Float]  # (P, S)
    reference_u: Mapping[str, Float]  # (P, S)
    limits: Mapping[str, tuple[float, float]]  # lower and upper limit of the value, where known
    files: tuple[tuple[str, str], ...]  # path as given and SHA-256 of every inspection
    warnings: tuple[str, ...] = ()
