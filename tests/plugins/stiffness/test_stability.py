"""Stability of milling: published numbers, closed forms, all eigenvalues, and small steps in time."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from workbench.api import Float
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


STEPS, SLICES = 200, 8  # of a tooth's period; of the depth


def growth(dynamics: Dynamics, cut: Milling, depth_mm: float) -> float:
    """Spectral radius of one tooth's period, by the modes' motion in small steps from every start and surface."""
    n, dt = dynamics.shape.shape[2], cut.period_s / STEPS
    to_xy, wide, (kt, kr, ka) = dynamics.shape[0, :2], depth_mm / 1e3 / SLICES, np.array(cut.chip) * 1e6
    start = np.eye(2 * n + 2 * STEPS)
    q, v, before = start[:n], start[n : 2 * n], start[2 * n :].reshape(STEPS, 2, -1)
    left = list[Float]()
    tooth, piece = np.meshgrid(np.arange(cut.flutes), (np.arange(SLICES) + 0.5) / SLICES)
    for k in range(STEPS):
        angle = 2 * np.pi * ((k + 0.5) / STEPS - tooth) / cut.flutes - cut.lag * depth_mm * piece
        angle = (angle - cut.entry) % (2 * np.pi) + cut.entry
        sine, cosine = np.sin(angle[angle < cut.exit]), np.cos(angle[angle < cut.exit])
        push = np.stack([kt * sine - kr * cosine, -kt * cosine - kr * sine, ka + 0 * sine])
        force = wide * push @ np.stack([cosine, sine], axis=1) @ (to_xy @ q - before[k])
        v = v + dt * (dynamics.shape[0].T @ force - dynamics.stiffness[0] @ q - dynamics.damping[0] @ v)
        q = q + dt * v
        left.append(to_xy @ q)
    whole = np.concatenate([q, v, *left])
    return float(np.abs(np.linalg.eigvals(whole)).max())


@pytest.mark.parametrize("seed", [0, 2, 3, 4, 7, 8])
def test_small_steps_in_time_say_the_same(seed: int) -> None:
    dynamics, cut = random_case(np.random.default_rng(seed))
    limit = float(limits(dynamics, cut, 50.0, np.minimum(screened(dynamics, cut, 50.0) / 4, 1.0))[0])
    assert np.isfinite(limit)
    assert growth(dynamics, cut, 0.97 * limit) < 1.0 < growth(dynamics, cut, 1.03 * limit)
