"""Bodies of a cell as triangles, and as the edges that the report's viewer draws."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Strokes
from workbench.geometry.poses import mapped
from workbench.robot.cell_model import Cell, Shape
from workbench.robot.collision import standing_poses
from workbench.robot.kinematics import motions
from workbench.units import AnyArray, Float

SIDES = 64  # of a round body
FEW_SIDES = 8  # of one that is drawn: so few that a capsule has edges
HUGE_MM = 7200.0  # a body that is larger, a floor or an envelope, is left out: it hides the others
CREASE = np.cos(np.radians(20.0))  # of neighbouring triangles: sharper, their edge is drawn
ROUND_MM = 0.01  # by which corners of two triangles may differ and be one
ROBOT, WAY, AROUND = "robot", "way of the tool", (120, 140, 125)
COLOURS = {
    ROBOT: (201, 130, 30),
    "cutter": (209, 31, 31),
    "tool": (79, 93, 117),
    "workpiece": (140, 106, 48),
    "turntable": (122, 139, 153),
    WAY: (90, 90, 200),
}


def body_edges(cell: Cell) -> dict[tuple[str, int], list[AnyArray]]:
    """Edges (2, 3), mm, of what is drawn in its link's frame, by name and `Shape.link`; the robot's share a name."""
    found: dict[tuple[str, int], list[AnyArray]] = {}
    for shape in cell.shapes:
        if 2 * shape.sphere[1] <= HUGE_MM:
            lines = edges(mapped(shape.pose, shape_triangles(shape, sides=FEW_SIDES)))
            found.setdefault((name_of(shape), shape.link), []).extend(lines)
    return {key: lines for key, lines in found.items() if lines}


def name_of(shape: Shape) -> str:
    """What a shape is drawn as."""
    return ROBOT if 0 <= shape.link <= 6 and shape.body not in COLOURS else shape.body


def cell_strokes(
    cell: Cell,
    joints: Float,
    turntable: Float | float,
    when: str = "",
    way_mm: Float | None = None,
    *,
    shown: bool = True,
) -> list[Strokes]:
    """The bodies of a cell in a posture, as edges in the base for a `Scene`; a floor or an envelope is left out.

    Args:
        cell: whose bodies they are.
        joints: (6,) rad.
        turntable: angle of the turntable, rad.
        when: what is added to their names.
        way_mm: (n, 3) of the tool, in the base, likewise drawn.
        shown: at first.

    Example:
        >>> import numpy as np
        >>> from workbench.robot import cell, cell_strokes
        >>> [one.name for one in cell_strokes(cell(cell="data/robot/cell.json"), np.zeros(6), 0.0)][:1]
        ['robot']
    """
    moved = [*motions(cell.chain, joints), *standing_poses(cell, turntable)]  # by `Shape.link`
    found: dict[str, list[AnyArray]] = {}
    for (name, link), lines in body_edges(cell).items():
        found.setdefault(name, []).extend(mapped(moved[max(link, 0)], line) for line in lines)
    if way_mm is not None:
        found[WAY] = [way_mm]
    return [drawn(f"{name}{when}", lines, name, shown=shown) for name, lines in found.items()]


def drawn(name: str, lines: list[AnyArray], as_what: str, *, shown: bool = True, moved: Float | None = None) -> Strokes:
    """Lines (k, 3) of one name in the colour of what they are."""
    colour = np.array(COLOURS.get(as_what, AROUND), np.uint8)
    return Strokes(name, tuple(lines), tuple(np.tile(colour, (len(line), 1)) for line in lines), shown, moved)


def shape_triangles(shape: Shape, sides: int = SIDES) -> Float:
    """Triangles (t, 3, 3) of a shape in its own frame: those of its mesh, or of a box, or turned about z."""
    if shape.vertices_mm is not None:
        return np.asarray(shape.vertices_mm[shape.triangles])
    if shape.kind == "box":
        half = np.array(shape.size_mm) / 2
        ring = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * half[:2]
        levels = ((0, -half[2]), (1, -half[2]), (1, half[2]), (0, half[2]))
        return _skin(np.array([np.column_stack([ring * s, np.full(4, z)]) for s, z in levels]))
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


def normals(triangles_mm: Float) -> tuple[Float, Float]:
    """Normals (t, 3) of triangles (t, 3, 3), and their lengths (t,), which are twice the areas."""
    normal = np.cross(triangles_mm[:, 1] - triangles_mm[:, 0], triangles_mm[:, 2] - triangles_mm[:, 0])
    return normal, np.linalg.norm(normal, axis=1)


def edges(triangles_mm: Float) -> list[AnyArray]:
    """Edges (2, 3) of triangles (t, 3, 3) at which the surface bends or ends, mm."""
    if not len(triangles_mm):
        return []
    normal, size = normals(triangles_mm)
    triangles_mm, normal = triangles_mm[size > 0], normal[size > 0] / size[size > 0, None]
    corners, which = np.unique(np.round(triangles_mm.reshape(-1, 3) / ROUND_MM), axis=0, return_inverse=True)
    which = which.reshape(-1, 3)
    ends = np.sort(np.concatenate([which[:, [0, 1]], which[:, [1, 2]], which[:, [2, 0]]]), axis=1)
    pairs, of, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    normal_sum = np.zeros((len(pairs), 3))
    np.add.at(normal_sum, of.reshape(-1), np.tile(normal, (3, 1)))
    bend = (normal_sum**2).sum(axis=1) / 2 - 1  # of two unit normals their sum's square: 2 + 2 cos
    drawn = (count != 2) | (bend < CREASE)
    return list(corners[pairs[drawn]] * ROUND_MM)
