"""Local polynomial regression along the edge: values at unevenly spaced arc lengths, weighted, robust."""

from __future__ import annotations

import numpy as np
from numba import njit

from workbench.units import Float

OUTLIER_SIGMAS = 5.0


@njit(cache=True, nogil=True)
def _solve3(a: Float, b: Float) -> Float:
    """Solve a 3 x 3 positive system (small matrices: Cramer's rule beats a library call)."""
    det = (a[0, 0] * (a[1, 1] * a[2, 2] - a[1, 2] * a[2, 1]) - a[0, 1] * (a[1, 0] * a[2, 2] - a[1, 2] * a[2, 0])
           + a[0, 2] * (a[1, 0] * a[2, 1] - a[1, 1] * a[2, 0]))  # fmt: skip
    out = np.empty(3)
    for k in range(3):
        m = a.copy()
        m[:, k] = b
        out[k] = (m[0, 0] * (m[1, 1] * m[2, 2] - m[1, 2] * m[2, 1]) - m[0, 1] * (m[1, 0] * m[2, 2] - m[1, 2] * m[2, 0])
                  + m[0, 2] * (m[1, 0] * m[2, 1] - m[1, 1] * m[2, 0])) / det  # fmt: skip
    return out


@njit(cache=True, nogil=True)
def _design(u: float, degree: int) -> Float:
    row = np.zeros(3)
    row[0] = 1.0
    if degree > 0:
        row[1] = u
    if degree > 1:
        row[2] = u * u
    return row


@njit(cache=True, nogil=True)
def local_polynomial(s: Float, y: Float, weight: Float, at: Float, half_width: float) -> Float:
    """Local regression of y on s at the points `at`: columns value, slope, variance factor, points used.

    s (n,) sorted; y (n,); weight (n,) inverse variances (0: left out); at (m,). Tricube weights of half width
    `half_width` (units of s) around each point. Quadratic where at least 7 points lie on both sides, else linear, else
    constant. The variance of a value is its variance factor if the weights are true. NaN where no point is near.
    """
    out = np.full((at.size, 4), np.nan)
    for i in range(at.size):
        first = np.searchsorted(s, at[i] - half_width)
        last = np.searchsorted(s, at[i] + half_width)
        normal, right, spread = np.zeros((3, 3)), np.zeros(3), np.zeros((3, 3))
        count, before, after = 0, 0, 0
        for j in range(first, last):
            if not weight[j] > 0:
                continue
            count += 1
            if s[j] < at[i] - 0.1 * half_width:
                before += 1
            if s[j] > at[i] + 0.1 * half_width:
                after += 1
        if count < 1:
            continue
        degree = 2 if count >= 7 and before >= 2 and after >= 2 else (1 if count >= 4 else 0)
        for j in range(first, last):
            if not weight[j] > 0:
                continue
            u = (s[j] - at[i]) / half_width
            near = (1.0 - abs(u) ** 3) ** 3
            row = _design(u, degree)
            for p in range(3):
                right[p] += near * weight[j] * row[p] * y[j]
                for q in range(3):
                    normal[p, q] += near * weight[j] * row[p] * row[q]
                    spread[p, q] += near * near * weight[j] * row[p] * row[q]
        for p in range(degree + 1, 3):
            normal[p, p] = 1.0
        for p in range(degree + 1):
            normal[p, p] *= 1.0 + 1e-10
        value = _solve3(normal, right)
        lever = _solve3(normal, np.array([1.0, 0.0, 0.0]))
        out[i, 0], out[i, 1] = value[0], value[1] / half_width
        out[i, 2] = max(lever @ spread @ lever, 0.0)
        out[i, 3] = count
    return out


def robust_weights(s: Float, y: Float, weight: Float, half_width: float, stations: Float) -> Float:
    """`weight` (n,) with the outliers of y (n,) about its own local regression set to 0. s (n,) sorted."""
    kept = weight.copy()
    for _ in range(2):
        fit = local_polynomial(s, y, kept, stations, half_width)[:, 0]
        good = np.isfinite(fit)
        if good.sum() < 2:
            return kept
        z = np.abs(y - np.interp(s, stations[good], fit[good])) * np.sqrt(weight)
        scale = float(np.median(z[weight > 0])) / 0.6745 if (weight > 0).any() else 1.0
        kept = np.where(z <= OUTLIER_SIGMAS * max(scale, 1e-12), weight, 0.0)
    return kept
