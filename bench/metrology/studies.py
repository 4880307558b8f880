"""The studies that `make metrology` runs: what each measures of a part, what it says of a condition, and its page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from bench.harness import ROOT
from bench.metrology.calibration.part import CalibrationResult, measure_calibration
from bench.metrology.calibration.summary import CalibrationSummary
from bench.metrology.measured.part import MeasuredResult, measure_measured
from bench.metrology.measured.summary import MeasuredSummary
from bench.metrology.planning.part import PlanResult, measure_plan
from bench.metrology.planning.summary import PlanSummary
from bench.metrology.run import Measurement
from bench.metrology.stiffness.part import StiffnessResult, measure_stiffness
from bench.metrology.stiffness.summary import StiffnessSummary
from bench.metrology.summary import Summary

DOCS = ROOT / "docs"
PLANNING = (
    *(f"workbench/{family}" for family in ("geometry", "scan", "cloud", "edge", "synthetic", "path")),
    *("bench/score", "bench/metrology", "bench/metrology/planning"),
)
MEASURED = (*PLANNING, "workbench/inspect", "workbench/twin", "bench/metrology/measured")
CALIBRATION = (
    *("workbench/geometry", "workbench/synthetic", "workbench/plugins/calibration"),
    *("bench/peers", "bench/metrology/calibration"),
)
STIFFNESS = ("workbench/geometry", "workbench/robot", "workbench/plugins/stiffness", "bench/metrology/stiffness")


@dataclass(frozen=True)
class Study:
    """One kind of measurement over many parts and the tables that come of it."""

    measurement: Measurement
    summary: type[Summary]  # of a condition's results
    parts: int  # a condition, unless the command says otherwise
    page: Path
    marks: str  # of the place in the page

    @property
    def conditions(self) -> tuple[str, ...]:
        return self.summary.conditions


STUDIES = {
    "planning": Study(
        Measurement(measure_plan, PlanResult, PLANNING), PlanSummary, 100, DOCS / "planning_metrology.md", "planning"
    ),
    "measured_loop": Study(
        Measurement(measure_measured, MeasuredResult, MEASURED),
        MeasuredSummary,
        100,
        DOCS / "planning_metrology.md",
        "measured_loop",
    ),
    "calibration": Study(
        Measurement(measure_calibration, CalibrationResult, CALIBRATION),
        CalibrationSummary,
        500,
        DOCS / "calibration_metrology.md",
        "calibration",
    ),
    "stiffness": Study(
        Measurement(measure_stiffness, StiffnessResult, STIFFNESS),
        StiffnessSummary,
        1000,
        DOCS / "stiffness_metrology.md",
        "stiffness",
    ),
}
