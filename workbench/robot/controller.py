"""What a maker's controller takes for its base and for its flange, and whether a cell's frames are these.

A program says joint angles and poses. The robot goes where the controller computes them to be, in frames that no
program names; a cell whose `base_frame` or `flange_frame` is another one makes a program that is whole in itself and
wrong in the world. So the frames are told from the robot's axes, all joints at zero, by each maker's rule, and a
program's first posture must be its pose there.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, Violation
from workbench.geometry.poses import inverse, pose_from, rpy_from_rotation, vector_from_rotation
from workbench.robot.cell_model import Cell
from workbench.robot.kinematics import Chain, forward_kinematics
from workbench.robot.makers import MAKERS, Maker
from workbench.units import DEG, Float

NEAR_MM, NEAR = 2.0, 0.5 * DEG  # what calibrated lengths and angles of a robot may differ by from its maker's rule
SAME_MM, SAME = 0.01, 0.001 * DEG  # frames by name are the same or others
LEAST_COSINE = 0.5  # of an axis with the direction that its sense is told by


def frame_faults(
    cell: Cell, program: ProgramMoves, tools: Mapping[str, Float]
) -> tuple[Violation | None, tuple[str, ...]]:
    """Where the controller would have the first posture's tool elsewhere than the program; what nobody can look at.

    Args:
        cell: robot and frames.
        program: in the language of the cell's controller; of another one's nothing is said.
        tools: flange_from_tool (4, 4) by name.
    """
    maker, posed = MAKERS.get(program.dialect), [move for move in program.moves if move.pose is not None]
    if not posed or (cell.controller is not None and cell.controller.dialect != program.dialect):
        return None, ()
    if maker is None:
        return None, (f"that base and flange are the controller's: no rule is known for '{program.dialect}'",)
    finding: str | None = (
        f"axes 1 and 2 are not at right angles: expected a robot of {maker.name}'s, whose base is known by them"
    )
    if abs(cell.chain.axes[0] @ cell.chain.axes[1]) < np.sin(NEAR):
        base, tool = _base(cell, maker), tools[posed[0].tool]
        finding = _senses(cell.chain, maker, base) or _elsewhere(cell, maker, base, program.moves[0], tool)
    fault = None if finding is None else Violation(posed[0].line, 0.0, "frame", finding)
    return fault, tuple(_unnamed(cell.chain, maker))


def _base(cell: Cell, maker: Maker) -> Float:
    """The controller's base (4, 4) in the cell's."""
    chain, named = cell.chain, cell.chain.frames
    z, y = chain.axes[:2] * maker.axes[:2].sum(axis=1, keepdims=True)
    y = y - z * (y @ z)
    y /= np.linalg.norm(y)
    foot = named.get("base", named.get("base_link", np.eye(4)))[:3, 3]
    height = chain.points_mm[1] if maker.at_axis_2 else foot
    origin = chain.points_mm[0] + z * (z @ (height - chain.points_mm[0]))
    return _of(pose_from(np.column_stack([np.cross(y, z), y, z]), origin), named.get("base"), np.eye(4))


def _flange(cell: Cell, maker: Maker, base: Float) -> Float:
    """The controller's flange (4, 4) in the cell's base, all joints at zero."""
    chain, named = cell.chain, cell.chain.frames
    axis, at = chain.axes[5], chain.points_mm[5]
    face = named.get("tool0", named.get("flange", chain.base_from_flange_at_zero))[:3, 3]
    ruled = pose_from(base[:3, :3] @ maker.base_from_flange, at + axis * (axis @ (face - at)))
    return _of(ruled, named.get("tool0"), chain.base_from_flange_at_zero)


def _of(ruled: Float, *known: Float | None) -> Float:
    """The first known frame that is the one by rule, but for the calibration of a robot; else that by rule."""
    for one in known:
        if one is not None and all(np.less(_apart(ruled, one), (NEAR_MM, NEAR))):
            return one
    return ruled


def _apart(one: Float, other: Float) -> tuple[float, float]:
    """Distance of two frames' origins, mm, and the angle between them."""
    turn = vector_from_rotation(one[:3, :3].T @ other[:3, :3])
    return float(np.linalg.norm(one[:3, 3] - other[:3, 3])), float(np.linalg.norm(turn))


def _same(one: Float, other: Float) -> bool:
    """Whether two frames are one."""
    return all(np.less_equal(_apart(one, other), (SAME_MM, SAME)))


def _unnamed(chain: Chain, maker: Maker) -> list[str]:
    """What stands in the cell file alone."""
    left = [] if maker.at_axis_2 or {"base", "base_link"} & set(chain.frames) else ["the base's height on axis 1"]
    left += [] if {"tool0", "flange"} & set(chain.frames) else ["the flange's place on axis 6"]
    return [f"{what}: the URDF has no frame by a conventional name there" for what in left]


def _senses(chain: Chain, maker: Maker, base: Float) -> str | None:
    """Joints that turn the other way, or about another direction, than this maker's."""
    cosine = ((chain.axes @ base[:3, :3]) * maker.axes).sum(axis=1)
    wrong = [str(i + 1) for i in np.flatnonzero(cosine < LEAST_COSINE)]
    if not wrong:
        return None
    return (
        f"with all joints at zero, these turn about other axes than {maker.name}'s ({maker.joints} in its base): "
        f"{', '.join(wrong)}; expected the controller's zeros and senses in the URDF"
    )


def _elsewhere(cell: Cell, maker: Maker, base: Float, first: ProgramMove, tool: Float) -> str | None:
    """The first posture's pose as the controller computes it, against the cell's."""
    chain, stated = cell.chain, None if cell.controller is None else cell.controller.world_from_base
    if stated is not None and not maker.world:
        return f"$.controller.world_from_base: expected null, programs of {maker.name}'s know no world but the base"
    assert first.joints is not None  # else there is no way, and the judge has refused it
    flange = _flange(cell, maker, base)
    world_from_cell = (np.eye(4) if stated is None else stated) @ inverse(base)
    cells_from_flange = inverse(chain.base_from_flange_at_zero) @ flange
    there = forward_kinematics(chain, first.joints)
    faults = []
    if not _same(world_from_cell, np.eye(4)):
        where = f"its base lies {maker.origin}"
        faults.append(_advice(chain, "base_frame", where, base, np.eye(4)))
        if maker.world:
            faults.append("a world in which its base stands elsewhere is said by $.controller.world_from_base")
    if not _same(cells_from_flange, np.eye(4)):
        where = "its flange is the tool with all zeros"
        faults.append(_advice(chain, "flange_frame", where, flange, chain.base_from_flange_at_zero))
    if not faults:
        return None
    said, computed = there @ tool, world_from_cell @ there @ cells_from_flange @ tool
    mm, angle = _apart(said, computed)
    place, other = (", ".join(f"{value:.1f}" for value in pose[:3, 3]) for pose in (computed, said))
    return (
        f"{maker.name}'s controller has the first posture's tool at {place} mm, the program at {other}: {mm:.1f} mm "
        f"and {np.degrees(angle):.2f} deg apart; {'; '.join(faults)}"
    )


def _advice(chain: Chain, key: str, where: str, own: Float, cells: Float) -> str:
    """What to write in the cell file."""
    fits = [name for name, frame in chain.frames.items() if _same(frame, own)]
    if fits:
        return f'{where}: write "{key}": "{fits[0]}" in $.robot'
    off = inverse(cells) @ own
    at, turn = (
        " ".join(f"{value:.6g}" for value in np.round(values, 6) + 0.0)
        for values in (off[:3, 3] / 1000, np.array(rpy_from_rotation(off[:3, :3]))[::-1])
    )
    return (
        f"{where}: expected $.robot.{key} to be a frame of the URDF there; from the one that is named now it lies at "
        f'<origin xyz="{at}" rpy="{turn}"/>'
    )
