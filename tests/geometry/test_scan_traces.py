"""Lines of one pass or of several on a patch, made as a profiler on a robot makes them."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.geometry.patches import traces
from workbench.units import Float


def lines(rng: np.random.Generator, tangent: float, start_mm: float, pitch_mm: float = 0.2) -> Float:
    """x and s (2, n) of points 0.05 mm apart on parallel lines over a patch of 1 by 2 mm; poses to a micrometre."""
    first = np.arange(-2, 4, pitch_mm) + start_mm
    x, s = np.meshgrid(np.arange(-0.5, 0.5, 0.05) + 0.01, first + 0.001 * rng.normal(size=first.size))
    s = s + tangent * x
    here = (s > 0) & (s < 2) & (rng.random(s.shape) > 0.02)
    return np.stack([x[here], s[here]])


@pytest.mark.parametrize("tangent", [-0.2, 0.0, 0.031])
@pytest.mark.parametrize("pitch_mm", [0.1, 0.2])
def test_lines_of_one_pass(tangent: float, pitch_mm: float):
    assert traces(*lines(np.random.default_rng(1), tangent, 0.03, pitch_mm)) == "one pass"


@pytest.mark.parametrize("other", [(0.1, 0.0, 0.2), (0.0, 0.06, 0.2), (-0.15, 0.05, 0.3)])
def test_lines_of_two_passes_aslant_or_side_by_side(other: tuple[float, float, float]):
    rng = np.random.default_rng(2)
    assert traces(*np.hstack([lines(rng, 0.0, 0.0), lines(rng, *other)])) == "several passes"


def test_points_on_no_lines_say_nothing():
    rng = np.random.default_rng(3)
    assert traces(rng.uniform(-0.5, 0.5, 250), rng.uniform(0, 2, 250)) == "none"
