"""`python -m bench.groove`: errors of every size over random grooves of two simulators, as a table in Markdown.

Odd: the swept simulator with shapes that nothing is made for: any angle, gap, radius and misalignment, rounded upper
edges, coarse columns.
"""

from __future__ import annotations

import argparse
import math
from functools import partial
from itertools import product

import numpy as np

from bench.drawn.grooves import random_groove_recipe, random_prism_recipe
from bench.groove.table import Rows, study
from bench.simulators.swept import simulate_groove
from bench.simulators.swept.recipe import GrooveRecipe
from bench.simulators.swept.sweep import GROOVES
from workbench.artefacts import SIZES, GrooveInspection, u_name
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.inspect import groove as inspect_groove
from workbench.scan import fuse
from workbench.synthetic import GrooveTruth
from workbench.synthetic.prism_scan import simulate_prism
from workbench.units import DEG, Float


def main() -> None:
    arguments = argparse.ArgumentParser(prog="python -m bench.groove", description=__doc__)
    arguments.add_argument("--parts", type=int, default=200, help="parts a type and simulator")
    arguments.add_argument("--seed", type=int, default=0, help="of the first part")
    arguments.add_argument("--types", default=",".join(GROOVES))
    arguments.add_argument("--simulators", default="swept,prism")
    given = arguments.parse_args()
    chosen = product(range(given.seed, given.seed + given.parts), given.simulators.split(","), given.types.split(","))
    study(
        ((f"{simulator} {kind} {seed}", partial(judged, simulator, kind, seed)) for seed, simulator, kind in chosen),
        tuple(SIZES),
    )


def judged(simulator: str, kind: str, seed: int) -> tuple[str | None, Rows]:
    inspection, truth = measured(simulator, kind, seed)
    known = kind in (inspection.type, *inspection.alternatives)
    return None if known else inspection.type, errors(inspection, truth)


def measured(simulator: str, kind: str, seed: int) -> tuple[GrooveInspection, GrooveTruth]:
    """A random groove, scanned and inspected, and its truth."""
    if simulator in ("swept", "odd"):
        recipe = random_groove_recipe(kind, seed) if simulator == "swept" else odd_groove(kind, seed)
        recording, truth = simulate_groove(recipe)
    else:
        recording, truth = simulate_prism(random_prism_recipe(kind, seed))
    return inspect_groove(segment_groove(denoise(fuse(recording)))), truth


def odd_groove(kind: str, seed: int) -> GrooveRecipe:
    """A groove as `random_groove_recipe` draws it, with sizes from far beyond what is usual."""
    rng = np.random.default_rng([783, seed, GROOVES.index(kind)])
    recipe = random_groove_recipe(kind, seed, clutter=bool(rng.random() < 0.5)).model_dump(mode="json")
    part, scanner, way = recipe["part"], recipe["scanner"], recipe["passes"][0]
    thickness, under = rng.uniform(3.0, 25.0), 0.0
    if kind in "XK":
        under = rng.uniform(0.15, 0.5) * thickness
    root = rng.uniform(0.0, 0.7) * (thickness - under)
    left, right = rng.uniform(*((5.0, 25.0) if kind in "UJ" else (15.0, 60.0)), 2)
    gap = float(rng.choice([0.0, np.exp(rng.uniform(math.log(0.3), math.log(12.0)))]))
    part |= {
        "thickness_mm": _flat(thickness),
        "gap_mm": _flat(gap),
        "root_face_left_mm": _flat(root),
        "root_face_right_mm": _flat(root * rng.uniform(0.7, 1.2)),
        "bevel_left_deg": _flat(left),
        "bevel_right_deg": _flat(right),
        "under_depth_mm": max(under, 0.1),
        "root_radius_mm": float(np.exp(rng.uniform(math.log(0.5), math.log(12.0)))),
        "misalignment_mm": _flat(rng.uniform(-0.3, 0.3) * thickness),
        "upper_radius_mm": 0.0 if rng.random() < 0.4 else rng.uniform(0.0, 0.9),
    }
    half = (thickness - root) * math.tan(max(left, right) * DEG) + gap / 2 + 8.0
    scanner["columns"] = int(rng.choice([320, 640, 1280]))
    scanner["pitch_mm"] = 2.2 * half / scanner["columns"]
    scanner["near_mm"], scanner["far_mm"] = scanner["standoff_mm"] - 60.0, scanner["standoff_mm"] + 90.0
    way["aim_mm"] = [0.0, 0.7 * thickness]
    way["skew_mm"] = [-1.0, 1.0]
    return GrooveRecipe.model_validate(recipe)


def _flat(value: float) -> dict[str, float]:
    return {"start": value, "end": value}


def errors(inspection: GrooveInspection, truth: GrooveTruth) -> list[tuple[str, float, float]]:
    """Size, error and u of every value of every section; left and right as the section has them."""
    rows = []
    for section in inspection.sections:
        at = int(np.argmin(np.linalg.norm(truth.position_mm - section.origin_mm, axis=1)))
        swapped = float(truth.normal[at] @ section.normal) < 0
        for size in SIZES:
            value, u = section.values.get(size), section.values.get(u_name(size))
            exact = _exact(truth, size, swapped)[at]
            if value is not None and u is not None and np.isfinite(exact):
                rows.append((size, value - float(exact), u))
    return rows


def _exact(truth: GrooveTruth, size: str, swapped: bool) -> Float:
    if not swapped:
        return np.asarray(getattr(truth.sizes, size))
    other = {"left": "right", "right": "left"}
    name = "_".join(other.get(word, word) for word in size.split("_"))
    return np.asarray(getattr(truth.sizes, name)) * (-1.0 if size == "misalignment_mm" else 1.0)


if __name__ == "__main__":
    main()
