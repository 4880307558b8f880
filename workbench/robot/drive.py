"""A robot driven along a way: joint angles at places so near each other that all between them is bounded.

Between two places every joint stays near the middle one by at most `reach`: the larger distance to either end and what
a parabola through the three bulges out. A point of a body then moves by at most its distance from each axis times that
joint's reach (Schwarzer, Saha, Latombe, IEEE Trans. Robotics 21 (2005) 338: exact collision checking of paths).

Of joint moves whose time the program says, what they ask of each joint is told between their rows and across them.
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from workbench.geometry.poses import inverse
from workbench.kernels import kernel
from workbench.robot.cell import Cell
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import forward_kinematics
from workbench.robot.way import JOINTS, Way
from workbench.units import DEG, AnyArray, Float, Int, Shaped

STEP_MM, STEP_TURN, STEP_JOINT = 5.0, 2.0 * DEG, 4.0 * DEG  # of the first look; what it leaves open is looked at nearer
ROUNDING = 1e-6  # of a share


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """n places on a way, and how the robot stands there."""

    segment: Shaped[Int, " n"]
    share: Shaped[Float, " n"]  # of the segment
    joints: Shaped[Float, "n 6"]  # rad; NaN: out of reach
    turntable: Shaped[Float, " n"]  # rad
    tool: Shaped[Float, "n 4 4"]  # base_from_tool

    def __len__(self) -> int:
        """How many."""
        return len(self.segment)

    def at(self, which: AnyArray) -> Places:
        """Some of them."""
        return Places(
            self.segment[which], self.share[which], self.joints[which], self.turntable[which], self.tool[which]
        )


def joined(parts: list[Places]) -> Places:
    """All of them, one after the other."""
    columns = ([getattr(part, field.name) for part in parts] for field in dataclasses.fields(Places))
    return Places(*(np.concatenate(column) for column in columns))


def first_look(cell: Cell, way: Way) -> tuple[Way, Places]:
    """Places along the whole way in its order, and the way with the joint moves' beginnings filled in.

    The robot follows from its first posture on: of all postures that reach a place the nearest to the one before.
    """
    segment, share = _grid(way)
    tool, table = way.tool(segment, share)
    flange = tool @ inverse(way.flange_from_tool[segment])
    joints, at, starts = np.full((len(segment), 6), np.nan), way.start_joints, way.joints.copy()
    bounds = np.flatnonzero(np.append(True, np.diff(way.kind[segment] == JOINTS) != 0))
    for low, high in zip(bounds, np.append(bounds[1:], len(segment)), strict=True):
        run = slice(low, high)
        if way.kind[segment[low]] == JOINTS:
            for s in np.unique(segment[run]):
                starts[s, 0] = at
                at = starts[s, 1]
            joints[run] = dataclasses.replace(way, joints=starts).joint_move(segment[run], share[run])
        else:
            joints[run] = _follow(inverse_kinematics(cell.chain, flange[run]), at)
            at = joints[high - 1]
    way = dataclasses.replace(way, joints=starts)
    return way, _standing(cell, way, segment, share, joints, tool, table)


def between(cell: Cell, way: Way, before: Places, after: Places) -> Places:
    """The places in the middle of neighbours; a place that ends a segment begins the next one."""
    start = np.where(before.segment == after.segment, before.share, 0.0)
    segment, share = after.segment, (start + after.share) / 2
    tool, table = way.tool(segment, share)
    flange = tool @ inverse(way.flange_from_tool[segment])
    joints = np.full((len(segment), 6), np.nan)
    by_joints = way.kind[segment] == JOINTS
    joints[by_joints] = way.joint_move(segment[by_joints], share[by_joints])
    space = ~by_joints
    if space.any():
        wanted = (before.joints[space] + after.joints[space]) / 2
        joints[space] = _nearest(inverse_kinematics(cell.chain, flange[space]), wanted)
    return _standing(cell, way, segment, share, joints, tool, table)


def _standing(cell: Cell, way: Way, segment: Int, share: Float, joints: Float, tool: Float, table: Float) -> Places:
    by_joints = way.kind[segment] == JOINTS
    tool = tool.copy()
    tool[by_joints] = forward_kinematics(cell.chain, joints[by_joints]) @ way.flange_from_tool[segment[by_joints]]
    return Places(segment, share, joints, table, tool)


def _grid(way: Way) -> tuple[Int, Float]:
    """Places: the first segment's begin, and of each segment some within and its end."""
    q = way.quaternion
    turn = sum(2 * np.arccos(np.clip(np.abs((q[:, i] * q[:, i + 1]).sum(axis=1)), 0, 1)) for i in (0, 1))
    turn = np.where(way.kind == JOINTS, 0.0, turn)
    joints = np.nan_to_num(np.abs(way.joints[:, 1] - way.joints[:, 0]), nan=np.pi).max(axis=1)
    table = np.abs(np.diff(way.turntable, axis=1)).sum(axis=1)
    steps = np.stack([way.length_mm / STEP_MM, turn / STEP_TURN, joints / STEP_JOINT, table / STEP_TURN])
    count = np.maximum(np.ceil(steps.max(axis=0) - 1e-9), 1).astype(int)
    segment = np.concatenate([[0], np.repeat(np.arange(len(count)), count)])
    share = np.concatenate([[0.0], *(np.arange(1, n + 1) / n for n in count)])
    return segment, share


@kernel
def _follow(branches: AnyArray, start: AnyArray) -> AnyArray:
    """Of branches (n, b, 6) the one nearest to the place before, whole turns added (n, 6)."""
    found = np.full((len(branches), 6), np.nan)
    at = start.copy()
    for n in range(len(branches)):
        _choose(branches[n], at, found[n])
        if not np.isnan(found[n, 0]):
            at[:] = found[n]
    return found


@kernel
def _nearest(branches: AnyArray, wanted: AnyArray) -> AnyArray:
    """Of branches (n, b, 6) the one nearest to `wanted` (n, 6), whole turns added."""
    found = np.full((len(branches), 6), np.nan)
    for n in range(len(branches)):
        _choose(branches[n], wanted[n], found[n])
    return found


@kernel
def _choose(branches: AnyArray, wanted: AnyArray, found: AnyArray) -> None:
    best, one = np.inf, np.empty(6)
    for b in range(len(branches)):
        if np.isnan(branches[b, 0]):
            continue
        far = 0.0
        for i in range(6):
            one[i] = branches[b, i] + 2 * np.pi * np.round((wanted[i] - branches[b, i]) / (2 * np.pi))
            far = max(far, abs(one[i] - wanted[i]))
        if far < best:
            best = far
            found[:] = one


def rated(cell: Cell) -> Float:
    """Largest speeds (7,) of the joints and the turntable, rad/s."""
    return np.append(cell.chain.speeds, cell.turntable.speed if cell.turntable else np.inf)


def axis_name(i: int) -> str:
    """Of seven: the joints and the turntable."""
    return "the turntable" if i == 6 else f"joint {i + 1}"


def timed_faults(cell: Cell, way: Way) -> tuple[list[tuple[int, float, str, str]], float]:
    """What is beyond a joint's speed or acceleration, segment, share, kind, finding; and the largest share of a speed.

    All angles go evenly between two rows. What a joint's speed changes by at a row, it does in the time of the shorter
    step beside it; where timed moves begin and end the robot stands, and half a step leads from and to that.
    """
    if not way.timed.any():
        return [], 0.0
    moved = np.column_stack([way.joints[:, 1] - way.joints[:, 0], way.turntable[:, 2] - way.turntable[:, 0]])
    rate = np.where(way.timed[:, None], moved / way.duration_s[:, None], 0.0)
    speed = np.abs(rate) / rated(cell)
    faults = _worst(speed, np.arange(len(rate)), "speed")
    most = cell.rated_accelerations
    if most is not None:
        still, step = np.zeros((1, 7)), np.where(way.timed, way.duration_s, np.inf)
        change = np.abs(np.diff(np.concatenate([still, rate, still]), axis=0))
        before, after = np.append(np.inf, step), np.append(step, np.inf)
        within = np.minimum(before, after) * np.where(np.isinf(before + after), 0.5, 1.0)
        here = np.arange(len(step) + 1) - np.isinf(after)  # the segment that begins at the row, or ends there
        faults += _worst(change / within[:, None] / most, here, "acceleration")
    return faults, float(speed.max())


def _worst(asked: Float, segment: Int, kind: str) -> list[tuple[int, float, str, str]]:
    """Where most (n, 7) is asked of a joint, if that is more than it can."""
    i, joint = np.unravel_index(int(asked.argmax()), asked.shape)
    if asked[i, joint] <= 1 + ROUNDING:
        return []
    name = axis_name(int(joint))
    return [(int(segment[i]), 1.0, kind, f"{name} would need {asked[i, joint]:.2f} times its largest {kind}")]
