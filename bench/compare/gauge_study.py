"""The gauge study of `data/synthetic/gauge_study.csv`: `python -m bench.compare.gauge_study [FILE]`.

Three simulated parts, each scanned three times by three operators. Operators calibrate the hand-eye pose each for
themselves and look at the edge from another side; a trial draws its own noise of sensor and robot. The reference is the
part's truth as a laboratory would state it: with a standard uncertainty, and an error drawn from it.
"""

from __future__ import annotations

import csv
import dataclasses
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from workbench.artefacts import Inspection
from workbench.cloud import denoise
from workbench.edge import segment
from workbench.geometry.poses import pose_from, rotation_from_vector
from workbench.inspect import sections
from workbench.scan import fuse
from workbench.synthetic import parse_recipe, simulate_recording
from workbench.units import DEG

PARTS = {"P1": (1.45, 39.8), "P2": (1.6, 40.3), "P3": (1.52, 40.0)}  # root, bevel
OPERATORS = {"A": (38.0, 2.0), "B": (44.0, -3.0), "C": (41.0, 0.5)}  # elevation, oblique
TRIALS, SECTIONS = 3, 5
REFERENCE_U = {"root_mm": 0.005, "bevel_deg": 0.02}
COLUMNS = ("part", "operator", "trial", "section", "arc_length_mm", "root_mm", "root_u_mm", "bevel_deg", "bevel_u_deg")


def recipe(part: str, operator: str, trial: int) -> dict[str, Any]:
    """A recipe of `workbench simulate`: one trial."""
    (root, bevel), (elevation, oblique) = PARTS[part], OPERATORS[operator]
    number = [*PARTS].index(part), [*OPERATORS].index(operator)
    return {
        "format": "bevel-recipe",
        "version": 1,
        "part_id": part,
        "seed": 1000 * number[1] + 100 * number[0] + trial,
        "part": {
            "length_mm": 70.0,
            "root_mm": {"start": root - 0.03, "end": root + 0.03},
            "bevel_deg": {"start": bevel + 0.1, "end": bevel - 0.1},
        },
        "scanner": {"columns": 500},
        "robot": {"frame_pitch_mm": 0.4, "pose_noise_mm": 0.05, "pose_noise_deg": 0.01},
        "disturbances": {"outlier_share": 0.004, "dropout_share": 0.005},
        "passes": [{"from_mm": 3, "to_mm": 67, "elevation_deg": elevation, "oblique_deg": oblique}],
    }


def measure(part: str, operator: str, trial: int) -> tuple[Inspection, Any]:
    """The inspection of one trial and the truth of its part; the hand-eye pose is the operator's own."""
    recording, truth = simulate_recording(parse_recipe(recipe(part, operator, trial)))
    rng = np.random.default_rng([7, ord(operator)])
    error = pose_from(rotation_from_vector(rng.normal(0, 0.03 * DEG, 3)), rng.normal(0, 0.05, 3))
    recording = dataclasses.replace(recording, flange_from_profiler=recording.flange_from_profiler @ error)
    return sections(segment(denoise(fuse(recording))), sections=SECTIONS), truth


def rows() -> Iterator[tuple[Any, ...]]:
    """The study, row by row."""
    for part in PARTS:
        for operator in OPERATORS:
            for trial in range(1, TRIALS + 1):
                inspection, truth = measure(part, operator, trial)
                for one in inspection.sections:
                    yield (
                        part,
                        operator,
                        trial,
                        one.index,
                        round(one.arc_length_mm, 2),
                        one.root_mm,
                        one.root_u_mm,
                        one.bevel_deg,
                        one.bevel_u_deg,
                    )
        yield from reference(part, inspection, truth)


def reference(part: str, inspection: Inspection, truth: Any) -> Iterator[tuple[Any, ...]]:
    """The truth at the sections, as a laboratory would know it."""
    rng = np.random.default_rng([11, *part.encode()])
    for one in inspection.sections:
        place = int(np.argmin(np.linalg.norm(truth.position_mm - one.origin_mm, axis=1)))
        value = [getattr(truth, name)[place] + rng.normal(0, u) for name, u in REFERENCE_U.items()]
        yield (
            part,
            "reference",
            1,
            one.index,
            round(one.arc_length_mm, 2),
            value[0],
            REFERENCE_U["root_mm"],
            value[1],
            REFERENCE_U["bevel_deg"],
        )


def main(path: Path) -> None:
    with path.open("w", newline="") as file:
        file.write("# Simulated gauge study, made by `python -m bench.compare.gauge_study`: mm and degrees\n")
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for row in rows():
            table.writerow([f"{cell:.5f}" if isinstance(cell, float) and k > 4 else cell for k, cell in enumerate(row)])


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "data/synthetic/gauge_study.csv"))
