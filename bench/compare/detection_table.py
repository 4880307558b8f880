"""How often places of an unchanged part lie beyond their level of detection: `python -m bench.compare.detection_table`.

Prints the table of docs/comparison.md: two simulated scans of one part with a robot of each kind, registered, compared.
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from workbench.cloud import denoise
from workbench.compare import register, surface
from workbench.compare.deviation import Scales, course_of, deviations, moved, places_of
from workbench.compare.statistics import summarise
from workbench.compare.surface import Deviations, Surface
from workbench.scan import fuse
from workbench.synthetic import parse_recipe, simulate_recording

ROBOTS = (  # motion, noise of a pose, amplitude of an error that is smooth along the way, mm
    ("two_poses", 0.05, 0.0),
    ("stream", 0.01, 0.0),
    ("stream", 0.07, 0.0),
    ("stop_and_go", 0.02, 0.0),
    ("two_poses", 0.0, 0.05),
    ("two_poses", 0.0, 0.2),
)
SCALES = Scales(1.0, 2.0, 2.0, 1.0)


def scan(seed: int, motion: str, pose_noise_mm: float, smooth_mm: float) -> Surface:
    recipe: dict[str, Any] = {
        "format": "bevel-recipe",
        "version": 1,
        "seed": seed,
        "part": {"length_mm": 70},
        "scanner": {"columns": 400},
        "robot": {
            "frame_pitch_mm": 0.4,
            "pose_noise_mm": pose_noise_mm,
            "pose_noise_deg": 0.01,
            "smooth_error_mm": smooth_mm,
        },
        "disturbances": {"outlier_share": 0.004},
        "passes": [{"from_mm": 3, "to_mm": 67, "oblique_deg": 2, "motion": motion}],
    }
    return surface(denoise(fuse(simulate_recording(parse_recipe(recipe))[0])))


def unchanged(seed: int, motion: str, pose_noise_mm: float, smooth_mm: float) -> Deviations:
    """One part, scanned twice."""
    reference, other = (scan(2 * seed + k, motion, pose_noise_mm, smooth_mm) for k in (1, 2))
    registration = register(other, reference, open_directions="hold")[0]
    laid = moved(other, registration)
    course = course_of(laid, reference, None, np.array([0.0, 0.0, 1.0]))
    return deviations(laid, reference, places_of(laid, reference, SCALES), registration, 0.0, course, SCALES)


def main(parts: int) -> None:
    print("| robot | parts | called changed | places beyond their level | level of detection, median |")
    print("|---|---|---|---|---|")
    for motion, noise, smooth in ROBOTS:
        found = [unchanged(seed, motion, noise, smooth) for seed in range(parts)]
        wrong = sum(summarise(one, 9, 3.0, "", "change", SCALES.spacing_mm).changed.any() for one in found)
        share = np.mean([one.significant[np.isfinite(one.distance_mm)].mean() for one in found])
        level = np.mean([np.nanmedian(one.detectable_mm) for one in found])
        name = f"{motion}, {noise:g} mm" if noise else f"{motion}, smoothly {smooth:g} mm"
        print(f"| {name} | {parts} | {wrong} | {100 * share:.1f} % | {level:.3f} mm |")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 5)
