"""Paths that a robot can follow: moves with postures, by the inverse kinematics and nothing of the optimiser."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation, Slerp

from bench.program_outsider import Outsider, Target
from workbench.api import inverse, quaternion_from_rotation, rotation_from_quaternion
from workbench.artefacts import Moves, Postures, ProgramMoves, Toolpath
from workbench.path import simplify
from workbench.path.simplify_stage import _points
from workbench.robot import Cell, Turntable, forward_kinematics, inverse_kinematics, read_cell, within_limits
from workbench.units import Float

from .paths import Shape, mill_path, moved

URDFS = Path(__file__).parents[1] / "robot" / "urdf"
DATA = Path(__file__).parents[2] / "data" / "robot"
ROBOTS = {  # base frame, and a posture from which the arm can go some way, deg
    "irb6700": ("base_link", (10, 20, 10, 30, 50, -20)),
    "kr210": ("base_link", (15, -70, 95, -40, 60, 35)),
    "m20ia": ("base", (-20, 25, -15, 50, -70, 40)),
    "gp25": ("base", (15, 20, -10, 40, -60, 30)),
    "ur10e": ("base", (10, -70, 100, -60, -80, 30)),
}
FILLED = (
    "gp25",
)  # whose controller moves the tip straight: travels then need points on their way, as the optimiser makes
CUTTER = [[0, 0, 1, 260], [0, -1, 0, 0], [1, 0, 0, 140], [0, 0, 0, 1]]


def cell_of(robot: str, folder: Path, tool: str | None = None, place: str | None = None, **controller: object) -> Cell:
    """A cell with one of the robots, a spindle at its side and a turntable."""
    urdf = DATA / "irb6700_150_320.urdf" if robot == "irb6700" else URDFS / f"{robot}.urdf"
    tree = {
        "format": "robot-cell",
        "version": 1,
        "tool": {"flange_from_cutter": CUTTER, "controller_name": tool},
        "robot": {"urdf": str(urdf), "base_frame": ROBOTS[robot][0]},
        "controller": controller or None,
        "work_object": place and {"pose": {"position_mm": [900, 100, 50]}, "controller_name": place},
        "turntable": {"base_from_turntable": {"position_mm": [1500, 0, 300]}},
    }
    file = folder / f"{robot}.json"
    file.write_text(json.dumps(tree))
    return read_cell(file)


def as_workpiece(fixture: str, cell: Cell) -> Cell:
    """The cell with a fixture, which stands still, as what is milled."""
    shapes = (replace(one, body="workpiece") if one.body == fixture else one for one in cell.shapes)
    return replace(cell, shapes=tuple(shapes))


def postured(cell: Cell, robot: str, shape: Shape, turned: float = 0.0) -> Moves:
    """A path laid into the robot's reach, with the posture of each of its points; `turned`: by the turntable, rad."""
    middle = np.array(ROBOTS[robot][1]) * np.pi / 180
    path = filled(mill_path(shape), 5.0) if robot in FILLED else mill_path(shape)
    flange_from_point = np.array(CUTTER, float)
    flange_from_point[:3, 3] += 5 * flange_from_point[:3, 0] - 10 * flange_from_point[:3, 2]
    points = _points(path)
    frames = np.tile(np.eye(4), (len(points.layer), 1, 1))
    frames[:, :3, :3], frames[:, :3, 3] = rotation_from_quaternion(points.quaternion_wxyz), points.position_mm
    there = forward_kinematics(cell.chain, middle) @ flange_from_point
    move = there @ inverse(frames[len(frames) // 2])
    path = moved(path, move)
    branches = inverse_kinematics(cell.chain, move @ frames @ inverse(flange_from_point))
    joints, last = np.empty((len(frames), 6)), middle
    for i in [*range(len(frames) // 2, len(frames)), *range(len(frames) // 2 - 1, -1, -1)]:
        last = middle if i == len(frames) // 2 - 1 else last
        near = within_limits(cell.chain, branches[i], last)
        last = joints[i] = near[np.nanargmin(np.linalg.norm(near - last, axis=1))]
    assert np.isfinite(joints).all()
    targets = forward_kinematics(cell.chain, joints) @ flange_from_point
    table = turned * np.linspace(0, 1, len(frames))
    made = Postures(
        toolpath=path,
        layer=points.layer,
        cutting=points.cutting,
        measured=points.measured,
        position_mm=targets[:, :3, 3],
        quaternion_wxyz=quaternion_from_rotation(targets[:, :3, :3]),
        feed_mm_s=points.feed_mm_s,
        cutter_rotation=np.zeros(len(frames)),
        turntable=table,
        joints=joints,
        displacement_mm=np.zeros((len(frames), 3)),
        clearance_mm=np.zeros(len(frames)),
        flange_from_point=flange_from_point,
        has_turntable=isinstance(cell.turntable, Turntable),
    )
    return simplify(path, made)


def by_an_outsider(cell: Cell, read: ProgramMoves) -> tuple[Any, Outsider, Float, Float]:
    """A program of the shipped robot driven in fine steps by other formulas, clear of everything.

    Its moves on the path, the outsider, joint angles (n, 6), rad, and the external axes (n, ...), deg or mm.
    """
    begin = max(i for i, move in enumerate(read.moves[:-1]) if move.kind == "J")
    on_path, start = read.moves[begin + 1 : -2], read.moves[begin]  # behind the last target the tool is drawn back
    tool = read.tools[start.tool].flange_from_tool
    outsider = Outsider(DATA / "irb6700_150_320.urdf", replace(cell, flange_from_cutter=tool))
    frame = read.work_objects[start.work_object]
    targets = [
        Target(
            move.kind,
            frame @ move.pose,
            None if move.via is None else frame @ move.via,
            None,
            np.degrees(move.turntable),
            move.zone_mm,
        )
        for move in on_path
    ]
    ((wrong, joints, tables),) = outsider.drive([(start.joints, np.degrees(start.turntable), targets)])
    assert wrong == ""
    assert outsider.unsafe(cell, joints, tables) == ""
    return on_path, outsider, joints, tables


def filled(path: Toolpath, step_mm: float) -> Toolpath:
    """The path with points so near to each other along its travels, from the layer before to the layer behind."""
    parts = [part for part in path.in_order if len(part.feed_mm_s)]
    made = []
    for travel in path.travels:
        if not len(travel.feed_mm_s):
            made.append(travel)
            continue
        i = next(i for i, part in enumerate(parts) if part is travel)
        before, after = parts[max(i - 1, 0) : i], parts[i + 1 : i + 2]
        row = [*((one, slice(-1, None)) for one in before), (travel, slice(None)), *((one, slice(1)) for one in after)]
        place = np.concatenate([one.position_mm[which] for one, which in row])
        turn = np.concatenate([one.quaternion_wxyz[which] for one, which in row])
        way = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(place, axis=0), axis=1)))
        own = way[len(before) : len(way) - len(after)]
        new = np.append(True, np.diff(way) > 1e-9)
        place, turn, way = place[new], turn[new], way[new]
        at = np.unique(np.concatenate([own, np.arange(step_mm, way[-1], step_mm)]))
        made.append(
            replace(
                travel,
                position_mm=np.stack([np.interp(at, way, axis) for axis in place.T], axis=1),
                quaternion_wxyz=Slerp(way, Rotation.from_quat(turn, scalar_first=True))(at).as_quat(scalar_first=True),
                feed_mm_s=np.full(len(at), travel.feed_mm_s[0]),
            )
        )
    return replace(path, travels=tuple(made))
