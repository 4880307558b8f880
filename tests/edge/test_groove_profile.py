"""In which sense z counts, by what profiles of a groove show between its plates."""

import numpy as np
import pytest

from workbench.edge.groove_profile import _unbridged, upwards


@pytest.mark.parametrize(
    ("between_mm", "shown", "sense"),
    [(-20.0, 2, 0.0), (2.0, 3, 0.0), (2.0, 10, -1.0), (-2.0, 10, 1.0)],
)
def test_few_profiles_tell_nothing(between_mm: float, shown: int, sense: float) -> None:
    """25 profiles of plates 2 mm apart, some with returns between them: few are spatter."""
    x = np.concatenate([np.linspace(-20, -1, 200), np.linspace(-0.9, 0.9, 20), np.linspace(1, 20, 200)])
    between = np.abs(x) < 0.95
    z = np.where(between, between_mm, 0.0) + 0.005 * np.random.default_rng(3).standard_normal(x.size)
    profiles = [(x, z)] * shown + [(x[~between], z[~between])] * (25 - shown)
    assert upwards([one for one, _ in profiles], [one for _, one in profiles]) == sense


def test_returns_of_one_x_have_no_slope() -> None:
    """Five columns that a file gives x 0, then a gap: what is left of the line is the piece beyond it."""
    x = np.concatenate([np.zeros(5), np.linspace(5.0, 6.0, 6)])
    line = np.array([[0.0, 6.0, 0.1, 0.0, 11, 0, 10]])
    (left,) = _unbridged(x, 0.1 * x, line, 60)
    assert left[:2].tolist() == [5.0, 6.0]
    assert left[2] == pytest.approx(0.1)
