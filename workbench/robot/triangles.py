"""The bodies of a robot cell as triangles, for pictures. mm."""

from __future__ import annotations

import numpy as np

from workbench.robot.cell import Cell
from workbench.robot.collision import turntable_pose
from workbench.robot.kinematics import motions
from workbench.robot.shapes import ON_TURNTABLE, Shape
from workbench.units import Float

ROUND = 16  # sides of a round body


def cell_triangles(cell: Cell, joints: Float, turntable: float, sides: int = ROUND) -> list[tuple[str, Float]]:
    """Body and triangles (t, 3, 3) of every shape, in the base, at joint angles (6,) and a turntable angle, rad."""
    moved, turned = motions(cell.chain, joints), turntable_pose(cell, turntable)
    found = []
    for shape in cell.shapes:
        pose = (turned if shape.link == ON_TURNTABLE else moved[max(shape.link, 0)]) @ shape.pose
        corners = _triangles(shape, sides)
        area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        found.append((shape.body, corners[area > 0] @ pose[:3, :3].T + pose[:3, 3]))
    return found


def _triangles(shape: Shape, sides: int) -> Float:
    """Triangles (t, 3, 3) of a shape in its own frame."""
    if shape.vertices_mm is not None:
        return np.asarray(shape.vertices_mm[shape.triangles])
    if shape.kind == "box":
        half = np.array(shape.size_mm) / 2
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
        return _skin(
            np.array(
                [
                    np.column_stack([ring * s, np.full(4, z)])
                    for s, z in ((0, -half[2]), (1, -half[2]), (1, half[2]), (0, half[2]))
                ]
            )
        )
    radius = shape.size_mm[0]
    length = shape.size_mm[1] if len(shape.size_mm) > 1 else 0.0
    if shape.kind == "cylinder":
        outline = np.array([[0, -length / 2], [radius, -length / 2], [radius, length / 2], [0, length / 2]])
    else:
        bow = np.linspace(0, np.pi / 2, sides // 4 + 2)
        cap = np.column_stack([radius * np.sin(bow), length / 2 + radius * np.cos(bow)])
        outline = np.vstack([cap * (1, -1), cap[::-1]])
    angles = np.linspace(0, 2 * np.pi, sides, endpoint=False)
    circle = np.column_stack([np.cos(angles), np.sin(angles)])
    return _skin(np.array([np.column_stack([r * circle, np.full(sides, z)]) for r, z in outline]))


def _skin(rings: Float) -> Float:
    """Triangles between rings (r, k, 3) one above the other."""
    a, b = rings[:-1], rings[1:]
    a_next, b_next = np.roll(a, -1, axis=1), np.roll(b, -1, axis=1)
    return np.concatenate(
        [np.stack(corners, axis=2).reshape(-1, 3, 3) for corners in ((a, a_next, b_next), (a, b_next, b))]
    )
