"""What straight lines leave of the faces: bows and patterns, wherever they stay."""

from __future__ import annotations

import math

import numpy as np
import pytest

from workbench.edge.form import PLACES, _excess
from workbench.units import Float

FRAMES, COLUMNS, SIGMA = 100, 45, 0.012


def residuals(pattern: Float, first: Float, rng: np.random.Generator) -> tuple[Float, Float, Float]:
    """What lines leave (f, M) of faces of COLUMNS columns from `first` (f,) on; place on the face, and column group."""
    off = np.full((FRAMES, pattern.size), np.nan)
    place = np.zeros(off.shape)
    v = np.arange(COLUMNS) - (COLUMNS - 1) / 2
    for i, start in enumerate(first.astype(int)):
        r = pattern[start : start + COLUMNS] + rng.normal(0.0, SIGMA, COLUMNS)
        off[i, start : start + COLUMNS] = r - r.mean() - v * (v @ r) / (v @ v)
        place[i, start : start + COLUMNS] = np.arange(COLUMNS) * PLACES // COLUMNS
    return off, place, np.broadcast_to(np.arange(pattern.size) * PLACES // COLUMNS, off.shape)


@pytest.mark.parametrize("moved", [0.0, 40.0])
def test_a_pattern_of_the_columns_shows_where_the_face_moves_across_them(moved: float) -> None:
    """Pooled by place on the face a pattern averages out; by column it does not."""
    rng = np.random.default_rng(5)
    smooth = np.convolve(rng.normal(0.0, 1.0, 140), np.ones(8), mode="valid")[:120]
    pattern = 0.012 * smooth / smooth.std()
    off, place, column = residuals(pattern, 10.0 + np.linspace(0.0, moved, FRAMES), rng)
    by_place, by_column = _excess(off, place), _excess(off, column)
    assert 0.3 * 0.012 < math.sqrt(by_column) < 2.0 * 0.012
    if moved:
        assert by_place < 0.5 * by_column


def test_noise_alone_is_no_form() -> None:
    rng = np.random.default_rng(6)
    found = []
    for _ in range(20):
        off, place, column = residuals(np.zeros(120), 10.0 + np.linspace(0.0, 40.0, FRAMES), rng)
        found.append(max(_excess(off, place), _excess(off, column)))
    assert np.sqrt(np.median(found)) < 0.1 * SIGMA
