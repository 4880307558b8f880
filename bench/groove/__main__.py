"""`python -m bench.groove`: errors of every size over random grooves of both simulators, as a table in Markdown."""

from __future__ import annotations

import argparse
from collections import defaultdict

import numpy as np

from bench.groove.table import FAR, print_table
from workbench.artefacts import SIZES, GrooveInspection, u_name
from workbench.cloud import denoise
from workbench.edge import segment_groove
from workbench.errors import InputError
from workbench.inspect import groove as inspect_groove
from workbench.scan import fuse
from workbench.synthetic.prism_conditions import random_prism_recipe
from workbench.synthetic.prism_scan import simulate_prism
from workbench.synthetic.swept import GrooveTruth, simulate_groove
from workbench.synthetic.swept.groove_conditions import GROOVES, random_groove_recipe
from workbench.units import Float


def main() -> None:
    arguments = argparse.ArgumentParser(prog="python -m bench.groove", description=__doc__)
    arguments.add_argument("--parts", type=int, default=200, help="parts a type and simulator")
    arguments.add_argument("--seed", type=int, default=0, help="of the first part")
    arguments.add_argument("--types", default=",".join(GROOVES))
    arguments.add_argument("--simulators", default="swept,prism")
    given = arguments.parse_args()
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    refused: dict[str, int] = defaultdict(int)
    excluded, parts, places = 0, 0, 0
    for simulator in given.simulators.split(","):
        for kind in given.types.split(","):
            for seed in range(given.seed, given.seed + given.parts):
                parts += 1
                try:
                    inspection, truth = measured(simulator, kind, seed)
                except InputError as error:
                    refused[kind] += 1
                    print(f"{simulator} {kind} {seed}: refused: {error}")
                    continue
                if kind not in (inspection.type, *inspection.alternatives):
                    excluded += 1
                    print(f"{simulator} {kind} {seed}: taken for {inspection.type}")
                    continue
                places += len(inspection.sections)
                for size, error, u in errors(inspection, truth):
                    found[size].append((error, u))
                    if abs(error) > FAR * u:
                        print(f"{simulator} {kind} {seed}: {size} off by {error:.3f}, {abs(error) / u:.1f} u")
    print(f"\n{parts} parts; {sum(refused.values())} refused; {excluded} taken for a type that they are not\n")
    print_table(tuple(SIZES), found)


def measured(simulator: str, kind: str, seed: int) -> tuple[GrooveInspection, GrooveTruth]:
    """A random groove, scanned and inspected, and its truth."""
    if simulator == "swept":
        recording, truth = simulate_groove(random_groove_recipe(kind, seed))
    else:
        recording, truth = simulate_prism(random_prism_recipe(kind, seed))
    return inspect_groove(segment_groove(denoise(fuse(recording)))), truth


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
