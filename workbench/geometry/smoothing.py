"""Local polynomial regression along the edge: values at unevenly spaced arc lengths, weighted, robust."""

from __future__ import annotations

import numpy as np

from workbench.geometry.blocks import as_input
from workbench.kernels import kernel
from workbench.units import Float, Int

OUTLIER_SIGMAS = 5.0
RIDGE = 1.0 + 1e-10  # keeps the normal equations regular where all points share one place


def local_polynomial(s: Float, y: Float, weight: Float, at: Float, half_width: float) -> Float:
    """Local regression of y on s at the points `at`: columns value, slope, variance factor, points used.

    s (n,) sorted; y (n,); weight (n,) inverse variances (0: left out); at (m,). Tricube weights of half width
    `half_width` (units of s) around each point. Quadratic where at least 7 points lie on both sides, else linear, else
    constant. The variance of a value is its variance factor if the weights are true. NaN where no point is near.
    """
    out = np.full((at.size, 4), np.nan)
    first, last = np.searchsorted(s, at - half_width), np.searchsorted(s, at + half_width)
    s, y, weight, at = (as_input(v.astype(np.float64, copy=False)) for v in (s, y, weight, at))
    _regress(s, y, weight, at, as_input(first), as_input(last), half_width, out)
    return out


@kernel(fastmath={"reassoc", "contract"})
def _regress(s: Float, y: Float, weight: Float, at: Float, first: Int, last: Int, half_width: float,
             out: Float) -> None:  # fmt: skip
    """Fill each row i of `out` as `local_polynomial` returns it, from the points first[i] to last[i] - 1."""
    for i in range(at.size):
        count, before, after = 0, 0, 0
        m0, m1, m2, m3, m4 = 0.0, 0.0, 0.0, 0.0, 0.0  # weighted sums of the powers of u
        v0, v1, v2, v3, v4 = 0.0, 0.0, 0.0, 0.0, 0.0  # the same with the tricube weight squared
        b0, b1, b2 = 0.0, 0.0, 0.0  # weighted sums of the powers of u times y
        for j in range(first[i], last[i]):
            used = weight[j] > 0
            u = (s[j] - at[i]) / half_width
            count += used
            before += used and u < -0.1
            after += used and u > 0.1
            near = 1.0 - abs(u) * u * u
            near = near * near * near
            w = near * weight[j] if used else 0.0
            v, wy = near * w, w * y[j] if used else 0.0
            wu, vu = w * u * u, v * u * u
            m0, m1, m2, m3, m4 = m0 + w, m1 + w * u, m2 + wu, m3 + wu * u, m4 + wu * u * u
            v0, v1, v2, v3, v4 = v0 + v, v1 + v * u, v2 + vu, v3 + vu * u, v4 + vu * u * u
            b0, b1, b2 = b0 + wy, b1 + wy * u, b2 + wy * u * u
        if count < 1:
            continue
        n00, n01, n11, n02, n12, n22 = m0 * RIDGE, m1, m2 * RIDGE, m2, m3, m4 * RIDGE  # the normal equations' matrix
        if not (count >= 7 and before >= 2 and after >= 2):
            n02, n12, n22 = 0.0, 0.0, 1.0  # linear
        if count < 4:
            n01, n11, b1 = 0.0, 1.0, 0.0  # constant
        c00, c01, c02 = n11 * n22 - n12 * n12, n12 * n02 - n01 * n22, n01 * n12 - n11 * n02  # cofactors
        c11, c12 = n00 * n22 - n02 * n02, n01 * n02 - n00 * n12
        det = n00 * c00 + n01 * c01 + n02 * c02
        out[i, 0] = (c00 * b0 + c01 * b1 + c02 * b2) / det
        out[i, 1] = (c01 * b0 + c11 * b1 + c12 * b2) / det / half_width
        l0, l1, l2 = c00 / det, c01 / det, c02 / det  # the value by (b0, b1, b2)
        spread = l0 * l0 * v0 + 2.0 * l0 * l1 * v1 + (2.0 * l0 * l2 + l1 * l1) * v2 + 2.0 * l1 * l2 * v3 + l2 * l2 * v4
        out[i, 2] = max(spread, 0.0)
        out[i, 3] = count


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
