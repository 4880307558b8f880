"""The program as written, played in the report's viewer: robot, tool, plate and what stands around, place by place."""

from __future__ import annotations

import numpy as np

from workbench.artefacts import Judgement, Scene, Strokes
from workbench.geometry.poses import inverse, mapped
from workbench.robot.bounds import CollisionScreen
from workbench.robot.cell import Cell
from workbench.robot.collision import base_from_targets, standing_poses
from workbench.robot.drawing import HUGE_MM, shape_triangles
from workbench.robot.kinematics import forward_kinematics, motions
from workbench.units import AnyArray, Float

FRAMES = 600  # that are shown at most, spread evenly over the places at which the judge looked first
CREASE = np.cos(np.radians(20.0))  # of neighbouring triangles: sharper, their edge is drawn
ROUND_MM = 0.01  # by which corners of two triangles may differ and be one
WAY, AROUND = "way of the tool", (120, 140, 125)
COLOURS = {
    "robot": (201, 130, 30),
    "cutter": (209, 31, 31),
    "tool": (79, 93, 117),
    "workpiece": (140, 106, 48),
    "turntable": (122, 139, 153),
    WAY: (90, 90, 200),
}


def playback(judgement: Judgement, cell: Cell) -> Scene | None:
    """The scene of a program that was driven; None: it was not, or reaches nowhere."""
    driven = judgement.driven
    if not driven:
        return None
    reached = np.flatnonzero(np.isfinite(driven["joints"]).all(axis=1))
    at = reached[np.unique(np.linspace(0, len(reached) - 1, min(FRAMES, len(reached))).astype(int))]
    if not len(at):
        return None
    joints, table = driven["joints"][at], driven["turntable"][at]
    floor = inverse(base_from_targets(cell, table))
    links = np.swapaxes(floor[:, None] @ motions(cell.chain, joints), 0, 1)
    moved = [*links, *(floor @ standing_poses(cell, table))]  # by `Shape.link`
    clearance = CollisionScreen(cell).clearances_mm(joints, table)
    said = tuple(
        f"line {line:.0f} · {time_s:.1f} s · {mm_s:.3g} mm/s"
        + (f" · clearance {near:.1f} mm" if np.isfinite(near) else "")
        for line, time_s, mm_s, near in zip(
            *(driven[name][at].tolist() for name in ("line", "time_s", "mm_s")), clearance.tolist(), strict=True
        )
    )
    tip = (floor @ forward_kinematics(cell.chain, joints) @ cell.flange_from_cutter)[:, :3, 3]
    bodies: dict[tuple[str, int], list[AnyArray]] = {}
    for shape in cell.shapes:
        if 2 * shape.sphere[1] <= HUGE_MM:
            name = "robot" if 0 <= shape.link <= 6 and shape.body not in COLOURS else shape.body
            corners = shape_triangles(shape, sides=8)  # so few that a capsule has edges to be drawn
            lines = edges(mapped(shape.pose, corners))
            bodies.setdefault((name, shape.link), []).extend(lines)
    strokes = [
        Strokes(name, tuple(lines), (_colour(name, 2),) * len(lines), moved=moved[max(link, 0)])
        for (name, link), lines in bodies.items()
        if lines
    ]
    strokes += [Strokes(WAY, (tip,), (_colour(WAY, len(tip)),))] if len(tip) > 1 else []
    return Scene(np.zeros((0, 3)), (), tuple(strokes), (), np.eye(3), "places", ("x", "y", "z"), said)


def _colour(name: str, points: int) -> AnyArray:
    return np.tile(np.array(COLOURS.get(name, AROUND), np.uint8), (points, 1))


def edges(triangles_mm: Float) -> list[AnyArray]:
    """Edges (2, 3) of triangles (t, 3, 3) at which the surface bends or ends, mm."""
    if not len(triangles_mm):
        return []
    normal = np.cross(triangles_mm[:, 1] - triangles_mm[:, 0], triangles_mm[:, 2] - triangles_mm[:, 0])
    size = np.linalg.norm(normal, axis=1)
    triangles_mm, normal = triangles_mm[size > 0], normal[size > 0] / size[size > 0, None]
    corners, which = np.unique(np.round(triangles_mm.reshape(-1, 3) / ROUND_MM), axis=0, return_inverse=True)
    which = which.reshape(-1, 3)
    ends = np.sort(np.concatenate([which[:, [0, 1]], which[:, [1, 2]], which[:, [2, 0]]]), axis=1)
    pairs, of, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    beside = np.zeros((len(pairs), 3))
    np.add.at(beside, of.reshape(-1), np.tile(normal, (3, 1)))
    bend = (beside**2).sum(axis=1) / 2 - 1  # of two unit normals their sum's square: 2 + 2 cos
    drawn = (count != 2) | (bend < CREASE)
    return list(corners[pairs[drawn]] * ROUND_MM)
