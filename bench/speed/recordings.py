"""The recordings that are measured: milled edges by the project's own simulator, as long as the count of points asks.

A frame every 0.1 mm, 1,000 columns 0.03 mm apart: 50 million points are 5 m of edge. Every frame is simulated by
itself, with noise, 0.5 % outliers, dropouts and mixed pixels; nothing is repeated.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from workbench.synthetic.recipe_file import parse_recipe
from workbench.synthetic.simulate import write_simulation

COLUMNS = 1000
FRAME_PITCH_MM = 0.1
MARGIN_MM = 10.0  # of the part before and after what is scanned


def recipe(million_points: int) -> dict[str, Any]:
    """Straight, 40 deg and 1.5 mm, both drifting; one oblique pass on a straight uniform motion."""
    frames = million_points * 1_000_000 // COLUMNS
    scanned_mm = (frames - 1) * FRAME_PITCH_MM
    return {
        "format": "bevel-recipe",
        "version": 1,
        "seed": 1,
        "part": {
            "length_mm": scanned_mm + 2 * MARGIN_MM,
            "root_mm": {"start": 1.46, "end": 1.58, "amplitude": 0.04, "wavelength_mm": 45},
            "bevel_deg": {"start": 39.85, "end": 40.1, "amplitude": 0.1, "wavelength_mm": 70},
            "table_gap_mm": 25,
            "base_from_part": {"position_mm": [1450, -320, 760], "rpy_deg": [35, 2.5, -1.5]},
        },
        "scanner": {"columns": COLUMNS, "pitch_mm": 0.03, "near_mm": 120, "far_mm": 190},
        "robot": {"frame_pitch_mm": FRAME_PITCH_MM, "pose_noise_mm": 0.02, "pose_noise_deg": 0.002},
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


def simulated(million_points: int, folder: Path) -> Path:
    """The recording as `workbench simulate` writes it (gzip and shuffle, chunks of 64 frames); kept if it is there."""
    path = folder / f"{million_points}m.h5"
    if path.exists():
        return path
    write_simulation(parse_recipe(recipe(million_points)), path)
    return path


def unpacked(packed: Path) -> Path:
    """The same recording without compression, contiguous, in a file beside it."""
    import h5py

    path = packed.with_suffix(".plain.h5")
    with h5py.File(packed) as old, h5py.File(path, "w") as new:
        new.attrs.update(old.attrs)
        for name in ("robot", "hand_eye"):
            old.copy(name, new)
        for name, values in old["profiles"].items():
            new.create_dataset(f"profiles/{name}", data=values[()])
    return path
