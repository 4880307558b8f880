"""What the dialects share: the zone, and the tool and the work object as the cell has them."""

from __future__ import annotations

import dataclasses
from typing import Annotated

import numpy as np
from pydantic import Field

from workbench.artefacts import Moves
from workbench.dialect import MillingTool, ProgramJob
from workbench.geometry.poses import inverse, pose_from, quaternion_from_rotation, rotation_from_quaternion
from workbench.robot.cell import Cell
from workbench.units import Bool, Float

Zone = Annotated[
    float,
    Field(
        ge=0,
        le=50,
        description="how far before a target the next move may blend in, but at sharp corners; 0: never",
    ),
]
GENTLE = 0.8  # share of a joint's acceleration that blending may take
NOTHING = 1e-6  # mm
NO_LOAD_KG, NO_LOAD_MM = 0.001, (0.0, 0.0, 0.001)  # ABB's tool0: what a program says of a load that nobody stated


def program_job(name: str, moves: Moves, cell: Cell, zone_mm: float, rounding_mm: float) -> ProgramJob:
    """The job as the cell has it.

    A tool that the controller knows by name is the cutter's tip; one that the program declares is the path's own frame,
    on the cutter's flank. Targets are in the cell's work object.
    """
    assert moves.flange_from_point is not None
    tool = moves.flange_from_point if cell.tool_name is None else cell.flange_from_cutter
    seen = as_seen(moves, inverse(cell.base_from_workobject), inverse(moves.flange_from_point) @ tool)
    radius = moves.toolpath.cutter.diameter_mm / 2
    stated = cell.tool_mass_kg is not None and cell.tool_centre_of_gravity_mm is not None
    mass, centre = (cell.tool_mass_kg, cell.tool_centre_of_gravity_mm) if stated else (NO_LOAD_KG, np.array(NO_LOAD_MM))
    assert mass is not None
    assert centre is not None
    spindle = MillingTool(tool[:3, 3] - radius * tool[:3, 0], quaternion_from_rotation(tool[:3, :3]), mass, centre)
    return ProgramJob(
        name,
        seen,
        spindle,
        zone_mm,
        moves.turntable_deg,
        rounding_mm,
        cell.base_from_workobject,
        cell.tool_name,
        cell.work_object_name,
        too_sudden(moves, cell, zone_mm),
    )


def too_sudden(moves: Moves, cell: Cell, zone_mm: float) -> Bool | None:
    """Targets (k,) at which blending would ask more of a joint than GENTLE of its acceleration: these are reached.

    Through a zone the velocity turns from the one move's to the next one's, in the time that it takes to cross it at
    the feed. Velocities of the joints are those of the path's own postures beside the target. None: the cell's file
    states no accelerations.
    """
    made, point = moves.postures, moves.point
    if cell.accelerations is None or made is None or point is None:
        return None
    length = np.linalg.norm(np.diff(moves.position_mm, axis=0), axis=1)
    room = np.minimum(np.append(0.0, length), np.append(length, 0.0)) / 2
    zone = np.maximum(np.minimum(zone_mm, room), NOTHING)
    steps = np.linalg.norm(np.diff(made.position_mm, axis=0), axis=1)
    a_mm = np.diff(made.joints, axis=0) / np.maximum(steps, NOTHING)[:, None]  # rad of each joint a mm of way
    inside = np.clip(point, 1, len(a_mm) - 1)
    turned = np.abs(a_mm[inside] - a_mm[inside - 1]) * moves.feed_mm_s[:, None]
    asked = turned / (2 * zone / moves.feed_mm_s)[:, None]
    return np.asarray((asked > GENTLE * cell.accelerations).any(axis=1))


def as_seen(moves: Moves, frame_from_base: Float, point_from_tool: Float) -> Moves:
    """The same moves as targets of another tool frame in another frame."""

    def turned(position: Float, quaternion: Float) -> tuple[Float, Float]:
        poses = frame_from_base @ pose_from(rotation_from_quaternion(quaternion), position) @ point_from_tool
        return poses[:, :3, 3], quaternion_from_rotation(poses[:, :3, :3])

    position, quaternion = turned(moves.position_mm, moves.quaternion_wxyz)
    via, via_turn = moves.via_position_mm.copy(), moves.via_quaternion_wxyz.copy()
    arcs = moves.circular
    via[arcs], via_turn[arcs] = turned(via[arcs], via_turn[arcs])
    return dataclasses.replace(
        moves, position_mm=position, quaternion_wxyz=quaternion, via_position_mm=via, via_quaternion_wxyz=via_turn
    )
