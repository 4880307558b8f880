"""Random straight grooves of the first simulator, drawn as its plates are."""

from __future__ import annotations

import math
import zlib

import numpy as np

from workbench.errors import InputError, nearest
from workbench.synthetic.draws import Document, draw_course, draw_disturbances, draw_part, draw_robot, draw_scanner
from workbench.synthetic.prism_recipe import PrismRecipe
from workbench.units import DEG

TYPES = ("I", "V", "Y", "HV", "HY", "X", "K", "U", "J")
_STEEP = ("U", "J")  # flanks of 10 to 20 deg above a radius; others 28 to 45


def random_prism_recipe(kind: str, seed: int) -> PrismRecipe:
    """A groove of type `kind` drawn at random; the same seed gives the same recipe."""
    if kind not in TYPES:
        raise InputError(f"groove '{kind}'", "a type of groove" + nearest(kind, TYPES))
    rng = np.random.default_rng([seed, zlib.crc32(f"prism {kind}".encode())])
    thickness = rng.uniform(8, 15)
    low, high = (10, 20) if kind in _STEEP else (28, 45)
    bevels = rng.uniform(low, high, 2)
    robot, scanner, length = draw_robot(rng), draw_scanner(rng), rng.uniform(80, 140)
    half_width = (thickness - 1) * math.tan(max(bevels) * DEG) + (6 if kind in _STEEP else 2)
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
