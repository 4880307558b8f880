"""A face that rocks along the edge in waves too short to be followed: each section is told within its uncertainty."""

from __future__ import annotations

import numpy as np
import pytest

from bench.drawn.swept import random_swept_recipe
from bench.score.analytic import milled_part
from bench.score.measure import alone
from bench.simulators.swept import simulate_swept


@pytest.mark.parametrize("wavelength_mm", [5.0, 14.0])
def test_a_bevel_that_rocks_is_uncertain_by_that(wavelength_mm: float) -> None:
    """With 5 to 10 mm the bevel was 4.5 to 7.6 u off, with a plain pass."""
    recipe = random_swept_recipe("swept_plain", 18_007_000)
    bevel = recipe.part.bevel_deg.model_copy(update={"amplitude": 0.4, "wavelength_mm": wavelength_mm})
    part = recipe.part.model_copy(update={"bevel_deg": bevel})
    found = alone(milled_part(*simulate_swept(recipe.model_copy(update={"part": part}))))
    assert not found.refused
    assert np.abs(found.found["bevel_deg"].error / found.found["bevel_deg"].u).max() < 3.0
