"""Prepared plates: of the swept simulator, usual ones and odd ones, and of the third one (`bench.outside`).

Odd: fillets of every radius, hollow corners that are rounded, narrow and bowed faces, coarse columns. X: bevels above
and below the root face, each turned to the sensor in turn.
"""

from __future__ import annotations

import math

import numpy as np

from bench.drawn.common import anywhere, course, held, noise, robot, scanner, spine, way
from bench.drawn.declared import Document, Generator
from bench.odd_plates import Corners, Sizes, compound, drawn_above, j_shape, ledge, plate
from bench.outside import FAR_MM, simulate
from bench.simulators.swept import SweptRecipe
from workbench.artefacts import Recording
from workbench.units import DEG, Float

KINDS = ("bevel", "compound", "nose", "J")
Truth = dict[str, Float]


def swept_plate(kind: str, seed: int) -> SweptRecipe:
    """A prepared plate drawn at random; the same seed gives the same recipe."""
    rng = np.random.default_rng([780, seed, KINDS.index(kind)])
    root, length = rng.uniform(0.8, 3.0), rng.uniform(80.0, 160.0)
    thickness = root + rng.uniform(5.0, 9.0)
    bevel = rng.uniform(6.0, 20.0) if kind == "J" else rng.uniform(25.0, 55.0)
    upper = float(np.clip(bevel + rng.choice([-1.0, 1.0]) * rng.uniform(8.0, 30.0), 5.0, 70.0))
    land = rng.uniform(0.6, 3.0) if kind == "nose" else float(rng.choice([0.0, rng.uniform(0.3, 2.0)]))
    radius = rng.uniform(2.0, 0.55 * (thickness - root))
    rounded = 0.0 if rng.random() < 0.6 else rng.uniform(0.0, 0.3)
    along = spine(rng, length)
    width = (thickness - root) * math.tan(max(bevel, upper if kind == "compound" else 0.0) * DEG) + land + 3.0
    standoff = rng.uniform(120, 250)
    return SweptRecipe.model_validate(
        {
            "simulator": "swept",
            "seed": seed,
            "part": {
                "preparation": kind,
                "spine": along,
                "thickness_mm": _course(rng, thickness, 0.05),
                "root_mm": _course(rng, root, 0.1),
                "bevel_deg": _course(rng, bevel, 0.3),
                "upper_bevel_deg": _course(rng, upper, 0.3),
                "lower_bevel_mm": _course(rng, rng.uniform(0.25, 0.75) * (thickness - root), 0.1),
                "land_mm": _course(rng, land, 0.1 * land),
                "root_radius_mm": radius,
                "lower_radius_mm": 0.5 * rounded,
                "upper_radius_mm": rounded,
                "texture": {"sd_mm": rng.uniform(0, 0.008), "correlation_mm": rng.uniform(0.1, 0.8)},
                "twist_deg": {"start": 0.0, "end": float(rng.choice([0.0, rng.uniform(-4, 4)]))},
                "base_from_part": anywhere(rng, 40, 40),
            },
            "scanner": {"columns": 800, "pitch_mm": max(0.03, (width + thickness + 8) / 800)}
            | scanner(rng, standoff, (-40, 40), apex_mm=(30, 150))
            | {"mixed_share": rng.uniform(0.2, 0.8), "noise": noise(rng, rng.uniform(0.003, 0.015), 0.6)},
            "losses": {
                "single_share": 0.005,
                "outlier_share": float(rng.choice([0.0, 0.003])),
                "block_share": float(rng.choice([0.0, 0.03])),
            },
            "robot": {"frame_pitch_mm": 0.3} | robot(rng),
            "passes": [
                {
                    "way_mm": way(rng, length),
                    "elevation_deg": rng.uniform(40.0, 60.0),
                    "aim_mm": [-0.45 * width, 0.5 * thickness],
                }
                | held(rng, along)
            ],
        }
    )


def _course(rng: Generator, mean: float, change: float) -> Document:
    return course(rng, mean, change, 0.2 * change)


def outside_plate(kind: str, seed: int) -> tuple[Recording, Truth]:
    """The same of the third simulator: straight, one section all along; truths (1,)."""
    rng = np.random.default_rng([781, seed, KINDS.index(kind)])
    root, height, bevel = rng.uniform(0.8, 3.0), rng.uniform(5.0, 9.0), rng.uniform(25.0, 55.0)
    exact = {"root_face_mm": root, "depth_mm": height, "bevel_deg": bevel}
    corners: Corners = ((-height * math.tan(bevel * DEG), height),)
    if kind == "compound":
        upper, share = float(np.clip(bevel + rng.choice([-1, 1]) * rng.uniform(8, 30), 5, 70)), rng.uniform(0.25, 0.75)
        corners = compound(bevel, upper, share, height)
        exact |= {"upper_bevel_deg": upper, "lower_bevel_mm": share * height}
    if kind == "nose":
        land = rng.uniform(0.6, 3.0)
        corners = ledge(land, bevel, height)
        exact |= {"land_mm": land}
    if kind == "J":
        land, bevel, radius = (
            float(rng.choice([0.0, rng.uniform(0.3, 2.0)])),
            rng.uniform(2, 20),
            rng.uniform(2, 0.55 * height),
        )
        corners = j_shape(radius, bevel, land, height)
        exact |= {"land_mm": land, "bevel_deg": bevel, "root_radius_mm": radius}
    exact["width_mm"] = -corners[-1][0]
    table = None if rng.random() < 0.5 else rng.uniform(4.0, 30.0)
    part = simulate(seed, False, drawn_above(root, bevel * DEG, corners, table))
    return part.recording, {name: np.array([value]) for name, value in exact.items()}


def x_plate(seed: int) -> tuple[Recording, Truth]:
    """Plate seed // 2 of the third simulator with an X preparation, its other side up where the seed is odd."""
    rng = np.random.default_rng([790, seed // 2])
    root, bevels = rng.uniform(0.8, 3.0), rng.uniform(25.0, 55.0, 2)
    heights = np.array([rng.uniform(3.0, 8.0), rng.uniform(1.5, 8.0)])
    up, low = (1, 0) if seed % 2 else (0, 1)
    wide = heights * np.tan(bevels * DEG)
    above = ((-float(wide[up]), float(heights[up])),)
    below = ((0.0, 0.0), (-float(wide[low]), -float(heights[low])), (-FAR_MM, -float(heights[low])))
    table = None if (seed // 2) % 2 else heights[low] + rng.uniform(4.0, 30.0)
    sizes = Sizes(root, bevels[up] * DEG, root + heights[up], table)
    part = simulate(seed // 2, False, sizes.drawn((plate(root, above, below),)))
    exact = {"root_face_mm": root, "depth_mm": heights[up], "bevel_deg": bevels[up], "width_mm": wide[up]}
    return part.recording, {name: np.array([value]) for name, value in exact.items()}
