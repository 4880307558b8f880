"""`python -m bench.scan_plan [--parts N]`: achieved over predicted u, by simulator and quantity."""

from __future__ import annotations

import argparse
from typing import Any

import numpy as np

from bench.scan_plan.achieved import SIMULATORS, compare, draw, ratio
from workbench.errors import WorkbenchError
from workbench.scan_plan.information import MOST_INCIDENCE
from workbench.units import DEG

CORNER_DEG = 90.0 - MOST_INCIDENCE / DEG  # seen from so far below the lower surface is in view for certain


def row(ratios: list[float], errors: list[float]) -> str:
    if not ratios:
        return "none"
    low, middle, high = np.percentile(ratios, [10.0, 50.0, 90.0])
    within = np.mean([(0.8 <= one <= 1.25) for one in ratios])
    covered = np.mean(np.array(errors) <= 2.0)
    return f"{len(ratios)} | {low:.2f} | {middle:.2f} | {high:.2f} | {100 * within:.0f} | {100 * covered:.0f}"


def main(parts: int) -> None:
    print("| simulator, view | quantity | parts | 10 % | median | 90 % | within 0.8 to 1.25, % | error within 2 u, % |")
    print("|---|---|---|---|---|---|---|---|")
    for simulator in SIMULATORS:
        found: dict[tuple[str, str], tuple[list[float], list[float]]] = {}
        refused = 0
        for seed in range(parts):
            drawn = draw(seed)
            try:
                one = compare(simulator, seed, drawn)
            except WorkbenchError:
                refused += 1
                continue
            grey = any(-CORNER_DEG < view.elevation / DEG < 0.0 for view in drawn.views)
            kind = "slightly from below" if grey else "other views"
            sides: tuple[tuple[str, Any, float, Any], ...] = (
                ("root face", one.achieved_root_u_mm, one.root_u_mm, one.root_error_mm),
                ("bevel angle", one.achieved_bevel_u_deg, one.bevel_u_deg, one.bevel_error_deg),
            )
            for name, achieved, predicted, error in sides:
                ratios, errors = found.setdefault((kind, name), ([], []))
                ratios.append(ratio(achieved, predicted))
                errors += np.abs(error / achieved).tolist()
        for (kind, name), (ratios, errors) in sorted(found.items()):
            print(f"| {simulator}, {kind} | {name} | {row(ratios, errors)} |", flush=True)
        print(f"| {simulator} | refused by the engine | {refused} |")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--parts", type=int, default=100)
    main(parser.parse_args().parts)
