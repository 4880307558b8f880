"""Profiles laid on each other: what they show of a motion, whatever their noise."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.checks.profiles import chains
from workbench.units import DEG, Float

COUNT = 60
SWAY_MM = 1.0 * np.sin(np.linspace(0.0, 4.0 * np.pi, COUNT))
X_MM = np.linspace(-2.5, 2.5, 240)


def laid(z_mm: Float, noise_mm: float) -> tuple[Float, Float]:
    """Way (k, 2) in the view, mm, and rotation (k,), deg, by profiles (k, m) with noise of their ranges."""
    z_mm = z_mm + np.random.default_rng(5).normal(0.0, noise_mm, z_mm.shape)
    point, angle, _ = chains(np.tile(X_MM, (COUNT, 1)), z_mm, np.zeros(COUNT, np.int64), least=COUNT)[0].track
    return point - point[0], angle / DEG


@pytest.mark.parametrize("noise_mm", [0.002, 0.04, 0.06])
def test_a_corner_in_noise_shows_where_it_goes(noise_mm: float) -> None:
    beside = X_MM - SWAY_MM[:, None]
    way, angle = laid(200.0 - np.minimum(beside, 0.0), noise_mm)
    assert np.abs(angle).max() < 0.1 + 40.0 * noise_mm
    assert np.abs(way[:, 0] - SWAY_MM).max() < 0.02 + 5.0 * noise_mm


@pytest.mark.parametrize("noise_mm", [0.002, 0.04])
def test_a_line_shows_no_way_along_itself(noise_mm: float) -> None:
    way, angle = laid(200.0 + 0.3 * X_MM + 0.0 * SWAY_MM[:, None], noise_mm)
    assert np.abs(angle).max() < 0.1 + 40.0 * noise_mm
    assert np.abs(way).max() < 0.02 + noise_mm
