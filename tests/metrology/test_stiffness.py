"""The metrology of stiffness: the bound agrees with what is known otherwise, tables tell what fell short."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrology.loading_truth import K, known
from bench.metrology.stiffness import measure
from workbench.plugins.stiffness.equations import covariances, equations


@pytest.mark.parametrize("condition", ["one_lever", "table_a1_points"])
def test_bound_is_that_of_the_identifications_own_information(condition):
    """Differences of the balance under load and first-order formulas, written apart."""
    truth = known(condition)
    eq = equations(truth.cell.chain, truth.setup, truth.exact)
    information = sum(a.T @ np.linalg.solve(s, a) for a, s in zip(eq.a, covariances(eq, 1 / K), strict=True))
    assert truth.bound == pytest.approx(np.sqrt(np.diag(np.linalg.inv(information))) * K, rel=2e-3)


def test_a_trial_is_measured_against_the_truth():
    found = measure("one_lever", 3)
    assert found["loads"] == [6, 6, 6]
    assert np.abs(np.divide(found["error"], found["bound"])).max() < 5
    assert 0 < found["nees"] < 40
