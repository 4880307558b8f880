"""One raw edge through the closed loop: scanned, planned, milled and inspected, beside what was milled in truth."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from bench.drawn.plates import random_recipe
from bench.metrology.part import WINDOW_MM, Clock, Numbers, numbers
from bench.metrology.planning.part import plan_as_a_user
from bench.metrology.true_edge import true_edge_at
from workbench.artefacts import Inspection, Toolpath
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.errors import WorkbenchError
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import Recipe, Truth, simulate_recording
from workbench.synthetic.workpiece import Workpiece, milled_truth
from workbench.twin import mill, scan
from workbench.units import DEG, Float


@dataclass(slots=True)
class LoopResult:
    """Sections as inspected and as milled, by case: 'perfect' mechanics, and 'errors' of hand-eye and robot."""

    condition: str
    seed: int
    refused: str | None = None  # a stage's error, in one line
    crashed: str | None = None  # any other exception: a defect
    seen_share: float = 1.0  # of the raw edge, by truth
    cases: dict[str, dict[str, Numbers]] = field(default_factory=dict)  # case -> see `loop.part.compare`
    cut: dict[str, list[bool]] = field(default_factory=dict)  # case -> whether the plan cuts all about each section
    warnings: dict[str, list[str]] = field(default_factory=dict)  # case -> of the mill
    seconds: dict[str, float] = field(default_factory=dict)


HAND_EYE_ERROR_MM = 0.4  # in a random direction
ROBOT_NOISE_MM = 0.1
CASES = ("perfect", "errors")


def measure_loop(condition: str, seed: int) -> LoopResult:
    """Take raw edge `seed` of a condition through the loop, once a case. There are no peers."""
    return close_loop(LoopResult(condition, seed), random_recipe(condition, seed))


def close_loop(result: LoopResult, recipe: Recipe) -> LoopResult:
    """Scan, plan and, once a case, mill, scan and inspect the raw part of a recipe."""
    clock = Clock(result.seconds)
    recording, truth = simulate_recording(recipe)
    result.seen_share = float(truth.seen.mean())
    clock.lap("simulation")
    try:
        _, toolpath, gate = plan_as_a_user(recording, truth, clock)
        if not gate.passed:
            result.refused = f"path.check: {gate.reason}"
            return result
        for case in CASES:
            offset = injected_offset_mm(result.seed) if case == "errors" else np.zeros(3)
            milled, engagement = mill(Workpiece(recipe), toolpath, seed=result.seed, **mechanics(case, offset))
            clock.lap(f"{case}: milling")
            again = scan(milled)
            clock.lap(f"{case}: simulation")
            inspection = sections(segment(denoise(fuse(again))))
            clock.lap(f"{case}: inspection")
            result.cases[case] = compare(inspection, milled_truth(milled), truth, offset)
            result.cut[case] = wholly_cut(inspection, toolpath, truth)
            result.warnings[case] = list(engagement.warnings)
    except WorkbenchError as error:
        result.refused = str(error)
    except Exception as error:
        result.crashed = repr(error)
    return result


def mechanics(case: str, offset_mm: Float) -> dict[str, Any]:
    """Parameters of `twin.mill`: what is wrong with the robot."""
    if case == "perfect":
        return {}
    return {"offset_mm": tuple(float(v) for v in offset_mm), "robot_noise_mm": ROBOT_NOISE_MM}


def injected_offset_mm(seed: int) -> Float:
    """An error of the hand-eye calibration as it displaces the tool in the base."""
    direction = np.random.default_rng([seed, 0x10]).normal(size=3)
    return np.asarray(direction / np.linalg.norm(direction) * HAND_EYE_ERROR_MM)


def compare(inspection: Inspection, milled: Truth, raw: Truth, offset_mm: Float) -> dict[str, Numbers]:
    """Nine entries each: root face and bevel angle as inspected, as milled and u; root face as the offset implies it.

    A tool that is displaced by d above the bevel, along its normal, leaves a root that is larger by d / sin(bevel).
    """
    found, required = inspection.sections, inspection.requirements
    origins = np.array([s.origin_mm for s in found])
    normal = true_edge_at(raw, origins).bevel_normal(required.bevel_nominal_deg)
    by_offset = normal @ offset_mm / math.sin(required.bevel_nominal_deg * DEG)
    return {
        "root_mm": [s.root_mm for s in found],
        "root_u_mm": [s.root_u_mm for s in found],
        "root_milled_mm": numbers(milled.root_mm_at(origins)),
        "root_injected_mm": numbers(required.root_nominal_mm + by_offset),
        "bevel_deg": [s.bevel_deg for s in found],
        "bevel_u_deg": [s.bevel_u_deg for s in found],
        "bevel_milled_deg": numbers(milled.bevel_deg_at(origins)),
    }


def wholly_cut(inspection: Inspection, toolpath: Toolpath, raw: Truth) -> list[bool]:
    """Whether the plan cuts all along the frames that a section rests on; beside clamps it does not."""
    final = toolpath.layers[-1]
    key = (final.arc_length_mm >= 0) & (final.arc_length_mm <= toolpath.edge_length_mm) & ~final.cutting
    left = raw.arc_length_mm_at(final.position_mm[key])
    at = raw.arc_length_mm_at(np.array([s.origin_mm for s in inspection.sections]))
    return [bool(np.all(np.abs(left - s) > WINDOW_MM)) for s in at]
