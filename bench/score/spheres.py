"""Calibration spheres of three simulators: ordinary ones, and one in seven as a shop has them."""

from __future__ import annotations

import numpy as np

from bench.drawn.seeds import generator
from bench.drawn.spheres import random_sphere_recipe
from bench.score.parts import Drawn
from bench.simulators.spheres import by_rays, by_sections, shown
from workbench.synthetic import simulate_sphere

ORDINARY, ODD = ("sphere_nine", "sphere_six", "sphere_equator"), ("sphere_stray", "sphere_gross")
ODD_EVERY = 7


def analytic(seed: int) -> Drawn:
    condition = ODD[seed % len(ODD)] if seed % ODD_EVERY == 0 else ORDINARY[seed % len(ORDINARY)]
    recipe = random_sphere_recipe(condition, seed)
    recording, truth = simulate_sphere(recipe)
    return drawn(
        recording, truth.flange_from_profiler, recipe.robot.pose_noise_mm, recipe.robot.pose_noise_deg, condition
    )


def rays(seed: int) -> Drawn:
    return made(seed, "score spheres rays", by_rays)


def sections(seed: int) -> Drawn:
    return made(seed, "score spheres sections", by_sections)


def made(seed: int, words: str, optics: object) -> Drawn:
    """Postures by a robot of 0.02 to 0.1 mm; odd: strays on the profiles, and few postures."""
    rng = generator(words, seed)
    odd = seed % ODD_EVERY == 0
    robot_mm, robot_deg = float(rng.uniform(0.02, 0.1)), float(rng.uniform(0.003, 0.015))
    seen = shown(rng, int(rng.integers(5, 7) if odd else rng.integers(8, 14)), robot_mm, robot_deg)
    recording = optics(rng, seen, int(rng.integers(1, 6)), 0.01 if odd else 0.0)  # type: ignore[operator]
    return drawn(recording, seen.flange_from_profiler, robot_mm, robot_deg, seen.sensor.name + ", odd" * odd)


def drawn(recording: object, true: np.ndarray, robot_mm: float, robot_deg: float, about: str) -> Drawn:
    declared = {
        "kind": "sphere",
        "pose_noise_mm": float(f"{robot_mm:.2g}"),
        "pose_noise_deg": float(f"{robot_deg:.2g}"),
    }
    return Drawn(recording, {"flange_from_profiler": true}, declared, about)  # type: ignore[arg-type]
