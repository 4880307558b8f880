"""A dozen small recordings that differ in simulator, shape, view and passes: some 60 frames of 300 columns each."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from bench.outside import simulate as outside
from bench.score import analytic, outsider, triangulated
from bench.score.parts import Drawn
from bench.simulators.swept import parse_swept_recipe, simulate_swept
from bench.simulators.triangulated import STRAIGHT_MM, Course
from workbench.synthetic import PrismRecipe, parse_as, parse_recipe, simulate_prism, simulate_recording
from workbench.units import DEG

ABOVE = {"from_mm": 2.0, "to_mm": 38.0, "elevation_deg": 40.0, "skew_mm": [-0.6, 0.9]}
NEAR = {"root_nominal_mm": 1.5, "bevel_nominal_deg": 40.0}


def plate(*passes: dict[str, Any], upper_side: bool = False, **part: Any) -> Drawn:
    """Of the package's simulator."""
    recipe = {
        "seed": 7,
        "part": {"length_mm": 40.0, "root_mm": {"start": 1.4, "end": 1.7}} | part,
        "scanner": {"columns": 300, "pitch_mm": 0.08},
        "robot": {"frame_pitch_mm": 0.6},
        "passes": passes or (ABOVE,),
    }
    recording, truth = simulate_recording(parse_recipe(recipe))
    if part.get("kind") == "raw":
        return analytic.raw_part(recording, truth, "raw")
    up = {"upper_side": truth.across[0].tolist()} if upper_side else {}
    return analytic.milled_part(recording, truth, NEAR | up)


def swept(spine: dict[str, Any], **part: Any) -> Drawn:
    recipe = {
        "simulator": "swept",
        "seed": 3,
        "part": {"spine": {"length_mm": 40.0} | spine, "root_mm": {"start": 1.7, "end": 1.5}} | part,
        "scanner": {"columns": 300, "pitch_mm": 0.08},
        "robot": {"frame_pitch_mm": 0.6},
        "passes": [{"way_mm": [1, 39], "elevation_deg": 42, "oblique_deg": 3, "skew_mm": [-0.5, 0.7]}],
    }
    return analytic.milled_part(*simulate_swept(parse_swept_recipe(recipe)), NEAR)


def camera(kind: str, seed: int, radius_mm: float = STRAIGHT_MM, robot_mm: float = 0.0) -> Drawn:
    """Of the simulator with the camera beside the laser; the robot errs as a process that is declared."""
    part, eye, led, known = triangulated.real(
        np.random.default_rng(seed), kind, seed, (35.0, 45.0), (max(robot_mm, 0.005),) * 2
    )
    part = replace(part, length_mm=40.0, radius_mm=radius_mm, bevel=Course(42.0 * DEG, 0.01), table_mm=None)
    eye = replace(eye, columns=300, linearity_mm=0.0)
    return triangulated.made(part, eye, replace(led, step_mm=0.6), seed, known if robot_mm else {}, "")


class Small(outsider.Sharp):
    """Sharp edges, seen from above in few frames and columns."""

    def window(self, rng: np.random.Generator, thick_mm: float, is_raw: bool) -> tuple[int, float]:
        return 300, super().window(rng, thick_mm, is_raw)[1]

    def frames(self, rng: np.random.Generator) -> tuple[int, float]:
        super().frames(rng)
        return 60, 0.6


def groove(kind: str) -> Drawn:
    size = {"type": kind, "thickness_mm": 10.0, "length_mm": 40.0, "gap_mm": {"start": 2.0, "end": 2.6}}
    recipe = {
        "format": "groove-recipe",
        "groove": size,
        "passes": [ABOVE | {"elevation_deg": 84.0, "aim_mm": [0, 6]}],
        "scanner": {"columns": 400, "pitch_mm": 0.08},
        "robot": {"frame_pitch_mm": 0.6},
    }
    return analytic.groove_part(*simulate_prism(parse_as(PrismRecipe, recipe)))


DOZEN: dict[str, Callable[[], Drawn]] = {
    "straight": plate,
    "arc": lambda: plate(curve={"shape": "arc", "radius_mm": 300.0}),
    "from below": lambda: plate(ABOVE | {"elevation_deg": -20.0}, upper_side=True),
    "two passes": lambda: plate(ABOVE, ABOVE | {"from_mm": 38.0, "to_mm": 2.0, "elevation_deg": 25.0}),
    "twisted": lambda: swept(
        {"shape": "arc", "radius_mm": 250.0, "sense": "concave"}, twist_deg={"start": 0, "end": 3}
    ),
    "rounded": lambda: swept({}, lower_radius_mm=0.1),
    "camera": lambda: camera("milled", 3),
    "robot's process": lambda: camera("milled", 4, radius_mm=400.0, robot_mm=0.02),
    "rays": lambda: outsider.milled_part(outside(21, False, cell=Small()), {}, "rays"),
    "raw": lambda: plate(kind="raw"),
    "raw, camera": lambda: camera("raw", 5, robot_mm=0.02),
    "groove": lambda: groove("V"),
}
