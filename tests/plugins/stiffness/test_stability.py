"""Stability of milling: published numbers, closed forms, all eigenvalues, and a simulation in the time domain."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from bench.chatter_simulation import agreement
from workbench.plugins.stiffness.stability import (
    Dynamics,
    Judge,
    Milling,
    averaged,
    limits,
    mean_direction,
    milling,
    screened,
    spectral_radius,
)

W = 2 * np.pi * 922.0
DING = Dynamics(np.array([[[W**2]]]), np.array([[[2 * 0.011 * W]]]), np.array([[[0.0], [0.03993**-0.5], [0.0]]]))
PUBLISHED = {0.2: 0.8192, 0.5: 1.0726, 0.7: 1.2197, 1.0: 1.4040}  # spectral radius by depth, mm
cases = settings(max_examples=20, deadline=None, derandomize=True)


@pytest.mark.parametrize("way", [0, 1])
def test_spectral_radius_is_the_published_one(way: int) -> None:
    """Ding et al. (2010): one mode along the feed, two teeth, a slot at 5000 a minute, 600 and 200 N/mm2."""
    cut = milling((600.0, 200.0, 0.0), 2, 10.0, 10.0, 0.0, 5000.0)[way]
    found = Judge(DING, cut).radius(np.array(list(PUBLISHED)))
    assert np.allclose(found, list(PUBLISHED.values()), rtol=0.005)


def test_eigenvalues_of_one_size_that_arpack_does_not_part() -> None:
    assert spectral_radius(np.roll(np.eye(80), 1, axis=0)) == pytest.approx(1.0)


def test_the_limit_is_where_the_radius_is_one() -> None:
    cut = milling((600.0, 200.0, 0.0), 2, 10.0, 10.0, 0.0, 5000.0)[0]
    limit = limits(DING, cut, 10.0)[0]
    below, above = Judge(DING, cut).radius(limit * np.array([0.995, 1.005]))
    assert below < 1 < above
    assert limits(DING, cut, 10.0, np.array([5.0]))[0] == pytest.approx(limit, rel=0.01)  # found from above too


@cases
@given(seed=st.integers(0, 10**6), damping=st.sampled_from([0.0, 1e-3, 1e-2, 0.1]))
@example(seed=83388, damping=0.0)
@example(seed=83388, damping=1e-3)
def test_mode_coupling_is_the_closed_form(seed: int, damping: float) -> None:
    """Two modes, q'' + c q' + (W - s P) q = 0, of w^2 and s = depth (Gasparetto 1998).

    Undamped they meet where the discriminant D = (w1 - w2 - s (p11 - p22))^2 + 4 s^2 p12 p21 vanishes; as damped, an
    eigenvalue mu of W - s P has (Im mu)^2 = c^2 Re mu, which is D + 2 c^2 (w1 + w2 - s (p11 + p22)) = 0.
    """
    rng = np.random.default_rng(seed)
    w = np.sort((2 * np.pi * rng.uniform(8, 30, 2)) ** 2)
    turn = rng.uniform(0, np.pi)
    shape = np.zeros((3, 2))
    ways = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    shape[:2] = ways / np.sqrt(rng.uniform(50, 400, 2))
    cut = milling((800.0, 250.0, 0.0), 4, 10.0, float(rng.uniform(0.5, 6)), 0.0, 6000.0)[rng.integers(2)]
    p, c = shape.T @ mean_direction(cut) @ shape[:2] * 1e3, damping * np.sqrt(w[0])
    a, b, both, trace = p[0, 0] - p[1, 1], p[0, 1] * p[1, 0], w.sum(), np.trace(p)
    meeting = [a**2 + 4 * b, -2 * a * (w[0] - w[1]) - 2 * c**2 * trace, (w[0] - w[1]) ** 2 + 2 * c**2 * both]
    used_up = [p[0, 0] * p[1, 1] - b, -(w[0] * p[1, 1] + w[1] * p[0, 0]), w[0] * w[1]]  # no stiffness left
    roots = np.concatenate([np.roots(meeting), np.roots(used_up)])
    least = roots.real[(roots.real > 0) & (abs(roots.imag) < 1e-12 * abs(roots.real))].min(initial=np.inf)
    one = Dynamics(np.diag(w)[None], c * np.eye(2)[None], shape[None])
    found = screened(one, cut, 1e6, regeneration=False)[0]
    if damping:
        assert found == pytest.approx(least, rel=1e-9)
    else:  # growth below a millionth of a mode's frequency counts for none
        assert found == pytest.approx(least, rel=1e-4)


@cases
@given(seed=st.integers(0, 10**6))
def test_the_screen_steps_over_no_window(seed: int) -> None:
    """No depth below the limit is unstable by all eigenvalues, and just above it some are."""
    dynamics, cut = random_case(np.random.default_rng(seed))
    limit = screened(dynamics, cut, 1e3)[0]
    free, by, to = averaged(dynamics, cut)
    depth = np.append(np.linspace(0, min(limit, 1e3), 4001)[1:-1], limit * 1.0001 if limit < 1e3 else 1e3)
    growth = np.linalg.eigvals(free + depth[:, None, None] * (by @ to)).real.max(axis=1)
    assert (growth[:-1] < 0).all()
    assert (growth[-1] > 0) == (limit < 1e3)


def random_case(rng: np.random.Generator) -> tuple[Dynamics, Milling]:
    n = 4
    w = 2 * np.pi * rng.uniform(6, 90, n)
    shape = rng.normal(size=(3, n)) / 12
    up, down = milling((800.0, 250.0, 150.0), 3, 10.0, float(rng.uniform(0.3, 9)), 0.5, 6000.0)
    return Dynamics(np.diag(w**2)[None], np.diag(0.06 * w)[None], shape[None]), up if rng.integers(2) else down


@cases
@given(seed=st.integers(0, 10**6), factor=st.floats(0.2, 5))
def test_limits_scale_with_force_and_mass(seed: int, factor: float) -> None:
    """Twice the coefficients, half the depth; twice all masses, stiffnesses and dampers, twice the depth."""
    dynamics, cut = random_case(np.random.default_rng(seed))
    cut = cut._replace(lag=0.0)
    one = screened(dynamics, cut, 1e3)
    stronger = cut._replace(chip=tuple(factor * k for k in cut.chip))
    heavier = dynamics._replace(shape=dynamics.shape / np.sqrt(factor))
    assert np.allclose(screened(dynamics, stronger, 1e3 / factor) * factor, one, rtol=1e-6)
    assert np.allclose(screened(heavier, cut, 1e3 * factor) / factor, one, rtol=1e-6)


@pytest.mark.slow
def test_a_simulation_in_the_time_domain_says_the_same() -> None:
    """At 0.9 and 1.1 of the limit."""
    right, asked = agreement(10, 1)
    assert asked >= 14
    assert right >= 0.9 * asked
