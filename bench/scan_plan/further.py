"""`python -m bench.scan_plan.further`: undecided inspections, the pass that was to decide them, and whether it did.

One pass of the triangulated simulator, whose lower edges may have a radius; limits lie at random within three u of the
true sizes. The proposed pass is scanned, all is measured again.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from bench.harness import kept, made_by
from bench.scan_plan.parts import ROBOT_MM, draw, sensor_file, triangulated
from workbench import cloud, edge, inspect, scan
from workbench.artefacts import Cloud, Document, Inspection, MilledEdge
from workbench.result_files import SensorFile
from workbench.scan_next import next_
from workbench.scan_plan.information import Joint, View
from workbench.scan_plan.plan import as_profiler
from workbench.units import DEG

PITCH_MM = 0.4
FAR_U = 3.0  # of a limit from the true size, at most


def examine(seed: int) -> dict[str, Any]:
    """One part: undecided sections, those promised to be decided, and those that were; U as told and as had."""
    drawn, rng = draw(seed), np.random.default_rng([77, seed])
    elevation, share = float(rng.uniform(25.0, 55.0)), rng.uniform(0.0, FAR_U, 2)
    with TemporaryDirectory() as folder:
        sensor = sensor_file(drawn, Path(folder))

        def measured(*elevations_deg: float) -> tuple[Cloud, MilledEdge]:
            profiler = as_profiler(SensorFile.read(sensor), sensor)
            joint = Joint(drawn.thickness_mm, drawn.root_mm, drawn.bevel_deg * DEG)
            views = [View(one * DEG, profiler.middle_mm, PITCH_MM) for one in elevations_deg]
            points = cloud.denoise(scan.fuse(triangulated(drawn, joint, profiler, views, seed)[0]))
            nominal = {"root_nominal_mm": drawn.root_mm, "bevel_nominal_deg": drawn.bevel_deg}
            return points, edge.segment(points, robot_noise_mm=ROBOT_MM, sensor=sensor, **nominal)

        def inspected(found: MilledEdge) -> Inspection:
            return inspect.sections(
                found,
                root_nominal_mm=drawn.root_mm,
                bevel_nominal_deg=drawn.bevel_deg,
                root_tolerance_mm=(-1.0, float(share[0] * u[0])),
                bevel_tolerance_deg=(-5.0, float(share[1] * u[1])),
            )

        points, found = measured(elevation)
        u = float(np.nanmedian(found.root.u)), float(np.nanmedian(found.bevel.u))
        before = inspected(found)
        row: dict[str, Any] = {"seed": seed, "undecided": _undecided(before), "promised": [], "decided": []}
        made = next_(points, found, before, sensor=sensor, robot_noise_mm=ROBOT_MM)
        document = next((json.loads(one.content) for one in made if isinstance(one, Document)), None)
        if document is None:
            return row
        after = inspected(measured(elevation, document["elevation_deg"])[1])
        still = _undecided(after)
    row |= {"promised": document["decided_by_it"], "decided": [k for k in row["undecided"] if k not in still]}
    row["likely"] = sum(document["probability"])
    row |= {"elevations": [elevation, document["elevation_deg"]], "before_U": [2.0 * one for one in u]}
    row["told_U"] = [document["predicted_root_U_mm"], document["predicted_bevel_U_deg"]]
    sizes = ([s.root_u_mm for s in after.sections], [s.bevel_u_deg for s in after.sections])
    row["had_U"] = [2.0 * float(np.median([one for one in each if one is not None])) for each in sizes]
    return row


def _undecided(found: Inspection) -> list[int]:
    return [one.index for one in found.sections if one.verdict == "undecided"]


def summary(rows: Sequence[dict[str, Any]]) -> str:
    """What was promised and kept."""
    left = [row for row in rows if row["undecided"]]
    named = [row for row in left if "told_U" in row]
    undecided, promised, decided = (sum(len(row[key]) for row in left) for key in ("undecided", "promised", "decided"))
    likely = sum(row["likely"] for row in named)
    held = sum(len(set(row["promised"]) & set(row["decided"])) for row in named)
    ratio = np.array([np.divide(row["had_U"], row["told_U"]) for row in named]).reshape(-1, 2)
    raised = sum(row["told_U"][k] > row["before_U"][k] for row in named for k in range(2))
    shown = ", ".join(" ".join(f"{v:.2f}" for v in np.percentile(of, [10.0, 50.0, 90.0])) for of in ratio.T)
    return (
        f"{len(left)} undecided inspections, {len(named)} passes named: of {undecided} undecided sections {decided} "
        f"decided ({likely:.1f} expected); of {promised} that were promised {held}. "
        f"U as had over U as told (10 %, median, 90 %) of root face "
        f"and bevel: {shown}. Predictions that raise U: {raised}."
    )


def main() -> None:
    """Examine parts, print what came of them."""
    parser = argparse.ArgumentParser(prog="python -m bench.scan_plan.further", description=__doc__)
    parser.add_argument("--parts", type=int, default=40)
    parser.add_argument("--first", type=int, default=0, help="seed")
    parser.add_argument("--workers", type=int, default=2, help="processes (2)")
    given = parser.parse_args()
    rows = kept("scan_next", examine, range(given.first, given.first + given.parts), given.workers)
    print(
        f"`python -m bench.scan_plan.further --parts {given.parts} --first {given.first}`{made_by()}: {summary(rows)}"
    )


if __name__ == "__main__":
    main()
