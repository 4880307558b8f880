"""The studies that `make metrology` runs: what each measures of a part, under which conditions, and its page."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.drawn.plates import RAW_CONDITIONS
from bench.harness import ROOT
from bench.metrology.calibration.part import CalibrationResult, measure_calibration
from bench.metrology.calibration.summary import (
    CALIBRATION_CONDITIONS,
    calibration_tables,
    summarise_calibrations,
    worst_calibrations,
)
from bench.metrology.measured.part import MeasuredResult, measure_measured
from bench.metrology.measured.summary import MEASURED_CONDITIONS, measured_tables, summarise_measured, worst_measured
from bench.metrology.planning.part import PlanResult, measure_plan
from bench.metrology.planning.summary import plan_tables, summarise_plans, worst_plans
from bench.metrology.run import Measurement
from bench.metrology.stiffness.part import StiffnessResult, measure_stiffness
from bench.metrology.stiffness.summary import (
    STIFFNESS_CONDITIONS,
    stiffness_tables,
    summarise_stiffness,
    worst_stiffness,
)

MEASURING = tuple(f"workbench/{family}" for family in ("geometry", "scan", "cloud", "edge", "synthetic"))


@dataclass(frozen=True)
class Study:
    """One kind of measurement over many parts and the tables that come of it."""

    measurement: Measurement
    conditions: tuple[str, ...]
    parts: int  # a condition, unless the command says otherwise
    summarise: Callable[[str, list[Any]], Any]  # condition, results -> with `shortcomings`
    tables: Callable[[list[Any], str], str]  # summaries, command -> Markdown
    worst: Callable[[list[Any], int], Iterable[str]]  # results of one condition, how many -> lines for the screen
    page: Path
    marks: str = "tables"  # of the place in the page


STUDIES = {
    "planning": Study(
        Measurement(
            measure_plan,
            PlanResult,
            (*MEASURING, "workbench/path", "bench/score", "bench/metrology", "bench/metrology/planning"),
        ),
        tuple(RAW_CONDITIONS),
        100,
        summarise_plans,
        plan_tables,
        worst_plans,
        ROOT / "docs" / "planning_metrology.md",
        "planning",
    ),
    "measured_loop": Study(
        Measurement(
            measure_measured,
            MeasuredResult,
            (
                *MEASURING,
                "workbench/path",
                "workbench/inspect",
                "workbench/twin",
                "bench/score",
                "bench/metrology",
                "bench/metrology/planning",
                "bench/metrology/measured",
            ),
        ),
        MEASURED_CONDITIONS,
        100,
        summarise_measured,
        measured_tables,
        worst_measured,
        ROOT / "docs" / "planning_metrology.md",
        "measured_loop",
    ),
    "calibration": Study(
        Measurement(
            measure_calibration,
            CalibrationResult,
            (
                "workbench/geometry",
                "workbench/synthetic",
                "workbench/plugins/calibration",
                "bench/peers",
                "bench/metrology/calibration",
            ),
        ),
        CALIBRATION_CONDITIONS,
        500,
        summarise_calibrations,
        calibration_tables,
        worst_calibrations,
        ROOT / "docs" / "calibration_metrology.md",
        "calibration",
    ),
    "stiffness": Study(
        Measurement(
            measure_stiffness,
            StiffnessResult,
            ("workbench/geometry", "workbench/robot", "workbench/plugins/stiffness", "bench/metrology/stiffness"),
        ),
        STIFFNESS_CONDITIONS,
        1000,
        summarise_stiffness,
        stiffness_tables,
        worst_stiffness,
        ROOT / "docs" / "stiffness_metrology.md",
        "stiffness",
    ),
}
