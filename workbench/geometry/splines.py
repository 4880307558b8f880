"""Splines of degree 3 and less, compiled: piece by piece as polynomials, each kernel in one pass over its places."""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.kernels import kernel
from workbench.units import Float, Shaped

CUBIC = 3


@dataclass(frozen=True, slots=True, eq=False)
class Polynomials:
    """n polynomials of u = x - breaks[i], each from its break to the next; the first and the last go on beyond."""

    breaks: Float  # (n + 1,) rising
    powers: Shaped[Float, "n 4 d"]  # of u^0 to u^3

    def __call__(self, x: Float, order: int = 0, straight: bool = False) -> Float:
        """(..., d) at x (...): values, or first or second derivatives; `straight`: beyond the ends on the tangents."""
        at = np.asarray(x, dtype=float)
        out = np.empty((at.size, self.powers.shape[2]))
        _evaluate(self.breaks, self.powers, as_input(at.reshape(-1)), order, straight, out)
        return out.reshape(*at.shape, out.shape[1])


@dataclass(frozen=True, eq=False)
class Spline:
    """A spline by its knots and coefficients, as scipy.interpolate.BSpline has them."""

    t: Float  # (K + k + 1,) knots
    c: Shaped[Float, "K ..."]  # coefficients of one quantity, or of several
    k: int = CUBIC

    @functools.cached_property
    def pieces(self) -> Polynomials:
        """The same, piece by piece (de Boor, A Practical Guide to Splines, 2001, ch. IX and X)."""
        breaks = as_input(self.t[self.k : self.t.size - self.k])
        powers = np.zeros((breaks.size - 1, CUBIC + 1, 1 if self.c.ndim == 1 else self.c.shape[1]))
        _expand(as_input(self.t), as_input(self.c.reshape(len(self.c), -1)), self.k, powers)
        return Polynomials(breaks, as_input(powers))

    @property
    def ends(self) -> tuple[float, float]:
        """Where the first piece begins and the last one ends."""
        return float(self.t[self.k]), float(self.t[-1 - self.k])

    def __call__(self, x: Float, order: int = 0) -> Float:
        """Values at x (m,), or first or second derivatives: (m,) or (m, d); the pieces at the ends go on."""
        return self._shaped(self.pieces(x, order))

    def straight_on(self, x: Float) -> Float:
        """Values at x (m,), but beyond the ends on the tangents there: (m,) or (m, d)."""
        return self._shaped(self.pieces(x, straight=True))

    def _shaped(self, values: Float) -> Float:
        return values.reshape(values.shape[:-1] + self.c.shape[1:])


def through(x: Float, y: Float) -> Spline:
    """The cubic spline through values y (n,) or (n, d) at rising places x (n,); n < 4: of degree n - 1.

    No break at the second place and the last but one (de Boor, ch. IV, not-a-knot).

    Example:
        >>> x = np.array([0.0, 1.0, 2.5, 3.0, 4.0, 6.0])
        >>> bool(abs(through(x, x**3)(np.array([5.0]))[0] - 125.0) < 1e-9)
        True
    """
    k = min(CUBIC, x.size - 1)
    t, c = np.concatenate([[x[0]] * (k + 1), x[2:-2], [x[-1]] * (k + 1)]), y.reshape(len(y), -1).astype(float)
    rows = np.zeros((x.size, 2 * k + 1))
    _at_places(as_input(t), as_input(x), k, rows)
    _solve(rows, k, c)
    return Spline(t, c.reshape(y.shape), k)


def hermite(x: Float, y: Float, slope: Float) -> Polynomials:
    """The curve through y (n, d) with slopes (n, d) at rising places x (n,), n >= 2 (de Boor, ch. IV, eq. (6)).

    Example:
        >>> x = np.array([0.0, 1.0, 3.0])[:, None]
        >>> float(hermite(x[:, 0], x**3, 3.0 * x**2)(2.0)[0])
        8.0
    """
    h, first = np.diff(x)[:, None], slope[:-1]
    chord = np.diff(y, axis=0) / h
    cube = (first + slope[1:] - 2.0 * chord) / h
    return Polynomials(as_input(x), as_input(np.stack([y[:-1], first, (chord - first) / h - cube, cube / h], axis=1)))


@kernel
def _at_places(t: Float, x: Float, k: int, rows: Float) -> None:
    """Fill rows (n, 2 k + 1): at x[i] the values of the splines i - k to i + k of degree k on knots t (n + k + 1,)."""
    j, value = k, np.empty(k + 1)
    for i in range(x.size):
        while j < x.size - 1 and x[i] >= t[j + 1]:
            j += 1
        value[:] = 0.0  # of the splines j - k to j, that are not 0 here
        value[k] = 1.0
        for degree in range(1, k + 1):
            for r in range(k - degree, k + 1):
                knot, of, after = j - k + r, value[r], value[r + 1] if r < k else 0.0
                value[r] = (x[i] - t[knot]) / (t[knot + degree] - t[knot]) * of if r > k - degree else 0.0
                if r < k:
                    value[r] += (t[knot + degree + 1] - x[i]) / (t[knot + degree + 1] - t[knot + 1]) * after
        for r in range(k + 1):
            rows[i, j + r - i] = value[r]


@kernel
def _solve(rows: Float, k: int, c: Float) -> None:
    """Replace right sides c (n, d) by the solutions; without pivots, as the matrix is totally positive."""
    size, components = c.shape
    for i in range(size):
        for below in range(i + 1, min(i + k + 1, size)):
            factor = rows[below, k + i - below] / rows[i, k]
            for m in range(k + 1):
                rows[below, k + i - below + m] -= factor * rows[i, k + m]
            for d in range(components):
                c[below, d] -= factor * c[i, d]
    for i in range(size - 1, -1, -1):
        for d in range(components):
            for m in range(1, min(k, size - 1 - i) + 1):
                c[i, d] -= rows[i, k + m] * c[i + m, d]
            c[i, d] /= rows[i, k]


@kernel
def _expand(t: Float, c: Float, degree: int, powers: Float) -> None:
    """Fill `powers` (n, 4, d): derivatives at each piece's first knot over factorials."""
    left, e = np.empty(degree + 1), np.empty(degree + 1)
    for i in range(powers.shape[0]):
        j = degree + i
        for d in range(c.shape[1]):
            for r in range(degree + 1):
                left[r] = c[i + r, d]
            factorial = 1.0
            for m in range(degree + 1):
                p = degree - m
                if m > 0:
                    factorial *= m
                    for r in range(degree, m - 1, -1):
                        left[r] = (p + 1) * (left[r] - left[r - 1]) / (t[i + r + p + 1] - t[i + r])
                for r in range(m, degree + 1):
                    e[r] = left[r]
                for level in range(1, p + 1):
                    for r in range(degree, m + level - 1, -1):
                        share = (t[j] - t[i + r]) / (t[i + r + p + 1 - level] - t[i + r])
                        e[r] = (1.0 - share) * e[r - 1] + share * e[r]
                powers[i, m, d] = e[degree] / factorial


@kernel
def piece_of(breaks: Float, x: float) -> int:
    """Number of the piece that x lies in, the nearest one beyond the ends; quick where breaks are evenly spaced."""
    last = breaks.size - 2
    if not x > breaks[0]:
        return 0
    if x >= breaks[last]:
        return last
    i = min(int((x - breaks[0]) / (breaks[last + 1] - breaks[0]) * (last + 1)), last)
    while x < breaks[i]:
        i -= 1
    while x >= breaks[i + 1]:
        i += 1
    return i


@kernel
def derivatives(powers: Float, i: int, d: int, u: float) -> tuple[float, float, float]:
    """Value, first and second derivative of component d of piece i at u from its break."""
    a0, a1, a2, a3 = powers[i, 0, d], powers[i, 1, d], powers[i, 2, d], powers[i, 3, d]
    return a0 + u * (a1 + u * (a2 + u * a3)), a1 + u * (2.0 * a2 + 3.0 * u * a3), 2.0 * a2 + 6.0 * u * a3


@kernel
def _evaluate(breaks: Float, powers: Float, x: Float, order: int, straight: bool, out: Float) -> None:
    for m in range(x.size):
        at = min(max(x[m], breaks[0]), breaks[-1]) if straight else x[m]
        i = piece_of(breaks, at)
        u = at - breaks[i]
        for d in range(out.shape[1]):
            value, first, second = derivatives(powers, i, d, u)
            if straight:
                out[m, d] = value + (x[m] - at) * first
            elif order == 0:
                out[m, d] = value
            elif order == 1:
                out[m, d] = first
            else:
                out[m, d] = second
