"""Fits against reference data sets with known answers, in the form of NIST's algorithm testing."""

from pathlib import Path

import numpy as np
import pytest

from workbench.geometry.fits import Shape, fit

DATA = Path(__file__).parent / "data"


@pytest.mark.parametrize("shape", ["sphere", "cylinder"])
def test_the_answer_is_met(shape: Shape) -> None:
    """Centre or a point of the axis, the direction where there is one, last the diameter."""
    points, answer = np.loadtxt(DATA / f"{shape}.ds"), np.loadtxt(DATA / f"{shape}.fit").ravel()
    found, size = fit(shape, points), float(np.ptp(points, axis=0).max())
    assert found.radius_mm == pytest.approx(0.5 * answer[-1], abs=1e-9 * size)
    off = found.point_mm - answer[:3]
    if found.direction is not None:
        direction = answer[3:6] / np.linalg.norm(answer[3:6])
        assert np.linalg.norm(np.cross(found.direction, direction)) < 1e-9
        off = off - direction * (off @ direction)
    assert np.linalg.norm(off) < 1e-9 * size
    assert found.rms_mm > 1e-3
