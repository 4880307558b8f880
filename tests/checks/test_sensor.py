"""What a sensor's numbers tell of themselves: digits that were kept, the width of a filter."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from bench.score.outsider import raw
from workbench.checks.sensor import _gaussian_width, quaternion_step, sensor_traces


@pytest.mark.parametrize("digits", [1, 2, 3])
def test_digits_of_quaternions_are_counted(digits: int) -> None:
    quaternion = Rotation.random(50, random_state=5).as_quat()
    few = np.round(quaternion, digits)
    few /= np.linalg.norm(few, axis=1, keepdims=True)
    assert quaternion_step(few) == 10.0**-digits
    assert quaternion_step(few[:1]) == 10.0**-digits
    assert quaternion_step(quaternion) == 0.0
    assert quaternion_step(np.array([[0.5**0.5, 0.0, 0.0, 0.5**0.5]])) == 0.0


@pytest.mark.parametrize(("ratio", "width"), [(0.998, 0.0), (-3.0, 0.0), (1.489, 1.7), (3.9, 13.6), (1e9, 48.0)])
def test_the_width_of_a_filter_is_a_number_of_columns(ratio: float, width: float) -> None:
    """Also of neighbours that are less alike than those beyond, and of a filter wider than the pieces looked at."""
    assert _gaussian_width(ratio) == pytest.approx(width, abs=0.1)


def test_digits_that_wide_noise_hides_fill_no_gaps() -> None:
    """Ranges of 0.1 um in float32 beyond 256 mm are equal three times as often as its digits let expect."""
    seen = raw(17890010).recording
    assert sensor_traces(seen.x_mm, seen.z_mm, seen.pass_index).held_end_share == 0.0
