"""Random calibration recordings under named conditions."""

from __future__ import annotations

import math

import numpy as np

from bench.drawn.declared import Condition, Document, Generator, apply, uniform
from bench.drawn.plates import around_the_base, begun, draw_disturbances, draw_hand_eye
from workbench.synthetic.recipe import SphereRecipe
from workbench.synthetic.recipe_file import parse_sphere_recipe

TURN_DEG = 25.0  # of the flange about each axis, at most
VIEW_MM = (10.0, 15.0)  # half width and half height of where the sphere's centre is shown
OFF_PLANE_MM = (1.5, 4.25)  # least and greatest |y| of the centre: 0.3 to 0.85 of the radius
RADIUS_MM = 5.0


def random_sphere_recipe(condition: str, seed: int) -> SphereRecipe:
    """A calibration recording drawn at random under `condition`; the same seed gives the same recipe.

    Unless the condition (a key of SOUND) says otherwise: nine postures of a 10 mm sphere within 25 deg
    an axis, noise 0.015 mm at a pitch of 0.05 mm, pose noise 0.07 mm and 0.01 deg an axis, the design's hand-eye pose
    off by up to 20 deg and 50 mm, z away from the sensor or towards it.
    """
    rng = begun(condition, seed, SOUND)
    document: Document = {
        "format": "sphere-recipe",
        "title": condition,
        "seed": seed,
        "sphere": {"center_mm": around_the_base(rng)},
        "scanner": {
            "columns": 800,
            "noise": {"sd_mm": 0.015, "grazing_power": 0.0},
            "z_away": bool(rng.random() < 0.7),
            "near_mm": 100.0,
            "far_mm": 210.0,
        },
        "robot": {
            "flange_from_profiler": draw_hand_eye(rng),
            "nominal_rpy_deg": [rng.uniform(-180, 180), rng.uniform(-80, 80), rng.uniform(-180, 180)],
            "design_error_mm": rng.uniform(0, 50),
            "design_error_deg": rng.uniform(0, 20),
        },
        "passes": postures(rng, 9),
    }
    apply(SOUND[condition], rng, document)
    return parse_sphere_recipe(document, source=condition)


def turn(rng: Generator) -> list[float]:
    """Of the flange from its nominal orientation, deg."""
    return [float(v) for v in rng.uniform(-TURN_DEG, TURN_DEG, 3)]


def place(rng: Generator, least_mm: float = OFF_PLANE_MM[0]) -> list[float]:
    """Where the sphere's centre lies in the view."""
    y = rng.choice([-1.0, 1.0]) * rng.uniform(least_mm, OFF_PLANE_MM[1])
    return [rng.uniform(-VIEW_MM[0], VIEW_MM[0]), float(y), rng.uniform(-VIEW_MM[1], VIEW_MM[1])]


def postures(rng: Generator, count: int, least_mm: float = OFF_PLANE_MM[0]) -> list[Document]:
    """Distinct postures held still."""
    return [{"sphere_mm": place(rng, least_mm), "turn_deg": turn(rng)} for _ in range(count)]


def gross(rng: Generator, document: Document) -> None:
    """Two of fifteen postures are off by 2 to 20 mm."""
    document["passes"] = postures(rng, 15)
    for index in rng.choice(15, 2, replace=False):
        way = rng.normal(size=3)
        size = math.exp(rng.uniform(math.log(2), math.log(20)))
        document["passes"][index]["gross_mm"] = [float(v) for v in way / np.linalg.norm(way) * size]


def grid(rng: Generator) -> list[Document]:
    """Three orientations, three positions each: what the analytic way needs."""
    return [{"sphere_mm": place(rng), "turn_deg": t} for t in [turn(rng) for _ in range(3)] for _ in "abc"]


def scan(rng: Generator, way: float, share: float = 1.0) -> Document:
    """Once across the sphere, begun within a share of the view."""
    start, end = [share * v for v in place(rng)], [rng.uniform(-2, 2), -11.0 * way, rng.uniform(-2, 2)]
    start[1] = 5.5 * way
    return {"sphere_mm": start, "to_mm": [a + b for a, b in zip(start, end, strict=True)], "turn_deg": turn(rng)}


OWN_CLOCK = {"clock": "own", "clock_offset_s": uniform(-2, 2), "pose_rate_hz": 25.0}
SCANS: Condition = {  # six over the sphere, to and fro
    "passes": lambda rng: [scan(rng, (-1.0) ** i) for i in range(6)],
    "robot": OWN_CLOCK,
}
WEAVED: Condition = {  # the same in 6 s each about the middle of the view, weaved by 12 mm and 3 deg
    "passes": lambda rng: [
        scan(rng, (-1.0) ** i, 0.2) | {"weave_mm": 12.0, "weave_deg": 3.0, "seconds": 6.0} for i in range(6)
    ],
    "robot": OWN_CLOCK | {"pose_rate_hz": 50.0, "frame_rate_hz": 25.0},
}
COMMON: Condition = {"robot": {"pose_noise_common": uniform(0.8, 1.0)}}  # most of a pose's error is that of its scan
SYSTEMATIC: Condition = {  # the robot errs smoothly by 0.5 mm an axis
    "passes": lambda rng: postures(rng, 15),
    "robot": {"systematic_mm": 0.5, "systematic_reach_deg": uniform(60, 120)},
}
STRAY: Condition = {  # 3 % outliers, a table, a stem, lost returns, a diameter that is not what is stated
    "sphere": {
        "table_gap_mm": uniform(6, 30),
        "table_tilt_deg": lambda rng: rng.uniform(-15, 15, 2).tolist(),
        "stem_diameter_mm": uniform(2, 5),
        "stated_diameter_mm": lambda rng: 2 * RADIUS_MM + rng.uniform(-0.2, 0.2),
    },
    "disturbances": lambda rng: (
        draw_disturbances(rng) | {"outlier_share": 0.02, "streak_outlier_share": 0.01, "dropout_share": 0.01}
    ),
}
_SOUND: dict[str, Condition] = {
    "nine": {},
    "six": {"passes": lambda rng: postures(rng, 6)},
    "equator": {"passes": lambda rng: postures(rng, 9, 0.0)},  # the centre may lie in the laser plane
    "stray": STRAY,
    "gross": gross,
    "systematic": SYSTEMATIC,
    "smooth": (SYSTEMATIC, {"robot": {"systematic_reach_deg": uniform(120, 240)}}),  # taken for the hand-eye pose's
    "scans": SCANS,
    "weaved": WEAVED,
    "scans_common": (SCANS, COMMON),
    "weaved_common": (WEAVED, COMMON),
    "grid": {"passes": grid},
}
SOUND = {f"sphere_{name}": condition for name, condition in _SOUND.items()}
