"""Fillets of grooves: circles of many profiles, and what stands off them in all alike."""

from __future__ import annotations

import numpy as np

from workbench.edge.fillet import Fillets, fit_circle
from workbench.units import DEG, Float

RADIUS, NOISE, PITCH = 3.0, 0.015, 0.05
UP = np.array([0.0, 1.0])


def profile(rng: np.random.Generator, wave_mm: float = 0.0, noise_mm: float = NOISE) -> Float:
    """Returns (n, 2) of an arc that falls by 60 to 5 deg, its lowest level at 0; a wave of the sensor's over it."""
    across = np.arange(-RADIUS * np.sin(60 * DEG) + rng.random() * PITCH, -RADIUS * np.sin(5 * DEG), PITCH)
    up = RADIUS - np.sqrt(RADIUS**2 - across**2)
    return np.stack([across, up + wave_mm * np.sin(8.0 * across) + noise_mm * rng.normal(size=across.size)], axis=1)


def fillets(count: int, wave_mm: float = 0.0, noise_mm: float = NOISE) -> Fillets:
    rng = np.random.default_rng(3)
    out = Fillets(count)
    for k in range(count):
        found = fit_circle(profile(rng, wave_mm, noise_mm), UP, noise_mm)
        assert found is not None
        out.add(k, found)
    return out


def test_radii_that_noise_makes_small_do_not_count_more() -> None:
    """By each profile's own variance the mean was 0.02 mm too small."""
    found = fillets(400)
    weight = 1.0 / found.variances()[0]
    u = float(np.sqrt(found.variances()[0][0] / 400))
    assert abs((weight * found.radius).sum() / weight.sum() - RADIUS) < 2.0 * u < 0.013


def test_what_all_profiles_leave_is_in_the_uncertainty() -> None:
    straight, waved = fillets(40, noise_mm=0.002), fillets(40, wave_mm=0.01, noise_mm=0.002)
    for k, (of, exact) in enumerate((("radius", RADIUS), ("bottom", 0.0))):
        error = abs(float(np.median(getattr(waved, of))) - exact)
        assert error > 4.0 * abs(float(np.median(getattr(straight, of))) - exact)
        assert error < 3.0 * waved.form_u()[k]
        assert straight.form_u()[k] < 0.2 * waved.form_u()[k]
