"""Fits against data sets whose least-squares answer is known exactly.

Feet lie on a known shape; residuals along its normals are orthogonal to every column of the Jacobian there, so the
gradient of the sum of squares vanishes at the known parameters (null-space construction; Cox, Forbes and others, "The
design and use of reference data sets for testing scientific software", Anal. Chim. Acta 380, 1999).
"""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from workbench.geometry.fits import LEAST_POINTS, Shape, fit
from workbench.units import Float

SHAPES: tuple[Shape, ...] = ("line", "plane", "circle", "sphere", "cylinder")
ARCS_DEG = (10.0, 30.0, 90.0, 180.0, 360.0)
FAR_MM = 1e6
TOLERANCE = 1e-9  # of the size


@dataclass
class Known:
    """Points and the shape that fits them best: in its own frame about the origin, then moved."""

    points_mm: Float
    centre_mm: Float
    axis: Float
    size_mm: float


def known(shape: Shape, seed: int, arc_deg: float, far: bool) -> Known:
    rng = np.random.default_rng([seed, int(arc_deg), far])
    count, size = int(rng.integers(12, 80)), float(10 ** rng.uniform(1, 3))
    feet, normals, jacobian = CONSTRUCTION[shape](rng, count, np.deg2rad(arc_deg))
    residual = rng.normal(size=len(jacobian))
    columns = np.linalg.qr(jacobian)[0]
    for _ in range(2):
        residual -= columns @ (columns.T @ residual)
    height = 1 - np.cos(min(np.deg2rad(arc_deg), np.pi) / 2)  # of the arc over its chord: the shape must show
    residual *= 0.02 * height / np.abs(residual).max()
    local = feet + sum(r[:, None] * n for r, n in zip(residual.reshape(-1, count), normals, strict=True))
    turn = Rotation.random(random_state=rng).as_matrix()
    at = rng.uniform(-1, 1, 3) * (FAR_MM if far else 100.0)
    return Known(size * local @ turn.T + at, at, turn[:, 2], size)


def line(rng: np.random.Generator, count: int, _: float) -> tuple[Float, list[Float], Float]:
    h, zero, one = rng.uniform(-1, 1, count), np.zeros(count), np.ones(count)
    x, y = np.column_stack([one, zero, zero]), np.column_stack([zero, one, zero])
    half = np.column_stack([one, h])
    return np.column_stack([zero, zero, h]), [x, y], np.kron(np.eye(2), half)


def plane(rng: np.random.Generator, count: int, _: float) -> tuple[Float, list[Float], Float]:
    u, v = rng.uniform(-1, 1, (2, count))
    normal = np.tile([0.0, 0.0, 1.0], (count, 1))
    return np.column_stack([u, v, 0 * u]), [normal], np.column_stack([np.ones(count), u, v])


def circle(rng: np.random.Generator, count: int, arc: float) -> tuple[Float, list[Float], Float]:
    angle = rng.uniform(-arc / 2, arc / 2, count)
    radial = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    up, none = np.tile([0.0, 0.0, 1.0], (count, 1)), np.zeros((count, 3))
    inside = np.column_stack([radial[:, :2], np.ones(count)])
    off = np.column_stack([np.ones(count), radial[:, :2]])
    return radial, [radial, up], np.block([[inside, none], [none, off]])


def sphere(rng: np.random.Generator, count: int, arc: float) -> tuple[Float, list[Float], Float]:
    away, around = np.arccos(rng.uniform(np.cos(arc / 2), 1, count)), rng.uniform(0, 2 * np.pi, count)
    normal = np.column_stack([np.sin(away) * np.cos(around), np.sin(away) * np.sin(around), np.cos(away)])
    return normal, [normal], np.column_stack([normal, np.ones(count)])


def cylinder(rng: np.random.Generator, count: int, arc: float) -> tuple[Float, list[Float], Float]:
    angle, h = rng.uniform(-arc / 2, arc / 2, count), rng.uniform(-1, 1, count) * max(arc, 0.5)
    normal = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle])
    jacobian = np.column_stack([normal[:, :2], h[:, None] * normal[:, :2], np.ones(count)])
    return normal + np.outer(h, [0.0, 0.0, 1.0]), [normal], jacobian


CONSTRUCTION = {"line": line, "plane": plane, "circle": circle, "sphere": sphere, "cylinder": cylinder}


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
