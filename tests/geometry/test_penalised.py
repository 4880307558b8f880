"""The banded kernels against dense algebra."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.interpolate import BSpline

from workbench.geometry.penalised import BAND, Penalised, penalised, with_local_noise
from workbench.geometry.processes import Process, correlated
from workbench.units import Float

STRENGTHS = np.array([[1e-2, 1e-3], [0.2, 1e-2], [40.0, 20.0]])  # over the step's powers


def problem(
    step: float, components: int, orders: tuple[int, int], free: bool = False
) -> tuple[Penalised, Float, Float, Float, Float]:
    rng = np.random.default_rng(17)
    knots = step * np.arange(-3, 13.0)
    s, weight = np.sort(rng.uniform(knots[3], knots[-4], 40)), rng.uniform(1.0, 9.0, 40)
    s[-1] = knots[-4]
    y = np.sin(s / step / 3.0)[:, None] + rng.normal(0.0, 0.1, (40, components))
    return penalised(s, y, weight, knots, orders, free), s, y, weight, knots


def dense(knots: Float, orders: tuple[int, int], strengths: Float, basis: Float, weight: Float) -> Float:
    size, step = knots.size - BAND, knots[4] - knots[3]
    matrix = basis.T @ (weight[:, None] * basis)
    for order, strength in zip(orders, strengths, strict=True):
        differences = np.diff(np.eye(size), order, axis=0)
        matrix = matrix + differences.T @ differences / step ** (2 * order - 1) / strength
    return np.asarray(matrix)


@pytest.mark.parametrize("orders", [(1, 2), (2, 3)])
@pytest.mark.parametrize("step", [0.2, 4.0])  # in the first case a slope's chord reaches over several knots
@pytest.mark.parametrize("components", [1, 3])
def test_as_dense_algebra(orders: tuple[int, int], step: float, components: int) -> None:
    made, s, y, weight, knots = problem(step, components, orders)
    basis = BSpline.design_matrix(s, knots, 3).toarray()
    at = np.linspace(knots[3], knots[-4], 57)
    before, after = np.maximum(at - 0.5, at[0]), np.minimum(at + 0.5, at[-1])
    value = BSpline.design_matrix(at, knots, 3).toarray()
    chord = BSpline.design_matrix(after, knots, 3).toarray() - BSpline.design_matrix(before, knots, 3).toarray()
    rows = np.concatenate([value, chord / (after - before)[:, None]])
    share = np.array([0.2, 0.5, 0.3])
    all_strengths = STRENGTHS / step ** (2.0 * np.array(orders) - 1.0)
    found, scores, within = [], [], np.zeros(len(rows))
    for strengths, part in zip(all_strengths, share, strict=True):
        matrix, right = dense(knots, orders, strengths, basis, weight), basis.T @ (weight[:, None] * y)
        found.append(np.linalg.solve(matrix, right))
        within += part * np.einsum("ij,ji->i", rows, np.linalg.solve(matrix, rows.T))
        misfit = float((weight[:, None] * y**2).sum() - (right * found[-1]).sum())
        prior = np.log(made.waves[0] / strengths[0] + made.waves[1] / strengths[1]).sum()
        scores.append(-0.5 * misfit - components * 0.5 * (np.linalg.slogdet(matrix)[1] - prior))
    mean = np.einsum("g,gkd->kd", share, np.array(found))
    between = sum(part * ((rows @ (c - mean)) ** 2).mean(axis=1) for c, part in zip(found, share, strict=True))
    np.testing.assert_allclose(made.evidence(all_strengths), scores, rtol=1e-9)
    coefficients, variance, slope_variance, _ = made.average(all_strengths, share, at)
    np.testing.assert_allclose(coefficients, mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(np.concatenate([variance, slope_variance]), within + between, rtol=1e-8)


@pytest.mark.parametrize("orders", [(0, 3), (1, 3)])
@pytest.mark.parametrize("weak", [1e-4, 1.0, 1e6])
def test_a_free_polynomial_is_one_of_a_wide_prior(orders: tuple[int, int], weak: float) -> None:
    """A column beside the splines whose coefficient has all but no prior: dense algebra with one unknown more."""
    made, s, y, weight, knots = problem(4.0, 2, orders, free=True)
    basis = BSpline.design_matrix(s, knots, 3).toarray()
    at = np.linspace(knots[3], knots[-4], 57)
    value = BSpline.design_matrix(at, knots, 3).toarray()
    strengths = weak * STRENGTHS[1] / 4.0 ** (2.0 * np.array(orders) - 1.0)
    size = basis.shape[1]
    wide = np.hstack([np.eye(size), made.free[0][:, None]])
    held = dense(knots, orders, strengths, np.zeros((1, size)), np.zeros(1))
    matrix = wide.T @ (basis.T @ (weight[:, None] * basis)) @ wide
    matrix[:size, :size] += held
    right = wide.T @ basis.T @ (weight[:, None] * y)
    rows = value @ wide
    mean, variance, *_ = made.average(strengths[None, :], np.ones(1), at)
    np.testing.assert_allclose(value @ mean, rows @ np.linalg.solve(matrix, right), rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(variance, np.einsum("ij,ji->i", rows, np.linalg.solve(matrix, rows.T)), rtol=1e-6)
    misfit = float((weight[:, None] * y**2).sum() - (right * np.linalg.solve(matrix, right)).sum())
    prior = np.log(made.waves[0] / strengths[0] + made.waves[1] / strengths[1]).sum()
    along = np.log(made.free[0] @ held @ made.free[0])
    score = -0.5 * misfit - 2 * 0.5 * (np.linalg.slogdet(matrix)[1] - prior - along)
    assert made.evidence(strengths[None, :])[0] == pytest.approx(score, rel=1e-7)


def test_many_factors_do_not_overflow() -> None:
    """5 m of edge: the product of all factors has thousands of digits."""
    rng = np.random.default_rng(18)
    knots = 4.0 * np.arange(-3, 1254.0)
    s = np.linspace(0.0, 5000.0, 2500)
    for scale in (1e-9, 1.0, 1e9):
        y = scale * rng.normal(size=(s.size, 1))
        made = penalised(s, y, np.full(s.size, scale**-2), knots, (1, 2))
        assert np.isfinite(made.evidence(STRENGTHS * scale**2)).all()


def test_no_solution_is_told() -> None:
    made, *_ = problem(4.0, 1, (1, 2))
    with pytest.raises(np.linalg.LinAlgError, match="not positive definite"):
        made.evidence(np.array([[-1e-6, -1e-6]]))


@pytest.mark.parametrize("passes", [1, 2])
@pytest.mark.parametrize("orders", [(1, 2), (0, 3)])
def test_noise_of_neighbours_as_the_whole_covariance(passes: int, orders: tuple[int, int]) -> None:
    s = np.tile(np.arange(200.0) * 2.0, passes) + 0.3 * np.repeat(np.arange(passes), 200)
    rough, spread, variance = Process(0.6, 2.0, by_pass=False), np.full(s.size, 0.6), np.full(s.size, 0.01)
    y = np.random.default_rng(5).normal(np.sin(s / 9.0)[:, None], 0.4, (s.size, 2))
    plain = penalised(s, y, 1.0 / variance, s[0] + 4.0 * np.arange(-3, 105.0), orders, orders[0] == 0)
    covariance = rough.covariance(s, spread, np.zeros(s.size)) + np.diag(variance)
    whole, noise = correlated(plain, s, y, np.linalg.inv(covariance)), rough.near(s, spread, variance, passes)
    made, at, share = with_local_noise(plain, s, y, noise), np.linspace(0.0, 398.0, 99), np.array([0.2, 0.5, 0.3])
    found = made.evidence(STRENGTHS) - noise.log_determinant
    np.testing.assert_allclose(found, whole.evidence(STRENGTHS), rtol=1e-5)
    for one, other in zip(made.average(STRENGTHS, share, at), whole.average(STRENGTHS, share, at), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose((noise.white(y) ** 2).sum(), whole.squares, rtol=1e-4)
    np.testing.assert_allclose(noise.log_determinant, np.linalg.slogdet(covariance)[1], rtol=1e-5)
