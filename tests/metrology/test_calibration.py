"""The hand-eye pose on a sphere: errors are those of the Cramer-Rao bound and of the covariance stated."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from scipy.stats import chi2

from bench.calibration.sphere_truth import Cell, bound, cell_of, circles, recorded_poses
from bench.drawn.spheres import random_sphere_recipe
from tests.seldom import seldom
from workbench.geometry.poses import pose_from
from workbench.plugins.calibration.model import Estimate, Noise, Sphere
from workbench.plugins.calibration.observations import from_arrays
from workbench.plugins.calibration.solve import solve
from workbench.synthetic.sphere import design_hand_eye
from workbench.units import Bool, Float

SEED, SETS = 9_974, 24


def calibrated(condition: str, seed: int) -> tuple[Cell, Any, Bool, Float]:
    """What is true, what is found, the postures that were not made gross, and the bound (6, 6) of these."""
    recipe = random_sphere_recipe(condition, seed)
    cell = cell_of(recipe)
    circle, covariance = circles(cell, np.random.default_rng([seed, 9]))
    found = solve(from_arrays(circle, covariance, recorded_poses(recipe)), Noise(), design_hand_eye(recipe)).found
    sound = np.array([not any(one.gross_mm) for one in recipe.passes])
    return cell, found, sound, bound(cell.only(sound), covariance[sound], Noise().radius_u_mm)


def test_bound_is_that_of_the_calibrations_own_information():
    """Derivatives by differences and by formula, written apart."""
    recipe = random_sphere_recipe("sphere_nine", 11)
    cell = cell_of(recipe)
    circle, covariance = circles(cell, np.random.default_rng(0))
    estimate = Estimate(cell.hand_eye[:3, :3], cell.hand_eye[:3, 3], np.array(recipe.sphere.center_mm), 5.0)
    own = np.linalg.inv(
        Sphere(from_arrays(circle, covariance, cell.turned), Noise()).rows(estimate).normal().information
    )[:6, :6]
    ratio = np.linalg.eigvals(np.linalg.solve(own, bound(cell, covariance, 0.05)))
    assert ratio.real == pytest.approx(np.ones(6), rel=2e-3)


@pytest.mark.parametrize("condition", seldom("sphere_gross", "sphere_nine"))
def test_errors_are_those_of_the_bound_and_of_the_covariance(condition):
    errors, bounds, squared = [], [], []
    for seed in range(SEED, SEED + SETS):
        cell, found, sound, least = calibrated(condition, seed)
        assert not found.used[~sound].any()
        pose = pose_from(found.estimate.rotation, found.estimate.translation_mm)
        off, covariance = cell.off(pose), found.covariance[:6, :6]
        errors.append(cell.vol_mm(pose))
        bounds.append(cell.vol_u_mm(least))
        squared.append(off @ np.linalg.solve(covariance, off))
    assert np.sqrt(np.mean(np.square(errors)) / np.mean(np.square(bounds))) < 1.25
    assert np.mean(squared) == pytest.approx(6.0, rel=0.25)  # chi-square of six, 24 times: 6 +- 0.7
    assert np.mean(np.array(squared) < chi2.ppf(0.95, 6)) > 0.84  # by chance once in 250 times
