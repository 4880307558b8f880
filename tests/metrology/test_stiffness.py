"""The metrology of stiffness: the bound agrees with what is known otherwise, tables tell what fell short."""

from __future__ import annotations

import numpy as np
import pytest

from bench.metrology.stiffness.part import StiffnessResult, measure_stiffness
from bench.metrology.stiffness.summary import StiffnessSummary
from bench.metrology.stiffness.truth import K, known, noisy
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
    one, same, other = (noisy(truth, seed) for seed in (1, 1, 2))
    assert np.array_equal(one.wrench, same.wrench)
    assert not np.array_equal(one.wrench, other.wrench)
    off = np.concatenate([(noisy(truth, seed).wrench - truth.exact.wrench)[:, :3] for seed in range(40)])
    assert off.std() == pytest.approx(truth.setup.force_noise_n, rel=0.05)


def test_a_trial_is_measured_against_the_truth():
    result = measure_stiffness("one_lever", 3)
    assert result.refused is None
    assert result.crashed is None
    assert result.loads == [6, 6, 6]
    assert np.abs(np.divide(result.error, result.bound)).max() < 5
    assert 0 < result.nees < 40


def trial(seed, error, nees):
    return StiffnessResult(
        "planned",
        seed,
        loads=[40, 6],
        error=[error] * 6,
        bound=[0.02] * 6,
        stated=[0.02] * 6,
        nees=nees,
        seconds={"identify": 0.01},
    )


def test_what_falls_short_is_told():
    """Twice the bound and a chi-square out of the ellipsoid in every trial; then all as it should be."""
    bad = StiffnessSummary("planned", [trial(seed, 0.04 * (-1) ** seed, 24.0) for seed in range(100)])
    assert bad.rmse_ratio == pytest.approx(np.full(6, 2.0))
    assert list(bad.shortcomings) == ["planned: errors over their bound", "planned: coverage of the ellipsoid"]
    good = [trial(seed, 0.02 * (-1) ** seed, 14.0 if seed % 20 == 0 else 6.0) for seed in range(200)]
    summary = StiffnessSummary("planned", good)
    assert not list(summary.shortcomings)
    text = StiffnessSummary.text([summary], "typed")
    assert "| planned | 40 + 6 | 4.00 |" in text
    assert "| 95.0 | 91.0 to 97.6 |" in text
    assert "Not met: nothing." in text
    assert next(iter(StiffnessSummary.worst(good, 1))).startswith("planned, seed 0: chi-square 14.0")


def test_a_refused_trial_and_a_wide_joint_count():
    refused = StiffnessResult("planned", 1, refused="joint 4 cannot be determined", loads=[44], bound=[0.03] * 6)
    summary = StiffnessSummary("planned", [trial(0, 0.02, 6.0), refused])
    assert len(summary.results) == 2
    assert "planned: 1 refused" in summary.shortcomings
    assert "the first (seed 1): joint 4 cannot" in StiffnessSummary.text([summary], "typed")
