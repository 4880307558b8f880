"""Fits against data sets whose least-squares answer is known exactly (known_fits.py)."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from tests.geometry.known_fits import FAR_MM, Known, known
from workbench.geometry.fits import LEAST_POINTS, Shape, fit
from workbench.units import Float

SHAPES: tuple[Shape, ...] = ("line", "plane", "circle", "sphere", "cylinder")
ARCS_DEG = (10.0, 30.0, 90.0, 180.0, 360.0)
TOLERANCE = 1e-9  # of the size


def error(shape: Shape, case: Known) -> float:
    """Largest error of radius, position and direction, as a share of the size."""
    found = fit(shape, case.points_mm)
    off = (found.point_mm - case.centre_mm) / case.size_mm
    errors = []
    if found.radius_mm is not None:
        errors.append(found.radius_mm / case.size_mm - 1)
    if found.direction is not None:
        errors.append(np.linalg.norm(np.cross(found.direction, case.axis)))
    if shape in ("circle", "sphere"):
        errors.append(np.linalg.norm(off))
    elif shape == "plane":
        errors.append(off @ case.axis)
    else:
        errors.append(np.linalg.norm(np.cross(off, case.axis)))
    return float(np.abs(errors).max())


@pytest.mark.parametrize("far", [False, True], ids=["near", "far"])
@pytest.mark.parametrize("arc_deg", ARCS_DEG)
@pytest.mark.parametrize("shape", SHAPES)
def test_known_answers_are_found(shape: Shape, arc_deg: float, far: bool) -> None:
    """50 shapes and arcs, 12 draws each: to 1e-9 of the size, at an origin of 1e6 mm too."""
    errors = [error(shape, known(shape, seed, arc_deg, far)) for seed in range(12)]
    assert max(errors) <= TOLERANCE


@pytest.mark.parametrize("shape", SHAPES)
def test_the_construction_can_fail(shape: Shape) -> None:
    """A residual that is not orthogonal to the Jacobian moves the answer: the tests above see it."""
    case = known(shape, 3, 90.0, False)
    case.points_mm[0] += 1e-6 * case.size_mm
    assert error(shape, case) > 10 * TOLERANCE


def test_steep_planes() -> None:
    """Planes that z = a x + b y + c cannot hold."""
    rng = np.random.default_rng(1)
    u, v = rng.uniform(-50, 50, (2, 40))
    for normal in np.eye(3):
        a, b = np.delete(np.eye(3), int(np.argmax(normal)), axis=0)
        found = fit("plane", np.outer(u, a) + np.outer(v, b) + FAR_MM)
        assert found.direction is not None
        assert np.abs(found.direction - normal).max() < 1e-9
        assert found.rms_mm < 1e-9


@pytest.mark.parametrize("shape", ["circle", "sphere", "cylinder"])
def test_residuals_are_distances_and_scipy_finds_no_less(shape: Shape) -> None:
    """A general minimiser, from the answer's neighbourhood, ends at the same sum of squares."""
    case = known(shape, 5, 180.0, False)
    points, found = case.points_mm - case.centre_mm, fit(shape, case.points_mm)
    assert found.direction is not None or shape == "sphere"
    axis = np.zeros(3) if found.direction is None else found.direction

    def distances(p: Float) -> Float:
        off, along = points - p[:3], p[4:] / max(np.linalg.norm(p[4:]), 1e-9)
        if shape == "sphere":
            return np.asarray(np.linalg.norm(off, axis=1) - p[3])
        radial = np.linalg.norm(off - np.outer(off @ along, along), axis=1) - p[3]
        return np.asarray(radial if shape == "cylinder" else np.r_[radial, off @ along])

    start = np.r_[found.point_mm - case.centre_mm, found.radius_mm, axis] + 1e-3 * case.size_mm * np.ones(7)
    best = least_squares(distances, start[: 4 if shape == "sphere" else 7], x_scale="jac", xtol=1e-14, ftol=1e-14)
    assert float((found.residuals_mm**2).sum()) == pytest.approx(2 * best.cost, rel=1e-6)


@pytest.mark.parametrize("shape", SHAPES)
def test_too_few_points_are_refused(shape: Shape) -> None:
    with pytest.raises(ValueError, match="expected at least"):
        fit(shape, np.eye(3)[: LEAST_POINTS[shape] - 1] if LEAST_POINTS[shape] <= 3 else np.eye(4)[:3, :3])


@pytest.mark.parametrize(
    ("shape", "points"),
    [
        ("line", np.ones((5, 3))),
        ("plane", np.outer(np.arange(6.0), [1.0, 2.0, 3.0])),
        ("circle", np.outer(np.arange(6.0), [1.0, 2.0, 3.0])),
        ("sphere", np.column_stack([np.cos(np.arange(9.0)), np.sin(np.arange(9.0)), np.zeros(9)])),
        ("cylinder", np.outer(np.arange(9.0), [1.0, 2.0, 3.0])),
    ],
)
def test_points_that_leave_the_shape_open_are_refused(shape: Shape, points: Float) -> None:
    with pytest.raises(ValueError, match=r"open|flat"):
        fit(shape, points)


@pytest.mark.parametrize("points", [np.ones((5, 2)), np.full((9, 3), np.nan)])
def test_other_arrays_are_refused(points: Float) -> None:
    with pytest.raises(ValueError, match="finite points"):
        fit("plane", points)
