"""Both sides of the calibration's timing solve the same task, and the page says what was measured."""

from __future__ import annotations

import numpy as np

from bench.drawn.spheres import random_sphere_recipe
from bench.metrology.calibration.part import recorded
from bench.metrology.calibration.truth import cell_of, circles
from bench.peers.genetic import genetic_hand_eye
from bench.speed.calibration import file_to_answer
from workbench.geometry.poses import pose_from
from workbench.plugins.calibration.methods import Centres
from workbench.plugins.calibration.model import Noise, linearise, signed_centres
from workbench.plugins.calibration.observations import from_arrays
from workbench.plugins.calibration.solve import solve
from workbench.synthetic.sphere import design_hand_eye


def test_both_sides_find_the_pose():
    recipe = random_sphere_recipe("sphere_nine", 12)
    cell, design, noise = cell_of(recipe), design_hand_eye(recipe), Noise()
    circle, covariance = circles(cell, np.random.default_rng(0))
    seen = from_arrays(circle, covariance, recorded(recipe))
    estimate = solve(seen, noise, design).found.estimate
    P = signed_centres(estimate, linearise(estimate, seen, noise), seen)
    centres = Centres(P, seen.base_from_flange[:, :3, :3], seen.base_from_flange[:, :3, 3])
    assert cell.vol_mm(pose_from(estimate.rotation, estimate.translation_mm)) < 0.5
    assert cell.vol_mm(genetic_hand_eye(design, centres, np.random.default_rng(0))) < 1.0


def test_a_file_is_answered():
    assert file_to_answer() > 0  # how long it takes is the bench's to say
