"""What `compare.repeatability` finds of one characteristic."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from workbench.compare.agreement import Agreement
from workbench.compare.anova import Anova
from workbench.compare.gauge import Gauge
from workbench.compare.values import Study, title_of
from workbench.errors import InputError
from workbench.units import Int


@dataclass(frozen=True, slots=True)
class SectionGauge:
    """One section: its place, mean value and the gauge there."""

    index: int
    arc_length_mm: float
    mean: float
    gauge: Gauge


@dataclass(frozen=True, slots=True)
class Characteristic:
    """What was found of one characteristic."""

    name: str
    limits: tuple[float, float] | None
    anova: Anova
    gauge: Gauge  # all sections
    sections: tuple[SectionGauge, ...]
    agreement: Agreement
    warnings: tuple[str, ...]

    @property
    def title(self) -> str:
        """Its name for a reader."""
        return title_of(self.name)


def seen_everywhere(study: Study, name: str) -> tuple[Int, tuple[str, ...]]:
    """Positions of the sections where every recording has a value, and a word on those left out."""
    seen = np.isfinite(study.measured[name]).all(axis=(0, 1, 2))
    if not seen.any():
        raise InputError(
            f"compare.repeatability: {title_of(name).lower()}",
            "expected a section in which every recording has a value, found none",
        )
    out = [str(study.section[k]) for k in np.flatnonzero(~seen)]
    words = (
        () if not out else (f"{title_of(name).lower()}: section {', '.join(out)} left out: hidden in some recording",)
    )
    return np.flatnonzero(seen), words
