"""Height maps measured as images, against shapes whose sizes are known."""

from __future__ import annotations

import numpy as np
import pytest

from workbench.look.foreign import regions_of


def plate(seed: int):
    """A tilted plate of 40 x 30 mm with two holes (8.4 and 5 mm) above a floor; 0.1 x 0.12 mm, noise 5 um, gaps."""
    rng = np.random.default_rng(seed)
    x, y = np.arange(0, 60, 0.1), np.arange(0, 50, 0.12)
    xx, yy = np.meshgrid(x, y)
    turn = np.radians(7.0)
    u, v = (xx - 30) * np.cos(turn) + (yy - 25) * np.sin(turn), -(xx - 30) * np.sin(turn) + (yy - 25) * np.cos(turn)
    holes = (np.hypot(u + 9, v) < 4.2) | (np.hypot(u - 10, v - 3) < 2.5)
    on = (np.abs(u) < 20) & (np.abs(v) < 15) & ~holes
    z = np.where(on, 12 + 0.03 * xx - 0.02 * yy, 2.0) + rng.normal(0, 0.005, xx.shape)
    z[holes] = np.nan
    z[rng.random(z.shape) < 0.002] = np.nan
    return x, y, z


def test_regions_holes_and_sides():
    floor_and_plate = regions_of(*plate(0))
    assert len(floor_and_plate) == 2
    found = min(floor_and_plate, key=lambda one: abs(one.area_mm2 - 1130))
    assert found.tilt_x_deg == pytest.approx(np.degrees(np.arctan(0.03)), abs=0.005)
    assert found.tilt_y_deg == pytest.approx(-np.degrees(np.arctan(0.02)), abs=0.005)
    assert found.rms_mm == pytest.approx(0.005, rel=0.1)
    diameters = sorted(hole.diameter_mm for hole in found.holes)
    assert diameters == pytest.approx([5.0, 8.4], abs=0.25)  # the pixel at a rim is left out: two pitches at most
    assert all(hole.rms_mm < 0.05 for hole in found.holes)
    angles = sorted(side.angle_deg for side in found.sides)
    assert angles == pytest.approx([7, 7, 97, 97], abs=0.1)
    assert sorted(side.length_mm for side in found.sides) == pytest.approx([30, 30, 40, 40], abs=0.35)


@pytest.mark.parametrize("seed", range(4))
def test_a_step_is_found_between_the_pixels(seed):
    """A round boss and the straight side of a plate as a sensor's spot blends them, noise 5 um: to a fifth of a pixel.

    The mask leaves out the pixels beside a step: it alone would be more than half a pixel off.
    """
    rng = np.random.default_rng(seed)
    pitch, radius, fine = 0.1, 4.0 + 0.1 * rng.random(), 8
    x, y = np.arange(0, 24, pitch), np.arange(0, 20, pitch)
    centre, side = np.array([9.0, 10.0]) + 0.1 * rng.random(2), 18.0 + 0.1 * rng.random()
    within = (np.arange(fine) + 0.5) / fine - 0.5
    xx, yy = np.meshgrid((x[:, None] + pitch * within).ravel(), (y[:, None] + pitch * within).ravel())
    hole = np.hypot(xx - centre[0], yy - centre[1]) < radius
    drawn = np.where((xx < side) & ~hole, 5.0, 2.0)
    z = drawn.reshape(len(y), fine, len(x), fine).mean(axis=(1, 3)) + rng.normal(0, 0.005, (len(y), len(x)))
    z[rng.random(z.shape) < 0.002] = np.nan
    plate = next(one for one in regions_of(x, y, z) if one.holes)
    (found,) = plate.holes
    assert found.diameter_mm / 2 == pytest.approx(radius, abs=0.2 * pitch)
    assert (found.x_mm, found.y_mm) == pytest.approx(tuple(centre), abs=0.2 * pitch)
    assert found.rms_mm < 0.2 * pitch
    edge = next(one for one in plate.sides if abs(one.angle_deg - 90) < 1 and one.start_mm[0] > 12)
    assert edge.start_mm[0] == pytest.approx(side, abs=0.2 * pitch)
    assert edge.end_mm[0] == pytest.approx(side, abs=0.2 * pitch)
