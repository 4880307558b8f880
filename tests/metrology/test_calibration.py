"""The metrology of calibration: truth and bound agree with what is known otherwise, tables tell what fell short."""

from __future__ import annotations

import numpy as np
import pytest

from bench.drawn.spheres import random_sphere_recipe
from bench.metrology.__main__ import STUDIES
from bench.metrology.calibration import measure, named, recorded
from bench.metrology.sphere_truth import bound, cell_of, circles
from bench.metrology.study import Share
from bench.peers.genetic import evolve
from workbench.api import pose_from, rotation_from_vector
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


def test_error_over_the_field(cell):
    """A shift counts as it is; a turn about the field's middle by its lever."""
    moved = cell.hand_eye.copy()
    moved[:3, 3] += [0.3, 0.0, 0.4]
    assert cell.vol_mm(moved) == pytest.approx(0.5)
    middle = np.append(cell.field().mean(axis=0), 1.0)
    turn = pose_from(rotation_from_vector(np.array([0.0, 1e-3, 0.0])), np.zeros(3))
    turned = cell.hand_eye @ turn
    turned[:3, 3] += (cell.hand_eye @ middle - turned @ middle)[:3]
    x = np.linspace(-16, 16, 401)[:, None]
    z = np.linspace(-20, 20, 401)[None]
    assert cell.vol_mm(turned) == pytest.approx(1e-3 * np.sqrt(np.mean(x**2 + z**2)), rel=1e-2)
    error = cell.off(moved)
    assert cell.vol_u_mm(np.outer(error, error)) == pytest.approx(0.5)


def test_circles_scatter_as_their_covariance_says(cell):
    rng = np.random.default_rng(1)
    drawn = np.array([circles(cell, rng)[0] for _ in range(400)])
    assert drawn.std(axis=0) == pytest.approx(np.sqrt(np.diagonal(circles(cell, rng)[1], axis1=1, axis2=2)), rel=0.15)
    assert recorded(random_sphere_recipe("sphere_nine", 11)).shape == (9, 4, 4)


def test_genetic_algorithm_finds_a_minimum():
    target = np.array([0.3, -0.2, 0.1])
    found = evolve(lambda g: np.sum((g - target) ** 2, axis=1), np.zeros(3), 1.0, np.random.default_rng(0))
    assert found == pytest.approx(target, abs=2e-3)


@pytest.mark.parametrize("condition", ["sphere_nine", "sphere_gross", "sphere_stray", "sphere_planned", "sphere_grid"])
def test_sound_sets_are_measured(condition):
    found = measure(condition, 5)
    assert found["vol_mm"] < 4 * found["bound_mm"]


def test_sets_that_determine_nothing_are_refused_by_name():
    for condition in ("same_orientation", "repeats"):
        assert named(STUDIES["calibration"].measured((condition, 5))["refused"])
    assert not named("no sphere in view")


def test_interval_of_a_share():
    low, high = Share(95, 100).interval
    assert (low, high) == (pytest.approx(0.887, abs=1e-3), pytest.approx(0.984, abs=1e-3))
    assert Share(50, 100).outside(0.93, 0.97)
    assert not Share(95, 100).outside(0.93, 0.97)
