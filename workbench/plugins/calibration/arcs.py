"""The sphere's arc in a profile: found by random samples (RANSAC), then fitted by maximum likelihood.

A laser plane cuts a sphere in a circle, of which the sensor sees the side that faces it: z = z_c + s sqrt(w - (x -
x_c)^2) with w the circle's squared radius and s the sense of z, +1 where z counts towards the sensor. The noise acts
along z, so the fit is one of z on x, in exactly the unknowns (x_c, z_c, w) that the calibration needs.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from workbench.api import Bool, Float, Int, kernel

SAMPLES = 500  # of three points; 15 % of a frame on the sphere give 20 good ones
SCORED = 400  # points that judge a sample
STEEP = 0.95  # |x - x_c| / r beyond which a point is left out: the surface is too steep for a sensor
LATERAL = 0.1  # noise along x, as a share of that along z: keeps steep points from ruling the fit
TUKEY = 4.685  # cut-off of the biweight in standard deviations: 95 % efficient (Beaton and Tukey 1974)
GATE = 4.0  # standard deviations within which a point lies on the arc
GAP = 0.4  # in sphere radii: a wider gap in x ends an arc


@kernel
def _through(x: Float, z: Float, a: int, b: int, c: int) -> tuple[float, float, float]:
    """Circle (x_c, z_c, w) through three points; w = 0 where they lie on a line."""
    ux, uz, vx, vz = x[b] - x[a], z[b] - z[a], x[c] - x[a], z[c] - z[a]
    cross = 2.0 * (ux * vz - uz * vx)
    if abs(cross) < 1e-9:
        return 0.0, 0.0, 0.0
    u, v = ux * ux + uz * uz, vx * vx + vz * vz
    dx, dz = (vz * u - uz * v) / cross, (ux * v - vx * u) / cross
    return x[a] + dx, z[a] + dz, dx * dx + dz * dz


@kernel
def _score(x: Float, z: Float, xc: float, zc: float, w: float, sense: float, gate: float) -> float:
    """How well a circle explains the points above its chord: truncated squares; a point elsewhere costs a little."""
    score = 0.0
    step = max(1, len(x) // SCORED)
    for k in range(0, len(x), step):
        dx = x[k] - xc
        q2 = w - dx * dx
        if q2 < (1 - STEEP * STEEP) * w:
            continue
        q = np.sqrt(q2)
        e = abs(z[k] - zc - sense * q) * q / np.sqrt(w)  # distance across the surface
        score += 1.0 - (e / gate) ** 2 if e < gate else -0.2
    return score * step


@kernel
def search(x: Float, z: Float, radius: float, gate: float, sense: float, seed: int) -> tuple[Float, float]:
    """Best circle of up to `SAMPLES` through three points: (x_c, z_c, w, sense) and its score; w = 0: none.

    `x`, `z` (n,) in the order of the columns; `radius` of the sphere; `gate` the distance within which a point counts;
    `sense` +-1, or 0: whichever fits better. A circle is no larger than the sphere allows (5 % and the gate more).
    """
    np.random.seed(seed)
    n = len(x)
    best, best_score = np.zeros(4), 0.0
    for _ in range(SAMPLES):
        a, reach = np.random.randint(n), (0.3 + 1.5 * np.random.random()) * radius
        c = a
        while c < n - 1 and abs(x[c] - x[a]) < reach:
            c += 1
        if c - a < 4 or abs(x[c] - x[a]) > 2 * radius:
            continue
        b = a + 1 + np.random.randint(c - a - 1)
        xc, zc, w = _through(x, z, a, b, c)
        if w < (0.15 * radius) ** 2 or w > (1.05 * radius + gate) ** 2:
            continue
        s = 1.0 if z[b] > zc else -1.0
        if (sense != 0.0 and s != sense) or s * (z[a] - zc) <= 0 or s * (z[c] - zc) <= 0:
            continue
        score = _score(x, z, xc, zc, w, s, gate)
        if score > best_score:
            best_score = score
            best[0], best[1], best[2], best[3] = xc, zc, w, s
    return best, best_score


@kernel
def _normal_equations(x: Float, z: Float, circle: Float, sense: float, sigma: float) -> tuple[Float, Float]:
    """Normal matrix (3, 3) and right-hand side (3,) of one weighted step in (x_c, z_c, w), unit noise."""
    matrix, side = np.zeros((3, 3)), np.zeros(3)
    row = np.zeros(3)
    for k in range(len(x)):
        dx = x[k] - circle[0]
        q2 = circle[2] - dx * dx
        if q2 < (1 - STEEP * STEEP) * circle[2]:
            continue
        q = np.sqrt(q2)
        residual = z[k] - circle[1] - sense * q
        variance = 1.0 + LATERAL * LATERAL * dx * dx / q2
        t = residual * residual / (variance * (TUKEY * sigma) ** 2)
        if t >= 1.0:
            continue
        weight = (1.0 - t) ** 2 / variance
        row[0], row[1], row[2] = sense * dx / q, 1.0, sense / (2.0 * q)
        for i in range(3):
            side[i] += weight * row[i] * residual
            for j in range(3):
                matrix[i, j] += weight * row[i] * row[j]
    return matrix, side


@kernel
def _residuals(x: Float, z: Float, circle: Float, sense: float) -> Float:
    """Residuals along z over what a point's noise is, relative to sigma; infinite off the arc's span."""
    out = np.full(len(x), np.inf)
    for k in range(len(x)):
        dx = x[k] - circle[0]
        q2 = circle[2] - dx * dx
        if q2 >= (1 - STEEP * STEEP) * circle[2]:
            out[k] = (z[k] - circle[1] - sense * np.sqrt(q2)) / np.sqrt(1.0 + LATERAL**2 * dx * dx / q2)
    return out


@kernel
def fit(x: Float, z: Float, start: Float, sense: float, sigma: float) -> tuple[Float, Float, float, bool]:
    """Maximum-likelihood circle from a start: (x_c, z_c, w), the inverse of its normal matrix (3, 3), scale, success.

    The covariance is sigma^2 times that matrix. Robust by Tukey's biweight, whose scale comes down from the start's
    misfit to the points' own (median absolute residual), never below `sigma`.
    """
    circle, inverse = start[:3].copy(), np.zeros((3, 3))
    scale = sigma
    for step in range(30):
        residual = np.abs(_residuals(x, z, circle, sense))
        near = residual[residual < 0.3 * np.sqrt(circle[2])]
        if len(near) < 8:
            return circle, inverse, scale, False
        scale = max(sigma, 1.4826 * np.median(near))
        matrix, side = _normal_equations(x, z, circle, sense, scale)
        if not np.linalg.det(matrix) > 1e-9:
            return circle, inverse, scale, False
        inverse[:] = np.linalg.inv(matrix)
        change = inverse @ side
        limit = max(abs(change[0]), abs(change[1]), abs(change[2]) / (2 * np.sqrt(circle[2])))
        circle += change * min(1.0, 0.2 * np.sqrt(circle[2]) / max(limit, 1e-12))
        if circle[2] <= 0:
            return circle, inverse, scale, False
        if step > 2 and limit < 1e-7:
            break
    return circle, inverse, scale, True


@kernel
def on_arc(x: Float, z: Float, circle: Float, sense: float, sigma: float, gap: float) -> Bool:
    """Which points (n,), in the order of the columns, make the largest contiguous arc: no gap in x wider than `gap`."""
    good = np.abs(_residuals(x, z, circle, sense)) < GATE * sigma
    run = np.zeros(len(x), np.int64)
    number, last = 0, -1
    for k in range(len(x)):
        if good[k]:
            if last >= 0 and abs(x[k] - x[last]) > gap:
                number += 1
            run[k], last = number, k
    counts = np.zeros(number + 1, np.int64)
    for k in range(len(x)):
        counts[run[k]] += good[k]
    kept: Bool = good & (run == np.argmax(counts))
    return kept


def second_differences(z: Float) -> float:
    """Noise of the returns (n,) along a profile, from their second differences: blind to slopes, robust to jumps."""
    if len(z) < 5:
        return float("inf")
    return float(np.median(np.abs(np.diff(z, 2))) / (0.6745 * np.sqrt(6.0)))


def returns(x_mm: Any, z_mm: Any) -> tuple[Float, Float, Int]:
    """Points of one frame that came back, in float64, and their columns."""
    columns = np.flatnonzero(np.isfinite(x_mm) & np.isfinite(z_mm))
    return x_mm[columns].astype(float), z_mm[columns].astype(float), columns
