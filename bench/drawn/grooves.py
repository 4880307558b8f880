"""Random grooves of each type, of the package's (straight ones) and of the swept simulator, for statistics."""

from __future__ import annotations

import math

from bench.drawn.common import anywhere, course, held, noise, robot, scanner, spine, way
from bench.drawn.declared import Document
from bench.drawn.plates import begun, draw_course, draw_disturbances, draw_part, draw_robot, draw_scanner
from bench.simulators.swept.recipe import GrooveRecipe
from bench.simulators.swept.sweep import GROOVES
from workbench.synthetic.recipe import TYPES, PrismRecipe
from workbench.units import DEG

BEVEL_DEG = {"U": (8, 20), "J": (10, 20), "HV": (30, 50), "HY": (30, 50), "K": (35, 50)}  # others 25 to 35
GROOVE = ("groove", "type of groove")
STEEP = ("U", "J")  # flanks of 10 to 20 deg above a radius; others 28 to 45


def random_prism_recipe(kind: str, seed: int) -> PrismRecipe:
    """A groove of type `kind` drawn at random; the same seed gives the same recipe."""
    rng = begun(kind, seed, TYPES, "prism ", *GROOVE)
    thickness = rng.uniform(8, 15)
    low, high = (10, 20) if kind in STEEP else (28, 45)
    bevels = rng.uniform(low, high, 2)
    robot, scanner, length = draw_robot(rng), draw_scanner(rng), rng.uniform(80, 140)
    half_width = (thickness - 1) * math.tan(max(bevels) * DEG) + (6 if kind in STEEP else 2)
    scanner["pitch_mm"] = max(0.04, (2 * half_width + 16) / scanner["columns"])
    scanner["near_mm"], scanner["far_mm"] = scanner["standoff_mm"] - 40, scanner["standoff_mm"] + 60
    lean = rng.uniform(-8, 8) if kind in "VYXU" else rng.uniform(3, 9 if kind == "J" else 20)
    groove: Document = {
        "type": kind,
        "length_mm": length,
        "thickness_mm": draw_course(rng, thickness, 0.05, 0.05),
        "gap_mm": draw_course(rng, rng.uniform(1, 3.5), 0.5, 0.2),
        "root_face_mm": draw_course(rng, rng.uniform(0.5, 0.2 * thickness), 0.1, 0.05),
        "bevel_left_deg": draw_course(rng, bevels[0], 0.5, 0.2),
        "bevel_right_deg": draw_course(rng, bevels[1], 0.5, 0.2),
        "radius_mm": rng.uniform(2, 5),
        "under_mm": rng.uniform(0.25, 0.4) * thickness,
        "misalignment_mm": draw_course(rng, rng.uniform(-0.8, 0.8), 0.3, 0.1),
        "background_mm": None if rng.random() < 0.4 else rng.uniform(2, 20),
        "mounds": [
            {
                "at_mm": rng.uniform(10, length - 10),
                "z_mm": rng.uniform(0, 2),
                "half_mm": [rng.uniform(3, 8), rng.uniform(1.5, 3), rng.uniform(1, 3)],
            }
            for _ in range(rng.integers(0, 3))
        ],
        "base_from_part": draw_part(rng)["base_from_part"],
    }
    ends = [2.0, length - 2.0]
    if rng.random() < 0.5:
        ends.reverse()
    scan = {
        "from_mm": ends[0],
        "to_mm": ends[1],
        "elevation_deg": 90 + lean,
        "oblique_deg": rng.uniform(-5, 5),
        "lead_deg": rng.uniform(-6, 6),
        "aim_mm": [rng.uniform(-1, 1), 0.7 * thickness],
        "skew_mm": [-1.0, 1.0],
        "upside_down": bool(rng.random() < 0.5),
    }
    document: Document = {"format": "groove-recipe", "title": kind, "seed": seed, "groove": groove, "passes": [scan]}
    document |= {"scanner": scanner, "robot": robot | {"frame_pitch_mm": 0.4}, "disturbances": draw_disturbances(rng)}
    return PrismRecipe.model_validate(document)


def random_groove_recipe(groove: str, seed: int) -> GrooveRecipe:
    """A groove of type `groove` (a letter of GROOVES) drawn at random; the same seed gives the same recipe.

    Plates of 6 to 15 mm, 80 to 120 mm long, straight, an arc or waving in space; gap, root faces, angles and
    misalignment drift.
    """
    rng = begun(groove, seed, GROOVES, "groove ", *GROOVE)
    length, thickness = rng.uniform(80, 120), rng.uniform(8, 15) if groove in "XK" else rng.uniform(6, 15)
    under = rng.uniform(0.25, 0.4) * thickness
    root = rng.uniform(0.5, 0.2 * thickness)
    low, high = BEVEL_DEG.get(groove, (25, 35))
    left, right = rng.uniform(low, high, 2)
    part: Document = {
        "kind": "groove",
        "groove": groove,
        "bevelled": str(rng.choice(["left", "right"])),
        "spine": spine(rng, length, 1.0),
        "thickness_mm": course(rng, thickness, 0.05, 0.05),
        "gap_mm": course(rng, rng.uniform(0.9, 3.5), 0.5, 0.2),
        "root_face_left_mm": course(rng, root, 0.1, 0.05),
        "root_face_right_mm": course(rng, root * rng.uniform(0.9, 1.1), 0.1, 0.05),
        "bevel_left_deg": course(rng, left, 0.5, 0.2),
        "bevel_right_deg": course(rng, right, 0.5, 0.2),
        "under_depth_mm": under,
        "root_radius_mm": rng.uniform(2, 5),
        "misalignment_mm": course(rng, rng.uniform(-0.8, 0.8), 0.3, 0.1),
        "background_mm": None if rng.random() < 0.4 else rng.uniform(2, 20),
        "upper_radius_mm": 0.0 if rng.random() < 0.5 else rng.uniform(0, 0.3),
        "base_from_part": anywhere(rng, 40, 40),
    }
    half_width = (thickness - root) * math.tan(max(left, right) * DEG) + (6 if groove in "UJ" else 3)
    columns = 640
    pitch = max(0.04, (2 * half_width + 16) / columns)
    standoff = rng.uniform(120, 250)
    lateral = 0.1 * half_width * rng.uniform(-1, 1)
    lean = rng.uniform(-8, 8)
    if groove in ("HV", "HY", "K", "J") or groove == "I":  # from the bevelled side, so that the square face shows
        lean = rng.uniform(3, 9 if groove == "J" else 20) * (-1 if part["bevelled"] == "right" else 1)
    return GrooveRecipe.model_validate(
        {
            "simulator": "swept",
            "title": groove,
            "seed": seed,
            "part": part,
            "scanner": {"columns": columns, "pitch_mm": pitch}
            | scanner(rng, standoff, (-40, 60))
            | {
                "mixed_share": rng.uniform(0.2, 0.8),
                "noise": noise(rng, 0.015, 0.8),
                "intensity": bool(rng.random() < 0.5),
            },
            "losses": {
                "single_share": 0.005,
                "outlier_share": 0.003,
                "outlier_reach_mm": rng.uniform(1, 8),
                "block_share": float(rng.choice([0.0, 0.05])),
            },
            "robot": robot(rng),
            "passes": [
                {
                    "way_mm": way(rng, length),
                    "elevation_deg": 90 + lean,
                    "aim_mm": [lateral, 0.7 * thickness],
                    "skew_mm": [-1.0, 1.0],
                }
                | held(rng, part["spine"])
            ],
        }
    )
