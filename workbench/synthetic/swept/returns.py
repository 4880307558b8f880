"""From exact profiles to what the profiler hands over: noise, brightness, losses, outliers, quantisation."""

from __future__ import annotations

import numpy as np
import scipy

from workbench.synthetic.swept.recipe import AnyRecipe, SweptScanner
from workbench.synthetic.swept.section import ROOT
from workbench.synthetic.swept.sensor import Profiles
from workbench.units import AnyArray, Bool, Float

FULL = 20000.0  # brightness of a full pixel that looks square at a face
DARK = 0.3  # speckle dims a pixel's signal, and raises its noise, no further


def returned(profiles: Profiles, recipe: AnyRecipe, pattern: Float, rng: np.random.Generator) -> tuple[Float, AnyArray]:
    """Ranges (n, M), NaN where there is no return, and brightness (n, M) uint16."""
    scanner, noise, losses = recipe.scanner, recipe.scanner.noise, recipe.losses
    cosine = np.clip(profiles.cosine, 1e-3, 1)
    speckle = np.ones(cosine.shape)
    if noise.speckle > 0:  # M looks: contrast 1 / sqrt(M)
        speckle = rng.gamma(noise.speckle**-2, noise.speckle**2, cosine.shape)
    grown = np.minimum(cosine**-noise.grazing_power, noise.grazing_cap)
    fill = np.maximum(profiles.fill, 1.0 / 8)
    sd = noise.sd_mm * grown / np.sqrt(np.maximum(speckle, DARK) * fill)
    unit = _correlated(rng.standard_normal(cosine.shape), noise.column_correlation)
    unit = np.sqrt(1 - noise.pattern_share) * unit + np.sqrt(noise.pattern_share) * pattern
    ranges = profiles.range_mm + sd * unit
    wrong = rng.random(ranges.shape) < losses.outlier_share
    ranges[wrong] += rng.uniform(-losses.outlier_reach_mm, losses.outlier_reach_mm, int(wrong.sum()))
    ranges[lost(profiles, recipe, rng)] = np.nan
    if scanner.quantum_mm > 0:
        ranges = np.round(ranges / scanner.quantum_mm) * scanner.quantum_mm
    light = np.clip(FULL * cosine * speckle * profiles.fill, 1, 65535)
    return ranges, np.where(np.isnan(ranges), 0, light).astype(np.uint16)


def fixed_pattern(scanner: SweptScanner, rng: np.random.Generator) -> Float:
    """The part of the noise (M,) that is the same in every frame, of unit variance."""
    return np.asarray(_correlated(rng.standard_normal((1, scanner.columns)), scanner.noise.column_correlation)[0])


def _correlated(white: Float, keep: float) -> Float:
    """First-order autoregressive along the columns, of unit variance from the first column on."""
    if keep == 0:
        return white
    fresh = np.sqrt(1 - keep**2)
    return np.asarray(scipy.signal.lfilter([fresh], [1, -keep], white, axis=1, zi=(1 - fresh) * white[:, :1])[0])


def lost(profiles: Profiles, recipe: AnyRecipe, rng: np.random.Generator) -> Bool:
    """Returns that are lost one by one, in blocks, or as the last columns of the root face."""
    losses, shape = recipe.losses, profiles.range_mm.shape
    gone = rng.random(shape) < losses.single_share
    if losses.block_share > 0:
        (wide_low, wide_high), (long_low, long_high) = losses.block_columns, losses.block_frames
        size = (wide_low + wide_high) / 2 * (long_low + long_high) / 2
        for _ in range(rng.poisson(-np.log1p(-losses.block_share) * gone.size / size)):
            rows, columns = rng.integers(long_low, long_high + 1), rng.integers(wide_low, wide_high + 1)
            i, j = rng.integers(1 - rows, shape[0]), rng.integers(1 - columns, shape[1])
            gone[max(i, 0) : i + rows, max(j, 0) : j + columns] = True
    if losses.edge_columns:
        gone |= _last_on_root(profiles, losses.edge_columns, losses.edge_from_mm, losses.edge_to_mm)
    return gone


def _last_on_root(profiles: Profiles, columns: int, start: float, stop: float) -> Bool:
    """The `columns` returns of the root face that are nearest to its lower edge, and all below it beside them."""
    on = (profiles.face == ROOT) & np.isfinite(profiles.range_mm)
    share = np.where(on, profiles.share, np.inf)
    rank = np.argsort(np.argsort(share, axis=1), axis=1)
    here = (profiles.s >= start) & (profiles.s <= stop)
    return np.asarray(on & (rank < columns) & here)
