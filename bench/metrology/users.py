"""What a user does with a recording, and how long its steps take."""

from __future__ import annotations

import time

import numpy as np

from bench.drawn.seeds import nominal_sizes
from workbench.artefacts import Inspection, Recording
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import Truth
from workbench.units import Float

Numbers = list[float | None]  # one a place; None: not measured


class Clock:
    """Puts the seconds between laps into `laps`, by name."""

    def __init__(self) -> None:
        self.laps: dict[str, float] = {}
        self._last = time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name], self._last = round(now - self._last, 3), now


def inspect_as_a_user(recording: Recording, truth: Truth) -> Inspection:
    """The pipeline with all its defaults, but for what the part's drawing says: rounded to 0.5 mm and 5 deg."""
    return sections(segment(denoise(fuse(recording)), **nominal_sizes(truth.root_mm.mean(), truth.bevel_deg.mean())))


def numbers(values: Float) -> Numbers:
    """As JSON has it: None for what is not finite."""
    return [round(float(v), 6) if np.isfinite(v) else None for v in values]
