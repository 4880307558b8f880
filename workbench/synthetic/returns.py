"""From exact ranges to what a scanner returns: noise, mixed pixels, outliers, dropouts, quantisation."""

from __future__ import annotations

import math

import numpy as np

from workbench.kernels import kernel
from workbench.synthetic.recipe import Disturbances, Noise, Recipe
from workbench.synthetic.sphere_recipe import SphereRecipe
from workbench.units import AnyArray, Bool, Float

_STREAK_COLUMNS = (4, 30)  # greatest and least extent of a streak, [low, high)
_STREAK_FRAMES = (1, 5)


def disturb(recipe: Recipe | SphereRecipe, ranges: Float, cosines: Float, rng: np.random.Generator) -> Float:
    """Ranges (frames, columns) as returned; NaN where there is no return. `ranges` are exact."""
    what = recipe.disturbances
    mixed = _mix_pixels(ranges, what, rng)
    noisy = mixed + _noise(cosines, recipe.scanner.noise, rng)
    noisy = noisy + _outliers(ranges.shape, what, rng)
    noisy[_dropouts(cosines, what, rng)] = np.nan
    if recipe.scanner.quantum_mm > 0:
        noisy = np.round(noisy / recipe.scanner.quantum_mm) * recipe.scanner.quantum_mm
    return np.asarray(noisy)


def intensities(ranges: Float, cosines: Float, rng: np.random.Generator) -> AnyArray:
    """Intensity (frames, columns) uint16: Lambert's law times speckle; 0 where there is no return."""
    speckle = rng.gamma(16.0, 1 / 16.0, ranges.shape)
    return np.where(np.isnan(ranges), 0.0, np.clip(30000.0 * cosines * speckle, 1, 65535)).astype(np.uint16)


def _noise(cosines: Float, noise: Noise, rng: np.random.Generator) -> Float:
    """Range noise that grows with grazing incidence; first-order autoregressive along the columns where correlated."""
    white = rng.standard_normal(cosines.shape)
    if noise.correlation_columns > 0:
        _correlate(white, math.exp(-1.0 / noise.correlation_columns))
    if noise.grazing_power == 0:
        return white * noise.sd_mm
    lowest = noise.grazing_cap ** (-1.0 / noise.grazing_power)
    return np.asarray(white * (noise.sd_mm * np.maximum(cosines, lowest) ** -noise.grazing_power))


@kernel
def _correlate(white: Float, keep: float) -> None:
    """In place: e[j] = keep e[j-1] + sqrt(1 - keep^2) white[j], of unit variance."""
    fresh = math.sqrt(1.0 - keep * keep)
    for i in range(white.shape[0]):
        for j in range(1, white.shape[1]):
            white[i, j] = keep * white[i, j - 1] + fresh * white[i, j]


def _mix_pixels(ranges: Float, what: Disturbances, rng: np.random.Generator) -> Float:
    """A column whose spot straddles a jump in depth may return a range between the two."""
    step = np.diff(ranges, axis=1)
    rows, columns = np.nonzero(np.abs(step) > what.mixed_pixel_jump_mm)
    chosen = rng.random(len(rows)) < what.mixed_pixel_probability
    rows, columns = rows[chosen], columns[chosen]
    weight, after = rng.uniform(0.05, 0.95, len(rows)), rng.integers(0, 2, len(rows))
    mixed = ranges.copy()
    mixed[rows, columns + after] = ranges[rows, columns] + weight * step[rows, columns]
    return mixed


def _outliers(shape: tuple[int, ...], what: Disturbances, rng: np.random.Generator) -> Float:
    """What outliers add to the ranges: isolated ones uniform within the reach, streaks a ramp with speckle."""
    added = np.zeros(shape)
    flat = added.reshape(-1)
    where = np.flatnonzero(rng.random(flat.size) < what.outlier_share) if what.outlier_share > 0 else np.zeros(0, int)
    flat[where] = rng.uniform(-what.outlier_reach_mm, what.outlier_reach_mm, len(where))
    for rows, columns in _streaks(shape, what.streak_outlier_share, rng):
        size = added[rows, columns].shape
        ends = rng.uniform(-what.outlier_reach_mm, what.outlier_reach_mm) * rng.uniform(0.5, 1.0, 2)
        added[rows, columns] = np.linspace(ends[0], ends[1], size[1]) + rng.normal(0.0, 0.1, size)
    return added


def _dropouts(cosines: Float, what: Disturbances, rng: np.random.Generator) -> Bool:
    """Where returns are lost: at random, the more grazing the likelier, and in streaks."""
    share = what.dropout_share + what.grazing_dropout * (1.0 - cosines) ** 3
    lost = rng.random(cosines.shape) < share
    for rows, columns in _streaks(cosines.shape, what.streak_dropout_share, rng):
        lost[rows, columns] = True
    return np.asarray(lost)


def _streaks(shape: tuple[int, ...], share: float, rng: np.random.Generator) -> list[tuple[slice, slice]]:
    """Runs of columns over one or several frames that cover about `share` of the grid."""
    size = (sum(_STREAK_COLUMNS) - 1) / 2 * (sum(_STREAK_FRAMES) - 1) / 2
    count = rng.poisson(share * shape[0] * shape[1] / size)
    first = rng.integers(0, shape, (count, 2))
    extent = rng.integers((_STREAK_FRAMES[0], _STREAK_COLUMNS[0]), (_STREAK_FRAMES[1], _STREAK_COLUMNS[1]), (count, 2))
    return [(slice(i, i + n), slice(j, j + m)) for (i, j), (n, m) in zip(first, extent, strict=True)]
