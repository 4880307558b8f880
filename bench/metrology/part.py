"""What the studies share of a part: its inspection as a user would, and how long its steps take."""

from __future__ import annotations

import time
import zlib

import numpy as np

from workbench.artefacts import Inspection, Recording, Requirements
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import Truth
from workbench.units import Float

FIXED = ("paper", "limit")  # conditions drawn about the default requirements
Numbers = list[float | None]  # one a section; None: not measured


class Clock:
    """Puts the seconds between laps into `laps`, by name."""

    def __init__(self, laps: dict[str, float]) -> None:
        self.laps, self._last = laps, time.perf_counter()

    def lap(self, name: str) -> None:
        now = time.perf_counter()
        self.laps[name], self._last = round(now - self._last, 3), now


def inspect_as_a_user(recording: Recording, truth: Truth) -> Inspection:
    """The pipeline with all its defaults, but for what the part's drawing says: rounded to 0.5 mm and 5 deg."""
    required = requirements(truth)
    edge = segment(
        denoise(fuse(recording)),
        root_nominal_mm=max(0.5, round(float(truth.root_mm.mean()) * 2) / 2),
        bevel_nominal_deg=round(float(truth.bevel_deg.mean()) / 5) * 5.0,
    )
    return sections(
        edge,
        root_nominal_mm=required.root_nominal_mm,
        root_tolerance_mm=required.root_tolerance_mm,
        bevel_nominal_deg=required.bevel_nominal_deg,
        bevel_tolerance_deg=required.bevel_tolerance_deg,
    )


def requirements(truth: Truth) -> Requirements:
    """Requirements about the part's true values: some parts conform to them, some do not, some lie at a limit."""
    default = Requirements()
    if truth.recipe.title in FIXED:
        return default
    rng, nominal = np.random.default_rng([truth.recipe.seed, zlib.crc32(truth.recipe.title.encode())]), []
    for true, tolerance in ((truth.root_mm, default.root_tolerance_mm), (truth.bevel_deg, default.bevel_tolerance_deg)):
        inside, at_limit, outside = rng.uniform(0, 0.5), 1 + rng.uniform(-0.1, 0.1), rng.uniform(1.2, 2)
        off = rng.choice([-1, 1]) * rng.choice([inside, at_limit, outside], p=[0.5, 0.3, 0.2]) * tolerance[1]
        nominal.append(max(0.01, float(true.mean() + off)))
    return Requirements(root_nominal_mm=nominal[0], bevel_nominal_deg=nominal[1])


def numbers(values: Float) -> Numbers:
    """As JSON has it: None for what is not finite."""
    return [round(float(v), 6) if np.isfinite(v) else None for v in values]
