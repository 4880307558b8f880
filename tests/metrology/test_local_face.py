"""The truth that a rough end face is held against: the local plane through the surface that rays meet."""

from __future__ import annotations

import numpy as np

from bench.drawn.plates import random_recipe
from bench.score.face import LOCAL_MM, local_face
from workbench.synthetic import simulate_recording
from workbench.synthetic.raycast import _rough
from workbench.synthetic.workpiece import build_surface
from workbench.units import DEG


def test_the_local_face_is_that_of_the_simulated_surface() -> None:
    _, truth = simulate_recording(random_recipe("raw_rough", 11))
    part = truth.recipe.part
    surface = build_surface(part, truth.recipe.seed)
    position, normal, _, _ = local_face(truth)
    u = np.linspace(0.0, part.length_mm, len(truth.arc_length_mm))
    at = len(u) // 2
    width = float(truth.thickness_mm[at]) / np.cos(part.end_face_tilt_deg * DEG)
    v = np.linspace(0.0, width, 64)
    along = u[np.abs(u - u[at]) <= LOCAL_MM]
    height = np.array([[_rough(surface, x, y)[0] for y in v] for x in along]).mean(axis=0)
    slope, level = np.polyfit(v, height, 1)
    turn = np.arctan2(normal[at] @ truth.across[at], normal[at] @ truth.normal[at])
    assert abs(turn + np.arctan(slope)) < 0.1 * DEG
    assert abs((position[at] - truth.position_mm[at]) @ truth.normal[at] - level) < 0.005
