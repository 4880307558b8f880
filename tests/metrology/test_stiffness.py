"""The metrology of stiffness: the bound agrees with what is known otherwise, tables tell what fell short."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrology.loading_truth import K, known, noisy
from bench.metrology.stiffness import measure
from workbench.plugins.stiffness.equations import covariances, equations


@pytest.mark.parametrize("condition", ["one_lever", "table_a1_points"])
def test_bound_is_that_of_the_identifications_own_information(condition):
    """Differences of the balance under load and first-order formulas, written apart."""
    truth = known(condition)
    eq = equations(truth.cell.chain, truth.setup, truth.exact)
    information = sum(a.T @ np.linalg.solve(s, a) for a, s in zip(eq.a, covariances(eq, 1 / K), strict=True))
    assert truth.bound == pytest.approx(np.sqrt(np.diag(np.linalg.inv(information))) * K, rel=2e-3)


def test_loads_are_the_papers_with_one_lever():
    """Three postures, forces of 200 N both ways along three axes, 100 mm beside the sensor."""
    tests = known("one_lever").exact
    assert len(tests.labels) == 18
    assert np.linalg.norm(tests.wrench[:, :3], axis=1) == pytest.approx(200)
    assert np.linalg.norm(tests.wrench.reshape(3, 6, 6)[:, :, 3:], axis=2).max(axis=1) == pytest.approx(20)


def test_noise_is_that_of_the_cell_and_of_the_seed():
    truth = known("one_lever")
    one, same, other = (noisy(truth.exact, truth.setup, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.wrench, same.wrench)
    assert not np.array_equal(one.wrench, other.wrench)
    off = np.concatenate(
        [(noisy(truth.exact, truth.setup, seed).wrench - truth.exact.wrench)[:, :3] for seed in range(40)]
    )
    assert off.std() == pytest.approx(truth.setup.force_noise_n, rel=0.05)


def test_a_trial_is_measured_against_the_truth():
    found = measure("one_lever", 3)
    assert found["loads"] == [6, 6, 6]
    assert np.abs(np.divide(found["error"], found["bound"])).max() < 5
    assert 0 < found["nees"] < 40
