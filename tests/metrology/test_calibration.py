"""The metrology of calibration: truth and bound agree with what is known otherwise, tables tell what fell short."""

from __future__ import annotations

import numpy as np
import pytest

from bench.drawn.spheres import random_sphere_recipe
from bench.metrology.calibration import measure
from bench.metrology.sphere_truth import bound, cell_of, circles
from bench.metrology.study import Share
from workbench.plugins.calibration.model import Estimate, Noise, Sphere
from workbench.plugins.calibration.observations import from_arrays


@pytest.fixture(scope="module")
def cell():
    return cell_of(random_sphere_recipe("sphere_nine", 11))


def test_bound_is_that_of_the_calibrations_own_information(cell):
    """Derivatives by differences and by formula, written apart."""
    circle, covariance = circles(cell, np.random.default_rng(0))
    recipe = random_sphere_recipe("sphere_nine", 11)
    estimate = Estimate(cell.hand_eye[:3, :3], cell.hand_eye[:3, 3], np.array(recipe.sphere.center_mm), 5.0)
    own = np.linalg.inv(
        Sphere(from_arrays(circle, covariance, cell.turned), Noise()).rows(estimate).normal().information
    )[:6, :6]
    ratio = np.linalg.eigvals(np.linalg.solve(own, bound(cell, covariance, 0.05)))
    assert ratio.real == pytest.approx(np.ones(6), rel=2e-3)


@pytest.mark.parametrize("condition", ["sphere_gross", "sphere_planned"])
def test_sound_sets_are_measured(condition):
    found = measure(condition, 5)
    assert found["vol_mm"] < 4 * found["bound_mm"]


def test_interval_of_a_share():
    low, high = Share(95, 100).interval
    assert (low, high) == (pytest.approx(0.887, abs=1e-3), pytest.approx(0.984, abs=1e-3))
    assert Share(50, 100).outside(0.93, 0.97)
    assert not Share(95, 100).outside(0.93, 0.97)
