"""Errors that values along an edge share, and a course held against them: those of a robot on its way, above all."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from workbench.geometry.penalised import BAND, LocalNoise, Penalised
from workbench.units import AnyArray, Float, Int, Shaped

WINDOW = 16  # values of each pass on either side of one: farther off, what roughness makes alike is below 1e-6
LEAST = 1e-3  # of a process is each value's own: values without noise leave no matrix that can be factored


class Process(NamedTuple):
    """A stationary Gaussian process of the arc length, each pass its own: correlation exp(-(d / length)^2 / 2).

    What is not `by_pass` is the part's own, and all passes have it. One of `jerks` has the correlation exp(-d / length)
    (Uhlenbeck and Ornstein, Phys. Rev. 36 (1930), 823).

    Example:
        >>> shared = Process(0.05, 10.0).covariance(np.array([0.0, 10.0]), np.zeros(2), np.zeros(2, int))
        >>> [round(1e4 * float(one), 1) for one in shared[0]]
        [25.0, 15.2]
    """

    strength: float  # standard deviation of a value, in its unit
    length_mm: float
    share: float = 1.0  # of what is held possible
    by_pass: bool = True
    jerks: bool = False

    def covariance(self, s: Float, spread: Float, group: Int) -> Float:
        """Covariance (..., b, b) of means over values that lie about s (..., b) by `spread`, mm, in passes `group`."""
        off, wide = (np.subtract(*_pairs(s)), np.add(*_pairs(spread**2)))
        if self.jerks:  # values of two bins lie so far apart on average, however near the bins
            alike = np.exp(-np.hypot(off, np.sqrt(2.0 / math.pi * wide)) / self.length_mm)
        else:
            wide = wide + self.length_mm**2
            alike = self.length_mm / np.sqrt(wide) * np.exp(-0.5 * off**2 / wide)
        mine = np.equal(*_pairs(group)) if self.by_pass else True
        return np.asarray(np.where(mine, self.strength**2 * alike, 0.0))

    def near(self, s: Float, spread: Float, variance: Float, passes: int) -> LocalNoise:
        """What values share by a process that is short beside the edge, with variances (b,) of their own."""
        order, reach = np.argsort(s, kind="stable"), WINDOW * passes
        width = min(s.size, 4 * reach)
        starts = np.arange(0, s.size, 2 * reach if width < s.size else width)
        index = np.clip(starts - reach, 0, s.size - width)[:, None] + np.arange(width)
        own = (index >= starts[:, None]) & (index < np.append(starts[1:], s.size)[:, None])
        covariance = self.covariance(s[order[index]], spread[order[index]], order[index])
        covariance += variance[order[index]][..., None] * np.eye(width)
        inverse, factor = (np.asarray(of(covariance), dtype=float) for of in (np.linalg.inv, np.linalg.cholesky))
        return LocalNoise(order, index, own, inverse, factor, reach)

    @property
    def least_variance(self) -> float:
        """Of the noise of values beside it."""
        return (LEAST * self.strength) ** 2

    def slope_u(self, over_mm: float) -> float:
        """Standard deviation of its rise over a way, by that way; of a long process that of its slope.

        >>> round(Process(0.05, 10.0).slope_u(1e-3), 6), round(Process(0.05, 1e-3).slope_u(20.0), 6)
        (0.005, 0.003536)
        """
        lengths = over_mm / self.length_mm
        return self.strength * math.sqrt(-2.0 * math.expm1(-lengths if self.jerks else -0.5 * lengths**2)) / over_mm

    def density(self, wave_mm: float) -> float:
        """Of waves of this length: the variance that they have a wave number, times 2 pi; unit squared times mm."""
        waves = 2.0 * math.pi * self.length_mm / wave_mm
        if self.jerks:
            return 2.0 * self.strength**2 * self.length_mm / (1.0 + waves**2)
        return self.strength**2 * math.sqrt(2.0 * math.pi) * self.length_mm * math.exp(-0.5 * waves**2)


def _pairs(of: AnyArray) -> tuple[AnyArray, AnyArray]:
    """Each of (..., b) against each."""
    return of[..., :, None], of[..., None, :]


class Shared(NamedTuple):
    """What values along an edge share beside their own noise."""

    over_mm: float | None = None  # length over which they share their scatter: bins are as long, waves four times
    processes: tuple[Process, ...] = ()  # one of these, by their shares; passes then need no offsets of their own
    may_step: bool = False  # a step within a pass is looked for
    resolution: float = 0.0  # by which values differ at least where they differ, as ends of columns do
    may_be_rough: bool = False  # what is shorter than a course's waves may be no course, and noise of all passes

    @property
    def possible(self) -> list[tuple[Process | None, float]]:
        """The processes and their shares; or that there is none."""
        return [(one, one.share) for one in self.processes] or [(None, 1.0)]


ROUGH = Shared(may_be_rough=True)


@dataclass(frozen=True, slots=True, eq=False)
class Correlated:
    """The normal equations of a course through values whose noise has any covariance: as `Penalised`, but full."""

    plain: Penalised  # of the same values, for the spline and what holds it back
    squares: float  # y' M y, M the inverse of the covariance
    normal: Shaped[Float, "K K"]  # B' M B
    right: Shaped[Float, "K d"]  # B' M y
    roughness: Shaped[Float, "2 K K"]
    basis: Shaped[Float, "n K"]
    inverse: Shaped[Float, "n n"]  # M
    known: dict[bytes, Float] = field(default_factory=dict)  # covariances by strengths: they are asked for thrice

    def evidence(self, strengths: Float) -> Float:
        """As `Penalised.evidence`, of values whatever the covariance of their noise. Raises LinAlgError likewise."""
        size, components = self.right.shape
        one, other = strengths.T[:, :, None]
        prior = np.log(self.plain.waves[0] / one + self.plain.waves[1] / other).sum(axis=1)
        # the Cholesky factor of A, and L^-1 B' M y as rows below it
        both = np.empty((len(strengths), size + components, size + components))
        both[:, :size, :size] = self.normal
        for strength, rough in zip((one, other), self.roughness, strict=True):
            both[:, :size, :size] += rough / strength[..., None]
        both[:, size:, :size], both[:, :size, size:] = self.right.T, self.right
        both[:, size:, size:] = np.diag(np.full(components, 2.0 * self.squares + 1.0))
        low = np.linalg.cholesky(both)
        logs = np.log(np.diagonal(low, axis1=1, axis2=2)[:, :size]).sum(axis=1) - 0.5 * prior
        scores = 0.5 * (low[:, size:, :size] ** 2).sum(axis=(1, 2)) - components * logs
        return np.asarray(scores - 0.5 * self.squares + 0.5 * components * np.linalg.slogdet(self.inverse)[1])

    def average(self, strengths: Float, share: Float, at: Float) -> tuple[Float, Float, Float, float]:
        """As `Penalised.average`. Raises LinAlgError likewise."""
        covariance = self.covariance(strengths)
        answers = covariance @ self.right
        mean = np.tensordot(share, answers, 1)
        off = np.concatenate(np.asarray(answers - mean), axis=1)
        spread = np.tensordot(share, covariance, 1) + off * np.repeat(share / mean.shape[1], mean.shape[1]) @ off.T
        value, slope = self._variances(spread, at)
        return mean, value, slope, float(share @ (covariance * self.normal).sum(axis=(1, 2)))

    def variance_by(self, noise: Float, strengths: Float, share: Float, at: Float) -> Float:
        """What of the variances (2, m) of value and slope at places (m,) is by noise of covariance (n, n)."""
        weighted, gain = self.inverse @ self.basis, self.covariance(strengths)
        return self._variances(np.tensordot(share, gain @ (weighted.T @ noise @ weighted) @ gain, 1), at)

    def _variances(self, spread: Float, at: Float) -> Float:
        """Those (2, m) of value and slope at places (m,) by the covariance (K, K) of the coefficients."""
        return np.stack([((rows @ spread) * rows).sum(axis=1) for rows in self.plain.rows(at)])

    def covariance(self, strengths: Float) -> Float:
        """Of the coefficients (j, K, K), by pairs of strengths (j, 2). Raises LinAlgError likewise."""
        key = strengths.tobytes()
        if key not in self.known:
            one, other = strengths.T[:, :, None, None]
            self.known[key] = np.linalg.inv(self.normal + self.roughness[0] / one + self.roughness[1] / other)
        return self.known[key]


def shape_sizes(problem: Correlated, y: Float, shapes: Float, strengths: Float) -> tuple[Float, Float]:
    """Sizes (j, k) of shapes (n, k) in the values y (n,), each beside the course alone, and their u (j, k).

    By generalised least squares under each of the strengths (j, 2).
    """
    weighted = problem.inverse @ shapes
    mixed, square, shown = problem.basis.T @ weighted, (shapes * weighted).sum(axis=0), y @ weighted
    solved = problem.covariance(strengths) @ np.column_stack([mixed, problem.right[:, 0]])
    known = np.maximum(square - (mixed * solved[:, :, :-1]).sum(axis=1), 1e-300)
    return (shown - solved[:, :, -1] @ mixed) / known, 1.0 / np.sqrt(known)


def correlated(plain: Penalised, s: Float, y: Float, inverse: Float) -> Correlated:
    """Normal equations of values y (n, d) at s (n,) with the inverse (n, n) of their noise's covariance."""
    basis, _ = plain.rows(s)
    roughness = np.stack([_full(one) for one in plain.roughness])
    if plain.free.shape[1]:  # a polynomial that is not held back
        held, along = plain.free[1], float(plain.free[0] @ plain.free[1])
        roughness[0] -= np.outer(held, held) / along
    weighted = inverse @ basis
    squares = float(np.einsum("nd,nm,md->", y, inverse, y))
    return Correlated(plain, squares, basis.T @ weighted, weighted.T @ y, roughness, basis, inverse)


def _full(banded: Float) -> Float:
    """A symmetric matrix (K, K) from its bands (K, BAND)."""
    out = np.diag(banded[:, 0])
    for k in range(1, BAND):
        out += np.diag(banded[k:, k], -k) + np.diag(banded[k:, k], k)
    return out
