"""The one estimator against courses that are known: its values, its uncertainties, what it leaves out."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from scipy.stats import chi2

from workbench.geometry.course import Course, fit_course, stretches
from workbench.geometry.processes import Shared
from workbench.units import Float

Truth = Callable[[Float], Float]
LENGTH_MM, PITCH_MM, SIGMA = 120.0, 0.3, 0.1
AT = np.array([0.0, 7.0, 41.0, 60.0, 83.0, 115.0, 120.0])
RISK = 1e-3  # that a sound estimator fails one of these tests


def constant(s: Float) -> Float:
    return np.full(np.shape(s), 1.7)


def drift(s: Float) -> Float:
    return 1.0 + 0.004 * s


def long_wave(s: Float) -> Float:
    return 1.0 + 0.15 * np.sin(2 * np.pi * s / 60.0)


def short_wave(s: Float) -> Float:
    return 1.0 + 0.3 * np.sin(2 * np.pi * s / 24.0)


TRUTHS = [constant, drift, long_wave, short_wave]


def seen(truth: Truth, seed: int, sigma: float = SIGMA, pitch_mm: float = PITCH_MM) -> tuple[Float, Float]:
    rng = np.random.default_rng([seed, 9101])
    s = np.arange(0.0, LENGTH_MM + 1e-9, pitch_mm)
    return s, truth(s) + rng.normal(0.0, sigma, s.size)


def within(sum_z2: float, count: int, most: float) -> None:
    """Squares of errors in u: a chi-square's sum unless u is too small, or more than `most` times too large."""
    assert sum_z2 < chi2.ppf(1.0 - RISK, count)
    assert sum_z2 * most**2 > chi2.ppf(RISK, count)


@pytest.mark.parametrize("truth", TRUTHS)
def test_without_noise_it_is_the_truth(truth: Truth) -> None:
    s, y = seen(truth, 0, 1e-6)
    course = fit_course(s, y)
    inside = np.linspace(3.0, 117.0, 200)
    sagitta = 0.0 if truth in (constant, drift) else np.abs(np.gradient(np.gradient(truth(s), s), s)).max() * 2.0**2 / 8
    assert np.abs(course.value(inside) - truth(inside)).max() < sagitta + 1e-5


@pytest.mark.parametrize(
    ("truth", "stated"), [(constant, False), (drift, True), (long_wave, False), (short_wave, True)]
)
def test_errors_are_as_large_as_u_says(truth: Truth, stated: bool) -> None:
    """At one place a recording, anywhere along the edge and at its ends: independent, so chi-square holds."""
    z = []
    for seed in range(105):
        s, y = seen(truth, seed)
        course = fit_course(s, y, np.full(s.size, SIGMA**2) if stated else None)
        at = AT[seed % AT.size : seed % AT.size + 1]
        z.append(float(((course.value(at) - truth(at)) / course.u(at))[0]))
    within(float(np.square(z).sum()), len(z), 2.0)


def test_more_values_are_known_better() -> None:
    """By the root of their count where the course is as stiff as it can be."""
    few = [fit_course(*seen(constant, seed, pitch_mm=0.6)).u(AT[3:4])[0] for seed in range(20)]
    many = [fit_course(*seen(constant, seed, pitch_mm=0.15)).u(AT[3:4])[0] for seed in range(20)]
    assert np.mean(few) / np.mean(many) == pytest.approx(2.0, rel=0.2)


@pytest.mark.parametrize("alike", [1, 3])
def test_understated_noise_is_found(alike: int) -> None:
    """The bins' scatter counts, not what was said; values that share noise within a bin are no more than their groups.

    Noise that is alike over more than a bin is not told from the course (docs/method.md): `Shared.over_mm` is for that.
    """
    z = []
    for seed in range(100):
        rng = np.random.default_rng([seed, 9102])
        s = np.arange(0.0, LENGTH_MM, PITCH_MM)
        shared = np.repeat(rng.normal(0.0, SIGMA, s.size // alike + 1), alike)[: s.size]
        course = fit_course(s, 1.0 + shared + rng.normal(0.0, 0.02, s.size), np.full(s.size, 0.02**2))
        z.append(float(((course.value(AT[3:4]) - 1.0) / course.u(AT[3:4]))[0]))
        assert course.noise_factor > 5.0
    within(float(np.square(z).sum()), len(z), 2.0)


def test_noise_over_centimetres_is_found_where_its_length_is_said() -> None:
    z = []
    for seed in range(60):
        rng = np.random.default_rng([seed, 9108])
        s = np.arange(0.0, 3 * LENGTH_MM, PITCH_MM)
        course = fit_course(
            s,
            1.0 + np.repeat(rng.normal(0.0, SIGMA, s.size // 15 + 1), 15)[: s.size],
            np.full(s.size, 0.02**2),
            shared=Shared(10.0),
        )
        z.append(float(((course.value(AT[3:4]) - 1.0) / course.u(AT[3:4]))[0]))
    within(float(np.square(z).sum()), len(z), 2.0)


def test_a_vector_has_one_stiffness_and_each_component_its_value() -> None:
    s, x = seen(long_wave, 3)
    y = seen(drift, 4)[1]
    both = fit_course(s, np.stack([x, y], axis=1))
    assert both.value(AT).shape == (AT.size, 2)
    assert both.u(AT).shape == AT.shape
    assert np.abs(both.value(AT) - np.stack([long_wave(AT), drift(AT)], axis=1)).max() < 5.0 * both.u(AT).max()
    swapped = fit_course(s, np.stack([y, x], axis=1))
    np.testing.assert_allclose(swapped.value(AT)[:, ::-1], both.value(AT), atol=1e-9)


def test_units_do_not_matter() -> None:
    s, y = seen(long_wave, 5)
    one, thousand = fit_course(s, y), fit_course(s, 1000.0 * y)
    np.testing.assert_allclose(thousand.value(AT), 1000.0 * one.value(AT), rtol=1e-4)
    np.testing.assert_allclose(thousand.u(AT), 1000.0 * one.u(AT), rtol=1e-2)


def passes(truth: Truth, seed: int, offsets: Float, sigma: float = SIGMA) -> Course:
    rng = np.random.default_rng([seed, 9104])
    parts = [np.arange(0.1 * k, LENGTH_MM, PITCH_MM) for k in range(offsets.size)]
    y = [truth(s) + off + rng.normal(0.0, sigma, s.size) for s, off in zip(parts, offsets, strict=True)]
    group = np.repeat(np.arange(offsets.size), [s.size for s in parts])
    return fit_course(np.concatenate(parts), np.concatenate(y), None, group)


def test_the_mean_of_passes_is_as_uncertain_as_their_offsets_say() -> None:
    """Five passes: the mean's errors over u follow Student's t with 4 degrees of freedom, variance 2."""
    z2 = []
    for seed in range(100):
        offsets = np.random.default_rng([seed, 9105]).normal(0.0, 0.3, 5)
        course = passes(constant, seed, offsets)
        z2.append(float(((course.value(AT[3:4]) - constant(AT[3:4])) / course.u(AT[3:4]))[0]) ** 2)
    assert 1.0 / 3.0 < np.median(z2) / 0.549 < 3.0  # 0.741^2: median of |t| with 4 degrees of freedom


def test_passes_that_only_meet_are_uncertain_by_half_of_a_step_between_them() -> None:
    rng, step = np.random.default_rng(9), np.array([0.0, 0.2, -0.1])
    s = np.arange(0.0, LENGTH_MM, PITCH_MM)
    group = (s > 0.5 * LENGTH_MM).astype(np.int64)
    bend = np.stack([s, 2e-4 * s**2, 0.0 * s], axis=1)
    y = bend + rng.normal(0.0, 0.01, (s.size, 3))
    courses = [fit_course(s, one, None, group, (2, 3)) for one in (y, y + group[:, None] * step)]
    off = courses[1].value(AT) - np.stack([AT, 2e-4 * AT**2, 0.0 * AT], axis=1)
    assert np.abs(off - 0.5 * step).max() < 0.02
    assert courses[1].u(AT) == pytest.approx(0.5 * np.sqrt((step**2).mean()) * np.ones(AT.size), rel=0.1)
    assert courses[0].u(AT).max() < 0.01  # none is certain: nothing is put on


@pytest.mark.parametrize(
    ("spans", "noise_mm"),
    [
        ([(0.0, 120.0)] * 3, [0.002, 0.002, 0.1]),
        ([(0.0, 120.0), (0.0, 60.0), (60.0, 120.0)], [0.005] * 3),
        ([(0.0, 60.0), (30.0, 90.0), (60.0, 120.0)], [0.005] * 3),
    ],
)
def test_offsets_of_passes_that_differ_in_length_or_noise_are_no_misfit(
    spans: list[tuple[float, float]], noise_mm: list[float]
) -> None:
    rng = np.random.default_rng(11)
    parts = [np.arange(*span, 0.2) for span in spans]
    offset = [0.03, -0.03, 0.0]
    y = [off + rng.normal(0.0, noise, s.size) for s, off, noise in zip(parts, offset, noise_mm, strict=True)]
    variance = [np.full(s.size, noise**2) for s, noise in zip(parts, noise_mm, strict=True)]
    group = np.repeat(np.arange(3), [s.size for s in parts])
    course = fit_course(np.concatenate(parts), np.concatenate(y), np.concatenate(variance), group)
    assert course.misfit < 2.0
    assert np.ptp(course.value(np.linspace(1.0, 119.0, 60))) < 0.004


def test_passes_that_turn_against_each_other_leave_half_of_that_uncertain() -> None:
    """A robot that turns another way in the second pass: no misfit of the course, which would count without bound."""
    rng, turn = np.random.default_rng(10), np.array([0.0, 4e-4, -3e-4])
    s = np.tile(np.arange(0.0, LENGTH_MM, PITCH_MM), 2)
    group = np.repeat([0, 1], s.size // 2)
    turned = (group[:, None] - 0.5) * (s[:, None] - 0.5 * LENGTH_MM) * turn
    y = np.stack([s, 2e-4 * s**2, 0.0 * s], axis=1) + rng.normal(0.0, 0.001, (s.size, 3)) + turned
    course = fit_course(s, y, None, group, (2, 3))
    off = course.value(AT) - np.stack([AT, 2e-4 * AT**2, 0.0 * AT], axis=1)
    assert np.abs(off).max() < 0.002
    inner = AT[np.abs(AT - 0.5 * LENGTH_MM) < 0.3 * LENGTH_MM]
    assert course.slope_u(inner) == pytest.approx(0.5 * np.sqrt((turn**2).mean()) * np.ones(inner.size), rel=0.2)


def test_outliers_are_left_out() -> None:
    rng = np.random.default_rng(9107)
    s, y = seen(long_wave, 7, 0.02)
    wild = rng.random(s.size) < 0.05
    y[wild] += rng.choice([-1.0, 1.0], wild.sum()) * rng.uniform(0.5, 50.0, wild.sum())
    y[5], s_nan = np.nan, s.copy()
    s_nan[9] = np.nan
    course = fit_course(s_nan, y)
    assert not course.kept[wild].any()
    assert not course.kept[[5, 9]].any()
    assert course.kept.mean() > 0.9
    assert np.abs(course.value(AT) - long_wave(AT)).max() < 0.05


def test_no_value_at_all_is_an_error() -> None:
    with pytest.raises(ValueError, match="finite"):
        fit_course(np.arange(5.0), np.full(5, np.nan))


@pytest.mark.parametrize("count", [1, 2, 3, 5])
def test_few_values(count: int) -> None:
    s = np.linspace(0.0, 10.0, count)
    course = fit_course(s, np.full(count, 2.0), np.full(count, 0.01))
    np.testing.assert_allclose(course.value(s), 2.0, atol=1e-6)
    assert (course.u(s) > 0.02).all()


def test_a_gap_is_bridged_and_known_less() -> None:
    z = []
    for seed in range(60):
        s, y = seen(long_wave, 2000 + seed)
        on = (s < 40.0) | (s > 70.0)
        course = fit_course(s[on], y[on])
        at = np.array([20.0, 55.0])
        z.append(float(((course.value(at) - long_wave(at)) / course.u(at))[1]))
        assert course.u(at)[1] > 1.5 * course.u(at)[0]
    assert float(np.square(z).sum()) < chi2.ppf(1.0 - RISK, len(z)) * 1.5  # a wave's crest may lie in the gap


def test_the_evidence_prefers_the_truth() -> None:
    """Values that run smoothly against the same ones with what another face's waves add."""
    better = 0
    for seed in range(20):
        s, y = seen(constant, 3000 + seed)
        better += fit_course(s, y).log_evidence > fit_course(s, y + short_wave(s)).log_evidence
    assert better == 20


def test_stretches_do_not_turn_on_a_digit() -> None:
    """Where values stand at a regular pitch, one that moves by a digit stays in its stretch, whatever s counts from."""
    s = np.arange(0.0, 60.0, 0.5)
    first = stretches(s, 2.0)
    assert set(np.bincount(first)[1:-1]) == {4}
    for seed in range(20):
        rng = np.random.default_rng([seed, 9110])
        other = stretches(s + rng.uniform(-100, 100) + rng.normal(0, 1e-9, s.size), 2.0)
        np.testing.assert_array_equal(first, other)


@pytest.mark.parametrize("pitch", [0.33, 1.0])
@pytest.mark.parametrize("length", [3.0, 20.0])
@pytest.mark.parametrize("orders", [(1, 2), (2, 3)])
def test_values_that_leave_the_course_together_are_followed_or_uncertain(
    length: float, orders: tuple[int, int], pitch: float
) -> None:
    """A notch of some frames, however far apart, is no stray: what the course does not follow stands in its u."""
    if length < 4.0 * pitch:
        pytest.skip("one or two frames may be strays")
    s = np.arange(0.0, 120.0, pitch)
    truth = 0.8 * (np.abs(s - 60.0) < 0.5 * length)
    y = truth + np.random.default_rng(77).normal(0.0, 0.004, s.size)
    course = fit_course(s, y, np.full(s.size, 0.004**2), orders=orders)
    inside = np.abs(s - 60.0) < 0.5 * length - max(0.3, 1.5 * pitch)  # one frame at each end may be a stray
    assert inside.any()
    assert (np.abs(course.value(s) - truth)[inside] < 3.0 * course.u(s)[inside]).all()
    far = np.abs(s - 60.0) > 0.5 * length + 25.0
    assert (course.u(s)[far] < 0.05).all()
    assert (np.abs(course.value(s))[far] < 3.0 * course.u(s)[far]).mean() > 0.99


def test_values_that_weigh_little_make_little_uncertain() -> None:
    """Three cells in a row at the limit of where they were looked for, with a u that says so, depart from nothing.

    Three of ten frames of two passes within a station of 1 mm, off by 0.8: their mean is off by 0.24.
    """
    s = np.arange(0.0, 120.0, 2.0)
    y, u = np.random.default_rng(78).normal(0.0, 0.004, s.size), np.full(s.size, 0.004)
    plain = fit_course(s, y, u**2)
    y[30:33], u[30:33] = -0.16, 1.0
    beside = fit_course(s, y, u**2)
    assert (beside.u(s) < 2.0 * plain.u(s)).all()
    y[28:35], u[28:35] = -1.2, 1.0
    assert (fit_course(s, y, u**2).u(s) < 2.0 * plain.u(s)).all()
    s, group = np.tile(np.arange(0.0, 120.0, 0.2), 2), np.repeat([0, 1], 600)
    y = np.random.default_rng(79).normal(0.0, 0.004, s.size)
    y[300:303] += 0.8
    few = fit_course(s, y, np.full(s.size, 0.004**2), group).u(s)
    assert few[301] == pytest.approx(0.24, rel=0.3)
    assert np.median(few) < 0.002


def test_how_far_passes_differ_is_told_by_what_knows_it() -> None:
    """Frames at the end of a shadow show a sliver of a face: its direction is off by degrees, and says so."""
    s, group = np.tile(np.arange(0.0, 120.0, 0.2), 2), np.repeat([0, 1], 600)
    y, u = np.random.default_rng(80).normal(0.0, 0.01, s.size), np.full(s.size, 0.01)
    y[590:600], u[590:600] = 3.0, 2.0
    course = fit_course(s, y, u**2, group)
    assert np.abs(course.value(s)).max() < 0.01
    assert course.u(s).max() < 0.01


def test_beyond_its_ends_it_goes_straight_on_and_is_known_less() -> None:
    s = np.linspace(0.0, 100.0, 400)
    y = 0.2 * s + np.random.default_rng(5).normal(0.0, 0.01, s.size)
    course = fit_course(s, y)
    beyond = np.array([-6.0, -1.0, 101.0, 106.0])
    assert (np.abs(course.value(beyond) - 0.2 * beyond) < 3.0 * course.u(beyond)).all()
    assert course.u(beyond)[0] > course.u(beyond)[1] > 0.99 * course.u(np.array([0.0]))[0]
    pair = fit_course(s, np.stack([y, -y], axis=1))
    np.testing.assert_allclose(pair.value(beyond)[:, 0], -pair.value(beyond)[:, 1], atol=1e-9)
