"""The sphere around a shape, by which what is far off is left out of the search for collisions."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from workbench.robot.cell import Shape
from workbench.units import Float

POSE = np.eye(4)
POSE[:3, :3] = Rotation.from_euler("xyz", [40.0, -20.0, 70.0], degrees=True).as_matrix()
POSE[:3, 3] = (300.0, -120.0, 55.0)


def outermost(kind: str, size: tuple[float, ...]) -> Float:
    """Points (n, 3) of a shape's skin, in its own frame, among them those farthest from its middle."""
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), 0.0 * turn], axis=1)
    if kind == "box":
        return np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)]) * np.array(size) / 2.0
    if kind == "sphere":
        return np.concatenate([ring, ring[:, [2, 0, 1]]]) * size[0]
    ends = np.array([[0.0, 0.0, side * (size[1] / 2.0 + (size[0] if kind == "capsule" else 0.0))] for side in (-1, 1)])
    rims = np.concatenate([size[0] * ring + [0.0, 0.0, side * size[1] / 2.0] for side in (-1, 1)])
    return np.concatenate([ends, rims])


@pytest.mark.parametrize(
    ("kind", "size"),
    [("box", (30.0, 80.0, 10.0)), ("sphere", (25.0,)), ("capsule", (20.0, 90.0)), ("cylinder", (20.0, 90.0))],
)
def test_the_sphere_holds_the_shape_and_no_more(kind: str, size: tuple[float, ...]) -> None:
    shape = Shape("one", 0, kind, size, POSE)
    middle, radius = shape.sphere
    points = outermost(kind, size) @ POSE[:3, :3].T + POSE[:3, 3]
    assert np.linalg.norm(points - middle, axis=1).max() == pytest.approx(radius)


def test_the_sphere_of_a_mesh_is_that_of_its_box_wherever_its_frame_lies() -> None:
    corners = np.array([[x, y, z] for x in (10.0, 50.0) for y in (-7.0, 3.0) for z in (100.0, 104.0)])
    middle, radius = Shape("one", 0, "mesh", (), POSE, corners, np.array([[0, 1, 2]])).sphere
    far = np.linalg.norm(corners @ POSE[:3, :3].T + POSE[:3, 3] - middle, axis=1)
    assert far == pytest.approx(np.full(8, radius))
