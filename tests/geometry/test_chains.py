"""Profiles split into straight faces: the cheapest partition, whatever noise, gaps and stray points there are."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from workbench.geometry.chains import (
    COUNT,
    LINE_PRICE,
    MAX_BREAKS,
    MIN_POINTS,
    OFFSET,
    POINT_PRICE,
    SLOPE,
    X0,
    X1,
    _partition,
    _prefix_sums,
    noise_sigma,
    straight_faces,
)
from workbench.units import Float

PITCH_MM, NOISE_MM = 0.05, 0.012
ENDS_MM = np.array([0.0, 8.0, 16.0, 17.5, 30.0])  # upper surface, bevel face, root face, lower surface
SLOPES = np.array([-0.4, 0.7, 2.5, -0.5])
OFFSETS = np.cumsum(np.append(150.0, -np.diff(SLOPES) * ENDS_MM[1:-1]))


def polyline(x: Float) -> Float:
    face = np.clip(np.searchsorted(ENDS_MM, x, side="right") - 1, 0, 3)
    return np.asarray(SLOPES[face] * x + OFFSETS[face])


def columns(rng: np.random.Generator, noise_mm: float = NOISE_MM) -> tuple[Float, Float]:
    x = np.arange(0.0, ENDS_MM[-1], PITCH_MM)
    return x, polyline(x) + rng.normal(0, noise_mm, x.size)


def check_faces(chain: Float, x: Float, sigmas: float = 4.5) -> None:
    """The four faces, each with its slope and place about as exact as least squares on its points can be."""
    assert len(chain) == 4
    for row, slope, offset, start, end in zip(chain, SLOPES, OFFSETS, ENDS_MM[:-1], ENDS_MM[1:], strict=True):
        inner = x[(x > start) & (x < end)]
        spread = np.sqrt(((inner - inner.mean()) ** 2).sum())
        assert abs(row[SLOPE] - slope) < sigmas * NOISE_MM / spread
        middle = 0.5 * (start + end)
        off = row[SLOPE] * middle + row[OFFSET] - slope * middle - offset
        assert abs(off) < sigmas * NOISE_MM / np.sqrt(inner.size)
        assert abs(row[X0] - start) < 0.2
        assert abs(row[X1] - end) < 0.2


@pytest.mark.parametrize("seed", range(4))
def test_a_stray_return_cuts_no_face(seed: int) -> None:
    """One a face, as is left after rejecting outliers: the pieces on both sides of it come as one line."""
    rng = np.random.default_rng(seed)
    x, z = columns(rng)
    for place in ENDS_MM[:-1] + 0.5 * np.diff(ENDS_MM):
        z[np.searchsorted(x, place)] += rng.choice([-1, 1]) * rng.uniform(0.5, 8)
    chain = straight_faces(x, z)
    check_faces(chain, x, 9)  # pieces are averaged, each with its own slope: half as exact as one fit
    assert chain[:, COUNT].sum() <= x.size - 4


def test_a_streak_beside_a_face_is_a_line_of_its_own() -> None:
    x, z = columns(np.random.default_rng(4))
    off = (x > 11) & (x < 12)
    z[off] -= 3.0
    chain = straight_faces(x, z)
    streak = chain[(chain[:, X0] > 10.9) & (chain[:, X1] < 12.1)]
    assert len(streak) == 1
    assert streak[0, COUNT] == pytest.approx(off.sum(), abs=2)
    assert len(chain) == 6  # the bevel face is cut in two: the streak lies between its pieces


def test_a_slightly_bent_face_comes_as_one() -> None:
    """On a curved edge an oblique frame sees the faces bent, by some hundredths of a mm."""
    x = np.arange(400) * PITCH_MM
    z = 100 + 0.5 * x + 0.001 * (x - 10) ** 2  # 0.1 mm: eight times the noise
    chain = straight_faces(x, z + np.random.default_rng(5).normal(0, NOISE_MM, x.size))
    assert len(chain) == 1
    assert chain[0, SLOPE] == pytest.approx(0.5, abs=0.002)


def test_more_points_than_candidate_breaks() -> None:
    """Long profiles: several points share a breakpoint, and faces are as exact as the points allow."""
    x = np.linspace(0, 29.99, 4 * MAX_BREAKS)
    z = polyline(x) + np.random.default_rng(7).normal(0, NOISE_MM, x.size)
    check_faces(straight_faces(x, z), x)


def test_far_from_the_origin_no_digits_are_lost() -> None:
    x, z = columns(np.random.default_rng(8))
    near, far = straight_faces(x, z), straight_faces(x + 1000, z + 5000)
    np.testing.assert_allclose(far[:, SLOPE], near[:, SLOPE], rtol=0, atol=1e-7)
    np.testing.assert_array_equal(far[:, COUNT:], near[:, COUNT:])


@pytest.mark.parametrize("count", [0, 1, 2 * MIN_POINTS - 1])
def test_too_few_points(count: int) -> None:
    x = np.arange(count) * PITCH_MM
    assert straight_faces(x, x).shape == (0, 7)


def partitions(first: int, n: int) -> Iterator[tuple[tuple[int, int], ...]]:
    """Every choice of lines (first, last + 1) of at least MIN_POINTS points out of points first to n - 1."""
    if first >= n:
        yield ()
        return
    for rest in partitions(first + 1, n):
        yield rest
    for end in range(first + MIN_POINTS, n + 1):
        for rest in partitions(end, n):
            yield ((first, end), *rest)


def price(spans: tuple[tuple[int, int], ...], x: Float, z: Float, sigma: float) -> float:
    used = sum(j - i for i, j in spans)
    total = POINT_PRICE * (x.size - used) + LINE_PRICE * len(spans)
    for i, j in spans:
        residual = z[i:j] - np.polyval(np.polyfit(x[i:j], z[i:j], 1), x[i:j])
        total += float((residual**2).sum()) / sigma**2
    return total


@pytest.mark.parametrize("seed", range(6))
def test_no_partition_is_cheaper(seed: int) -> None:
    """Against all partitions there are, on profiles short enough to try them."""
    rng = np.random.default_rng(seed)
    x, sigma = np.arange(14) * 0.5, 0.1
    split = int(rng.integers(5, 9))
    turn, jump = rng.uniform(-2, 2), rng.choice([0.0, 1.0])
    z = 3.0 + 0.7 * x + turn * np.maximum(x - x[split], 0) + jump * (x > x[split]) + rng.normal(0, sigma, x.size)
    z[rng.integers(x.size)] += rng.uniform(0, 1)
    best = min(partitions(0, x.size), key=lambda spans: price(spans, x, z, sigma))
    made = _partition(x, _prefix_sums(x, z), sigma)
    assert [tuple(map(int, row)) for row in made] == list(best)


@pytest.mark.parametrize("sigma_mm", [0.005, 0.012, 0.04])
@pytest.mark.parametrize(("stray_share", "most"), [(0.0, 1.12), (0.03, 1.3)])
def test_white_noise_in_spite_of_corners_and_jumps(sigma_mm: float, stray_share: float, most: float) -> None:
    """A stray return spoils three second differences, a corner one or two: the median hardly moves."""
    rng = np.random.default_rng(9)
    found = []
    for _ in range(20):
        _, z = columns(rng, sigma_mm)
        z[rng.random(z.size) < stray_share] += 5.0
        found.append(noise_sigma(z))
    assert 0.97 * sigma_mm < np.mean(found) < most * sigma_mm
    assert np.min(found) > 0.88 * sigma_mm


def test_correlated_noise_does_not_hide() -> None:
    """Second differences of neighbours see 0.57 of noise with a correlation of 0.6; over four columns 0.91."""
    rng = np.random.default_rng(10)
    found = []
    for _ in range(20):
        z = rng.normal(0, 0.02, 800)
        for j in range(1, z.size):
            z[j] = 0.6 * z[j - 1] + np.sqrt(1 - 0.6**2) * z[j]
        found.append(noise_sigma(z))
    assert np.mean(found) == pytest.approx(0.91 * 0.02, rel=0.08)
