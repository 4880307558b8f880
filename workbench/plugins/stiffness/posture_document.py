"""`posture.json`: postures of every point, and the map that the choice was made on. Degrees, mm."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np

from workbench.api import DEG, AnyArray, Float, PostureFile, Postures
from workbench.plugins.stiffness.feasible import CAUSES, JUDGED
from workbench.plugins.stiffness.law_postures import Case, Found
from workbench.plugins.stiffness.search import PostureMap


def posture_document(found: Found) -> bytes:
    """`points` are the layers' in their order; `travels` those of the travel moves, which come in between."""
    made = found.postures
    air = made.layer == 0
    return PostureFile.written(
        {
            "format": "posture",
            "version": 1,
            "part": asdict(made.toolpath.part),
            "mode": found.mode,
            "mean_displacement_mm": float(found.displacement_mm.mean()),
            "constant": {
                "cutter_rotation_deg": round(found.choice.rotation / DEG, 6),
                "turntable_deg": round(found.choice.table / DEG, 6),
                "mean_displacement_mm": _mean(found.cases["best"]),
                "cells_examined": found.choice.examined,
            },
            "compared": {name: None if case is None else _case(case) for name, case in found.cases.items()},
            "pointwise_bound_mm": float(found.bound_mm.mean()),
            "gap_to_bound": found.gap,
            "law_bound_mm": found.law_bound_mm,
            "gap_to_best_law": found.law_gap,
            "warnings": list(made.warnings),
            "points": _rows(made, np.flatnonzero(~air)),
            "travels": _rows(made, np.flatnonzero(air)),
            "map": _map(found.map),
        }
    )


def _mean(case: Case | None) -> float | None:
    return None if case is None else float(case.displacement_mm.mean())


def _case(case: Case) -> dict[str, Any]:
    return {
        "cutter_rotation_deg": round(case.rotation / DEG, 6),
        "turntable_deg": round(case.table / DEG, 6),
        "mean_displacement_mm": _mean(case),
        "cause": CAUSES[case.cause],
        "pair": case.pair,
    }


def _rows(made: Postures, chosen: AnyArray) -> list[dict[str, Any]]:
    columns = {
        "layer": made.layer,
        "cutter_rotation_deg": _rounded(made.cutter_rotation / DEG, 6),
        "turntable_deg": _rounded(made.turntable / DEG, 6),
        "joints_deg": _rounded(made.joints / DEG, 6),
        "displacement_mm": _rounded(np.linalg.norm(made.displacement_mm, axis=1), 6),
        "clearance_mm": _rounded(made.clearance_mm, 3),
    }
    values = [column[chosen].tolist() for column in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*values, strict=True)]


def _map(over: PostureMap) -> dict[str, Any]:
    return {
        "cutter_rotation_deg": _rounded(over.rotations / DEG, 6),
        "turntable_deg": _rounded(over.tables / DEG, 6),
        "mean_displacement_mm": _rounded(over.mean_mm, 6),
        "cause": [[CAUSES[i] for i in row] for row in over.cause.tolist()],
        "judged": [[JUDGED[i] for i in row] for row in over.how.tolist()],
        "collision_pairs": [list(pair) for pair in over.pairs],
        "collision_pair": [[None if i < 0 else i for i in row] for row in over.pair.tolist()],
    }


def _rounded(values: Float, digits: int) -> Float:
    return np.asarray(np.round(values, digits) + 0.0)
