"""The estimator against dense algebra, refits and what is known of blunders."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass, field

import numpy as np
import pytest
import scipy
from hypothesis import given, settings
from hypothesis import strategies as st

from workbench.api import Float, InputError, estimator


@dataclass
class Linear:
    """Observations (n, d) that are slope (n, d, P) times the unknowns."""

    seen: Float
    slope: Float
    covariance: Float
    prior: Float = field(default_factory=lambda: np.zeros((0, 0)))
    values: Float | None = None
    shared: tuple[estimator.Shared, ...] = ()

    def rows(self, at: Float) -> estimator.Rows:
        n, d, size = self.slope.shape
        prior = self.prior if self.prior.size else np.zeros((size, size))
        values = np.full(n, float(d)) if self.values is None else self.values
        return estimator.Rows(self.seen - self.slope @ at, self.slope, self.covariance, values, prior, -at, self.shared)

    def moved(self, at: Float, step: Float) -> Float:
        return at + step


@dataclass
class Coarse(Linear):
    """Unknowns come in steps, as a clock's offset since 1970 does."""

    asked: list[Float] = field(default_factory=list)

    def rows(self, at: Float) -> estimator.Rows:
        self.asked.append(at)
        return super().rows(at)

    def moved(self, at: Float, step: Float) -> Float:
        return np.round((at + step) / 1e-4) * 1e-4


def spread(rng: np.random.Generator, *shape: int) -> Float:
    """Covariances (..., d, d)."""
    A = rng.normal(size=(*shape, shape[-1]))
    return A @ np.swapaxes(A, -1, -2) + 0.1 * np.eye(shape[-1])


def drawn(seed: int, n: int = 12, d: int = 2, size: int = 4) -> Linear:
    """Observations of random unknowns with their noise, and a prior about 0."""
    rng = np.random.default_rng(seed)
    slope, covariance = rng.normal(size=(n, d, size)), spread(rng, n, d)
    noise = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), rng.normal(size=(n, d)))
    return Linear(slope @ rng.normal(size=size) + noise, slope, covariance, np.diag([0.0, 0.0, 4.0, 0.5]))


def dense(one: Linear) -> Float:
    """Covariance (n d, n d) of all observations, what they share included."""
    n, d, _ = one.slope.shape
    out = np.zeros((n, d, n, d))
    out[np.arange(n), :, np.arange(n)] = one.covariance
    for s in one.shared:
        weight = np.zeros((len(s.rows), s.poses + 1))
        weight[np.arange(len(s.rows)), s.pose] += 1.0 - s.fraction
        weight[np.arange(len(s.rows)), s.pose + 1] += s.fraction
        block = np.einsum("ap,bp,aie,bje->aibj", weight, weight, s.own, s.own)
        block += np.einsum("aiv,bjv->aibj", s.whole, s.whole)
        block[np.arange(len(s.rows)), :, np.arange(len(s.rows))] += s.alone
        out[np.ix_(s.rows, range(d), s.rows, range(d))] = block
    return out.reshape(n * d, n * d)


def with_shared(seed: int) -> Linear:
    """Two scans of poses that several observations share, and some observations by themselves."""
    rng, one = np.random.default_rng(seed), drawn(seed, n=17, d=3)
    order, scans = rng.permutation(17), []
    for rows in (order[:6], order[6:13]):
        m = len(rows)
        pose, whole = np.sort(rng.integers(0, 3, m)), rng.normal(size=(m, 3, 2))
        scans.append(
            estimator.Shared(rows, spread(rng, m, 3), rng.normal(size=(m, 3, 2)), pose, rng.uniform(size=m), 3, whole)
        )
    return dataclasses.replace(one, shared=tuple(scans))


def test_a_fit_whose_steps_are_rounding_ends() -> None:
    """It went on to its last step."""
    plain = drawn(3)
    one = Coarse(plain.seen, plain.slope, plain.covariance, plain.prior)
    found, exact = estimator.fit(one, np.zeros(4)), estimator.fit(plain, np.zeros(4))
    assert 0.0 < np.abs(found.at - exact.at).max() < 1e-4
    assert len(one.asked) <= estimator.WANDERS + 2


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.booleans())
def test_a_fit_is_generalised_least_squares_with_its_prior(seed: int, shares: bool) -> None:
    one = with_shared(seed) if shares else drawn(seed)
    found = estimator.fit(one, np.zeros(4))
    J, weight = one.slope.reshape(-1, 4), np.linalg.inv(dense(one))
    information = J.T @ weight @ J + one.prior
    np.testing.assert_allclose(found.information, information, rtol=1e-7, atol=1e-9 * np.abs(information).max())
    np.testing.assert_allclose(found.at, np.linalg.solve(information, J.T @ weight @ one.seen.ravel()), atol=1e-7)
    off = one.seen.ravel() - J @ found.at
    assert found.chi2 == pytest.approx(off @ weight @ off + found.at @ one.prior @ found.at, rel=1e-7)
    assert found.freedom == one.seen.size + 2 - 4


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(0, 11))
def test_the_distance_of_an_observation_is_that_from_a_fit_without_it(seed: int, row: int) -> None:
    one = drawn(seed)
    used = np.arange(12) != row
    whole, rest = estimator.fit(one, np.zeros(4)), estimator.fit(one, np.zeros(4), used)
    off = rest.rows.residual[row]
    spread = one.covariance[row] + one.slope[row] @ rest.inverse @ one.slope[row].T
    chance = scipy.special.chdtrc(2, off @ np.linalg.solve(spread, off))  # of its two values
    expected = np.sqrt(scipy.special.chdtri(3, chance))
    assert whole.distance[row] == pytest.approx(expected, rel=0.03, abs=0.03)
    assert rest.distance[row] == pytest.approx(whole.distance[row], rel=1e-7)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6))
def test_more_unknowns_are_what_a_fit_with_them_finds(seed: int) -> None:
    one = drawn(seed)
    change = np.random.default_rng(seed + 1).normal(size=(*one.seen.shape, 2))
    more = dataclasses.replace(one, slope=np.concatenate([one.slope, change], axis=2), prior=np.pad(one.prior, (0, 2)))
    found, covariance = estimator.fit(one, np.zeros(4)).tested(change)
    expected = estimator.fit(more, np.zeros(6))
    np.testing.assert_allclose(found, expected.at[-2:], rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(covariance, expected.covariance[-2:, -2:], rtol=1e-6, atol=1e-9)


@dataclass
class Steep:
    """exp(x) seen five times, with a noise that has no inverse from x = `end` on."""

    end: float

    def rows(self, at: Float) -> estimator.Rows:
        grown, one = np.exp(at[0]), np.ones((5, 1, 1))
        noise = one * (at[0] < self.end)
        return estimator.Rows(np.e - grown * one[..., 0], grown * one, noise, np.ones(5), np.zeros((1, 1)), np.zeros(1))

    def moved(self, at: Float, step: Float) -> Float:
        return at + step


def test_a_step_that_cannot_be_solved_is_shortened_and_what_runs_away_ends_with_its_misfit() -> None:
    """From x = -3 the first step leads to 50, where nothing has an inverse."""
    assert estimator.fit(Steep(3.0), np.array([-3.0])).at[0] == pytest.approx(1.0)
    lost = estimator.fit(Steep(-2.99), np.array([-3.0]))
    assert lost.at[0] == -3.0
    assert lost.misfit > 5.0
    with pytest.raises(InputError, match="the rows contradict each other: a misfit of"):
        raise estimator.contradictory(lost.misfit, estimator.Labels("touches.csv", tuple(range(5))))


def test_a_covariance_grows_with_the_misfit_and_never_shrinks() -> None:
    one = drawn(8, n=400)
    found = estimator.fit(one, np.zeros(4))
    u = np.sqrt(np.diag(found.covariance))
    proud, humble = (
        estimator.fit(dataclasses.replace(one, covariance=k * one.covariance), np.zeros(4)) for k in (0.01, 100.0)
    )
    np.testing.assert_allclose(np.sqrt(np.diag(proud.covariance)), u, rtol=0.2)
    assert proud.misfit == pytest.approx(100.0, rel=0.2)
    assert np.sqrt(np.diag(humble.covariance)) == pytest.approx(
        np.sqrt(np.diag(np.linalg.inv(humble.information))), rel=1e-6
    )


def numbers(values: Float, repeats: Float | None = None) -> Linear:
    """Numbers of standard deviation 1 about a mean that is known to be 0: as three values, of which one is noise."""
    seen = np.zeros((len(values), 3))
    seen[:, 0] = values
    n = len(values)
    slope = np.zeros((n, 3, 1))
    slope[:, 0] = 1.0
    return Linear(seen, slope, np.tile(np.eye(3), (n, 1, 1)), np.eye(1) * 1e12, repeats)


def left_out(values: Float, spare: int = 4) -> tuple[estimator.Fit[Float], dict[int, str]]:
    """Of such numbers, on lines from 10."""
    labels = estimator.Labels("a.csv", tuple(range(10, 10 + len(values))), ask="look")
    return estimator.without_blunders(numbers(values), np.zeros(1), labels, spare=spare)


def test_blunders_are_left_out_by_their_lines_the_worst_first() -> None:
    found, told = left_out(np.array([1.0, -2.0, 30.0, 0.5, -6.0, 1.5, 0.2, 1.1]))
    assert np.flatnonzero(~found.used).tolist() == [2, 4]
    assert told == {
        12: "line 12 is left out: it lies 30.00 mm from where all other rows put it",
        14: "line 14 is left out: it lies 6.00 mm from where all other rows put it",
    }


def test_what_is_far_off_beside_three_quarters_of_the_rows_only_is_a_blunder() -> None:
    assert left_out(np.array([1.0, 1.0, 1.0, 4.9]))[1] == {}
    assert [*left_out(np.array([1.0, 1.0, 1.0, 5.1]))[1]] == [13]
    assert left_out(np.array([4.06, 4.06, 4.06, 9.9]))[1] == {}  # noise of twice what is stated: 5 becomes 10
    assert [*left_out(np.array([4.06, 4.06, 4.06, 10.1]))[1]] == [13]


def test_where_more_than_a_quarter_is_off_or_little_checks_it_no_row_is_blamed() -> None:
    with pytest.raises(InputError, match=r"a\.csv: the rows contradict each other: a misfit of .* look"):
        left_out(np.array([0.1, 0.2, 0.3, 0.1, 50.0, 60.0, 0.1]))
    assert left_out(np.array([1.0, 1.0, 1.0, 50.0]), spare=13)[1] == {}
    assert left_out(np.array([1.0, 1.0, 1.0, 50.0]), spare=12)[1] != {}
