"""INFORM, Yaskawa's language, as a relative job (`.JBI`).

(Yaskawa Motoman: NX100 and DX100 Instructions, Data Transmission Function, job data format; DX100 and YRC1000
Instructions, INFORM Language.) Targets are X, Y, Z in mm and R = Rz(Rz) Ry(Ry) Rx(Rx) in deg, in the robot's frame or
in a user frame that the controller has, for a tool that it has: a job declares none. RCONF says the arm's branch for
every target: flip 0 (R, axis 4, within +-90 deg) or no flip 1, upper arm 0 or lower arm 1, front 0 or rear 1, then
whether R, T and S (joints 4, 6 and 1) are beyond +-180 deg. MOVJ goes to such a target too: pulses of the encoders,
the other way to say a posture, are known to the controller alone. Speeds are mm/s in tenths, rounded down. A target
is reached (PL=0), or rounded by CR in mm where the controller has that tag, or by the largest position level (PL=1 to
8) that the zone holds, where the cell file says their zones, which no job does.

Read back strictly, and no more of it than milling jobs need.

    job     = /JOB //NAME //POS ///NPOS [///USER n] ///TOOL n ///POSTYPE ROBOT | USER ///RECTAN {///RCONF | C} //INST
              ///ATTR ///FRAME ///GROUP1 RB1 NOP {event} [MSG PAUSE] MOVJ {move | event} END
    move    = MOVJ C | P, VJ=, PL=0 | MOVL C, V=, PL= | CR= | arc
    arc     = [MOVC start, V=, PL=0] MOVC middle, V= MOVC end, V=, PL= | CR=, FPT
    event   = DOUT OT#(n) ON | OFF, WAIT IN#(n)=ON, TIMER T=, PAUSE, a label, CALL JOB:

An arc that follows another one begins where that ended; any other one says its start again. MOVJ goes to a pose by the
branch that RCONF names, of which the robot must have exactly one within its limits, or to the controller's home.
Everything else is refused with its line: counts and numbers of positions that are wrong, one that is not there, signals
and jobs that the cell file's process does not name, an event after a corner that is rounded.
"""

from __future__ import annotations

import functools
import itertools
import math
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.artefacts import EventKind, ProgramMove, ProgramMoves, ProgramTool
from workbench.errors import InputError
from workbench.geometry.poses import inverse, pose_from, quaternion_from_rotation, rotation_from_quaternion
from workbench.program.fanuc import cut
from workbench.program.krl import euler_deg
from workbench.program.skeleton import (
    CellDialect,
    check_standing_turntable,
    check_words,
    limited,
)
from workbench.program.words import NAME, NUMBER, Events, Lines, euler_pose, numbers, one_file
from workbench.robot.cell import Cell
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import Chain, forward_kinematics
from workbench.robot.wrist import arm_sides
from workbench.units import DEG, Float, Shaped

JOINT_PERCENT = 20  # of the axes' largest speeds, on the way to the first posture
SLOWEST_MM_S, FASTEST_MM_S = 0.1, 1500.0  # of the tag V=
LEAST_CORNER_MM = 1.0  # of the tag CR=
MOST_POSITIONS = 9999  # of a job: their names have five digits, and a job has as many steps
REMARK = 32  # characters of a comment and of MSG
Configuration = tuple[int, ...]  # no flip, lower arm, rear; R, T, S beyond +-180 deg
FLIP_DEG = 90.0  # to both sides of R's home, and of whole turns of it
WHOLE = 2 * np.pi
TURNED = [3, 5, 0]  # joints R, T, S
SAME_POSTURE = 1e-3 * DEG  # branches that coincide
UNUSED = ",0" * 18  # of RCONF
POSITION = rf"C(\d{{5}})={','.join([NUMBER] * 6)}"
SPEED = rf"V={NUMBER}"
NEAR = rf"(?:PL=([0-8])|CR={NUMBER})"
EVENT = rf"DOUT OT#\((\d+)\) (ON|OFF)|WAIT IN#\((\d+)\)=ON|TIMER T=(\d+\.\d\d)|(PAUSE)|\*([A-Z0-9]+)|CALL JOB:{NAME}"


@dataclass
class Inform(CellDialect):
    """The dialect of Yaskawa's controllers."""

    def __post_init__(self) -> None:
        """Refuse what a job cannot say."""
        feed = self.job.moves.feed_mm_s
        if not SLOWEST_MM_S <= feed.min() <= feed.max() <= FASTEST_MM_S:
            raise InputError(
                "program.write",
                f"expected feeds of {SLOWEST_MM_S:g} to {FASTEST_MM_S:g} mm/s for Yaskawa, found {feed.min():.3g} to "
                f"{feed.max():.5g}",
            )
        check_standing_turntable(
            self.job, self.cell, "jobs for Yaskawa's controllers are written for the robot's own axes only"
        )
        if self._count > MOST_POSITIONS:
            raise InputError(
                "program.write",
                f"expected at most {MOST_POSITIONS} positions in a job for Yaskawa, found {self._count}: larger "
                "tolerances of path.simplify make fewer",
            )
        process = self.cell.process
        if process is None:
            return
        check_words(self.cell, process, "Yaskawa", signals="numbers")
        home = process.home.controller_name
        if home is not None and not re.fullmatch(r"P\d{3,5}", home):
            where = f"{self.cell.source}: $.process.home.controller_name"
            raise InputError(where, f"expected a position variable, P000 to P99999, for Yaskawa, found {home!r}")

    @functools.cached_property
    def tool(self) -> int:
        """Number of the tool on the controller."""
        if self.job.tool_name is None:
            raise InputError(
                f"{self.cell.source}: $.tool.controller_name",
                "expected TOOL[n], the number of the tool as measured on Yaskawa's controller: its jobs declare none",
            )
        return self._number("TOOL", self.job.tool_name, "tool")

    @functools.cached_property
    def frame(self) -> int | None:
        """Number of the user frame on the controller; None: the robot's own frame."""
        name = self.job.work_object_name
        return None if name is None else self._number("USER", name, "work_object")

    def _number(self, what: str, name: str, part: str) -> int:
        found = re.fullmatch(rf"{what}\[(\d{{1,2}})\]", name)
        if found is None:
            where = f"{self.cell.source}: $.{part}.controller_name"
            raise InputError(where, f"expected {what}[n] for Yaskawa, found {name!r}")
        return int(found[1])

    @functools.cached_property
    def arm(self) -> Arm:
        """The robot with the controller's tool in the frame of the targets."""
        base_from_frame = np.eye(4) if self.frame is None else self.cell.base_from_workobject
        return Arm(self.cell.chain, self.cell.flange_from_cutter, base_from_frame)

    def event(self, kind: EventKind, value: str) -> list[str]:
        """What happens between moves: DOUT, WAIT, TIMER, PAUSE, a label, CALL.

        The move before reaches its target, and WAIT waits without end. Feeds are limited where they are written.
        """
        words: dict[EventKind, list[str]] = {
            "hook": [f"CALL JOB:{value.upper()}"],
            "stop": ["PAUSE"],
            "feed_limits": [],
            "restart": [f"*{value.upper()}"],
            "wait_speed": [f"WAIT IN#({value})=ON"],
        }
        if kind == "wait_time":
            return [f"TIMER T={float(value):.2f}"]
        switched = {"on": "ON", "off": "OFF"}.get(kind.rpartition("_")[2])
        return [f"DOUT OT#({value}) {switched}"] if switched else words[kind]

    @functools.cached_property
    def ends(self) -> list[str]:
        """All that stands behind the target of each move: speed, and how near it is reached."""
        controller = self.cell.controller
        corner = math.floor(self.job.zone_mm * 10 + 1e-9) / 10 if controller and controller.corner_region else 0.0
        levels = controller.levels_mm if controller else ()
        within = [level for level, zone_mm in enumerate(levels, 1) if zone_mm <= self.job.zone_mm]
        level = max(within, key=lambda level: levels[level - 1], default=0)
        rounded = f"CR={corner:.1f}" if corner >= LEAST_CORNER_MM else f"PL={level}"
        feeds = np.maximum(np.floor(limited(self.job.moves.feed_mm_s, self.cell) * 10 + 1e-9) / 10, SLOWEST_MM_S)
        blends = self.blends
        arc_next = [*self.job.moves.circular[1:].tolist(), False]  # its own start is said again: nothing to round there
        near = [rounded if free and not arc else "PL=0" for free, arc in zip(blends, arc_next, strict=True)]
        return [f"V={feed:.1f} {end}" for feed, end in zip(feeds.tolist(), near, strict=True)]

    def head(self) -> Iterator[str]:
        """Remarks; the first posture's angles, by which its branch is told on the pendant; the turntable's."""
        yield from (self.remark(remark) for remark in self.job.remarks)
        said = " ".join(
            f"{axis} {round(angle, 1) + 0.0:.1f}"
            for axis, angle in zip("SLURBT", self._first_deg.tolist(), strict=True)
        )
        yield self.remark(f"C00000 on the pendant, deg: {said}")
        yield from self.said(self.skeleton.first) if self.skeleton else ()
        if self.job.turntable_deg is not None:
            yield from (f'MSG "TURNTABLE AT {self.job.turntable_deg[0] + 0.0:.4f} DEG?"', "PAUSE")

    def start(self) -> Iterable[str]:
        """By the joints to the first posture; with a process from home, and straight to the first target."""
        start = f"MOVJ C00000 VJ={JOINT_PERCENT:.2f} PL=0"
        if self.skeleton is None:
            return [start]
        probe = self.probed(f"MOVJ {self._around[3]} VJ={JOINT_PERCENT:.2f} PL=0")
        return [self._home, *probe, start, *self.said(self.skeleton.on), f"MOVL {self._around[1]} {self.ends[0]}"]

    @property
    def _home(self) -> str:
        assert self.skeleton is not None
        place = self.skeleton.process.home.controller_name or self._around[0]
        return f"MOVJ {place} VJ={JOINT_PERCENT:.2f} PL=0"

    def straight(self, i: int) -> Iterable[str]:
        """MOVL."""
        return [*self.layer(i), f"MOVL {self._name(i)} {self.ends[i]}"]

    def circular(self, i: int) -> Iterable[str]:
        """MOVC over the middle to the end, which FPT ends; the first of several says its start once more."""
        said, (speed, near) = self.layer(i), self.ends[i].split(" ")
        begins = not self.job.moves.circular[i - 1] or bool(said)
        start = [f"MOVC {self._name(i - 1)} {speed} PL=0"] if begins else []
        via = f"MOVC C{self.numbers[i] - 1:05d} {speed}"
        return [*said, *start, via, f"MOVC {self._name(i)} {speed} {near} FPT"]

    def remark(self, text: str) -> str:
        """Up to the end of the line; a job takes 32 characters."""
        return f"'{text}"

    def foot(self) -> Iterable[str]:
        """With a process back, and home; the end."""
        skeleton = self.skeleton
        if skeleton is None:
            return ["END"]
        retract = f"MOVL {self._around[2]} {self.ends[-1]}"
        return [retract, *self.said(skeleton.off), self._home, *self.said(skeleton.last), "END"]

    @functools.cached_property
    def numbers(self) -> list[int]:
        """Of each target's position, from 0; the middle of an arc has the one before."""
        numbers: list[int] = (np.cumsum(1 + self.job.moves.circular.astype(int)) - 1).tolist()
        return numbers

    def _name(self, i: int) -> str:
        """Of move i's target; the first is said twice with a process: the second time by a straight move."""
        return self._around[1] if i == 0 and self.skeleton else f"C{self.numbers[i]:05d}"

    @property
    def _around(self) -> list[str]:
        """Behind the targets: home, the first target, the retract, the probe."""
        return [f"C{self.numbers[-1] + k:05d}" for k in (1, 2, 3, 4)]

    @property
    def _count(self) -> int:
        return self.numbers[-1] + 1 + (3 + self.cell.probes if self.cell.process else 0)

    def read(self, files: Mapping[str, str]) -> ProgramMoves:
        """Turn it back."""
        return read_inform(files, self.arm, self.cell)

    def configuration(self, joints: Float, cell: Cell) -> tuple[int, ...]:
        """RCONF of a posture (6,), rad: no flip, lower arm, rear, and whether R, T, S are beyond +-180 deg."""
        return inform_configuration(cell.chain, joints)

    def documents(self, text: str) -> dict[str, str]:
        """Positions, then instructions."""
        name = self.job.name.upper()
        frame = "ROBOT" if self.frame is None else "USER"
        user = [] if self.frame is None else [f"///USER {self.frame}"]
        content = ["/JOB", f"//NAME {name}", "//POS", f"///NPOS {self._count},0,0,0,0,0", *user]
        content += [f"///TOOL {self.tool}", f"///POSTYPE {frame}", "///RECTAN", *self._positions()]
        place = "ROBOT" if self.frame is None else f"USER {self.frame}"
        content += ["//INST", "///ATTR SC,RW,RJ", f"///FRAME {place}", "///GROUP1 RB1", "NOP"]
        content += [piece for line in text.splitlines() for piece in _short(line)]
        return {f"{name}.JBI": "\r\n".join([*content, ""])}

    @property
    def _first_deg(self) -> Float:
        """Joint angles (6,) of C00000, where the way along the path begins."""
        assert self.job.moves.joints_deg is not None
        angles = self.job.moves.joints_deg[0] if self.skeleton is None else self.skeleton.start_deg[0]
        return np.asarray(angles)

    def _positions(self) -> Iterator[str]:
        moves, skeleton = self.job.moves, self.skeleton
        assert moves.joints_deg is not None
        joints = moves.joints_deg * DEG
        arcs = np.flatnonzero(moves.circular)
        here = self._spelled(moves.position_mm, moves.quaternion_wxyz)
        over = self._spelled(moves.via_position_mm[arcs], moves.via_quaternion_wxyz[arcs])
        via = dict(zip(arcs.tolist(), over, strict=True))
        said = [self.configuration(posture, self.cell) for posture in joints]
        rows = [self._posture(self._first_deg * DEG)]
        for i in range(1, len(joints)):
            rows += [(said[i], via[i])] if i in via else []
            rows.append((said[i], here[i]))
        if skeleton is not None:
            back = self._spelled(*skeleton.retracted)[0]
            rows += [self._posture(skeleton.home_deg[0] * DEG), (said[0], here[0])]
            rows.append((self.configuration(skeleton.retract_joints, self.cell), back))
            rows += [] if skeleton.probe_deg is None else [self._posture(skeleton.probe_deg[0] * DEG)]
        last: tuple[int, ...] = ()
        for number, (configuration, values) in enumerate(rows):
            if configuration != last:
                yield "///RCONF " + ",".join(map(str, (*configuration, *[0] * 18)))
            last = configuration
            yield f"C{number:05d}={values}"

    def _posture(self, joints: Float) -> tuple[tuple[int, ...], str]:
        """RCONF and pose of joint angles (6,), rad."""
        pose = self.arm.pose(forward_kinematics(self.cell.chain, joints))
        return self.configuration(joints, self.cell), spelled(pose[None])[0]

    def _spelled(self, position_mm: Float, quaternion_wxyz: Float) -> list[str]:
        """Targets (k, 3), (k, 4) of the job's work object, in the frame of the positions."""
        poses = pose_from(rotation_from_quaternion(quaternion_wxyz), position_mm)
        return spelled(poses if self.frame is not None else self.job.base_from_workobject @ poses)


def spelled(poses: Float) -> list[str]:
    """X, Y, Z, Rx, Ry, Rz of poses (k, 4, 4): 3 decimals of a mm, 4 of a degree."""
    turned = euler_deg(quaternion_from_rotation(poses[:, :3, :3]))[:, ::-1]
    rows = zip((np.round(poses[:, :3, 3], 3) + 0.0).tolist(), (np.round(turned, 4) + 0.0).tolist(), strict=True)
    return [",".join([*(f"{x:.3f}" for x in place), *(f"{x:.4f}" for x in turn)]) for place, turn in rows]


def _short(line: str) -> list[str]:
    return [f"'{piece}" for piece in cut(line[1:], REMARK)] if line.startswith("'") else [line]


def inform_configuration(chain: Chain, joints: Float) -> Configuration:
    """RCONF of a posture (6,), rad: no flip, lower arm, rear; whether R, T and S are beyond +-180 deg.

    Flip is -90 < R <= 90 deg, and so about every whole turn of R (NX100 Operator's Manual, Manipulator Types): the
    wrist's other solution has R half a turn away. R counts from the axis' home position, as the robot's URDF must.
    """
    behind, down, _ = arm_sides(chain, joints)[0].tolist()
    angles = np.round(joints[TURNED] / DEG, 4)
    flip = 0.0 < (float(angles[0]) + FLIP_DEG) % 360.0 <= 2.0 * FLIP_DEG
    beyond = ((angles > 180) | (angles <= -180)).astype(int).tolist()
    return (int(not flip), int(down), int(behind), *beyond)


# The reader.


@dataclass(frozen=True, slots=True, eq=False)
class Arm:
    """A robot with the controller's tool, and the frame of its positions."""

    chain: Chain
    flange_from_tool: Shaped[Float, "4 4"]
    base_from_frame: Shaped[Float, "4 4"]

    def pose(self, base_from_flange: Float) -> Float:
        """frame_from_tool (4, 4) of a flange (4, 4) in the base."""
        return np.asarray(inverse(self.base_from_frame) @ base_from_flange @ self.flange_from_tool)

    def postures(self, frame_from_tool: Float, configuration: Configuration) -> list[Float]:
        """Joint angles (6,), rad, within the limits, that put the tool at a pose (4, 4) with this configuration."""
        flange = self.base_from_frame @ frame_from_tool @ inverse(self.flange_from_tool)
        branches = inverse_kinematics(self.chain, flange[None])[0]
        found: list[Float] = []
        for branch in branches[np.isfinite(branches).all(axis=1)]:
            for turns in itertools.product(*(self._turns(i, angle) for i, angle in enumerate(branch.tolist()))):
                joints = branch + WHOLE * np.array(turns)
                same = any(np.abs(joints - other).max() < SAME_POSTURE for other in found)
                if not same and inform_configuration(self.chain, joints) == configuration:
                    found.append(joints)
        return found

    def _turns(self, joint: int, angle: float) -> list[int]:
        lower, upper = self.chain.limits[joint]
        return [k for k in (0, 1, -1) if lower <= angle + WHOLE * k <= upper]


def read_inform(files: Mapping[str, str], arm: Arm, cell: Cell) -> ProgramMoves:
    """Read a job from its file, name -> text.

    Args:
        files: one that ends in `.JBI`.
        arm: the robot, its tool and the frame of the positions, for MOVJ to a pose.
        cell: whose process' signals switch what, and whose controller's levels are known.

    Raises:
        InputError: "line 12: expected ..., found ...".
    """
    name, text = one_file(files, ".jbi")
    lines = Lines(text, name, "'")
    lines.take("/JOB", "/JOB")
    lines.take(rf"//NAME {NAME}", "//NAME and a name of letters, digits and _")
    frame, tool, positions = _positions(lines)
    lines.take("//INST", "//INST")
    lines.take("///ATTR SC,RW,RJ", "///ATTR SC,RW,RJ: a relative job")
    lines.take(rf"///FRAME {re.escape(frame)}", f"///FRAME {frame}, as the positions have it")
    lines.take("///GROUP1 RB1", "///GROUP1 RB1")
    lines.take("NOP", "NOP")
    job = _Job(lines, arm, positions, (tool, frame), cell)
    job.read()
    lines.end()
    objects = {job.frame: np.eye(4) if frame == "ROBOT" else None}
    return ProgramMoves(
        "yaskawa",
        name,
        tuple(job.moves),
        {tool: ProgramTool(None)},
        objects,
        tuple(job.events.found),
        tuple(lines.remarks),
    )


def _positions(lines: Lines) -> tuple[str, str, list[tuple[Configuration, Float]]]:
    """Frame and tool of the positions; configuration and pose (4, 4) of each."""
    lines.take("//POS", "//POS")
    count = int(lines.take(r"///NPOS (\d+),0,0,0,0,0", "///NPOS n,0,0,0,0,0: positions of the robot alone")[1])
    user = lines.take(r"///USER (\d+)", "///USER n")[1] if lines.peek().startswith("///USER") else None
    tool = lines.take(r"///TOOL (\d+)", "///TOOL n")[1]
    frame = "ROBOT" if user is None else "USER"
    lines.take(f"///POSTYPE {frame}", f"///POSTYPE {frame}" + ("" if user else ", where no ///USER is said"))
    lines.take("///RECTAN", "///RECTAN")
    said: Configuration | None = None
    found: list[tuple[Configuration, Float]] = []
    while not lines.peek().startswith("//INST"):
        if lines.peek().startswith("///RCONF"):
            flags = lines.take(rf"///RCONF ([01],[01],[01],[01],[01],[01]){UNUSED}", "///RCONF and its flags")
            said = tuple(int(flag) for flag in flags[1].split(","))
            continue
        row = lines.take(POSITION, f"C{len(found):05d}=X,Y,Z,Rx,Ry,Rz")
        if said is None or int(row[1]) != len(found):
            lines.refuse(f"C{len(found):05d} behind an ///RCONF", row[0])
        x, y, z, rx, ry, rz = numbers(row, 2, 7)
        found.append((said, euler_pose([x, y, z, rz, ry, rx])))
    if len(found) != count:
        lines.refuse(f"///NPOS {len(found)}", str(count))
    return frame if user is None else f"USER {user}", f"TOOL[{tool}]", found


@dataclass
class _Job:
    """The instructions, one after the other."""

    lines: Lines
    arm: Arm
    positions: list[tuple[Configuration, Float]]
    names: tuple[str, str]  # of tool and frame
    cell: Cell
    moves: list[ProgramMove] = field(default_factory=list)
    turntable: float | None = None  # rad: where a message asks for it
    at: int | None = None  # the position that the last move went to, where it was not by the controller's home
    in_arc: bool = False  # an arc has just ended: the next one begins there

    def __post_init__(self) -> None:
        self.events = Events(self.lines, self.moves, self.cell.process)

    @property
    def levels_mm(self) -> tuple[float, ...]:
        """Zones of PL=1, 2, ..."""
        return self.cell.controller.levels_mm if self.cell.controller else ()

    @property
    def frame(self) -> str:
        """The frame's name as cell files have it."""
        return re.sub(r"USER (\d+)", r"USER[\1]", self.names[1])

    def read(self) -> None:
        """All between NOP and END."""
        lines = self.lines
        while lines.peek() not in ("END", ""):
            word = lines.peek().split(" ")[0]
            if word == "MOVJ":
                self.moves.append(self.by_joints())
            elif word in ("MOVL", "MOVC") and not self.moves:
                lines.take("MOVJ.*", "MOVJ first")
            elif word == "MOVL":
                self.moves.append(self.straight())
            elif word == "MOVC":
                self.moves.append(self.circular())
            elif word == "MSG":
                asked = lines.take(rf'MSG "TURNTABLE AT {NUMBER} DEG\?"', "the message that asks for the turntable")
                lines.take("PAUSE", "PAUSE")
                if self.moves or self.turntable is not None:
                    lines.refuse("this message once, before the first move", asked[0])
                self.turntable = float(asked[1]) * DEG
            else:
                self.event()
        lines.take("END", "a move, an event or END")

    def event(self) -> None:
        """What happens between moves."""
        found = self.lines.take(EVENT, "a move, an event or END (see workbench.program.inform)")
        self.in_arc = False
        self.events.tell(found)

    def by_joints(self) -> ProgramMove:
        """MOVJ to a posture."""
        lines, text = self.lines, self.lines.peek()
        found = lines.take(rf"MOVJ (?:C(\d{{5}})|(P\d+)) VJ={NUMBER} PL=0", "MOVJ to a position, VJ= and PL=0")
        if self.moves and self.moves[-1].zone_mm > 0:
            lines.refuse("a move that reaches its target before MOVJ", text)
        share = float(found[3]) / 100
        process = self.cell.process
        home = process.home.controller_name if process else None
        if not 0 < share <= 1 or (found[2] and found[2] != home):
            lines.refuse("VJ= above 0 to 100, and a position of this job or the controller's home", text)
        self.in_arc = False
        tool = self.names[0]
        if found[2]:
            self.at = None
            return ProgramMove(lines.number, "J", tool, self.frame, joint_speed=share, place=found[2])
        configuration, pose = self.position(found[1])
        postures = self.arm.postures(pose, configuration)
        if len(postures) != 1:
            lines.refuse(f"a position that RCONF makes one posture of the robot, not {len(postures)}", text)
        return ProgramMove(
            lines.number, "J", tool, self.frame, joints=postures[0], joint_speed=share, turntable=self.turntable
        )

    def straight(self) -> ProgramMove:
        """MOVL."""
        found = self.lines.take(rf"MOVL C(\d{{5}}) {SPEED} {NEAR}", "MOVL to a position, V= and PL= or CR=")
        self.in_arc = False
        return self.move(found[1], float(found[2]), self.zone_mm(found), None)

    def circular(self) -> ProgramMove:
        """MOVC over a middle to an end; before the first of several their start."""
        lines = self.lines
        if not self.in_arc:
            start = lines.take(rf"MOVC C(\d{{5}}) {SPEED} PL=0", "MOVC to the arc's start, V= and PL=0")
            if self.at is None or int(start[1]) != self.at or self.moves[-1].zone_mm > 0:
                lines.refuse("an arc that starts where the move before ended, with PL=0", start[0])
        middle = lines.take(rf"MOVC C(\d{{5}}) {SPEED}", "MOVC to the arc's middle and V=")
        via = self.position(middle[1])[1]
        end = lines.take(rf"MOVC C(\d{{5}}) {SPEED} {NEAR} FPT", "MOVC to the arc's end, V=, PL= or CR=, FPT")
        if float(end[2]) != float(middle[2]):
            lines.refuse(f"the same speed all along the arc, V={middle[2]}", end[0])
        self.in_arc = True
        return self.move(end[1], float(end[2]), self.zone_mm(end), via)

    def zone_mm(self, found: re.Match[str]) -> float:
        """Of PL= or CR=."""
        level, corner = int(found[3] or 0), float(found[4] or 0)
        if level > len(self.levels_mm):
            self.lines.refuse("PL=0, or a level of the cell file's ($.controller.position_levels_mm)", found[0])
        return self.levels_mm[level - 1] if level else corner

    def move(self, number: str, feed_mm_s: float, zone: float, via: Float | None) -> ProgramMove:
        """To a pose."""
        configuration, pose = self.position(number)
        if feed_mm_s <= 0 or zone < 0:
            self.lines.refuse("a speed above 0 and a corner of 0 mm or more", f"V={feed_mm_s:g} CR={zone:g}")
        return ProgramMove(
            self.lines.number,
            "L" if via is None else "C",
            self.names[0],
            self.frame,
            pose=pose,
            via=via,
            feed_mm_s=feed_mm_s,
            zone_mm=zone,
            turntable=self.turntable,
            configuration=configuration,
        )

    def position(self, number: str) -> tuple[Configuration, Float]:
        """Configuration and pose (4, 4) of C<number>, where the robot then is."""
        if int(number) >= len(self.positions):
            self.lines.refuse(f"a position of //POS, C00000 to C{max(len(self.positions) - 1, 0):05d}", f"C{number}")
        self.at = int(number)
        return self.positions[self.at]
