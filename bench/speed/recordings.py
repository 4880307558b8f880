"""The recordings that are measured, by the project's own simulator.

Every frame is simulated by itself, with noise, outliers, dropouts and mixed pixels; nothing is repeated.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from workbench.synthetic.recipe_file import parse_recipe
from workbench.synthetic.simulate import write_simulation

COLUMNS, FRAME_PITCH_MM = 1000, 0.1
MARGIN_MM = 10.0  # of the part before and after what is scanned
PART_MM, ROOT_SPREAD_MM, BEVEL_SPREAD_DEG, DRIFT_MM = 60.0, 0.05, 0.15, 0.1  # small parts; drift over all of them


def recipe(seed: int, scanned_mm: float, part: Any, scanner: Any, pitch_mm: float) -> Any:
    """A plate and one oblique pass along it, on a straight uniform motion."""
    return {
        "format": "bevel-recipe",
        "version": 1,
        "part_id": f"part {seed}",
        "seed": seed,
        "part": {
            "length_mm": scanned_mm + 2 * MARGIN_MM,
            "table_gap_mm": 25,
            "base_from_part": {"position_mm": [1450, -320, 760], "rpy_deg": [35, 2.5, -1.5]},
        }
        | part,
        "scanner": {"near_mm": 120, "far_mm": 190} | scanner,
        "robot": {"frame_pitch_mm": pitch_mm, "pose_noise_mm": 0.02, "pose_noise_deg": 0.002},
        "disturbances": {
            "dropout_share": 0.005,
            "grazing_dropout": 0.1,
            "outlier_share": 0.004,
            "streak_outlier_share": 0.001,
            "mixed_pixel_probability": 0.5,
        },
        "passes": [
            {
                "from_mm": MARGIN_MM,
                "to_mm": MARGIN_MM + scanned_mm,
                "elevation_deg": 42,
                "oblique_deg": 2.5,
                "lead_deg": -3,
                "aim_mm": [-4, 4],
            }
        ],
    }


def simulated(million_points: int, folder: Path, raw: bool = False) -> Path:
    """A frame every 0.1 mm, 1,000 columns: 50 million points are 5 m of edge. Kept if it is there.

    Milled and straight, both sizes drifting, or the end face of a raw plate of 12 mm, on an arc of 10 m.
    """
    path = folder / f"{million_points}m{'_raw' * raw}.h5"
    if not path.exists():
        scanned_mm = (million_points * 1_000_000 // COLUMNS - 1) * FRAME_PITCH_MM
        root = {"start": 1.46, "end": 1.58, "amplitude": 0.04, "wavelength_mm": 45}
        bevel = {"start": 39.85, "end": 40.1, "amplitude": 0.1, "wavelength_mm": 70}
        part: dict[str, Any] = {"root_mm": root, "bevel_deg": bevel}
        if raw:
            part = {"kind": "raw", "thickness_mm": 12, "curve": {"shape": "arc", "radius_mm": 10_000}}
        document = recipe(1, scanned_mm, part, {"columns": COLUMNS, "pitch_mm": 0.03}, FRAME_PITCH_MM)
        document["passes"][0] |= {"motion": "stream", "follow": "edge"} if raw else {}
        write_simulation(parse_recipe(document), path)
    return path


def small_parts(count: int, folder: Path) -> Iterator[Path]:
    """Parts of 60 mm that differ a little, 300 columns, a frame every 0.5 mm."""
    for number in range(1, count + 1):
        rng = np.random.default_rng([7, number])
        root_mm = 1.45 + DRIFT_MM * number / count + ROOT_SPREAD_MM * rng.normal()
        root = {"start": root_mm, "end": root_mm - 0.08, "amplitude": 0.06, "wavelength_mm": 50}
        bevel_deg = 40.0 + BEVEL_SPREAD_DEG * rng.normal()
        sizes = {"root_mm": root, "bevel_deg": {"start": bevel_deg, "end": bevel_deg + 0.1}}
        path = folder / f"part-{number:04d}.h5"
        document = recipe(number, PART_MM, sizes, {"columns": 300, "pitch_mm": 0.1}, 0.5)
        write_simulation(parse_recipe(document), path)
        yield path
