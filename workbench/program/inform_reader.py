"""A strict reader for the part of Yaskawa's INFORM (`.JBI`) that milling jobs need.

    job     = /JOB //NAME //POS ///NPOS [///USER n] ///TOOL n ///POSTYPE ROBOT | USER ///RECTAN {///RCONF | C} //INST
              ///ATTR ///FRAME ///GROUP1 RB1 NOP {event} [MSG PAUSE] MOVJ {move | event} END
    move    = MOVJ C | P, VJ=, PL=0 | MOVL C, V=, PL=0 | CR= | arc
    arc     = [MOVC start, V=, PL=0] MOVC middle, V= MOVC end, V=, PL=0 | CR=, FPT
    event   = DOUT OT#(n) ON | OFF, WAIT IN#(n)=ON, TIMER T=, PAUSE, a label, CALL JOB:

An arc that follows another one begins where that ended; any other one says its start again. MOVJ goes to a pose by the
branch that RCONF names, of which the robot must have exactly one within its limits, or to the controller's home.
Everything else is refused with its line: counts and numbers of positions that are wrong, one that is not there, signals
and jobs that the cell file's process does not name, an event after a corner that is rounded.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from workbench.artefacts import ProgramMove, ProgramMoves, ProgramTool
from workbench.geometry.poses import inverse
from workbench.program.reading import NAME, NUMBER, Events, Lines, euler_pose, numbers, one_file
from workbench.robot.cell_file import ProcessPart
from workbench.robot.inverse import inverse_kinematics
from workbench.robot.kinematics import Chain
from workbench.robot.wrist import arm_sides
from workbench.units import DEG, Float, Shaped

Configuration = tuple[int, ...]  # no flip, lower arm, rear; R, T, S beyond +-180 deg
FLIP_DEG = 90.0  # to both sides of R's home, and of whole turns of it
WHOLE = 2 * np.pi
TURNED = [3, 5, 0]  # joints R, T, S
SAME_POSTURE = 1e-3 * DEG  # branches that coincide
UNUSED = ",0" * 18  # of RCONF
POSITION = rf"C(\d{{5}})={','.join([NUMBER] * 6)}"
SPEED = rf"V={NUMBER}"
NEAR = rf"(?:PL=0|CR={NUMBER})"
EVENT = rf"DOUT OT#\((\d+)\) (ON|OFF)|WAIT IN#\((\d+)\)=ON|TIMER T=(\d+\.\d\d)|(PAUSE)|\*([A-Z0-9]+)|CALL JOB:{NAME}"


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


def read_inform(files: Mapping[str, str], arm: Arm, process: ProcessPart | None = None) -> ProgramMoves:
    """Read a job from its file, name -> text.

    Args:
        files: one that ends in `.JBI`.
        arm: the robot, its tool and the frame of the positions, for MOVJ to a pose.
        process: whose signals switch what; None: a job that switches any is refused.

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
    job = _Job(lines, arm, positions, (tool, frame), process)
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
    process: ProcessPart | None
    moves: list[ProgramMove] = field(default_factory=list)
    turntable: float | None = None  # rad: where a message asks for it
    at: int | None = None  # the position that the last move went to, where it was not by the controller's home
    in_arc: bool = False  # an arc has just ended: the next one begins there

    def __post_init__(self) -> None:
        self.events = Events(self.lines, self.moves, self.process)

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
        found = self.lines.take(EVENT, "a move, an event or END (see workbench.program.inform_reader)")
        self.in_arc = False
        self.events.tell(found)

    def by_joints(self) -> ProgramMove:
        """MOVJ to a posture."""
        lines, text = self.lines, self.lines.peek()
        found = lines.take(rf"MOVJ (?:C(\d{{5}})|(P\d+)) VJ={NUMBER} PL=0", "MOVJ to a position, VJ= and PL=0")
        if self.moves and self.moves[-1].zone_mm > 0:
            lines.refuse("a move that reaches its target before MOVJ", text)
        share = float(found[3]) / 100
        home = self.process.home.controller_name if self.process else None
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
        found = self.lines.take(rf"MOVL C(\d{{5}}) {SPEED} {NEAR}", "MOVL to a position, V= and PL=0 or CR=")
        self.in_arc = False
        return self.move(found[1], float(found[2]), found[3], None)

    def circular(self) -> ProgramMove:
        """MOVC over a middle to an end; before the first of several their start."""
        lines = self.lines
        if not self.in_arc:
            start = lines.take(rf"MOVC C(\d{{5}}) {SPEED} PL=0", "MOVC to the arc's start, V= and PL=0")
            if self.at is None or int(start[1]) != self.at or self.moves[-1].zone_mm > 0:
                lines.refuse("an arc that starts where the move before ended, with PL=0", start[0])
        middle = lines.take(rf"MOVC C(\d{{5}}) {SPEED}", "MOVC to the arc's middle and V=")
        via = self.position(middle[1])[1]
        end = lines.take(rf"MOVC C(\d{{5}}) {SPEED} {NEAR} FPT", "MOVC to the arc's end, V=, PL=0 or CR=, FPT")
        if float(end[2]) != float(middle[2]):
            lines.refuse(f"the same speed all along the arc, V={middle[2]}", end[0])
        self.in_arc = True
        return self.move(end[1], float(end[2]), end[3], via)

    def move(self, number: str, feed_mm_s: float, corner: str | None, via: Float | None) -> ProgramMove:
        """To a pose."""
        configuration, pose = self.position(number)
        zone = float(corner or 0)
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
