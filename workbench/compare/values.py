"""What the stages of `compare` exchange."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from workbench.artefacts import UNKNOWN_PART, Part
from workbench.units import Float, Shaped

CHARACTERISTICS = {"root_mm": "root_u_mm", "bevel_deg": "bevel_u_deg"}  # and their standard uncertainties
TITLES = {"root_mm": "Root face", "bevel_deg": "Bevel angle"}
UNITS = ("mm", "deg", "um")  # in which the name of a characteristic may end


def title_of(name: str) -> str:
    """A characteristic's name for a reader; one of other people's as they write it."""
    return TITLES.get(name, name)


@dataclass(frozen=True, slots=True, eq=False)
class Study:
    """Repeated measurements of parts by operators, crossed and balanced: P parts, O operators, R trials, S sections.

    Keys are the characteristics that every measurement has. NaN: hidden, or not stated.
    """

    parts: tuple[str, ...]
    operators: tuple[str, ...]
    trials: int
    section: tuple[int, ...]  # (S,) index, from 1
    arc_length_mm: Shaped[Float, " S"]  # mean place
    measured: Mapping[str, Float]  # (P, O, R, S)
    stated_u: Mapping[str, Float]  # (P, O, R, S) standard uncertainty that each measurement states
    reference: Mapping[str, Float]  # (P, S)
    reference_u: Mapping[str, Float]  # (P, S)
    limits: Mapping[str, tuple[float, float]]  # lower and upper limit of the value, where known
    files: tuple[tuple[str, str], ...]  # path as given and SHA-256 of every inspection
    warnings: tuple[str, ...] = ()
    part: Part = UNKNOWN_PART  # what all inspections agree on
    unit: str = "mm"  # of characteristics whose names do not end in one

    def unit_of(self, name: str) -> str:
        """The unit of a characteristic."""
        suffix = name.rpartition("_")[2]
        return suffix if suffix in UNITS else self.unit
