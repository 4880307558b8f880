"""The simulator with the camera beside the laser, against geometry that it does not use."""

import numpy as np
import pytest

from bench.simulators.triangulated import (
    Course,
    Sensor,
    Way,
    Workpiece,
    free,
    simulate,
    smooth,
)
from tests.simulators.returns import base_points
from workbench.units import DEG

PART = Workpiece("raw", 60.0, 200.0, 6.0, lean=Course(0.02, 0.01))
EXACT = Sensor(width_mm=20.0, noise_mm=1e-4, lost=0.0, stray=0.0, digit_mm=1e-7)
WAY = Way(elevation=35.0 * DEG, oblique=(0.03, 0.02, -0.03), aim_mm=(0.0, 3.0))


def in_sections(part: Workpiece, sensor: Sensor, way: Way) -> np.ndarray:
    """Returns (n, 2) along normal and across at the nearest station of the truth."""
    recording, truth = simulate(part, sensor, [way], 7)
    points = base_points(recording)[::37]
    place = truth["position_mm"]
    t = np.gradient(place, axis=0)
    t /= np.linalg.norm(t, axis=1, keepdims=True)
    nearest = np.abs(np.einsum("nsi,si->ns", points[:, None] - place[None], t)).argmin(axis=1)
    off = points - place[nearest]
    return np.stack([(off * truth[name][nearest]).sum(axis=1) for name in ("normal", "across")], axis=1)


def test_an_ideal_sensor_sees_the_part() -> None:
    n, m = in_sections(PART, EXACT, WAY).T
    face = (m > 0.5) & (m < 5.4) & (n > -8.0)  # the plate's surfaces lean by 1 deg to the end face
    assert face.sum() > 300
    assert np.abs(n[face]).max() < 2e-3  # stations of the truth are half a millimetre apart, float32 holds 1e-5
    assert not np.any((n < -0.05) & (n > -8.0) & (m > 0.5) & (m < 5.4))  # nothing within the plate


def test_what_stands_between_hides() -> None:
    wall = np.array([[[-1.0, 50.0], [1.0, 50.0]], [[-1.0, 50.0], [1.0, 50.0]]])
    eye, x, z = np.zeros((2, 2)), np.array([[0.0, 5.0], [0.0, 1.0]]), np.full((2, 2), 100.0)
    assert free([wall], eye, x, z).tolist() == [[False, True], [False, False]]
    assert free([wall], eye, x, np.full((2, 2), 40.0)).all()


@pytest.mark.parametrize("length_mm", [1.0, 12.0])
def test_the_robots_error_is_the_process_that_was_declared(length_mm: float) -> None:
    s = np.arange(0.0, 3000.0, 0.5)
    drawn = smooth(np.random.default_rng(1), s, length_mm)
    assert drawn.std() == pytest.approx(1.0, abs=0.1)
    k = round(length_mm / 0.5)
    assert (drawn[:-k] * drawn[k:]).mean() == pytest.approx(np.exp(-0.5), abs=0.12)
