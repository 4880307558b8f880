"""Parts of the swept simulator: `bench.simulators.swept`."""

from __future__ import annotations

from typing import Any

from bench.drawn.seeds import generator
from bench.drawn.swept import random_swept_recipe
from bench.score.analytic import groove_part, milled_part, raw_part
from bench.score.errors import about_robot, as_real
from bench.score.parts import Drawn
from bench.simulators.swept import simulate_groove, simulate_swept
from bench.simulators.swept.recipe import SweptRecipe

ORDINARY = ("plain", "arc", "space_wave", "sway", "stop_and_go", "reversal", "there_and_back", "twist")
WORN = ("rounded", "burr_out", "burr_in", "texture")
ODD = (
    "lost_edge",
    "lost_blocks",
    "ghosts",
    "bowed",
    "wavy_root",
    "correlated",
    "fixed_pattern",
    "clamps",
    "drift",
    "time_offset",
    "saddle",
    "helix",
    "mixed",
)
RAW = ("plain", "arc", "space_wave", "twist", "saddle", "rough", "rounded", "burr_out", "burr_in", "clamps")
MOST_RADIUS_MM = 0.3
TRIES = 50


def recipe(condition: str, seed: int, low_deg: float, high_deg: float) -> SweptRecipe:
    """The first of some that is seen at elevations from low to high."""
    for k in range(TRIES):
        drawn = random_swept_recipe(condition, 100 * seed + k)
        if low_deg <= drawn.passes[0].elevation_deg <= high_deg:
            return drawn
    raise AssertionError(f"{condition} {seed}: none of {TRIES} is seen from there")


def sharp(seed: int) -> Drawn:
    name = f"swept_{ORDINARY[seed % len(ORDINARY)]}"
    return milled_part(*simulate_swept(recipe(name, seed, 35.0, 55.0)), about=name)


def worn(seed: int) -> Drawn:
    rng = generator("score swept worn", seed)
    name = f"swept_{WORN[seed % len(WORN)]}"
    document: dict[str, Any] = recipe(name, seed, 25.0, 50.0).model_dump(mode="json")
    radius = float(rng.uniform(0.01, MOST_RADIUS_MM))
    document["part"] |= {"lower_radius_mm": radius, "middle_radius_mm": radius / 4, "upper_radius_mm": radius / 4}
    recording, truth = simulate_swept(SweptRecipe.model_validate(document))
    recording, known = as_real(recording, rng, 0.005, 0.03)
    return milled_part(recording, truth, known, f"{name}, radius {radius:.3f} mm, {about_robot(known)}")


def odd(seed: int) -> Drawn:
    return milled_part(*simulate_swept(random_swept_recipe(f"swept_{ODD[seed % len(ODD)]}", seed)))


def raw(seed: int) -> Drawn:
    rng = generator("score swept raw", seed)
    name = f"swept_raw_{RAW[seed % len(RAW)]}"
    return raw_part(*simulate_swept(random_swept_recipe(name, seed)), name, rng)


def groove(seed: int) -> Drawn:
    from bench.drawn.grooves import random_groove_recipe

    return groove_part(*simulate_groove(random_groove_recipe(("V", "Y", "HV", "HY")[seed % 4], seed)))


DRAWS = {"sharp": sharp, "worn": worn, "odd": odd, "raw": raw, "groove": groove}
