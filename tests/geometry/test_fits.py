"""Fits against shapes that are known: points stand off them in pairs, as far outwards as inwards.

At such a shape the residuals of each pair cancel in the gradient of the sum of squares, so that it fits best.
"""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.geometry.fits import LEAST_POINTS, Shape, fit
from workbench.units import Float

SHAPES: tuple[Shape, ...] = ("line", "plane", "circle", "sphere", "cylinder")
FAR_MM = 1e6
TOLERANCE = 1e-9  # of the size


def feet(shape: Shape, rng: np.random.Generator, arc: float) -> tuple[Float, Float]:
    """Points (n, 3) on a shape of size 1 about z and the origin, and unit normals there."""
    angle, h = rng.uniform(-arc / 2, arc / 2, 40), rng.uniform(-1.0, 1.0, 40)
    radial, up = np.column_stack([np.cos(angle), np.sin(angle), 0 * angle]), np.outer(h, [0.0, 0.0, 1.0])
    away = np.abs(angle) / 2
    ball = np.column_stack([np.sin(away) * np.cos(7 * angle), np.sin(away) * np.sin(7 * angle), np.cos(away)])
    return {
        "line": (up, np.column_stack([np.cos(9 * angle), np.sin(9 * angle), 0 * angle])),
        "plane": (radial * h[:, None], np.tile([0.0, 0.0, 1.0], (40, 1))),
        "circle": (radial, radial),
        "sphere": (ball, ball),
        "cylinder": (radial + up, radial),
    }[shape]


@pytest.mark.parametrize("far_mm", [100.0, FAR_MM])
@pytest.mark.parametrize("arc_deg", [30.0, 90.0, 360.0])
@pytest.mark.parametrize("shape", SHAPES)
def test_known_shapes_are_found(shape: Shape, arc_deg: float, far_mm: float) -> None:
    rng = np.random.default_rng([int(arc_deg), int(far_mm)])
    on, normal = feet(shape, rng, np.radians(arc_deg))
    off = 0.01 * (1 - np.cos(np.radians(arc_deg) / 4)) * rng.uniform(0.2, 1.0, (40, 1)) * normal
    turn, at, size = Rotation.random(random_state=rng), rng.uniform(-far_mm, far_mm, 3), 10 ** rng.uniform(1, 3)
    found = fit(shape, size * turn.apply(np.concatenate([on + off, on - off])) + at)
    wrong, axis = turn.inv().apply(found.point_mm - at) / size, np.array([0.0, 0.0, 1.0])
    if found.radius_mm is not None:
        assert found.radius_mm == pytest.approx(size, rel=TOLERANCE)
    if found.direction is not None:
        assert np.linalg.norm(np.cross(turn.inv().apply(found.direction), axis)) < TOLERANCE
    open_ways = {"line": [2], "cylinder": [2], "plane": [0, 1]}.get(shape, [])
    assert np.abs(np.delete(wrong, open_ways)).max() < TOLERANCE


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


@pytest.mark.parametrize(
    ("shape", "points", "told"),
    [
        *((shape, np.eye(4)[: LEAST_POINTS[shape] - 1, :3], "expected at least") for shape in SHAPES),
        ("line", np.ones((5, 3)), r"open|flat"),
        ("plane", np.outer(np.arange(6.0), [1.0, 2.0, 3.0]), r"open|flat"),
        ("circle", np.outer(np.arange(6.0), [1.0, 2.0, 3.0]), r"open|flat"),
        ("sphere", np.column_stack([np.cos(np.arange(9.0)), np.sin(np.arange(9.0)), np.zeros(9)]), r"open|flat"),
        ("cylinder", np.outer(np.arange(9.0), [1.0, 2.0, 3.0]), r"open|flat"),
    ],
)
def test_points_that_are_too_few_or_leave_the_shape_open_are_refused(shape: Shape, points: Float, told: str) -> None:
    with pytest.raises(ValueError, match=told):
        fit(shape, points)
