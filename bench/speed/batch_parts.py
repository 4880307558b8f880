"""Small parts of one process, simulated: the root face grows a little from part to part, section 7 is the thinnest."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from workbench.synthetic.recipe_file import parse_recipe
from workbench.synthetic.simulate import write_simulation

COLUMNS, FRAME_PITCH_MM, SCANNED_MM, MARGIN_MM = 300, 0.5, 60.0, 5.0
ROOT_SPREAD_MM, BEVEL_SPREAD_DEG, DRIFT_MM = 0.05, 0.15, 0.1  # part to part; of the root over all parts


def recipe(number: int, share: float) -> dict[str, Any]:
    """Part `number`, made after a share of all."""
    rng = np.random.default_rng([7, number])
    root_mm = 1.45 + DRIFT_MM * share + ROOT_SPREAD_MM * rng.normal()
    bevel_deg = 40.0 + BEVEL_SPREAD_DEG * rng.normal()
    return {
        "format": "bevel-recipe",
        "version": 1,
        "part_id": f"part {number}",
        "seed": number,
        "part": {
            "length_mm": SCANNED_MM + 2 * MARGIN_MM,
            "root_mm": {"start": root_mm, "end": root_mm - 0.08, "amplitude": 0.06, "wavelength_mm": 50},
            "bevel_deg": {"start": bevel_deg, "end": bevel_deg + 0.1},
            "table_gap_mm": 25,
            "base_from_part": {"position_mm": [1450, -320, 760], "rpy_deg": [35, 2.5, -1.5]},
        },
        "scanner": {"columns": COLUMNS, "pitch_mm": 0.1, "near_mm": 120, "far_mm": 190},
        "robot": {"frame_pitch_mm": FRAME_PITCH_MM, "pose_noise_mm": 0.02, "pose_noise_deg": 0.002},
        "disturbances": {"dropout_share": 0.005, "outlier_share": 0.004},
        "passes": [
            {
                "from_mm": MARGIN_MM,
                "to_mm": MARGIN_MM + SCANNED_MM,
                "elevation_deg": 42,
                "oblique_deg": 2.5,
                "lead_deg": -3,
                "aim_mm": [-4, 4],
            }
        ],
    }


def simulated_parts(count: int, folder: Path) -> Iterator[Path]:
    """The recordings, one after the other."""
    for number in range(1, count + 1):
        path = folder / f"part-{number:04d}.h5"
        write_simulation(parse_recipe(recipe(number, number / count)), path)
        yield path
