"""Two angles out of two equations that are linear in their cosines and sines; vectorised over n problems.

A a (cos alpha, sin alpha) = B b (cos beta, sin beta) + k, with matrices A, B (2, 2), radii a, b (n,) and k (n, 2).
Where a matrix is singular, its angle drops out of a combination of the equations, and the other one is solved first.
Else one angle is eliminated by cos^2 + sin^2 = 1, which leaves a polynomial of degree 4 (Pieper 1968).
"""

from __future__ import annotations

import numpy as np

from workbench.units import Float

FLAT = 1e-7  # smallest singular value of a matrix that counts as singular
DOUBLE = 1e-6  # imaginary part of a root that rounding may make of a real double one
ROUNDING = 1e-12


def two_angles(a: Float, radius_a: Float, b: Float, radius_b: Float, k: Float) -> tuple[Float, Float]:
    """alpha, beta (n, 4), NaN where there is no solution."""
    flat_a, flat_b = (float(np.linalg.svd(matrix, compute_uv=False)[1]) for matrix in (a, b))
    singular = min(flat_a, flat_b) < FLAT
    if (flat_b < flat_a) if singular else (flat_b > flat_a):
        beta, alpha = two_angles(b, radius_b, a, radius_a, -k)
        return alpha, beta
    solve = _one_after_the_other if singular else _by_elimination
    return solve(a, radius_a, b, radius_b, k)


def _one_after_the_other(a: Float, radius_a: Float, b: Float, radius_b: Float, k: Float) -> tuple[Float, Float]:
    """Where A is singular: beta from the combination without alpha, then alpha from what is left."""
    left = np.linalg.svd(a)[0]
    keep, without = left[:, 0], left[:, 1]
    beta = np.repeat(_on_line(radius_b[:, None] * (without @ b), -k @ without), 2, axis=1)
    rest = (radius_b[:, None, None] * _circle(beta)) @ (keep @ b)[..., None]
    alpha = _on_line((radius_a[:, None] * (keep @ a))[:, None], rest[..., 0][:, ::2] + (k @ keep)[:, None])
    return alpha.reshape(-1, 4), beta


def _by_elimination(a: Float, radius_a: Float, b: Float, radius_b: Float, k: Float) -> tuple[Float, Float]:
    """Where A is regular: |A^-1 (B b (cos beta, sin beta) + k)| = a, then alpha from its direction."""
    inverse = np.linalg.inv(a)
    g, shift = radius_b[:, None, None] * (inverse @ b), k @ inverse.T
    x, y = g[..., 0], g[..., 1]
    wave = np.column_stack(
        [
            ((x**2).sum(axis=1) + (y**2).sum(axis=1)) / 2 + (shift**2).sum(axis=1) - radius_a**2,
            2 * (shift * x).sum(axis=1),
            2 * (shift * y).sum(axis=1),
            ((x**2).sum(axis=1) - (y**2).sum(axis=1)) / 2,
            (x * y).sum(axis=1),
        ]
    )
    beta = _zeros(wave)
    end = _circle(beta) @ np.swapaxes(g, 1, 2) + shift[:, None]
    return np.arctan2(end[..., 1], end[..., 0]), beta


def _circle(angle: Float) -> Float:
    return np.stack([np.cos(angle), np.sin(angle)], axis=-1)


def _on_line(normal: Float, value: Float) -> Float:
    """Both angles t (..., 2) with normal . (cos t, sin t) = value; 0 where any will do."""
    r = np.hypot(normal[..., 0], normal[..., 1])
    reaches = np.abs(value) <= r * (1 + ROUNDING) + ROUNDING
    middle = np.arctan2(normal[..., 1], normal[..., 0])
    half = np.arctan2(np.sqrt(np.maximum(r**2 - value**2, 0.0)), value)
    found = np.stack([middle + half, middle - half], axis=-1)
    found = np.where((r < ROUNDING)[..., None], 0.0, found)
    return np.where(reaches[..., None], found, np.nan)


def _zeros(wave: Float) -> Float:
    """Zeros (n, 4) of w0 + w1 cos t + w2 sin t + w3 cos 2t + w4 sin 2t, w (n, 5); NaN: fewer.

    In tan of half the angle from where the function is largest, so that the polynomial's degree is truly 4.
    """
    around = np.linspace(0, 2 * np.pi, 8, endpoint=False)
    values = wave @ np.stack([np.ones(8), np.cos(around), np.sin(around), np.cos(2 * around), np.sin(2 * around)])
    far = around[np.argmax(np.abs(values), axis=1)] + np.pi  # goes to infinity in the tangent
    c, s = np.cos(far), np.sin(far)
    w0, w1, w2 = wave[:, 0], c * wave[:, 1] + s * wave[:, 2], c * wave[:, 2] - s * wave[:, 1]
    c, s = np.cos(2 * far), np.sin(2 * far)
    w3, w4 = c * wave[:, 3] + s * wave[:, 4], c * wave[:, 4] - s * wave[:, 3]
    leading = w0 - w1 + w3
    companion = np.zeros((len(wave), 4, 4))
    companion[:, [1, 2, 3], [0, 1, 2]] = 1.0
    lower = np.stack([w0 + w1 + w3, 2 * w2 + 4 * w4, 2 * w0 - 6 * w3, 2 * w2 - 4 * w4], axis=-1)
    companion[:, :, 3] = -lower / np.where(leading == 0.0, 1.0, leading)[:, None]
    root = np.linalg.eigvals(companion)
    real = np.abs(root.imag) <= DOUBLE * (1 + np.abs(root) ** 2)
    return np.where(real, 2 * np.arctan(root.real) + far[:, None], np.nan)
