"""A cubic spline on equal steps that two of its derivatives hold back, compiled: what `geometry.course` asks of it.

All matrices are symmetric and banded: row i of one holds its entries with i, i - 1, i - 2 and i - 3, and with further
ones where neighbouring values share noise. So everything is linear in the length of the edge, the variances too: they
need the inverse within a few columns of its diagonal alone, which follows from the factor row by row (Takahashi et al.
1973).
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.kernels import kernel
from workbench.units import Bool, Float, Int, Shaped

BAND = 4
SLOPE_MM = 0.5  # a slope is that of the chord from so far before to so far after
FAR, APART = 1e100, 4  # products of many factors, whose logarithm is wanted: looked at every so many for an overflow
LANES = 8  # strengths that are tried at once


class LocalNoise(NamedTuple):
    """Noise that values share with those near them, in windows of values: what lies farther off counts nothing."""

    order: Shaped[Int, " n"]  # of the values along the edge
    of: Shaped[Int, "k w"]  # values of each window, in that order
    own: Shaped[Bool, "k w"]  # those that no other window has
    inverse: Shaped[Float, "k w w"]  # of their covariance
    factor: Shaped[Float, "k w w"]  # of Cholesky
    reach: int  # values before and after one that count

    @property
    def log_determinant(self) -> float:
        """Of the covariance of all."""
        return 2.0 * float(np.log(np.diagonal(self.factor, axis1=1, axis2=2)[self.own]).sum())

    def white(self, y: Float) -> Float:
        """Values y (n, d), in their own order, without the noise that they share, in units of what is left."""
        out = np.empty(y.shape)
        out[self.order] = np.linalg.solve(self.factor, y[self.order][self.of])[self.own]
        return out


@dataclass(frozen=True, slots=True, eq=False)
class Penalised:
    """The normal equations of a course: A c = B' W y with A = B' W B + Q1 / q1 + Q2 / q2 (docs/method.md, eq. (1))."""

    first: float  # arc length of the first knot within
    step: float  # between knots
    squares: float  # y' W y
    normal: Shaped[Float, "K w"]  # B' W B
    right: Shaped[Float, "K d"]  # B' W y
    roughness: Shaped[Float, "2 K BAND"]  # Q1, Q2
    waves: Float  # (2, K - lower order) their eigenvalues, but for the ends
    # coefficients p of a polynomial that is free though Q1 holds it, Q1 p and B' W B p; or (3, 0)
    free: Shaped[Float, "3 _"]

    def evidence(self, strengths: Float) -> Float:
        """Logarithm of the restricted marginal likelihood (j,) of strengths (j, 2), but for a constant (eq. (3)).

        Raises LinAlgError: a matrix is not positive definite.
        """
        scores = np.empty(len(strengths))
        _evidence(
            self.normal, self.right, self.roughness, self.waves, self.free, self.squares, as_input(strengths), scores
        )
        return _finite(scores)

    def average(self, strengths: Float, share: Float, at: Float) -> tuple[Float, Float, Float, float]:
        """Mean coefficients (K, d), variance of value and slope (m,) at places (m,), over strengths (j, 2) by shares.

        And how many values' worth the course takes. Eq. (4) of docs/method.md. Raises LinAlgError: a matrix is not
        positive definite.
        """
        before, after = np.maximum(at - SLOPE_MM, at[0]), np.minimum(at + SLOPE_MM, at[-1])
        value_first, value = self._rows(at)
        low_first, low = self._rows(before)
        high_first, high = self._rows(after)
        width = max(int((high_first - low_first).max()) + BAND, self.normal.shape[1])
        rows = np.zeros((2, at.size, width))
        rows[0, :, :BAND] = value
        rows[1, :, :BAND] = -low
        place = (high_first - low_first)[:, None] + np.arange(BAND)
        np.add.at(rows[1], (np.arange(at.size)[:, None], place), high)
        rows[1] /= (after - before)[:, None]
        firsts = np.concatenate([value_first, low_first])
        mean, variance = np.empty(self.right.shape), np.empty(2 * at.size)
        spent = _average(
            self.normal,
            self.right,
            self.roughness,
            self.free,
            as_input(strengths),
            as_input(share),
            as_input(firsts),
            as_input(rows.reshape(-1, width)),
            mean,
            variance,
        )
        return mean, _finite(variance[: at.size]), variance[at.size :], spent

    def rows(self, at: Float) -> tuple[Float, Float]:
        """What coefficients count in value and slope (m, K) at places (m,) within the knots."""
        value, slope = np.zeros((2, at.size, self.normal.shape[0]))
        before, after = np.maximum(at - SLOPE_MM, at.min()), np.minimum(at + SLOPE_MM, at.max())
        apart = np.maximum(after - before, SLOPE_MM)
        for place, factor, rows in ((at, 1.0, value), (after, 1.0 / apart, slope), (before, -1.0 / apart, slope)):
            first, values = self._rows(place)
            column = first[:, None] + np.arange(BAND)
            np.add.at(rows, (np.arange(at.size)[:, None], column), values * np.reshape(factor, (-1, 1)))
        return value, slope

    def _rows(self, s: Float) -> tuple[Int, Float]:
        """Number of the first spline that is not 0 at places (m,), and the values there (m, BAND)."""
        first, values = np.empty(s.size, np.int64), np.empty((s.size, BAND))
        _basis(as_input(s), self.first, self.step, self.normal.shape[0], first, values)
        return first, values


def penalised(
    s: Float, y: Float, weight: Float, knots: Float, orders: tuple[int, int], free: bool = False
) -> Penalised:
    """Normal equations of values y (n, d) with weights (n,) at arc lengths s (n,), on knots at equal steps.

    orders: of the derivatives that are held back, each 0 to 3, the lower one first. free: polynomials of the degree of
    the lower order are not held back all the same.
    """
    size, step = knots.size - BAND, float(knots[4] - knots[3])
    normal, right = np.zeros((size, BAND)), np.zeros((size, y.shape[1]))
    _add_up(as_input(s), as_input(y), as_input(weight), float(knots[3]), step, normal, right)
    scale = [step ** (2 * order - 1) for order in orders]
    roughness = np.stack([_differences(size, order) / by for order, by in zip(orders, scale, strict=True)])
    wave = 2.0 - 2.0 * np.cos(np.pi * np.arange(orders[0] + free, size) / size)  # eigenvalues of D1' D1
    waves = np.stack([wave**order / by for order, by in zip(orders, scale, strict=True)])
    squares = float((weight[:, None] * y**2).sum())
    line = np.zeros((3, size if free else 0))
    if free:
        line[0] = np.linspace(-1.0, 1.0, size) ** orders[0]
        line[0] /= np.linalg.norm(line[0])
        line[1], line[2] = _times(roughness[0], line[0]), _times(normal, line[0])
    return Penalised(float(knots[3]), step, squares, normal, right, roughness, waves, line)


def with_local_noise(plain: Penalised, s: Float, y: Float, noise: LocalNoise) -> Penalised:
    """The same with the normal equations of values y (n, d) at s (n,) whose noise neighbours share.

    A whole number of coefficients apart, which noise joins, the matrix has entries: it is as wide.
    """
    first, rows = plain._rows(s[noise.order])
    joined = first[min(noise.reach, s.size - 1) :]
    width = int((joined - first[: joined.size]).max()) + BAND
    normal, right = np.zeros((plain.normal.shape[0], width)), np.zeros(plain.right.shape)
    squares = _add_shared(noise.of, noise.own, noise.inverse, first, rows, as_input(y[noise.order]), normal, right)
    free = plain.free
    if free.shape[1]:
        free = np.stack([free[0], free[1], _times(normal, free[0])])
    return replace(plain, squares=squares, normal=normal, right=right, free=free)


def _times(matrix: Float, x: Float) -> Float:
    """Product of a matrix (K, w) with x (K,)."""
    out = matrix[:, 0] * x
    for k in range(1, matrix.shape[1]):
        out[k:] += matrix[k:, k] * x[:-k]
        out[:-k] += matrix[k:, k] * x[k:]
    return np.asarray(out)


def _finite(values: Float) -> Float:
    if not np.isfinite(values).all():
        raise np.linalg.LinAlgError("normal equations of a course: not positive definite")
    return values


@functools.lru_cache(64)
def _differences(size: int, order: int) -> Float:
    """D' D of the differences of an order, (size, BAND); not to be changed."""
    row = np.array([(-1.0) ** (order - k) * math.comb(order, k) for k in range(order + 1)])
    out = np.zeros((size, BAND))
    for first in range(order + 1):
        for second in range(first, order + 1):
            out[second : size - order + second, second - first] += row[first] * row[second]
    return out


@kernel
def _splines(s: float, first_knot: float, step: float, size: int) -> tuple[int, float, float, float, float]:
    """Number of the first cubic spline that is not 0 at s, and the values of the four that are not."""
    i = min(max(math.floor((s - first_knot) / step), 0), size - 4)
    u = min(max((s - first_knot) / step - i, 0.0), 1.0)
    v = 1.0 - u
    return (
        i,
        v * v * v / 6.0,
        (3.0 * u * u * u - 6.0 * u * u + 4.0) / 6.0,
        (3.0 * v * v * v - 6.0 * v * v + 4.0) / 6.0,
        u * u * u / 6.0,
    )


@kernel
def _basis(s: Float, first_knot: float, step: float, size: int, first: Int, values: Float) -> None:
    for k in range(s.size):
        first[k], values[k, 0], values[k, 1], values[k, 2], values[k, 3] = _splines(s[k], first_knot, step, size)


@kernel
def _add_up(s: Float, y: Float, weight: Float, first_knot: float, step: float, normal: Float, right: Float) -> None:
    row = np.empty(4)
    for k in range(s.size):
        i, row[0], row[1], row[2], row[3] = _splines(s[k], first_knot, step, right.shape[0])
        for p in range(4):
            for q in range(p + 1):
                normal[i + p, p - q] += weight[k] * row[p] * row[q]
            for d in range(right.shape[1]):
                right[i + p, d] += weight[k] * row[p] * y[k, d]


@kernel
def _add_shared(
    of: Int, own: Bool, inverse: Float, first: Int, rows: Float, y: Float, normal: Float, right: Float
) -> float:
    """Add to B' M B and B' M y what windows of values (k, w) count with their inverses (k, w, w); and return y' M y."""
    squares, width = 0.0, normal.shape[1]
    for k in range(of.shape[0]):
        for a in range(of.shape[1]):
            if not own[k, a]:
                continue
            i = of[k, a]
            for b in range(of.shape[1]):
                j, m = of[k, b], inverse[k, a, b]
                for d in range(y.shape[1]):
                    squares += y[i, d] * m * y[j, d]
                for p in range(BAND):
                    part = rows[i, p] * m
                    for d in range(y.shape[1]):
                        right[first[i] + p, d] += part * y[j, d]
                    for q in range(BAND):
                        apart = first[i] + p - first[j] - q
                        if 0 <= apart < width:
                            normal[first[i] + p, apart] += part * rows[j, q]
    return squares


@kernel(error_model="numpy")
def _factor(normal: Float, roughness: Float, held: Float, low: Float, logs: Float) -> None:
    """Fill `low` (w - 1 + K, w, L) with the factors of A for L strengths, 1 / the diagonal in column 0; its logs (L,).

    held (2, L): 1 / strengths. The first w - 1 rows are 0. Each row waits for the one before: several strengths at once
    take little longer than one.
    """
    (size, width), lanes = normal.shape, logs.size
    product = np.ones(lanes)
    low[: width - 1] = 0.0
    logs[:] = 0.0
    for i in range(size):
        here = low[i + width - 1]
        for k in range(width - 1, -1, -1):
            earlier, n = low[i + width - 1 - k], normal[i, k]
            p, q = (roughness[0, i, k], roughness[1, i, k]) if k < BAND else (0.0, 0.0)
            for m in range(lanes):
                here[k, m] = n + held[0, m] * p + held[1, m] * q
            for j in range(k + 1, width):
                for m in range(lanes):
                    here[k, m] -= here[j, m] * earlier[j - k, m]
            for m in range(lanes):
                if k:
                    here[k, m] *= earlier[0, m]
                else:
                    root = math.sqrt(here[0, m])
                    here[0, m] = 1.0 / root
                    product[m] *= root
        if i % APART == 0:
            _take_apart(product, logs)
    for m in range(lanes):
        logs[m] += math.log(product[m])


@kernel
def _take_apart(product: Float, logs: Float) -> None:
    """Move factors (L,) that run out of the numbers' range to their logarithms (L,)."""
    for m in range(logs.size):
        if not 1.0 / FAR < product[m] < FAR:
            logs[m], product[m] = logs[m] + math.log(product[m]), 1.0


@kernel
def _forward(low: Float, right: Float, d: int, out: Float) -> None:
    """Fill `out` (w - 1 + K, L) with the solutions of L out = right[:, d] for the factors of `low`, below rows of 0."""
    width, lanes = low.shape[1], out.shape[1]
    out[: width - 1] = 0.0
    for i in range(width - 1, low.shape[0]):
        for m in range(lanes):
            out[i, m] = right[i - width + 1, d]
        for k in range(width - 1, 0, -1):
            for m in range(lanes):
                out[i, m] -= low[i, k, m] * out[i - k, m]
        for m in range(lanes):
            out[i, m] *= low[i, 0, m]


@kernel
def _backward(low: Float, solved: Float) -> None:
    """Replace `solved` (K,) by the solution of L' x = solved."""
    size, width = low.shape
    for i in range(size - 1, -1, -1):
        w = solved[i]
        for k in range(1, min(size - i, width)):
            w -= low[i + k, k] * solved[i + k]
        solved[i] = w * low[i, 0]


@kernel(error_model="numpy")
def _evidence(
    normal: Float,
    right: Float,
    roughness: Float,
    waves: Float,
    free: Float,
    squares: float,
    strengths: Float,
    scores: Float,
) -> None:
    (size, components), is_free, width = right.shape, free.shape[1] > 0, normal.shape[1]
    fixed, rows = 0.0, size + width - 1
    for i in range(free.shape[1]):
        fixed += free[0, i] * free[1, i]
    for first in range(0, strengths.shape[0], LANES):
        lanes = min(LANES, strengths.shape[0] - first)
        held, logs, misfit, inner = np.empty((2, lanes)), np.empty(lanes), np.full(lanes, squares), np.zeros(lanes)
        for m in range(lanes):
            held[0, m], held[1, m] = 1.0 / strengths[first + m, 0], 1.0 / strengths[first + m, 1]
        low, solved, bent = np.empty((rows, width, lanes)), np.empty((rows, lanes)), np.empty((rows, lanes))
        _factor(normal, roughness, held, low, logs)
        if is_free:
            _forward(low, free[1:2].T, 0, bent)
            _forward(low, free[2:3].T, 0, solved)
            _products(bent, solved, inner)
            for m in range(lanes):
                logs[m] += 0.5 * math.log(inner[m] / fixed)  # both over the strength
        for d in range(components):
            _forward(low, right, d, solved)
            left, total = np.zeros(lanes), np.zeros(lanes)
            _products(solved, solved, total)
            if is_free:
                _products(solved, bent, left)
            for m in range(lanes):
                misfit[m] -= total[m]
                if is_free:
                    misfit[m] -= left[m] * left[m] * held[0, m] / inner[m]
        _half_determinant(waves, held, logs)
        for m in range(lanes):
            scores[first + m] = -0.5 * misfit[m] - components * logs[m]


@kernel
def _products(one: Float, other: Float, out: Float) -> None:
    """Add to `out` (L,) the products of columns of two arrays (n, L)."""
    for i in range(one.shape[0]):
        for m in range(out.size):
            out[m] += one[i, m] * other[i, m]


@kernel
def _half_determinant(waves: Float, held: Float, logs: Float) -> None:
    """Take half of the logarithms of the prior's determinant off `logs` (L,)."""
    product, total = np.ones(logs.size), np.zeros(logs.size)
    for k in range(waves.shape[1]):
        for m in range(logs.size):
            product[m] *= waves[0, k] * held[0, m] + waves[1, k] * held[1, m]
        if k % APART == 0:
            _take_apart(product, total)
    for m in range(logs.size):
        logs[m] -= 0.5 * (total[m] + math.log(product[m]))


@kernel
def _inverse(low: Float, out: Float) -> None:
    """Fill `out` (K, w) with the inverse's entries (i, i) to (i, i + w - 1), from the last row up."""
    size, width = out.shape
    for i in range(size - 1, -1, -1):
        for m in range(width - 1, -1, -1):
            total = low[i, 0] if m == 0 else 0.0
            for k in range(1, min(size - i, low.shape[1])):
                if i + m < size:
                    total -= low[i + k, k] * out[i + min(m, k), abs(m - k)]
            out[i, m] = total * low[i, 0] if i + m < size else 0.0


@kernel(error_model="numpy")
def _average(
    normal: Float,
    right: Float,
    roughness: Float,
    free: Float,
    strengths: Float,
    share: Float,
    first: Int,
    rows: Float,
    mean: Float,
    variance: Float,
) -> float:
    """Fill mean (K, d) and variance (m,) of rows (m, w), each from its first coefficient on; return what is spent."""
    spent = 0.0
    size, components = right.shape
    width = rows.shape[1]
    before = normal.shape[1] - 1
    factors, held, logs = np.empty((before + size, before + 1, 1)), np.empty((2, 1)), np.empty(1)
    one, other = np.zeros((before + size, 1)), np.zeros((before + size, 1))
    low, inverse = factors.reshape((before + size, before + 1))[before:], np.empty((size, width))
    bent, solved = one.reshape(before + size)[before:], other.reshape(before + size)[before:]
    is_free, inner = free.shape[1] > 0, 0.0
    found = np.empty((strengths.shape[0], size, components))
    mean[:] = 0.0
    variance[:] = 0.0
    for j in range(strengths.shape[0]):
        held[0, 0], held[1, 0] = 1.0 / strengths[j, 0], 1.0 / strengths[j, 1]
        _factor(normal, roughness, held, factors, logs)
        if is_free:
            _forward(factors, free[1:2].T, 0, one)
            _backward(low, bent)
            inner = 0.0
            for i in range(size):
                bent[i] /= strengths[j, 0]
                inner += bent[i] * free[2, i]
        for d in range(components):
            _forward(factors, right, d, other)
            _backward(low, solved)
            added = 0.0
            if is_free:
                for i in range(size):
                    added += free[1, i] / strengths[j, 0] * solved[i] / inner
            for i in range(size):
                found[j, i, d] = solved[i] + added * bent[i]
                mean[i, d] += share[j] * found[j, i, d]
        _inverse(low, inverse)
        spent += share[j] * _spent(normal, inverse, bent, inner)
        for r in range(first.size):
            total = _form(rows, r, first[r], inverse)
            if is_free:
                off = 0.0
                for p in range(min(width, size - first[r])):
                    off += rows[r, p] * bent[first[r] + p]
                total += off * off / inner
            variance[r] += share[j] * total
    _add_spread(found, mean, share, first, rows, variance)
    return spent


@kernel(error_model="numpy")
def _spent(normal: Float, inverse: Float, bent: Float, inner: float) -> float:
    """Trace of the inverse (`_inverse`), with what is free of bent (K,) if inner is not 0, times B' M B."""
    total = 0.0
    for i in range(normal.shape[0]):
        for k in range(min(i + 1, normal.shape[1])):
            entry = inverse[i - k, k]
            if inner != 0.0:
                entry += bent[i - k] * bent[i] / inner
            total += (2.0 if k else 1.0) * normal[i, k] * entry
    return total


@kernel(error_model="numpy")
def _form(rows: Float, r: int, start: int, inverse: Float) -> float:
    """Row r, from coefficient `start` on, times the inverse (`_inverse`) times itself."""
    size, width = inverse.shape
    total = 0.0
    for p in range(min(width, size - start)):
        part = 0.5 * rows[r, p] * inverse[start + p, 0]
        for q in range(p):
            part += rows[r, q] * inverse[start + q, p - q]
        total += 2.0 * rows[r, p] * part
    return total


@kernel(error_model="numpy")
def _add_spread(found: Float, mean: Float, share: Float, first: Int, rows: Float, variance: Float) -> None:
    """Add to the variance (m,) how far each answer (K, d) of `found` lies off their mean, by its share."""
    size, components = mean.shape
    for j in range(share.size):
        for r in range(first.size):
            for d in range(components):
                off = 0.0
                for p in range(min(rows.shape[1], size - first[r])):
                    off += rows[r, p] * (found[j, first[r] + p, d] - mean[first[r] + p, d])
                variance[r] += share[j] * off * off / components
