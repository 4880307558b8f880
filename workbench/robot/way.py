"""The way that a program drives, at any place between its targets, and the robot driven along it.

Straight, circular and joint moves and rounded corners, vectorised over places. A place is (segment, share of it).
Corners are rounded as controllers do it, by a parabola from the zone's begin to its end; what a controller may do
otherwise within the zone is bounded by `Way.rounding`.

The robot stands at places so near each other that all between them is bounded. Between two places every joint stays
near the middle one by at most `reach`: the larger distance to either end and what a parabola through the three bulges
out. A point of a body then moves by at most its distance r_j from each axis times that joint's reach rho_j,
sum r_j rho_j / (1 - sum rho_j) (Schwarzer, Saha, Latombe, IEEE Trans. Robotics 21 (2005) 338: exact collision checking
of paths); exact to the third order in a stretch.

Of joint moves whose time the program says, what they ask of each joint is told between their rows and across them.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves
from workbench.geometry import moves
from workbench.geometry.poses import (
    inverse,
    pose_from,
    quaternion_from_rotation,
    rotation_from_quaternion,
    rotation_from_vector,
    slerp,
    vector_from_rotation,
)
from workbench.kernels import kernel
from workbench.robot.cell_model import Cell
from workbench.robot.collision import base_from_targets
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import forward_kinematics
from workbench.robot.surface import NO_LENGTH_MM, turned
from workbench.units import DEG, AnyArray, Bool, Float, Int, Shaped

Values = Float | float  # of the external axes, rad: one number, of several a vector
STRAIGHT, CIRCULAR, CORNER, JOINTS = range(4)
MOST_TURN = 170 * DEG  # of a move's orientation: beyond it, controllers may take either way round
BLENDING_JOINTS = "a joint move that blends: its way depends on the controller; expected a stop before and after it"
TURN_SPEED = 50 * DEG  # rad/s where the orientation alone moves, and of the turntable where a program does not say
STEP_MM, STEP_TURN, STEP_JOINT = 5.0, 2.0 * DEG, 4.0 * DEG  # of the first look; what it leaves open is looked at nearer
TOO_FAST = "times its largest"  # of a joint whose speed or acceleration does not suffice
ROUNDING = 1e-6  # of a share


class WayError(ValueError):
    """A move that no way can be made of; `line` is the program's."""

    def __init__(self, line: int, finding: str) -> None:
        """What was found, in words."""
        super().__init__(finding)
        self.line = line


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """g segments in the order of motion. Poses are of the flange's tool in the base; on a track, where it is at 0."""

    kind: Shaped[Int, " g"]  # STRAIGHT, CIRCULAR, CORNER or JOINTS
    line: Shaped[Int, " g"]  # of the program
    move: Shaped[Int, " g"]  # index of the move that it belongs to
    span: Shaped[Float, "g 2"]  # shares of the whole move that it reaches from and to
    position_mm: Shaped[Float, "g 3 3"]  # start, corner (of CORNER), end of the whole move
    quaternion: Shaped[Float, "g 3 4"]  # likewise
    centre_mm: Shaped[Float, "g 3"]  # of arcs
    turn: Shaped[Float, "g 3"]  # rotation axis of arcs, times the sweep
    joints: Shaped[Float, "g 2 6"]  # start and end of joint moves
    turntable: Shaped[Float, "g 3 ..."]  # of the external axes: start, corner, end
    flange_from_tool: Shaped[Float, "g 4 4"]
    duration_s: Shaped[Float, " g"]
    timed: Shaped[Bool, " g"]  # the program says the duration: of joint moves alone
    length_mm: Shaped[Float, " g"]
    start_joints: Shaped[Float, " 6"]

    def tool(self, segment: Int, share: Float) -> tuple[Float, Float]:
        """Poses (n, 4, 4) of the tool in the base, NaN on joint moves, and values of the external axes (n,)."""
        f = self.span[segment, 0] + share * (self.span[segment, 1] - self.span[segment, 0])
        kind = self.kind[segment]
        a, corner, b = (self.position_mm[segment, i] for i in range(3))
        position = a + f[:, None] * (b - a)
        arc = kind == CIRCULAR
        if arc.any():
            s, centre = segment[arc], self.centre_mm[segment[arc]]
            position[arc] = centre + _rotated(a[arc] - centre, self.turn[s], f[arc])
        q0, qc, q1 = (self.quaternion[segment, i] for i in range(3))
        quaternion = slerp(q0, q1, f)
        tables = self.turntable[segment]
        shape = (-1, *(1,) * (tables.ndim - 2))
        table = tables[:, 0] + f.reshape(shape) * (tables[:, 2] - tables[:, 0])
        bent = kind == CORNER
        if bent.any():
            v = f[bent][:, None]
            weights = (1 - v) ** 2, 2 * v * (1 - v), v**2
            position[bent] = weights[0] * a[bent] + weights[1] * corner[bent] + weights[2] * b[bent]
            quaternion[bent] = slerp(slerp(q0[bent], qc[bent], f[bent]), slerp(qc[bent], q1[bent], f[bent]), f[bent])
            table[bent] = sum(w.reshape(shape) * tables[bent, i] for i, w in enumerate(weights))
        return pose_from(rotation_from_quaternion(quaternion), position), table

    def joint_move(self, segment: Int, share: Float) -> Float:
        """Joint angles (n, 6) on joint moves."""
        start, end = self.joints[segment, 0], self.joints[segment, 1]
        return np.asarray(start + share[:, None] * (end - start))


def _rotated(arm: Float, turn: Float, share: Float) -> Float:
    """Vectors (n, 3) turned by a share of rotation vectors (n, 3)."""
    return np.asarray((rotation_from_vector(share[:, None] * turn) @ arm[..., None])[..., 0])


def _nowhere() -> Float:
    return np.zeros(3)


def _whole() -> list[float]:
    return [0.0, 1.0]


@dataclass
class _Leg:
    """One whole move, before its ends are rounded off."""

    index: int
    move: ProgramMove
    kind: int
    tool: Float  # flange_from_tool
    start: Shaped[Float, "4 4"]  # tool in the base
    end: Float
    tables: tuple[Values, Values]
    joints: tuple[Float, Float] | None = None
    centre: Float = field(default_factory=_nowhere)
    turn: Float = field(default_factory=_nowhere)
    length: float = field(default_factory=float)
    cut: list[float] = field(default_factory=_whole)  # shares at which it begins and ends
    seconds: float | None = None  # that the program says it takes

    def at(self, share: float) -> tuple[Float, Float, Values]:
        """Position, quaternion and values of the external axes on the whole move."""
        a, b = self.start[:3, 3], self.end[:3, 3]
        position = a + share * (b - a)
        if self.kind == CIRCULAR:
            position = self.centre + _rotated((a - self.centre)[None], self.turn[None], np.array([share]))[0]
        table = self.tables[0] + share * (self.tables[1] - self.tables[0])
        return position, self._quaternion(share), table

    def _quaternion(self, share: float) -> Float:
        """Quaternion on the whole move."""
        q0, q1 = self._turns
        return q0 if share == 0.0 else q1 if share == 1.0 and q0 @ q1 >= 0 else slerp(q0, q1, np.array(share))

    @functools.cached_property
    def _turns(self) -> tuple[Float, Float]:
        """Quaternions of both ends."""
        q0, q1 = quaternion_from_rotation(np.array([self.start[:3, :3], self.end[:3, :3]]))
        return q0, q1


def way_of(cell: Cell, program: ProgramMoves, tools: Mapping[str, Float], work_objects: Mapping[str, Float]) -> Way:
    """The way of a program from its first target on.

    Args:
        cell: robot and external axes.
        program: its first move gives joint angles.
        tools: flange_from_tool (4, 4) by name, those of the controller included.
        work_objects: base_from_workobject (4, 4) by name.

    Raises:
        WayError: a first move without joint angles, an orientation that turns too far, a circle that is none, a joint
            move to a pose, a joint move that blends, times that do not rise.
    """
    legs: list[_Leg] = []
    start: Float = np.empty(0)
    joints: Float | None = None
    flange: Float | None = None
    table: Values = np.zeros(len(cell.axes)) if len(cell.axes) > 1 else 0.0
    for i, move in enumerate(program.moves):
        if move.turntable is not None and np.shape(move.turntable) != np.shape(table):
            said = f"the program drives {np.size(move.turntable)} external axes, the cell has {np.size(table)}"
            raise WayError(move.line, said)
        end_table = table if move.turntable is None else move.turntable
        if i == 0:
            if move.joints is None:
                raise WayError(
                    move.line,
                    "the first move gives no joint angles: expected the program to say in which posture it begins",
                )
            start, flange, table = move.joints, flange_among_targets(cell, move.joints, end_table), end_table
            joints = start
            continue
        assert flange is not None
        frame = work_objects.get(move.work_object)
        leg = _leg(cell, i, move, tools[move.tool], frame, joints, flange, (table, end_table))
        leg.seconds = _seconds(program.moves[i - 1], move)
        legs.append(leg)
        joints = move.joints if leg.kind == JOINTS else None
        flange, table = leg.end @ inverse(leg.tool), end_table
    if not legs:
        raise WayError(1, "the program moves nowhere but to its first target")
    rows = [_row(leg, after, cell.rated_speeds) for leg, after in _rounded(legs)]
    return Way(*map(np.array, zip(*rows, strict=True)), start)  # type: ignore[call-arg]  # as many as `_row` gives


def _seconds(before: ProgramMove, move: ProgramMove) -> float | None:
    """How long a move takes, where the program says times."""
    if move.time_s is None:
        return None
    if move.kind != "J" or before.time_s is None or not before.time_s < move.time_s < np.inf:
        raise WayError(move.line, "expected joint angles at a time behind that of the move before")
    return move.time_s - before.time_s


def _leg(
    cell: Cell,
    i: int,
    move: ProgramMove,
    tool: Float,
    frame: Float | None,
    joints: Float | None,
    flange: Float,
    tables: tuple[Values, Values],
) -> _Leg:
    start = flange @ tool
    if move.kind == "J":
        if move.joints is None:
            raise WayError(
                move.line, "a joint move to a pose: its way depends on the controller; expected joint angles"
            )
        if move.zone_mm > 0:
            raise WayError(move.line, BLENDING_JOINTS)
        both = (np.full(6, np.nan) if joints is None else joints, move.joints)
        end = flange_among_targets(cell, move.joints, tables[1]) @ tool
        return _Leg(i, move, JOINTS, tool, start, end, tables, both)
    assert move.pose is not None
    assert frame is not None
    end = frame @ move.pose
    turn = np.linalg.norm(vector_from_rotation(start[:3, :3].T @ end[:3, :3]))
    if turn > MOST_TURN:
        raise WayError(
            move.line,
            f"the tool turns by {np.degrees(turn):.0f} deg in one move, either way round: expected at most 170 deg",
        )
    if move.kind == "L":
        length = float(np.linalg.norm(end[:3, 3] - start[:3, 3]))
        return _Leg(i, move, STRAIGHT, tool, start, end, tables, length=length)
    assert move.via is not None
    circle = np.empty(moves.CIRCLE)
    sweep = moves.circle_through(np.stack([start, frame @ move.via, end])[:, :3, 3].copy(), 0, 1, 2, circle)
    if not sweep:
        raise WayError(move.line, "a circular move whose three points lie on a line")
    centre, axis = (circle[first : first + 3] for first in (moves.CENTRE, moves.NORMAL))
    length = float(circle[moves.RADIUS]) * sweep
    return _Leg(i, move, CIRCULAR, tool, start, end, tables, None, centre, axis * sweep, length)


def _rounded(legs: list[_Leg]) -> list[tuple[_Leg, _Leg | None]]:
    """Legs, and between them corners (both legs) where a zone rounds them off."""
    order: list[tuple[_Leg, _Leg | None]] = []
    for i, leg in enumerate(legs):
        after = legs[i + 1] if i + 1 < len(legs) else None
        order.append((leg, None))
        if after is None or leg.move.zone_mm <= 0:
            continue
        if after.kind == JOINTS:
            raise WayError(leg.move.line, BLENDING_JOINTS)
        zone = min(leg.move.zone_mm, leg.length / 2, after.length / 2)
        if zone > NO_LENGTH_MM:
            leg.cut[1], after.cut[0] = 1 - zone / leg.length, zone / after.length
            order.append((leg, after))
    return order


def _row(leg: _Leg, after: _Leg | None, rated: Float) -> tuple[object, ...]:
    if after is None:
        begin = leg.at(0.0)
        places = begin, begin, leg.at(1.0)
        kind, span = leg.kind, tuple(leg.cut)
        length = leg.length * (leg.cut[1] - leg.cut[0])
    else:
        places, kind, span = (leg.at(leg.cut[1]), leg.at(1.0), after.at(after.cut[0])), CORNER, (0.0, 1.0)
        length = sum(float(np.linalg.norm(places[i + 1][0] - places[i][0])) for i in (0, 1))
    joints = np.zeros((2, 6)) if leg.joints is None or after is not None else np.array(leg.joints)
    position, quaternion, table = (np.array(part) for part in zip(*places, strict=True))
    feed = leg.move.feed_mm_s
    duration = length / feed if feed else 0.0
    if leg.seconds is not None:
        duration = leg.seconds
    elif kind == JOINTS:
        moved = np.abs(np.append(joints[1] - joints[0], table[2] - table[0]))
        duration = max(duration, float((np.nan_to_num(moved) / rated).max()) / leg.move.joint_speed)
    elif length < NO_LENGTH_MM:
        turn = np.append(turned(quaternion[0], quaternion[2]), np.abs(table[2] - table[0]))
        duration = max(duration, float(turn.max()) / TURN_SPEED)
    return (
        kind,
        leg.move.line,
        leg.index,
        span,
        position,
        quaternion,
        leg.centre,
        leg.turn,
        joints,
        table,
        leg.tool,
        duration,
        leg.seconds is not None,
        length,
    )


# The robot driven along the way.


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """n places on a way, and how the robot stands there."""

    segment: Shaped[Int, " n"]
    share: Shaped[Float, " n"]  # of the segment
    joints: Shaped[Float, "n 6"]  # rad; NaN: out of reach
    turntable: Shaped[Float, "n ..."]  # of the external axes, rad
    tool: Shaped[Float, "n 4 4"]  # as in `Way`

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
    columns = ([getattr(part, one.name) for part in parts] for one in dataclasses.fields(Places))
    return Places(*(np.concatenate(column) for column in columns))


def first_look(cell: Cell, way: Way) -> tuple[Way, Places]:
    """Places along the whole way in its order, and the way with the joint moves' beginnings filled in.

    The robot follows from its first posture on: of all postures that reach a place the nearest to the one before.
    """
    segment, share = _grid(way)
    tool, table, flange = _in_space(cell, way, segment, share)
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
    tool, table, flange = _in_space(cell, way, segment, share)
    joints = np.full((len(segment), 6), np.nan)
    by_joints = way.kind[segment] == JOINTS
    joints[by_joints] = way.joint_move(segment[by_joints], share[by_joints])
    space = ~by_joints
    if space.any():
        wanted = (before.joints[space] + after.joints[space]) / 2
        joints[space] = nearest_branch(inverse_kinematics(cell.chain, flange[space]), wanted)
    return _standing(cell, way, segment, share, joints, tool, table)


def _in_space(cell: Cell, way: Way, segment: Int, share: Float) -> tuple[Float, Float, Float]:
    """Tool and external axes at places (n,), as `Way.tool` has them, and poses (n, 4, 4) of the flange in the base."""
    tool, table = way.tool(segment, share)
    return tool, table, base_from_targets(cell, table) @ tool @ inverse(way.flange_from_tool[segment])


def _standing(cell: Cell, way: Way, segment: Int, share: Float, joints: Float, tool: Float, table: Float) -> Places:
    by_joints = way.kind[segment] == JOINTS
    tool = tool.copy()
    flange = flange_among_targets(cell, joints[by_joints], table[by_joints])
    tool[by_joints] = flange @ way.flange_from_tool[segment[by_joints]]
    return Places(segment, share, joints, table, tool)


def _grid(way: Way) -> tuple[Int, Float]:
    """Places: the first segment's begin, and of each segment some within and its end."""
    q = way.quaternion
    turn = np.where(way.kind == JOINTS, 0.0, turned(q[:, :-1], q[:, 1:]).sum(axis=1))
    joints = np.nan_to_num(np.abs(way.joints[:, 1] - way.joints[:, 0]), nan=np.pi).max(axis=1)
    table = np.abs(np.diff(way.turntable, axis=1)).sum(axis=1).reshape(len(way.kind), -1).max(axis=1)
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
            for i in range(6):  # a slice takes two seconds to compile
                at[i] = found[n, i]
    return found


@kernel
def nearest_branch(branches: AnyArray, wanted: AnyArray) -> AnyArray:
    """Of branches (n, b, 6) the one nearest to `wanted` (n, 6), whole turns added; NaN: there is none."""
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
            for i in range(6):
                found[i] = one[i]


def flange_among_targets(cell: Cell, joints: Float, table: Values) -> Float:
    """The flange (..., 4, 4) in the frame in which programs have their targets, at joint angles (..., 6)."""
    return inverse(base_from_targets(cell, table)) @ forward_kinematics(cell.chain, joints)


def axis_name(cell: Cell, i: int) -> str:
    """Of the joints and the external axes."""
    return f"joint {i + 1}" if i < 6 else f"the {cell.axes[i - 6].name}"


def timed_faults(cell: Cell, way: Way) -> tuple[list[tuple[int, float, str, str]], float]:
    """What is beyond a joint's speed or acceleration, segment, share, kind, finding; and the largest share of a speed.

    All angles go evenly between two rows. What a joint's speed changes by at a row, it does in the time of the shorter
    step beside it; where timed moves begin and end the robot stands, and half a step leads from and to that.
    """
    if not way.timed.any():
        return [], 0.0
    moved = np.column_stack([way.joints[:, 1] - way.joints[:, 0], way.turntable[:, 2] - way.turntable[:, 0]])
    rate = np.where(way.timed[:, None], moved / way.duration_s[:, None], 0.0)
    speed = np.abs(rate) / cell.rated_speeds
    found = [("speed", np.arange(len(rate)), worst(cell, speed, "speed"))]
    most = cell.rated_accelerations
    if most is not None:
        still, step = np.zeros((1, len(most))), np.where(way.timed, way.duration_s, np.inf)
        change = np.abs(np.diff(np.concatenate([still, rate, still]), axis=0))
        before, after = np.append(np.inf, step), np.append(step, np.inf)
        within = np.minimum(before, after) * np.where(np.isinf(before + after), 0.5, 1.0)
        here = np.arange(len(step) + 1) - np.isinf(after)  # the segment that begins at the row, or ends there
        found.append(("acceleration", here, worst(cell, change / within[:, None] / most, "acceleration")))
    faults = [(int(at[one[0]]), 1.0, kind, one[1]) for kind, at, one in found if one is not None]
    return faults, float(speed.max())


def worst(cell: Cell, asked: Float, kind: str) -> tuple[int, str] | None:
    """Where most (n, 6 + e) of its largest speed or acceleration is asked of a joint, in words; None: all can."""
    i, joint = np.unravel_index(int(asked.argmax()), asked.shape) if asked.size else (0, 0)
    if not asked.size or asked[i, joint] <= 1 + ROUNDING:
        return None
    return int(i), f"{axis_name(cell, int(joint))} would need {asked[i, joint]:.2f} {TOO_FAST} {kind}"
